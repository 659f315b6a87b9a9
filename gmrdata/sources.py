"""Where a clip's motion came from, and what that allows."""

import re
from pathlib import Path, PurePosixPath

from gmrdata.manifest.current import Source

OWN_LICENCE = "CC0-1.0"
"""Generated gait on a CC0 body: nobody's work but the program's."""
CMU_LICENCE = (
    "CMU Graphics Lab Motion Capture Database: free for all uses, may not be resold; credit "
    "mocap.cs.cmu.edu, created with funding from NSF EIA-0196217"
)
AMASS_LICENCE = "AMASS's licence (amass.is.tue.mpg.de): non-commercial; not to be passed on"
FILE_LICENCE = "as the motion file that it was made from"


def gait_source(name: str) -> Source:
    """A motion of the embedded generator."""
    return Source(dataset="gmrdata", sequence=name)


def file_source(stem: str) -> Source:
    """A motion file, known as CMU's by a name like 02_03."""
    is_cmu = re.fullmatch(r"\d{2,3}_\d{2}", stem) is not None
    return Source(dataset="CMU" if is_cmu else "file", sequence=stem)


def motion_source(path: Path, tail: PurePosixPath) -> Source:
    """A motion file, known as AMASS's by its layout: `KIT/3/kick_poses.npz`.

    Args:
        path: The file.
        tail: The last parts of its path.
    """
    in_amass = path.suffix.lower() == ".npz" and path.stem.endswith(("_poses", "_stageii"))
    if in_amass and len(tail.parts) == 3:
        return Source(dataset="AMASS", sequence=tail.with_suffix("").as_posix())
    return file_source(path.stem)


def licence_of(source: Source) -> str:
    """Terms under which a clip of this source may be passed on."""
    licences = {"gmrdata": OWN_LICENCE, "CMU": CMU_LICENCE, "AMASS": AMASS_LICENCE}
    return licences.get(source.dataset, FILE_LICENCE)
