"""A solved video: painted frames, exact cameras in a reconstruction's form, and a person, whose
motion a network may fill in."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.cameras.files import POINTS_FILE, load_cameras, save_points
from gmrdata.cameras.match.tracks import TRACKS_FILE, Tracks, save_tracks
from gmrdata.film.programmes import Circular, Panning
from gmrdata.fusion.fuse import fuse
from gmrdata.read.body_file import save_body
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.values import camera, transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, save_clip
from gmrdata.values.people import DOUBTS_FILE, PersonFiles
from gmrdata.world.pseudo_gt import WorldEvidence, make_pseudo_gt
from gmrdata.world.recipe import Doubts, PseudoGtConfig, verdict_of
from tests.fusion.test_network_evidence import record
from tests.pages.conftest import paint_clip
from tests.world.test_compose import as_input, reconstruction, true_clip

OFF_PX = 0.25
"""How far each background point is seen from its place."""
N_ROWS = 24


def solved_video(
    folder: Path,
    body: BodyModel,
    geometry: str = "full",
    lost: Sequence[int] = (),
    *,
    config: PseudoGtConfig | None = None,
    person: bool = True,
    doubts: Doubts | None = None,
) -> Clip:
    """Make `frames`, `masks`, `sfm`, `body` and, of a person, `pseudo_gt`; gives the true clip.
    `doubts` are what the video says against frames."""
    true = true_clip(body, Circular() if geometry == "full" else Panning()).take(slice(N_ROWS))
    folder.mkdir(parents=True)
    paint_clip(folder, true, body)
    save_body(folder / "body" / "body.npz", body)
    save_clip(folder / "in.npz", as_input(true), body.rest_pelvis_m(true.motion.shape))
    reconstruction(folder / "sfm", true, geometry, list(lost))
    if geometry == "full":
        _add_tracks(folder / "sfm", true)
    people = (PersonFiles(folder / "in.npz", folder / "body" / "body.npz"),)
    if person:
        config = config or PseudoGtConfig()
        doubts_path = None if doubts is None else folder / DOUBTS_FILE
        if doubts is not None and doubts_path is not None:
            doubts.write(doubts_path)
        evidence = WorldEvidence(folder / "sfm", people, doubts_path=doubts_path)
        make_pseudo_gt(evidence, folder / "pseudo_gt", config)
    (folder / "in.npz").unlink()
    return true


def camera_verdict(*reasons: str, images_dir: str = "frames") -> VideoVerdict:
    """On cameras alone, accepted, by images at 10 Hz; `reasons` are why the first frames are
    dropped."""
    camera = verdict_of("camera", True, (), [*reasons, *(N_ROWS - len(reasons)) * [""]])
    return VideoVerdict(
        images_dir=images_dir, fps_hz=10.0, accepted=True, reasons=(), camera=camera,
        people=(), notes=(),
    )  # fmt: skip


def fuse_video(folder: Path, run_dir: Path) -> Path:
    """Make `fused` of a solved video, with the network of a run."""
    errors_path = run_dir.with_name("delta_errors.json")
    record().write(errors_path)
    body_path = folder / "body" / "body.npz"
    given = {"network": run_dir, "body_path": body_path, "errors_path": errors_path}
    return fuse(folder, folder / "fused", **given)


def _add_tracks(sfm_dir: Path, true: Clip) -> None:
    """Points of the floor and the frames that see them, `OFF_PX` beside their places."""
    x, y = np.meshgrid(np.arange(-4.0, 5.0), np.arange(-4.0, 5.0))
    floor_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    view = camera_of(true)
    found = load_cameras(sfm_dir)
    known = np.flatnonzero(found.path.has_camera)
    # From the true world to that of the reconstruction, by its cameras.
    here, there = view.world_from_cam[known], found.path.world_from_cam[known]
    fit = transforms.fit_similarity(there[:, :3, 3], here[:, :3, 3], scale=True)
    seen_px = camera.project(view.world_from_cam, floor_m, view.intrinsics_px)
    inside = ((seen_px > 0) & (seen_px < [view.width_px, view.height_px])).all(axis=-1)
    inside[~found.path.has_camera] = False
    rows, points = np.nonzero(inside)
    image_px = seen_px[rows, points] + [OFF_PX, 0.0]
    names = tuple(f"{number:05d}.jpg" for number in true.image_numbers)
    save_points(sfm_dir / POINTS_FILE, fit.apply(floor_m), inside.sum(axis=0))
    tracks = Tracks(rows, points, image_px, np.ones(len(names), dtype=bool), names)
    save_tracks(sfm_dir / TRACKS_FILE, tracks)
