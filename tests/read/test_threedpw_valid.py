"""The named rules for valid frames, and the reasons of frames that can't be used."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from gmrdata.read.threedpw import ValidRule, frames_by_rule, read_sequence, unusable_reasons
from gmrdata.values.clip import dropped_ranges
from gmrdata.values.errors import BadRecipe
from gmrdata.write.threedpw import write_sequence

NAME = "courtyard_walk_00"

# Each row: campose_valid, keypoints by confidence, and the rules that keep the frame.
ALL = {"campose_valid", "3dpw_eval", "glamr", "vibe", "slahmr"}
CASES: list[tuple[int, list[float], set[str]]] = [
    (1, [0.9] * 18, ALL),
    (0, [0.9] * 18, {"vibe"}),
    (1, [0.9] * 7, ALL),
    (1, [0.9] * 6, ALL - {"vibe"}),
    (1, [0.9] * 5, ALL - {"vibe", "glamr"}),
    (1, [0.3] * 18, ALL - {"vibe", "glamr"}),
    (1, [0.1], ALL - {"vibe", "glamr"}),
    (1, [], {"campose_valid"}),
    (0, [], set()),
]


def test_each_rule_keeps_the_frames_that_it_says(walk_arrays):
    points_px = np.zeros((len(CASES), 18, 3))
    for row, (_, confidences, _) in enumerate(CASES):
        points_px[row, : len(confidences)] = 50.0
        points_px[row, : len(confidences), 2] = confidences
    person = replace(
        walk_arrays.people[0],
        campose_valid=np.array([valid == 1 for valid, _, _ in CASES]),
        poses2d_px=points_px,
    )
    for rule in get_args(ValidRule):
        kept = frames_by_rule(person, rule).tolist()
        assert kept == [rule in rules for _, _, rules in CASES], rule


def test_an_unknown_rule_is_refused(walk_arrays):
    with pytest.raises(BadRecipe, match="no rule 'mine' .*campose_valid, 3dpw_eval"):
        frames_by_rule(walk_arrays.people[0], "mine")  # type: ignore[arg-type]


def test_every_frame_that_can_not_be_used_says_why(make_dataset, walk_arrays):
    first = walk_arrays.people[0]
    cameras, poses, trans = (
        a.copy() for a in (walk_arrays.cam_from_world, first.poses_rad, first.trans_m)
    )
    cameras[0, 1, 1] = np.nan
    cameras[1, :3, :3] *= 2.0
    cameras[2, :3, :3] *= -1.0
    cameras[3] = np.diag([-1.0, 1.0, -1.0, 1.0]) @ cameras[3]  # looks the other way
    cameras[4, 3] = 1.0
    poses[5, 70] = np.nan
    poses[6, 0] = 1e300
    trans[7] = np.inf
    arrays = replace(
        walk_arrays,
        cam_from_world=cameras,
        people=(replace(first, poses_rad=poses, trans_m=trans), walk_arrays.people[1]),
    )
    root = make_dataset(arrays)
    (root / "imageFiles" / NAME / "image_00020.jpg").unlink()
    sequence = read_sequence(root, NAME)
    reasons = unusable_reasons(sequence, 0)
    not_rigid, not_finite = "cam_poses is no rigid transform", "poses or trans is not finite"
    assert dropped_ranges(reasons) == [
        (0, 1, "cam_poses is not finite"),
        (1, 3, not_rigid),
        (3, 4, "the body is behind the camera"),
        (4, 5, not_rigid),
        (5, 8, not_finite),
        (10, 13, "campose_valid is 0"),
        (20, 21, "image_00020.jpg is missing"),
    ]
    other = dropped_ranges(unusable_reasons(sequence, 1))
    assert [(start, stop) for start, stop, _ in other] == [(0, 1), (1, 3), (3, 4), (4, 5), (20, 21)]


def test_two_people_have_valid_frames_of_their_own(make_dataset, walk_arrays):
    second = replace(walk_arrays.people[1], campose_valid=np.arange(30) >= 20)
    root = make_dataset(replace(walk_arrays, people=(walk_arrays.people[0], second)))
    sequence = read_sequence(root, NAME)
    assert dropped_ranges(unusable_reasons(sequence, 0)) == [(10, 13, "campose_valid is 0")]
    assert dropped_ranges(unusable_reasons(sequence, 1)) == [(0, 20, "campose_valid is 0")]


def test_ranges_cover_what_is_dropped():
    assert dropped_ranges([]) == []
    assert dropped_ranges(["", ""]) == []
    assert dropped_ranges(["a", "a", "", "b", "a"]) == [(0, 2, "a"), (3, 4, "b"), (4, 5, "a")]


def test_rewriting_a_sequence_replaces_it(make_dataset, walk_arrays):
    root = make_dataset()
    one = replace(walk_arrays, people=walk_arrays.people[:1])
    write_sequence(root, "train", one)
    assert len(read_sequence(root, NAME).arrays.people) == 1
