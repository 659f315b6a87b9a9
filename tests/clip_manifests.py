"""Clips written to files, with a manifest of them."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.manifest.current import CameraMotion, ClipEntry, Manifest, Quality, Source
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ClipAbout, ClipFiles, ManifestHead, clip_entry, write_manifest
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip

Edit = Callable[[Callable[[dict], object]], Path]
"""Changes what stands in a manifest; gives the manifest."""


def a_head(name: str, kind: str = "synthetic", **more: str) -> ManifestHead:
    said = {"version": "1.0.0", "description": "Clips of a test.", "licence": "CC0-1.0"}
    return ManifestHead(name=name, kind=kind, **said | more)


def a_walk(camera_motion: CameraMotion = "circular", **more: Any) -> ClipAbout:
    """What is said of a clip of this package's own walk."""
    source = Source(dataset="gmrdata", sequence="walk")
    return ClipAbout(camera_motion=camera_motion, licence="CC0-1.0", source=source, **more)


def clips_of(path: Path) -> list[ClipEntry]:
    """What a manifest of clips lists."""
    manifest = read_manifest(path)
    assert isinstance(manifest, Manifest)
    return list(manifest.clips)


def write_clips(
    folder: Path,
    body: BodyModel,
    clips: Sequence[Clip],
    qualities: Mapping[str, Quality] | None = None,
    *,
    camera_motions: Sequence[CameraMotion] | None = None,
    kind: str = "motions",
    sources: str | Mapping[str, Source] = "gmrdata",
) -> Path:
    """Write `<clip id>.npz` and `manifest.yaml`; gives the manifest.

    Args:
        folder: Where to.
        body: The clips' body.
        clips: The clips.
        qualities: What is known of them, by id.
        camera_motions: Class of each one's camera motion; "none" for all when left out.
        kind: Kind of manifest.
        sources: Where each one is from, by id; or the data set of all, whose sequences are the ids.
    """
    if isinstance(sources, str):
        sources = {clip.id: Source(dataset=sources, sequence=clip.id) for clip in clips}
    entries = []
    for number, clip in enumerate(clips):
        path = folder / f"{clip.id}.npz"
        save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
        camera_motion: CameraMotion = "none" if camera_motions is None else camera_motions[number]
        entries.append(
            clip_entry(
                folder,
                ClipFiles(path),
                ClipAbout(
                    camera_motion=camera_motion,
                    licence="CC0-1.0",
                    source=sources[clip.id],
                    quality=(qualities or {}).get(clip.id),
                ),
            )
        )
    return write_manifest(folder / "manifest.yaml", a_head("clips", kind), entries)
