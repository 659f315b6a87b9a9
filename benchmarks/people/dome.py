"""People under the high cameras of CMU Panoptic's dome: five pictures, each by five cameras.

They lie in `tests/data/panoptic_body3d/demo` of open-mmlab/mmpose at its commit bb2b14d of 2022,
with calibrations but without joints.  Joints are where the rays of what the landmark network sees
in several cameras meet, so they know distances and up, and share what the network errs by in the
picture.  Each picture is shown as a video of itself.
"""

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from networks import networks_in, own_people
from people.real import TWELVE, write_lens
from poses.score import aligned_mm

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
from gmrdata.people.following import load_tracks
from gmrdata.people.landmark_body import VISIBLE
from gmrdata.solve.request import FOLLOWED
from gmrdata.solve.videos import solve_video
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.people import BODIES, PSEUDO_GT, person_file
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_deg
from gmrdata.world.judge import load_record

VIEWS = ("00_03", "00_06", "00_12", "00_13", "00_23")
COPIES, FPS_HZ = 12, 30.0
LIMBS = (11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28)  # landmarks of `TWELVE`
MET_M, ALL_MET_M = 0.08, 0.15  # between rays of one person: of the nearest views, and of any two
WITHIN_PX = 25.0  # of a landmark that others agree with
CM_PER_M = 100.0


@dataclass(frozen=True, eq=False)
class DomeView:
    """One camera of the dome."""

    matrix_px: np.ndarray  # (3, 3)
    bends: np.ndarray  # (5,) as OpenCV has them
    cam_from_dome: np.ndarray  # (3, 4); the dome's y axis points down [m]

    @property
    def up(self) -> np.ndarray:
        """(3,) in the camera's axes."""
        return -self.cam_from_dome[:, 1]

    @property
    def centre_m(self) -> np.ndarray:
        return np.asarray(-self.cam_from_dome[:, :3].T @ self.cam_from_dome[:, 3])

    def rays(self, at_px: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of places (N, 2), in the dome's axes."""
        ends = np.c_[at_px, np.ones(len(at_px))] @ np.linalg.inv(self.matrix_px).T
        ends = ends @ self.cam_from_dome[:, :3]
        return np.asarray(ends / np.linalg.norm(ends, axis=1, keepdims=True))


class Sighting(NamedTuple):
    """Somebody in one picture."""

    view: str
    number: int
    limbs_px: np.ndarray  # (12, 2)
    seen: np.ndarray  # (12,) bool


@dataclass(frozen=True)
class DomeRow:
    """Somebody in one picture, beside what all cameras tell."""

    picture: str
    person: int
    accepted: bool
    looks_down_deg: float
    """How far the camera does."""
    pa_mm: float | None
    """Null where fewer than six joints meet."""
    distance_ratio: float | None
    """Null where the hips don't."""
    said_share: float
    level_deg: float
    said_deg: float


def dome_views(folder: Path) -> dict[str, DomeView]:
    said = json.loads((folder / "camera_parameters.json").read_text(encoding="utf-8"))
    return {
        one["name"]: DomeView(
            np.array(one["K"]),
            np.array(one["distCoef"]),
            np.c_[np.array(one["R"]), np.array(one["t"]) / CM_PER_M],
        )
        for one in said["cameras"]
        if one["name"] in VIEWS
    }


def dome_rows(
    folder: Path, out_dir: Path, models_dir: Path, body: BodyModel, *, small: bool
) -> Iterator[DomeRow]:
    """Everybody whom three cameras see; pictures that are solved stay so."""
    views = dome_views(folder)
    moments = sorted(path.stem.removeprefix("00_03_") for path in (folder / "00_03").iterdir())
    for moment in moments[:1] if small else moments:
        solved = {}
        for name, view in views.items():
            image = folder / name / f"{name}_{moment}.jpg"
            solved[name] = _solved(image, view, out_dir / image.stem, models_dir)
        for sightings in _people(_sightings(solved), views):
            true_m = _joints_m(sightings, views)
            for one in sightings:
                row = _row(one, solved[one.view], views[one.view], true_m, body)
                if row is not None:
                    yield replace(row, picture=f"{one.view}_{moment}")


def _solved(image: Path, view: DomeView, out_dir: Path, models_dir: Path) -> Path:
    """A picture's video, without the distortion of its lens."""
    frames, matrix_px = out_dir / "frames", view.matrix_px
    seen = cv2.imread(str(image))
    assert seen is not None
    picture = cv2.undistort(seen, matrix_px, view.bends)
    if not frames.is_dir():
        frames.mkdir(parents=True)
        for number in range(COPIES):
            cv2.imwrite(str(frames / f"{number:05d}.png"), picture)
    numbers = [matrix_px[0, 0], matrix_px[1, 1], *matrix_px[:2, 2], 0.0, 0.0, 0.0, 0.0]
    lens = write_lens(out_dir / "cameras.txt", picture.shape[1::-1], numbers)
    solve_video(
        frames,
        out_dir / "solved",
        poses="own",
        lens=GivenIntrinsics(file=lens),
        fps_hz=FPS_HZ,
        config=own_people(networks_in(models_dir)),
    )
    return out_dir / "solved"


def _sightings(solved: dict[str, Path]) -> list[Sighting]:
    middle = COPIES // 2
    return [
        Sighting(
            name,
            number,
            track.image_px[middle][list(LIMBS)],
            track.visibility[middle][list(LIMBS)] > VISIBLE,
        )
        for name, folder in solved.items()
        for number, track in enumerate(load_tracks(folder / FOLLOWED))
    ]


def _people(sightings: list[Sighting], views: dict[str, DomeView]) -> list[list[Sighting]]:
    """Who is the same person: sightings by at least three cameras whose rays meet."""
    groups = [[one] for one in sightings]
    pairs = [
        (_apart_m(a, b, views), a, b)
        for a, b in itertools.combinations(sightings, 2)
        if a.view != b.view
    ]
    for apart_m, a, b in sorted(pairs, key=lambda pair: pair[0]):
        one, other = (next(g for g in groups if any(s is x for s in g)) for x in (a, b))
        shared = {s.view for s in one} & {s.view for s in other}
        if one is other or apart_m > MET_M or shared:
            continue
        if max(_apart_m(x, y, views) for x in one for y in other) <= ALL_MET_M:
            groups = [g for g in groups if g is not other]
            one += other
    return [group for group in groups if len(group) >= 3]


def _apart_m(a: Sighting, b: Sighting, views: dict[str, DomeView]) -> float:
    """Between the rays of two sightings' limbs, in the median."""
    one, other = views[a.view], views[b.view]
    across = np.cross(one.rays(a.limbs_px), other.rays(b.limbs_px))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return float(np.median(np.abs(across @ (other.centre_m - one.centre_m))))


def _joints_m(sightings: list[Sighting], views: dict[str, DomeView]) -> np.ndarray:
    """(12, 3) in the dome's axes; NaN where fewer than three cameras agree."""
    return np.array([_joint_m(sightings, views, limb) for limb in range(len(LIMBS))])


def _joint_m(sightings: list[Sighting], views: dict[str, DomeView], limb: int) -> np.ndarray:
    seen = [(views[s.view], s.limbs_px[limb]) for s in sightings if s.seen[limb]]
    best: list[tuple[DomeView, np.ndarray]] = []
    for pair in itertools.combinations(seen, 2):
        place_m = _met_m(list(pair))
        agree = [one for one in seen if _off_px(*one, place_m) < WITHIN_PX]
        best = max(best, agree, key=len)
    return _met_m(best) if len(best) >= 3 else np.full(3, np.nan)


def _met_m(seen: list[tuple[DomeView, np.ndarray]]) -> np.ndarray:
    """Where rays meet (direct linear transformation)."""
    rows = []
    for view, at_px in seen:
        projection = view.matrix_px @ view.cam_from_dome
        rows += [at_px[axis] * projection[2] - projection[axis] for axis in (0, 1)]
    equations = np.array(rows) / np.linalg.norm(rows, axis=1, keepdims=True)
    place = np.linalg.svd(equations)[2][-1]
    return np.asarray(place[:3] / place[3])


def _off_px(view: DomeView, at_px: np.ndarray, place_m: np.ndarray) -> float:
    seen = view.matrix_px @ view.cam_from_dome @ np.r_[place_m, 1.0]
    return float(np.linalg.norm(seen[:2] / seen[2] - at_px))


def _row(
    one: Sighting, solved: Path, view: DomeView, true_dome_m: np.ndarray, body: BodyModel
) -> DomeRow | None:
    """None of somebody who got no pose."""
    if not (solved / PSEUDO_GT / person_file(one.number)).is_file():
        return None
    quality, middle = load_record(solved / PSEUDO_GT), COPIES // 2
    clip = load_clip(solved / BODIES / person_file(one.number))
    found_m = motion_joints_m(body, clip.motion)[middle, TWELVE]
    true_m = true_dome_m @ view.cam_from_dome[:, :3].T + view.cam_from_dome[:, 3]
    known = np.isfinite(true_m[:, 0])
    hips = known[6:8].all()
    camera = camera_of(load_clip(solved / PSEUDO_GT / person_file(one.number)))
    up = camera.world_from_cam[middle, :3, :3] @ view.up
    assert quality.level is not None
    return DomeRow(
        picture="",
        person=one.number,
        accepted=quality.people[one.number].accepted,
        looks_down_deg=float(np.rad2deg(np.arcsin(-view.up[2]))),
        pa_mm=float(aligned_mm(found_m[None, known], true_m[None, known])[0])
        if known.sum() >= 6
        else None,
        distance_ratio=float(found_m[6:8, 2].mean() / true_m[6:8, 2].mean()) if hips else None,
        said_share=quality.distance_sigmas[one.number],
        level_deg=float(angles_deg(up, np.eye(3)[2])),
        said_deg=quality.level.sigma_deg,
    )
