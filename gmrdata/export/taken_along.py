"""Files of a solved video to take along: of the people who were accepted, or of cameras alone."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.export.export import Exported, export
from gmrdata.export.formats import FormatName, seen_points, write_background
from gmrdata.export.sources import list_clips, world_people_dir
from gmrdata.read.video import video_record
from gmrdata.solve.solve import SFM
from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict
from gmrdata.solve.videos import FILES
from gmrdata.values.errors import GmrdataError
from gmrdata.values.people import PSEUDO_GT
from gmrdata.world.background import load_background
from gmrdata.world.quality import load_record
from gmrdata.write.trajectories import write_tum

TAKEN_ALONG: tuple[FormatName, ...] = ("colmap", "tum", "bvh", "glb", "amass")
"""Formats that are written of people; of cameras alone the first two."""


def write_files(
    out_dir: Path, *, images: Path | None = None, body: str | None = None
) -> Sequence[tuple[str, str]]:
    """Files for other programs of the people who were accepted, by `fused/` where it is there, or
    of cameras alone; gives what could not be written, and why.

    What lies there of another verdict or body is taken away.
    """
    path, pseudo_gt_dir = out_dir / VERDICT_FILE, out_dir / PSEUDO_GT
    verdict = VideoVerdict.read(path) if path.is_file() else None
    try:
        people = load_record(pseudo_gt_dir).people if pseudo_gt_dir.is_dir() else ()
        clips = list_clips(people_dir := world_people_dir(out_dir)) if people else []
        ids = [files.id for files, one in zip(clips, people, strict=True) if one.accepted]
        for name in TAKEN_ALONG:
            shutil.rmtree(out_dir / FILES / name, ignore_errors=True)
        results: list[Exported] = []
        if ids:
            into = TAKEN_ALONG, out_dir / FILES
            results = export(people_dir, *into, clips=ids, body=body, images=images, redo=True)
    except (GmrdataError, ValueError) as error:
        return [("all formats", str(error))]
    if not ids and verdict is not None and verdict.accepted:
        _write_cameras(out_dir, images or out_dir / verdict.images_dir, verdict.fps_hz)
    return [
        (f"{one.unit.format} of {one.unit.name}", one.left_out) for one in results if one.left_out
    ]


def _write_cameras(out_dir: Path, images: Path, fps_hz: float) -> None:
    """Cameras alone as a COLMAP model and as TUM's trajectory, in their own unit and world."""
    sfm_dir, colmap = out_dir / SFM, out_dir / FILES / "colmap"
    found = load_background(sfm_dir, None)
    names, points = seen_points(found, sfm_dir, "keyframes")
    known = found.camera.has_camera
    colmap.mkdir(parents=True)
    write_background(colmap, found, names, points, images)
    video = video_record(images)
    times_s = np.arange(len(known)) / fps_hz
    if video is not None:
        times_s = video.times_of(found.image_numbers)
    write_tum(
        out_dir / FILES / "tum" / "camera.txt", found.camera.world_from_cam[known], times_s[known]
    )
