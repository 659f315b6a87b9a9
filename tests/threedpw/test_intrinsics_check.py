"""The focal length that keypoints ask for, on twins whose K is right, too long and too short."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.film.programmes import Circular, Linear, Panning, Programme, Small, Static, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.read.threedpw import Sequence3DPW, SequenceImages
from gmrdata.read.threedpw_files import SequenceArrays, SequenceFiles, ThreedpwPerson
from gmrdata.threedpw.clips import sequence_arrays
from gmrdata.threedpw.intrinsics_check import (
    FocalEstimate,
    IntrinsicsCheckConfig,
    estimate_focal,
    intrinsics_reason,
)
from gmrdata.twins.faults import FaultConfig, dataset_side
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from tests.fixtures.filmed_sets import keypoints_px

WIDTH_PX, HEIGHT_PX, N_FRAMES = 540, 960, 150
CONFIG = IntrinsicsCheckConfig()
EXACT = FaultConfig(
    root_error_m=(0, 0), root_error_deg=(0, 0), joint_noise_deg=(0, 0), invalid_runs=(0, 0)
)
PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "panning": Panning(),
    "linear": Linear(),
    "small": Small(),
    "static": Static(),
}


def twin(
    body: BodyModel,
    programme: Programme,
    seed: int,
    *,
    people: int = 1,
    faults: FaultConfig | None = None,
    noise_px: float = 2.0,
) -> Sequence3DPW:
    """A faulty sequence of someone who walks, without images; a second one walks beside."""
    rng = np.random.default_rng(seed)
    frames = slice(N_FRAMES)
    motions = [
        make_gait("walk", N_FRAMES / 30, 30.0, body, rng).take(frames) for _ in range(people)
    ]
    if people == 2:
        aside_m = motions[0].pelvis_m[75] - motions[1].pelvis_m[75] + np.array([0.8, 0.3, 0.0])
        moved_m = motions[1].pelvis_m + aside_m * (1.0, 1.0, 0.0)
        motions[1] = replace(motions[1], pelvis_m=moved_m)
    camera = camera_path(programme, motions[0].pelvis_m, 30.0, WIDTH_PX, HEIGHT_PX, 50.0, rng)
    n = np.arange(N_FRAMES)
    clips = [Clip(f"w.p{number}", one, n >= 0, n, camera) for number, one in enumerate(motions)]
    points_px = [keypoints_px(body, clip, noise_px, rng) for clip in clips]
    faulty = dataset_side(clips, faults or FaultConfig(), rng)
    arrays = sequence_arrays(
        "walk_00", faulty, [body] * people, ["female", "male"][:people], points_px
    )
    images = SequenceImages((), WIDTH_PX, HEIGHT_PX, ("",) * N_FRAMES, 0)
    return Sequence3DPW(SequenceFiles(Path("3DPW"), "walk_00", "train"), arrays, images, ())


def with_k(sequence: Sequence3DPW, factor: float, shift_px: tuple[float, float] = (0, 0)) -> Any:
    """The sequence with a K that is wrong: focal length times a factor, centre moved."""
    intrinsics_px = sequence.arrays.intrinsics_px.copy()
    intrinsics_px[[0, 1], [0, 1]] *= factor
    intrinsics_px[:2, 2] += shift_px
    return replace(sequence, arrays=replace(sequence.arrays, intrinsics_px=intrinsics_px))


def with_people(sequence: Sequence3DPW, *people: ThreedpwPerson) -> Sequence3DPW:
    arrays: SequenceArrays = replace(sequence.arrays, people=people)
    return replace(sequence, arrays=arrays)


def estimate_of(sequence: Sequence3DPW, body: BodyModel) -> FocalEstimate:
    estimate = estimate_focal(sequence, [body], CONFIG)
    assert estimate is not None
    return estimate


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("programme", ["circular", "static"])
def test_exact_input_gives_the_exact_focal_length(small_body, programme, factor):
    sequence = twin(small_body, PROGRAMMES[programme], 0, faults=EXACT, noise_px=0.0)
    estimate = estimate_of(with_k(sequence, factor), small_body)
    assert estimate.factor == pytest.approx(1 / factor, abs=2e-4)
    assert np.abs(estimate.shift_px).max() < 0.1
    assert estimate.residual_px < 0.25


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("programme", list(PROGRAMMES))
def test_right_intrinsics_pass_and_wrong_ones_are_named_with_the_true_factor(
    small_body, programme, seed
):
    sequence = twin(small_body, PROGRAMMES[programme], seed, people=1 + seed % 2)
    right = estimate_of(sequence, small_body)
    assert abs(right.factor - 1) < 3 * right.sigma
    assert right.sigma < 0.04
    assert intrinsics_reason(right, CONFIG) is None
    for factor in (1.3, 1 / 1.3):
        wrong = estimate_of(with_k(sequence, factor), small_body)
        assert abs(wrong.factor - 1 / factor) < 3 * wrong.sigma
        said = intrinsics_reason(wrong, CONFIG)
        assert said is not None
        assert f"ask for a focal length {wrong.factor:.2f} times that of cam_intrinsics" in said


def test_joints_that_a_detector_sees_elsewhere_are_no_wrong_focal_length(small_body):
    """OpenPose's hips are higher and its shoulders lower and further in: a body 15 % smaller."""
    for seed, name in enumerate(PROGRAMMES):
        sequence = twin(small_body, PROGRAMMES[name], seed)
        points_px = sequence.arrays.people[0].poses2d_px.copy()
        seen = points_px[:, 8, 2] * points_px[:, 11, 2] * points_px[:, 2, 2] > 0
        torso_px = points_px[:, [1, 2, 5], :2].mean(axis=1) - points_px[:, [8, 11], :2].mean(axis=1)
        points_px[seen, 8:14:3, :2] += 0.08 * torso_px[seen, None]
        points_px[np.ix_(seen, [1, 2, 5], [0, 1])] -= 0.08 * torso_px[seen, None]
        person = replace(sequence.arrays.people[0], poses2d_px=points_px)
        moved = with_people(sequence, person)
        assert intrinsics_reason(estimate_of(moved, small_body), CONFIG) is None
        said = intrinsics_reason(estimate_of(with_k(moved, 1.3), small_body), CONFIG)
        assert said is not None


def test_keypoints_of_somebody_else_are_outvoted(small_body):
    sequence = twin(small_body, Circular(), 4)
    points_px = sequence.arrays.people[0].poses2d_px.copy()
    points_px[30:60, :, 0] += 180.0  # a passer-by was taken for the person
    points_px[80:100] = points_px[20:40]
    person = replace(sequence.arrays.people[0], poses2d_px=points_px)
    estimate = estimate_of(with_k(with_people(sequence, person), 1 / 1.3), small_body)
    assert abs(estimate.factor - 1.3) < 3 * estimate.sigma
    assert intrinsics_reason(estimate, CONFIG) is not None


def test_a_shifted_principal_point_is_no_wrong_focal_length(small_body):
    sequence = twin(small_body, Static(), 5)
    estimate = estimate_of(with_k(sequence, 1.0, (-15.0, 10.0)), small_body)
    assert intrinsics_reason(estimate, CONFIG) is None
    assert estimate.shift_px == pytest.approx((15.0, -10.0), abs=12.0)


def test_frames_that_are_not_valid_and_keypoints_without_confidence_do_not_count(small_body):
    sequence = twin(small_body, Panning(), 6)
    person = sequence.arrays.people[0]
    spoilt_px, trans_m = person.poses2d_px.copy(), person.trans_m.copy()
    spoilt_px[~person.campose_valid] = 77.0
    unsure = np.random.default_rng(0).random(spoilt_px.shape[:2]) < 0.2
    less_px = person.poses2d_px.copy()
    less_px[unsure, 2] = 0.0
    spoilt_px[unsure] = (5.0, 5.0, 0.3)
    for row, x_px in enumerate((np.nan, np.inf, 1e300, -1.0, WIDTH_PX + 1.0)):
        spoilt_px[row, 4], less_px[row, 4] = (x_px, 5.0, 0.9), 0.0
    trans_m[~person.campose_valid] = np.nan
    spoilt = replace(person, poses2d_px=spoilt_px, trans_m=trans_m)
    less = replace(person, poses2d_px=less_px)
    assert estimate_of(with_people(sequence, spoilt), small_body) == estimate_of(
        with_people(sequence, less), small_body
    )


def test_a_body_that_is_lost_far_outside_the_image_does_not_count(small_body):
    """Leverage is what makes few frames count much: a wrong pose close to the camera has it."""
    sequence = twin(small_body, Circular(), 8)
    person = sequence.arrays.people[0]
    cam_from_world = sequence.arrays.cam_from_world.copy()
    cam_from_world[10:20, :3, 3] += (4.0, 0.0, -2.5)
    arrays = replace(sequence.arrays, cam_from_world=cam_from_world)
    lost = estimate_of(replace(sequence, arrays=arrays), small_body)
    valid = person.campose_valid & ~np.isin(np.arange(N_FRAMES), np.arange(10, 20))
    without = with_people(sequence, replace(person, campose_valid=valid))
    assert lost == estimate_of(without, small_body)


def test_too_few_keypoints_say_nothing(small_body):
    sequence = twin(small_body, Circular(), 7)
    person = sequence.arrays.people[0]
    few_px = np.where(np.arange(N_FRAMES)[:, None, None] < 20, person.poses2d_px, 0.0)
    few = with_people(sequence, replace(person, poses2d_px=few_px))
    assert estimate_focal(few, [small_body], CONFIG) is None
    assert intrinsics_reason(None, CONFIG) is None
    none = with_people(sequence, replace(person, campose_valid=np.zeros(N_FRAMES, bool)))
    assert estimate_focal(none, [small_body], CONFIG) is None


@pytest.mark.parametrize(
    ("factor", "sigma", "speaks"),
    [(0.77, 0.02, True), (0.77, 0.05, False), (1.3, 0.06, True), (0.89, 0.003, True),
     (0.91, 0.001, False), (1.099, 0.0, False)],
)  # fmt: skip
def test_the_deviation_must_pass_its_limit_by_three_sigma(factor, sigma, speaks):
    estimate = FocalEstimate(factor, sigma, (0.0, 0.0), 2.0, 1000)
    said = intrinsics_reason(estimate, CONFIG)
    assert (said is not None) == speaks
    if said is not None:
        assert said.startswith(f"the 2D keypoints ask for a focal length {factor:.2f} times that")
