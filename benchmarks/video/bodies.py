"""People of five estimators before the camera and in the world, of files made of rendered truth.

Each file is what the system would have written at its best: true poses, its own crop and focal
length, and the place whose picture is nearest to the true one (tests/read/system_files.py).
So what is measured is what becomes of a file here, and not the estimators.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, MASKS_FOLDER, VideoFacts

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics, IntrinsicsConfig
from gmrdata.people.sources import FolderSource, MasksConfig
from gmrdata.read.bodies import load_body
from gmrdata.read.body_file import save_body
from gmrdata.read.systems.result import read_system
from gmrdata.solve.request import SolveConfig
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.solve.videos import solve_video
from gmrdata.stage.run import Run
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values.body import SMPL_REST_PELVIS_M, BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.world.placement import assumed_place, place_body
from tests.read import system_files
from tests.read.system_files import Seen

SYSTEMS = ("vibe", "wham", "gvhmr", "tram", "phalp")
MOST_PLACEMENT_PERCENT, MOST_OME_DEG, MOST_TME_MM = 2.0, 0.3, 15.0


@dataclass(frozen=True)
class BodiesRow:
    """One system on one clip."""

    clip: str
    system: str
    placement_error_percent: float
    """Mean distance of the placed pelvis from the true one, over its distance from the camera."""
    largest_error_percent: float
    untouched_error_percent: float
    """Mean error of the places as the file has them."""
    unturned_error_deg: float
    """Mean error of the file's own orientations; of placed ones it is `turned_error_deg`."""
    turned_error_deg: float
    accepted: bool | None
    """Verdict on the world motion; None where it was not made."""
    ome_deg: float | None
    tme_mm: float | None


def bodies_rows(clip_dirs: Sequence[Path], work_dir: Path) -> Iterator[BodiesRow]:
    """Every system on every clip, and WHAM on the default body as `wham on anny`."""
    for clip_dir in clip_dirs:
        facts, clip = VideoFacts.read(clip_dir / FACTS_FILE), load_clip(clip_dir / CLIP_FILE)
        body = own_body(load_body("anny"), clip)
        folder = work_dir / facts.name
        folder.mkdir(parents=True, exist_ok=True)
        save_body(folder / "body.npz", body)
        motion = replace(clip.motion, shape=np.zeros(body.n_shape), body=body.name)
        camera = camera_of(clip)
        seen = system_files.seen_person(motion, camera, body, radial_k1=facts.radial_k1)
        for system, path in estimator_files(seen, folder / "files").items():
            yield _row(system, path, seen, clip_dir, facts, clip, folder, str(folder / "body.npz"))
        wham = folder / "files" / "wham_output.pkl"
        yield _row("wham on anny", wham, seen, clip_dir, facts, clip, folder, "anny")


def own_body(body: BodyModel, clip: Clip) -> BodyModel:
    """The person's own size as the mean of a body in SMPL's name, whose rest pelvis is SMPL's."""
    shape = clip.motion.shape
    joints_m = body.rest_joints_m(shape)
    moved_m = np.array(SMPL_REST_PELVIS_M) - joints_m[0]
    return replace(
        body,
        name="smpl-neutral",
        template_m=body.rest_vertices_m(shape) + moved_m,
        joints_template_m=joints_m + moved_m,
        shape_dirs_m=0 * body.shape_dirs_m[..., :10],
        joint_shape_dirs_m=0 * body.joint_shape_dirs_m[..., :10],
        adult_shapes=None,
        adult_phenotypes=None,
    )


def estimator_files(seen: Seen, folder: Path) -> dict[str, Path]:
    """A file or folder of each system."""
    n, rng = len(seen.frames), np.random.default_rng(0)
    write = system_files.write_joblib
    return {
        "vibe": write(folder / "vibe_output.pkl", system_files.vibe_people([seen], rng)),
        "wham": write(folder / "wham_output.pkl", system_files.wham_people([seen])),
        "gvhmr": system_files.write_torch(folder / "a.pt", system_files.gvhmr_result(seen)),
        "tram": system_files.write_seen_tram(folder / "tram", [seen], n),
        "phalp": write(folder / "demo.pkl", system_files.phalp_frames([seen], n, rng)),
    }


def _row(
    system: str,
    path: Path,
    seen: Seen,
    clip_dir: Path,
    facts: VideoFacts,
    clip: Clip,
    folder: Path,
    body_path: str,
) -> BodiesRow:
    person = read_system(path, "camera").people[0]
    assert person.in_camera is not None
    as_it_is = assumed_place(person.in_camera, facts.size_px, path).transl_m + seen.rest_pelvis_m
    lens = replace(camera_of(clip).lens, radial=(facts.radial_k1, 0.0))
    placed = place_body(person, load_body(body_path), lens, facts.size_px, path)
    true = seen.motion
    errors = _percent(placed.pelvis_m, true.pelvis_m)
    accepted, ome_deg, tme_mm = _in_world(path, clip_dir, facts, clip, folder, body_path)
    return BodiesRow(
        clip=facts.name,
        system=system,
        placement_error_percent=float(errors.mean()),
        largest_error_percent=float(errors.max()),
        untouched_error_percent=float(_percent(as_it_is, true.pelvis_m).mean()),
        unturned_error_deg=_angle_deg(person.in_camera.root_rotmats, true.root_rotmats),
        turned_error_deg=_angle_deg(placed.root_rotmats, true.root_rotmats),
        accepted=accepted,
        ome_deg=ome_deg,
        tme_mm=tme_mm,
    )


def _percent(places_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    off_m = np.linalg.norm(places_m - true_m, axis=1)
    return np.asarray(100 * off_m / np.linalg.norm(true_m, axis=1))


def _angle_deg(found: np.ndarray, true: np.ndarray) -> float:
    cosines = (np.einsum("tij,tij->t", found, true) - 1) / 2
    return float(np.rad2deg(np.arccos(np.clip(cosines, -1, 1))).mean())


def _in_world(
    path: Path, clip_dir: Path, facts: VideoFacts, clip: Clip, folder: Path, body_path: str
) -> tuple[bool, float | None, float | None]:
    """Verdict, OME [degrees] and TME [mm] between frames; one reconstruction serves all systems."""
    masks = MasksConfig(sources=(FolderSource(path=clip_dir / MASKS_FOLDER),))
    verdict_path = solve_video(
        clip_dir / FRAMES_FOLDER,
        folder / "solved",
        poses=path,
        body=body_path,
        lens=GivenIntrinsics(focal_px=facts.focal_px),
        fps_hz=facts.fps_hz,
        config=SolveConfig(masks=masks, intrinsics=IntrinsicsConfig(look_in_frames=False)),
        run=Run(redo=True),
    )
    verdict = VideoVerdict.read(verdict_path)
    made = folder / "solved" / "pseudo_gt" / "person_0.npz"
    if not verdict.people or not made.is_file():
        return verdict.accepted, None, None
    error = compare_clips(load_clip(made), clip)
    return verdict.accepted, error.ome_deg, error.tme_mm


def bodies_figures(rows: Sequence[BodiesRow]) -> dict[str, Any]:
    """What stands in the record: the worst clip of each system, and of all of them."""
    own = [row for row in rows if row.system in SYSTEMS]
    standin = [row for row in rows if row.system not in SYSTEMS]

    def worst(of: Sequence[BodiesRow], name: str) -> float | None:
        values = [getattr(row, name) for row in of]
        known = [value for value in values if value is not None]
        return round(max(known), 4) if known else None

    names = ("placement_error_percent", "ome_deg", "tme_mm")
    return {
        "placement_error_percent": worst(own, "placement_error_percent"),
        "bodies_ome_deg": worst(own, "ome_deg"),
        "bodies_tme_mm": worst(own, "tme_mm"),
        "bodies_accepted_share": float(np.mean([bool(row.accepted) for row in own])),
        "bodies_by_system": {
            system: {name: worst([r for r in own if r.system == system], name) for name in names}
            for system in SYSTEMS
        },
        "stand_in_tme_mm": worst(standin, "tme_mm"),
        "bodies_untouched_error_percent": worst(own, "untouched_error_percent"),
        "bodies_unturned_error_deg": worst(own, "unturned_error_deg"),
    }
