"""The newest manifest format; stages import it from here and never name a version."""

from gmrdata.manifest.v1 import *  # noqa: F403
from gmrdata.manifest.v1 import FORMAT

READS = (FORMAT,)  # formats that this gmrdata reads
