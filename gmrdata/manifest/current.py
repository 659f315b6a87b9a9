"""The newest manifest format; stages import it from here and never name a version."""

from gmrdata.manifest.v1 import (
    FORMAT,
    AnyManifest,
    CameraMotion,
    Clip,
    CreatedBy,
    DroppedRange,
    Extra,
    FileRecord,
    FolderRecord,
    FrameRange,
    ListedClip,
    ListManifest,
    Manifest,
    Quality,
    Recipe,
    Source,
)

__all__ = [
    "FORMAT", "READS", "AnyManifest", "CameraMotion", "Clip", "CreatedBy", "DroppedRange", "Extra",
    "FileRecord", "FolderRecord", "FrameRange", "ListedClip", "ListManifest", "Manifest", "Quality",
    "Recipe", "Source",
]  # fmt: skip

READS = (FORMAT,)
"""Formats that this gmrdata reads."""
