"""The newest manifest format; stages import it from here and never name a version."""

from gmrdata.manifest.v1 import (
    FORMAT as FORMAT,
)
from gmrdata.manifest.v1 import (
    AnyManifest as AnyManifest,
)
from gmrdata.manifest.v1 import (
    CameraMotion as CameraMotion,
)
from gmrdata.manifest.v1 import (
    Clip as Clip,
)
from gmrdata.manifest.v1 import (
    CreatedBy as CreatedBy,
)
from gmrdata.manifest.v1 import (
    DroppedRange as DroppedRange,
)
from gmrdata.manifest.v1 import (
    Extra as Extra,
)
from gmrdata.manifest.v1 import (
    FileRecord as FileRecord,
)
from gmrdata.manifest.v1 import (
    FolderRecord as FolderRecord,
)
from gmrdata.manifest.v1 import (
    FrameRange as FrameRange,
)
from gmrdata.manifest.v1 import (
    ListedClip as ListedClip,
)
from gmrdata.manifest.v1 import (
    ListManifest as ListManifest,
)
from gmrdata.manifest.v1 import (
    Manifest as Manifest,
)
from gmrdata.manifest.v1 import (
    Quality as Quality,
)
from gmrdata.manifest.v1 import (
    Recipe as Recipe,
)
from gmrdata.manifest.v1 import (
    Source as Source,
)

READS = (FORMAT,)
"""Formats that this gmrdata reads."""
