"""2D joints: OpenPose's JSON, and the translation of one frame from them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.paper.placement import PlacementConfig, closed_form, place
from gmrdata.read.openpose import PAIRS, keypoint_files, read_people
from gmrdata.values.body import JOINT, JOINT_NAMES, MIRRORED, BodyModel
from gmrdata.values.camera import intrinsics_from_fov, project_cam
from gmrdata.values.errors import BadKeypoints, BadRecord, GmrdataError, MissingInput

INTRINSICS_PX = intrinsics_from_fov(60.0, 640, 480)
CONFIG = PlacementConfig()


def seen(
    body: BodyModel, seed: int, noise_px: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints from the pelvis [m], their points with confidences, and where the pelvis is [m]."""
    rng = np.random.default_rng(seed)
    joints_m = body.rest_joints_m(rng.normal(0, 1, body.n_shape))
    joints_m = (joints_m - joints_m[0]) @ Rotation.random(
        random_state=rng.integers(9999)
    ).as_matrix()
    pelvis_m = rng.uniform([-1.0, -0.7, 2.5], [1.0, 0.7, 8.0])
    points = np.zeros((24, 3))
    joints = list(PAIRS.values())
    points[joints, :2] = project_cam(joints_m[joints] + pelvis_m, INTRINSICS_PX)
    points[joints, :2] += rng.normal(0, noise_px, (len(joints), 2))
    points[joints, 2] = rng.uniform(0.4, 1.0, len(joints))
    return joints_m, points, pelvis_m


@given(st.integers(0, 10**6))
def test_exact_points_give_the_exact_place(small_body, seed):
    joints_m, points, pelvis_m = seen(small_body, seed)
    found_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    np.testing.assert_allclose(found_m, pelvis_m, atol=1e-6)


@given(st.integers(0, 10**6))
def test_the_closed_form_is_exact_for_exact_points(small_body, seed):
    joints_m, points, pelvis_m = seen(small_body, seed)
    joints = list(PAIRS.values())
    found_m = closed_form(joints_m[joints], points[joints, :2], points[joints, 2], INTRINSICS_PX)
    np.testing.assert_allclose(found_m, pelvis_m, atol=1e-6)


def by_differences(joints_m: np.ndarray, points: np.ndarray, start_m: np.ndarray) -> np.ndarray:
    """What scipy finds without the Jacobian, started from the true place."""
    joints = list(PAIRS.values())

    def residuals(place_m: np.ndarray) -> np.ndarray:
        image_px = project_cam(joints_m[joints] + place_m, INTRINSICS_PX)
        return (np.sqrt(points[joints, 2:]) * (image_px - points[joints, :2])).ravel()

    exact = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12}
    found = least_squares(residuals, start_m, loss="huber", f_scale=CONFIG.robust_px, **exact)
    return np.asarray(found.x)


@pytest.mark.parametrize("seed", range(5))
def test_noisy_points_give_the_least_reprojection_error(small_body, seed):
    joints_m, points, pelvis_m = seen(small_body, seed, noise_px=2.0)
    found_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    expected_m = by_differences(joints_m, points, pelvis_m)
    np.testing.assert_allclose(found_m, expected_m, atol=1e-4)
    assert found_m is not None and np.linalg.norm(found_m - pelvis_m) < 0.4


def test_where_it_starts_does_not_matter(small_body):
    joints_m, points, _ = seen(small_body, 3, noise_px=2.0)
    alone_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    for previous_m in ([0.0, 0.0, 3.0], [2.0, 0.0, 20.0], [0.0, 0.0, -50.0]):
        found_m = place(joints_m, points, INTRINSICS_PX, CONFIG, np.array(previous_m))
        np.testing.assert_allclose(found_m, alone_m, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_one_wild_joint_moves_it_less_than_without_huber(small_body, seed):
    """Though the closed form starts far off, it ends where a start from the true place does."""
    joints_m, points, pelvis_m = seen(small_body, seed)
    points[PAIRS[4], :2] += [300.0, -200.0]
    robust_m = place(joints_m, points, INTRINSICS_PX, CONFIG)
    expected_m = by_differences(joints_m, points, pelvis_m)
    np.testing.assert_allclose(robust_m, expected_m, atol=1e-4)
    plain_m = place(joints_m, points, INTRINSICS_PX, PlacementConfig(robust_px=1e6))
    assert robust_m is not None and plain_m is not None
    errors_m = [np.linalg.norm(found_m - pelvis_m) for found_m in (robust_m, plain_m)]
    assert errors_m[0] < 0.25 * errors_m[1]


def test_too_few_joints_tell_nothing(small_body):
    joints_m, points, _ = seen(small_body, 2)
    points[list(PAIRS.values())[5:], 2] = 0.29
    assert place(joints_m, points, INTRINSICS_PX, CONFIG) is None
    at_hand = PlacementConfig(min_joints=5)
    assert place(joints_m, points, INTRINSICS_PX, at_hand) is not None


def test_nobody_is_placed_behind_the_camera(small_body):
    """A person turned inside out, at the place behind the camera, has the same image."""
    joints_m, points, pelvis_m = seen(small_body, 4)
    joints = list(PAIRS.values())
    behind_m = closed_form(-joints_m[joints], points[joints, :2], points[joints, 2], INTRINSICS_PX)
    np.testing.assert_allclose(behind_m, -pelvis_m, atol=1e-6)
    assert place(-joints_m, points, INTRINSICS_PX, CONFIG) is None
    found_m = place(-joints_m, points, INTRINSICS_PX, CONFIG, pelvis_m)
    assert found_m is not None and (found_m - joints_m)[joints, 2].min() > 0


def test_parallel_rays_have_no_closed_form():
    points_px = np.tile([320.0, 240.0], (6, 1))
    joints_m = np.random.default_rng(0).normal(0, 0.3, (6, 3))
    assert closed_form(joints_m, points_px, np.ones(6), INTRINSICS_PX) is None


BODY_25 = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
    "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip
"""OpenPose's own names in its own order."""


def test_pairs_have_the_same_names():
    sides = {"R": "right_", "L": "left_"}
    for keypoint, joint in PAIRS.items():
        name = BODY_25[keypoint]
        expected = name.lower() if name == "Neck" else sides[name[0]] + name[1:].lower()
        assert JOINT_NAMES[joint] == expected
    assert sorted(MIRRORED[joint] for joint in PAIRS.values()) == sorted(PAIRS.values())


@pytest.mark.parametrize("n", [25, 21])
def test_each_keypoint_arrives_at_its_joint(tmp_path, n):
    """In OpenPose's layout and STAF's; joints without a keypoint have no confidence."""
    path = tmp_path / "00000.json"
    flat = [value for i in range(n) for value in (10.0 * i, 10.0 * i + 1, i / 100)]
    person = {"person_id": [4], "pose_keypoints_2d": flat, "face_keypoints_2d": []}
    path.write_text(json.dumps({"version": 1.3, "people": [person]}))
    (found,) = read_people(path)
    assert found.id == 4
    np.testing.assert_array_equal(found.keypoints[JOINT["left_wrist"]], [70, 71, 0.07])
    np.testing.assert_array_equal(found.keypoints[JOINT["right_ankle"]], [110, 111, 0.11])
    assert found.confidence == pytest.approx(sum(keypoint / 100 for keypoint in PAIRS))
    unpaired = sorted(set(range(24)) - set(PAIRS.values()))
    assert not found.keypoints[unpaired].any()


def test_nobody_and_no_track(tmp_path):
    path = tmp_path / "00000.json"
    path.write_text('{"people": []}')
    assert read_people(path) == []
    for track in ('"person_id": [-1], ', ""):
        path.write_text(f'{{"people": [{{{track}"pose_keypoints_2d": {[0.5] * 75}}}]}}')
        assert read_people(path)[0].id is None


FLAT = [1.0, 2.0, 0.5] * 25


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ([], "no list of people"),
        ({"persons": []}, "no list of people"),
        ({"people": ["me"]}, "pose_keypoints_2d has none, expected 75 .BODY_25 of OpenPose. or 63"),
        ({"people": [{"pose_keypoints_2d": FLAT[:54]}]}, "has 54 numbers"),
        ({"people": [{"pose_keypoints_2d": [None, *FLAT[1:]]}]}, "something that is no number"),
        ({"people": [{"pose_keypoints_2d": [True, *FLAT[1:]]}]}, "something that is no number"),
        ({"people": [{"pose_keypoints_2d": [float("nan"), *FLAT[1:]]}]}, "is no number"),
        ({"people": [{"pose_keypoints_2d": [10**400, *FLAT[1:]]}]}, "is no number"),
        ({"people": [{"pose_keypoints_2d": [*FLAT[:-1], -0.5]}]}, "a confidence below zero"),
        ({"people": [{"pose_keypoints_2d": FLAT, "person_id": ["3"]}]}, "person_id is"),
    ],
)
def test_json_of_another_kind(tmp_path, record, words):
    path = tmp_path / "00007_keypoints.json"
    path.write_text(json.dumps(record))
    with pytest.raises(BadKeypoints, match=rf"00007_keypoints.json: .*{words}"):
        read_people(path)


@given(st.integers(0, 400))
def test_a_truncated_file_is_named(tmp_path_factory, kept):
    path = tmp_path_factory.mktemp("cut") / "00007_keypoints.json"
    text = json.dumps({"people": [{"person_id": [0], "pose_keypoints_2d": FLAT}]})
    path.write_text(text[: min(kept, len(text) - 1)])
    with pytest.raises(BadRecord, match=r"00007_keypoints.json: not JSON"):
        read_people(path)


@given(st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.sampled_from(["people", "person_id", "pose_keypoints_2d"]), inner),
))  # fmt: skip
def test_whatever_json_is_read_or_refused(tmp_path_factory, record):
    path = tmp_path_factory.mktemp("any") / "1.json"
    path.write_text(json.dumps(record))
    try:
        assert read_people(path) == []
    except GmrdataError as error:
        assert "1.json" in str(error)


def test_frames_are_found_by_number(tmp_path):
    for name in ("take2_000000000010_keypoints.json", "00009_keypoints.json", "notes.txt"):
        (tmp_path / name).write_text("{}")
    assert list(keypoint_files(tmp_path)) == [9, 10]
    (tmp_path / "9.json").write_text("{}")
    with pytest.raises(BadKeypoints, match=r"are both of frame 9"):
        keypoint_files(tmp_path)
    (tmp_path / "9.json").rename(tmp_path / "all.json")
    with pytest.raises(BadKeypoints, match=r"all.json: no number in the name"):
        keypoint_files(tmp_path)
    with pytest.raises(MissingInput, match="gone: no such folder"):
        keypoint_files(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match="empty: no JSON files"):
        keypoint_files(tmp_path / "empty")
