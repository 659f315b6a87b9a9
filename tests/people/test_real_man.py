"""A real man before a camera: a second of landmarks and of his true joints, as numbers.

Camera 2 of perfanalytics/pose2sim's Demo_SinglePerson (BSD-3): frames 0 to 59 at 60 Hz, as
BlazePose GHUM heavy and lite see them, and shoulders, elbows, wrists, hips, knees and ankles
by four cameras, left first, before this one [m].  Lite takes his front for his back at times.
"""

from pathlib import Path

import numpy as np
import pytest

from gmrdata.people.facing import looks_reversed, mirrored, rate_remarks, unsure_frames
from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.landmark_body import SeenLandmarks
from gmrdata.people.local_poses import LocalPosesConfig, sure_frames
from gmrdata.score.metrics import aligned_errors_mm
from gmrdata.values.body import BodyModel
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import fit_similarities
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m
from gmrdata.world.size import of_height
from tests.motions import made_up

TWELVE = [16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8]


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    with np.load(Path(__file__).with_name("man_camera_2.npz")) as file:
        return {key: file[key].astype(np.float64) for key in file.files}


def seen_by(network: str, numbers: dict[str, np.ndarray], every: int = 1) -> SeenLandmarks:
    rays, world_m, visibility = (
        numbers[f"{network}_{key}"][::every] for key in ("rays", "world_m", "visibility")
    )
    return SeenLandmarks(np.arange(60)[::every] / 60, rays, world_m, visibility)


def mean_rest_m(body: BodyModel) -> np.ndarray:
    return body.rest_joints_m(np.zeros(body.n_shape))


@pytest.mark.parametrize("every", [1, 4])
def test_the_body_lies_on_the_man_at_any_frame_rate(every, numbers, anny):
    """A fit of 60 steps moved joints by 2 mm at 60 Hz and by 90 at 15."""
    found = fit(seen_by("heavy", numbers, every), mean_rest_m(anny), FitConfig())
    assert found.converged
    joints_m, _ = posed_joints_m(mean_rest_m(anny), found.rotmats, found.pelvis_m)
    joints_m, true_m = joints_m[:, TWELVE], numbers["true_m"][::every]
    aligned_mm = aligned_errors_mm(joints_m, true_m, fit_similarities(true_m, joints_m))
    assert aligned_mm.mean() < 62
    ratio = joints_m[:, 6:8, 2].mean(axis=1) / true_m[:, 6:8, 2].mean(axis=1)
    assert 0.94 < np.median(ratio) < 1.03


def test_a_view_that_was_seen_right_has_no_doubts(numbers, anny):
    seen = seen_by("heavy", numbers)
    sure, doubt = sure_frames(seen, anny, LocalPosesConfig())
    assert sure.all() and not doubt
    assert not looks_reversed(seen, mean_rest_m(anny), FitConfig())


def test_a_view_that_is_partly_reversed_is_doubted(numbers, anny):
    sure, doubt = sure_frames(seen_by("lite", numbers), anny, LocalPosesConfig())
    assert sure.all() and doubt == "front and back may be exchanged in 60 of 60 frames"


def spoiled(seen: SeenLandmarks, frames: slice) -> SeenLandmarks:
    """The same with some frames seen from the wrong side."""
    other = mirrored(seen)
    rays, world_m = seen.rays.copy(), seen.world_m.copy()
    rays[frames], world_m[frames] = other.rays[frames], other.world_m[frames]
    return SeenLandmarks(seen.times_s, rays, world_m, seen.visibility)


def test_a_few_reversed_frames_are_left_out(numbers, anny):
    seen = spoiled(seen_by("heavy", numbers), slice(34, 40))
    sure, doubt = sure_frames(seen, anny, LocalPosesConfig())
    assert np.flatnonzero(~sure).tolist() == [*range(34, 40)] and not doubt


@pytest.mark.parametrize("at", [slice(0, 36), slice(24, 60)])
def test_a_long_run_that_looks_the_other_way_is_told(at, numbers):
    """Six tenths of a second each way: the fewer frames are unsure, and too many to go on."""
    seen = seen_by("heavy", numbers)
    late = SeenLandmarks(seen.times_s * 2, seen.rays, seen.world_m, seen.visibility)
    unsure = unsure_frames(spoiled(late, at))
    assert unsure.sum() == 24 and len(set(unsure[at])) == 1


@pytest.mark.parametrize("reversed_at", [slice(30, 34), slice(26, 30), slice(30, 42)])
def test_of_two_stretches_each_is_told_by_itself(reversed_at, numbers):
    """Who was found again looked the other way for four frames: the rest of that stretch was
    unsure, and these were sure."""
    seen = seen_by("heavy", numbers)
    times_s = np.arange(60) / 30 + 1.0 * (np.arange(60) >= 30)
    late = SeenLandmarks(times_s, seen.rays, seen.world_m, seen.visibility)
    unsure = unsure_frames(spoiled(late, reversed_at))
    assert np.flatnonzero(unsure).tolist() == [*range(60)[reversed_at]]


def test_at_ten_frames_a_second_leaps_are_none_wherever_the_video_begins(numbers):
    """By rounding about half of the steps were shorter than 0.1 s, and right frames left out."""
    seen = spoiled(seen_by("heavy", numbers, 6), slice(5, 10))
    for first in range(30):
        times_s = (first + np.arange(10)) / 10.0
        late = SeenLandmarks(times_s, seen.rays, seen.world_m, seen.visibility)
        assert not unsure_frames(late).any()


def test_a_rate_at_which_leaps_are_none_is_said():
    few = "10 images per second are too few"
    said = f"{few} to tell where front and back were exchanged for a while"
    assert rate_remarks(10.2, 3) == ()
    assert rate_remarks(10.0, 3) == (f"{said}; take more of them, by a smaller --every",)
    assert rate_remarks(10.0) == (said,)  # all that there are


def test_a_view_that_is_reversed_throughout_is_doubted(numbers, anny):
    seen = mirrored(seen_by("heavy", numbers))
    assert sure_frames(seen, anny, LocalPosesConfig())[1].startswith("a body that looks the other")


def test_who_stands_with_bent_knees_stands_on_the_floor(anny):
    """Every 16th frame of a dancer of 1.64 m, seen twice by heavy, and up and the camera's height
    over the floor by a phone's LiDAR [m].  Legs that were drawn to their rest pose put the dancer
    8 cm below it."""
    with np.load(Path(__file__).with_name("dancer_bent.npz")) as file:
        dance = {key: file[key].astype(np.float64) for key in file.files}
    landmarks = (dance[key] for key in ("rays", "world_m", "visibility"))
    found = fit(SeenLandmarks(dance["rows"] / 30, *landmarks), mean_rest_m(anny), FitConfig())
    given = {"shape": np.zeros(anny.n_shape), "body": anny.name, "frame": "camera"}
    motion = made_up(found.rotmats[:, 1:], found.rotmats[:, 0], found.pelvis_m, **given)
    motion = of_height(motion, anny, 1.64)
    soles_m = foot_points_m(anny, motion)[:, :, SOLE_POINTS].mean(axis=2)
    over_m = dance["camera_height_m"] + np.einsum("tfk,tk->tf", soles_m, dance["up_cam"]).min(1)
    assert abs(np.median(over_m)) < 0.01
