"""Files of any zero pose, unit and naming, beside the same motion from a T-pose."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.set_plan import SyntheticRecipe, planned_clip
from gmrdata.motion.files import read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.motion.library import READING_FILE, ReadingRecord, make_library, motion_table
from gmrdata.motion.local_poses import read_local_poses
from gmrdata.motion.pelvis import hung_on
from gmrdata.motion.rest_pose import limb_corrections
from gmrdata.motion.retarget import _turned as turned_source
from gmrdata.motion.retarget import retarget
from gmrdata.motion.up_axis import is_upright, person_of
from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import ReadConfig, SourceMotion
from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS, BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.joint_names import MIXAMO, find_joints, joints_by_name
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import global_rotmats
from gmrdata.values.transforms import smallest_rotation
from tests.clip_manifests import clips_of

NAME = {joint: name for name, joint in MIXAMO.items()}
T_POSE = np.tile(np.eye(3), (24, 1, 1))


@pytest.fixture
def write(write_person, small_body, tmp_path) -> Callable[..., Path]:
    """A walk of the small body as a BVH that is told from the pose `zero` (24, 3, 3)."""
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(0))
    joints_m = small_body.joints_template_m.copy()
    joints_m[JOINT["head"]] += 0.2 * (joints_m[JOINT["head"]] - joints_m[JOINT["neck"]])
    long_necked = replace(small_body, joints_template_m=joints_m)  # that of no body in any shape

    def write(
        name: str,
        zero: np.ndarray,
        *,
        t_pose: bool = False,
        per_unit: float = 0.01,
        lies: bool = False,
        bent_deg: float = 0.0,
    ) -> Path:
        local = np.concatenate([walk.root_rotmats[:, None], walk.local_rotmats], axis=1)
        for side, sign in (("left", -1), ("right", 1)):
            bent = Rotation.from_euler("y", sign * bent_deg, degrees=True).as_matrix()
            local[:, JOINT[f"{side}_elbow"]] = local[:, JOINT[f"{side}_elbow"]] @ bent
        from_rest = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z up -> y up
        local[:, 0] = from_rest @ local[:, 0]
        pelvis_m = walk.pelvis_m @ from_rest.T
        if lies:
            local[:, 0] = from_rest @ local[:, 0]
        if t_pose:
            local[0], pelvis_m[0] = np.eye(3), [0, 1, 0]
        above = np.concatenate([np.eye(3)[None], zero])[np.array(PARENTS) + 1]
        told = above @ local @ zero.swapaxes(1, 2)
        angles_deg = Rotation.from_matrix(told.reshape(-1, 3, 3)).as_euler("ZXY", degrees=True)
        return write_person(
            tmp_path / f"{name}.bvh",
            long_necked,
            angles_deg.reshape(-1, 24, 3),
            pelvis_m,
            prefix="",
            cm_per_unit=100 * per_unit,
            zero=zero,
            frame_time="0.04",
        )

    return write


@pytest.fixture
def plain(write) -> tuple[SourceMotion, dict[int, int]]:
    """That walk from a T-pose, and the joints of its skeleton."""
    source = read_bvh(write("t", T_POSE))
    return source, find_joints(source.names, source.parents, None, Path("a"))


def _turned(**angles_deg: float) -> np.ndarray:
    """A pose (24, 3, 3) with each arm turned down about the front by so many degrees."""
    local = T_POSE.copy()
    for joint, angle_deg in angles_deg.items():
        for side, sign in (("left", -1), ("right", 1)):
            turn = Rotation.from_euler("z", sign * angle_deg, degrees=True).as_matrix()
            local[JOINT[f"{side}_{joint}"]] = turn
    return global_rotmats(PARENTS, local[None])[0]


def _along_bones(small_body: BodyModel) -> np.ndarray:
    """A pose in which each bone lies along x, as rigs are drawn that nobody set upright."""
    rest_m = small_body.rest_joints_m(np.zeros(10))
    zero = T_POSE.copy()
    for joint in range(1, 24):
        child = next((c for c in range(24) if PARENTS[c] == joint), None)
        bone = rest_m[child] - rest_m[joint] if child is not None else np.array([1.0, 2.0, 3.0])
        zero[joint] = Rotation.align_vectors([[1.0, 0, 0]], [bone])[0].as_matrix()
    return zero


def _apart_deg(a: Motion, b: Motion) -> np.ndarray:
    """(24,) largest angle between the global rotations of each joint [deg]."""
    both = [global_rotmats(PARENTS, m.rotmats) for m in (a, b)]
    turns = both[0].swapaxes(-1, -2) @ both[1]
    angles = Rotation.from_matrix(turns.reshape(-1, 3, 3)).magnitude().reshape(turns.shape[:2])
    return np.rad2deg(angles).max(axis=0)


@pytest.mark.parametrize("down_deg", [0.0, 45.0, 90.0])
def test_arms_may_hang_in_the_zero_pose(write, small_body, down_deg):
    motion = read_motion(write("t", T_POSE), small_body)
    other = read_motion(write("a", _turned(shoulder=down_deg)), small_body)
    # Hands and palms, too: the arm is 2.2 degrees off the plane in which it was turned down.
    apart_deg = _apart_deg(motion, other)
    assert apart_deg.max() < 4.5 and apart_deg[: JOINT["left_shoulder"]].max() < 1e-6
    np.testing.assert_allclose(other.pelvis_m, motion.pelvis_m, atol=1e-9)
    assert "limbs 0.0 (0.0), hip line 0.0 (0.0), shoulder line 0.0 (0.0)" in other.source


@pytest.mark.parametrize("raised", [True, False], ids=["arms up", "along the bones"])
def test_a_t_pose_in_frame_0_says_what_rotations_mean(write, small_body, raised):
    zero = _turned(shoulder=-90.0) if raised else _along_bones(small_body)
    motion = read_motion(
        write("t", T_POSE, t_pose=True), small_body, drop_rest_frame=False, ground=True
    )
    other = read_motion(
        write("bones", zero, t_pose=True), small_body, drop_rest_frame=False, ground=True
    )
    assert "turns told from frame 0, a T-pose" in other.source
    # Toe bones that were drawn along x may show how flat a foot is to a hair.
    assert _apart_deg(motion, other).max() < 0.01
    np.testing.assert_allclose(other.pelvis_m, motion.pelvis_m, atol=1e-3)


@pytest.mark.parametrize("rest_pose", [None, "first_frame"])
def test_a_t_pose_that_is_dropped_says_it_too(write, small_body, rest_pose):
    path = write("up", _turned(shoulder=-90.0), t_pose=True)
    kept = read_motion(path, small_body, drop_rest_frame=False, rest_pose=rest_pose, ground=False)
    motion = read_motion(path, small_body, rest_pose=rest_pose, ground=False)
    assert "added rest pose in frame 0 dropped, turns told from frame 0" in motion.source
    assert motion.n_frames == kept.n_frames - 1
    # What a flat foot is, is told from the frames.
    apart_deg = _apart_deg(kept.take(slice(1, None)), motion)
    assert np.delete(apart_deg, [7, 8, 10, 11]).max() < 1e-5


def test_a_t_pose_after_an_added_one_says_it_as_well(write, small_body):
    zero = _turned(shoulder=-90.0)
    source = read_bvh(write("up", zero, t_pose=True), drop_rest_frame=False)
    source = replace(source, first_row=1, added_pose=T_POSE)  # the arms go up in it, as at zero
    joints = find_joints(source.names, source.parents, None, Path("a"))
    motion, _ = retarget(source, joints, small_body)
    assert "turns told from frame 1, a T-pose" in motion.source


def test_the_added_pose_goes_with_its_motion(write):
    source = read_bvh(write("t", T_POSE))
    source = replace(source, added_pose=source.local_rotmats[0])
    hung = hung_on(source, source.names.index("LeftArm"))
    np.testing.assert_allclose(hung.added_pose, hung.local_rotmats[0], atol=1e-12)
    turned = turned_source(source, Rotation.from_euler("x", 90, degrees=True).as_matrix(), "")
    np.testing.assert_array_equal(turned.added_pose, turned.local_rotmats[0])


def test_local_poses_are_counted_by_the_files_rows(write, small_body):
    path = write("t", T_POSE, t_pose=True)
    (clip,) = read_local_poses(path, body=small_body)
    np.testing.assert_array_equal(clip.image_numbers, np.arange(1, 60))


def test_without_a_t_pose_it_is_the_mean_pose(write, small_body):
    motion = read_motion(write("t", T_POSE), small_body)
    other = read_motion(write("bones", _along_bones(small_body)), small_body)
    assert "turns told from the mean pose" in other.source
    apart_deg = _apart_deg(motion, other)
    # Nobody knows how far a walker's palms are turned and the trunk leans in the mean.
    assert apart_deg[JOINT["pelvis"]] < 6 and apart_deg.max() < 30, apart_deg.round(1)
    assert "limbs 0.0 (0.0)" in other.source


def test_elbows_that_are_bent_in_the_mean_pose_are_not_rolled(write, small_body):
    """Forearms were turned straight to the mean pose, and rolled by 64 degrees."""
    motion = read_motion(write("t", T_POSE, bent_deg=60.0), small_body)
    other = read_motion(write("bones", _along_bones(small_body), bent_deg=60.0), small_body)
    assert "turns told from the mean pose" in other.source
    local = [m.rotmats[:, [JOINT["left_elbow"], JOINT["right_elbow"]]] for m in (motion, other)]
    turns = local[0].swapaxes(-1, -2) @ local[1]
    assert np.rad2deg(Rotation.from_matrix(turns.reshape(-1, 3, 3)).magnitude()).max() < 15.0


def test_a_bent_limb_is_bent_after_the_one_above_is_turned(small_body):
    rest_m = small_body.rest_joints_m(np.zeros(10))
    source_m = rest_m.copy()
    chain = [JOINT[f"left_{part}"] for part in ("shoulder", "elbow", "wrist")]
    upper_m, lower_m = (rest_m[b] - rest_m[a] for a, b in pairwise(chain))
    down = smallest_rotation(upper_m, np.array([0.2, -1.0, 0.1]))
    hinge = np.cross(down @ lower_m, [0.0, 0.0, 1.0])
    bent = Rotation.from_rotvec(1.2 * hinge / np.linalg.norm(hinge)).as_matrix() @ down
    source_m[chain[1]] = source_m[chain[0]] + down @ upper_m
    source_m[chain[2]] = source_m[chain[1]] + bent @ lower_m
    found = limb_corrections(source_m, rest_m)
    np.testing.assert_allclose(found[chain[0]], down, atol=1e-12)
    np.testing.assert_allclose(found[chain[1]], bent, atol=1e-12)
    np.testing.assert_allclose(found[chain[2]], bent, atol=1e-12)


SOMA_DEG = {
    "pelvis Hips": (90, 0.19, 90), "spine1 Spine1": (90, 0.24, 90), "head Head": (90, 6.75, 90),
    "spine2 Spine2": (90, 6.17, 90), "spine3 Chest": (90, 0.2, 90), "neck Neck1": (90, -16.63, 90),
    "left_collar LeftShoulder": (0, 20.24, 90), "right_collar RightShoulder": (0, -20.24, -90),
    "left_shoulder LeftArm": (0, 0, 90), "right_shoulder RightArm": (0, 0, -90),
    "left_elbow LeftForeArm": (0, 0, 90), "right_elbow RightForeArm": (0, 0, -90),
    "left_wrist LeftHand": (0, 0, 99.71), "right_wrist RightHand": (0, 0, -80.29),
    "left_hand LeftHandMiddle1": (0, 0, 99.71), "right_hand RightHandMiddle1": (0, 0, -80.29),
    "left_hip LeftLeg": (-90, 1.06, -90), "right_hip RightLeg": (90, -1.06, 90),
    "left_knee LeftShin": (-90, 4.72, -90), "right_knee RightShin": (90, -4.72, 90),
    "left_ankle LeftFoot": (-90, -69.07, -90), "right_ankle RightFoot": (90, 69.07, 90),
    "left_foot LeftToeBase": (-90, -73.8, -90), "right_foot RightToeBase": (90, 73.8, 90),
}  # fmt: skip
"""Joints of the body and of SOMA, and their z, y, x in SOMA's T-pose, as Kimodo writes BVH."""


def test_somas_t_pose_is_known(write, small_body):
    """By the mean pose upper arms were rolled by 70 degrees, and heads bent by 40."""
    zero, names = T_POSE.copy(), {}
    for both, angles_deg in SOMA_DEG.items():
        joint, name = both.split()
        zero[JOINT[joint]] = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix().T
        names[NAME[joint]] = name
    motion = read_motion(write("t", T_POSE), small_body, ground=True)
    path = write("soma", zero)
    text = path.read_text()
    for name in sorted(names, key=len, reverse=True):
        text = re.sub(rf"(ROOT|JOINT) {name}\n", rf"\1 soma:{names[name]}\n", text)
    path.write_text(text.replace("soma:", ""))
    other = read_motion(path, small_body, ground=True)
    assert "turns told from SOMA's T-pose" in other.source
    assert _apart_deg(motion, other).max() < 0.6
    np.testing.assert_allclose(other.pelvis_m, motion.pelvis_m, atol=2e-3)


def test_the_zero_pose_may_be_given(write, small_body):
    up = _turned(shoulder=-90.0)
    motion = read_motion(write("t", T_POSE), small_body, ground=False)
    path = write("up", up)
    assert "turns told from the mean pose" in read_motion(path, small_body).source
    given = read_motion(path, small_body, rest_pose="arms_up", ground=False)
    assert _apart_deg(motion, given).max() < 4.5 and "zero pose given as arms_up" in given.source
    rest = write("rest", up, t_pose=True)
    told = read_motion(path, small_body, rest_pose=rest, ground=False)
    assert "told from the first frame of rest_pose's file" in told.source
    assert np.delete(_apart_deg(motion, told), [7, 8, 10, 11]).max() < 0.01
    for wrong, words in (
        ("t", r"up.bvh: the arms of the zero pose point \+\d\d degrees above the level, so"),
        (write("other", T_POSE), "up.bvh: the offset of .* is another in the file of --rest-pose"),
        (Path("tpose"), "tpose: no such file. --rest-pose takes a BVH file, or t, a, arms_down"),
    ):
        with pytest.raises((BadMotionFile, MissingInput), match=words):
            read_motion(path, small_body, rest_pose=wrong)
    with pytest.raises(MissingInput, match="^tpose: no such file. --rest-pose takes"):
        make_library([path], "anny", path.parent / "out", rest_pose=Path("tpose"))
    assert not (path.parent / "out").exists()


@pytest.mark.parametrize("frame_time", ["0", "1"])
def test_the_file_of_a_zero_pose_needs_no_rate(write, small_body, frame_time):
    up = _turned(shoulder=-90.0)
    path, rest = write("up", up), write("rest", up, t_pose=True)
    wanted = read_motion(path, small_body, rest_pose=rest)
    head, _, table = rest.read_text().partition("Frames: 60\nFrame Time: 0.04\n")
    first = table.partition("\n")[0]
    rest.write_text(f"{head}Frames: 1\nFrame Time: {frame_time}\n{first}\n")
    found = read_motion(path, small_body, rest_pose=rest)
    np.testing.assert_array_equal(found.rotmats, wanted.rotmats)


def test_a_recipe_says_how_files_are_read(write, small_body):
    path = write("odd", _turned(shoulder=-90.0))
    path.write_text(path.read_text().replace("LeftLeg", "Bone7"))
    clip = {"id": "odd", "trial": "odd", "programme": {"kind": "static"}}
    recipe = {"recipe": "synthetic", "name": "set", "film": {"duration_s": 0.5}, "clips": [clip]}
    names = {NAME[joint]: joint for joint in JOINT_NAMES} | {"Bone7": "left_knee"}
    del names["LeftLeg"]
    with pytest.raises(BadMotionFile, match="no joint is known to be left_knee"):
        _plan(recipe, path, small_body)
    planned = _plan(
        recipe | {"read": {"joint_map": names, "rest_pose": "arms_up"}}, path, small_body
    )
    assert "zero pose given as arms_up" in planned.motion.source
    own = [clip | {"read": {"joint_map": names}}]
    assert (
        "told from the mean pose" in _plan(recipe | {"clips": own}, path, small_body).motion.source
    )


def _plan(recipe: dict[str, object], path: Path, body: BodyModel) -> Clip:
    read = SyntheticRecipe.model_validate(recipe)
    return planned_clip(read.clips[0], read, path, body)[0]


def test_hands_that_the_zero_pose_bends(write, small_body):
    motion = read_motion(write("t", T_POSE), small_body, ground=False)
    other = read_motion(write("bent", _turned(wrist=40.0)), small_body, ground=False)
    assert _apart_deg(motion, other)[[JOINT["left_wrist"], JOINT["right_hand"]]].max() < 0.01


def test_joints_that_move_as_well_as_turn(plain, small_body):
    # Axis Neuron's files have places for each joint, which give in as flesh does.
    source, joints = plain
    moved_m = source.translations_m.copy()
    moved_m[:, 1:] += 0.02 * np.random.default_rng(0).normal(size=moved_m[:, 1:].shape)
    _, residual = retarget(replace(source, translations_m=moved_m), joints, small_body)
    assert residual.worst_deg["limbs"] < 1e-3 and 0.1 < residual.mean_deg["hip line"] < 20


def test_what_was_read_stands_in_table_and_manifest(write, body_path, tmp_path):
    write("walk", _turned(shoulder=60.0))
    fallen = write("fallen", _turned(shoulder=60.0), lies=True)
    table = motion_table((tmp_path,), str(body_path), ReadConfig(fps_hz=50))
    assert [row[:4] for row in table.rows] == [
        ("fallen.bvh", "60", "50", "given"),
        ("walk.bvh", "60", "50", "given"),
    ]
    assert table.rows[1][-4:] == ("0.0 (0.0)",) * 4
    warning, fast = table.warnings
    assert warning.startswith("fallen.bvh: the person lies or leans throughout")
    assert fast.startswith("walk.bvh: walks at")  # at 50 Hz, not at its 30
    made = make_library((fallen,), str(body_path), tmp_path / "out")
    (clip,) = clips_of(made)
    assert clip.quality is not None
    assert clip.quality.figures["limbs_residual_deg_worst"] == 0.0
    record = ReadingRecord.read(tmp_path / "out" / "clips" / "fallen" / READING_FILE)
    assert (record.rate_from, record.upright) == ("header", False)
    with pytest.raises(BadMotionFile, match=r"config\.rest_pose"):
        make_library((fallen,), str(body_path), tmp_path / "out", rest_pose="a")


@pytest.mark.parametrize("per_unit", [1.0, 0.0254, 0.001, 0.04, 0.01])
def test_any_unit_is_found_by_the_legs(write, small_body, per_unit):
    motion = read_motion(write("cm", T_POSE), small_body)
    other = read_motion(write("unit", T_POSE, per_unit=per_unit), small_body)
    # The unit says only when a foot counts as still, from which flat feet and the floor are read.
    np.testing.assert_allclose(other.rotmats, motion.rotmats, atol=1e-4)
    np.testing.assert_allclose(other.pelvis_m, motion.pelvis_m, atol=1e-3)
    assert ("lengths x" in other.source) == (per_unit != 0.01)


def _with_pivots(source: SourceMotion, angles_deg: np.ndarray) -> SourceMotion:
    """The same, but the root turns (T,) degrees more, and pivots above its children turn back."""
    n = len(source.parents)
    children = [joint for joint in range(n) if source.parents[joint] == 0]
    order = [0, *(-joint for joint in children), *range(1, n)]  # -joint: the pivot above a joint
    place = {joint: row for row, joint in enumerate(order)}
    parents = [0 if j < 0 else place.get(-j, place[max(source.parents[j], 0)]) for j in order]
    turns = Rotation.from_euler("y", angles_deg[:, None], degrees=True).as_matrix()
    rows = np.maximum(order, 0)
    local, zeros = source.local_rotmats[:, rows], np.array(order) < 0
    local[:, 0] = local[:, 0] @ turns
    local[:, zeros] = turns.swapaxes(1, 2)[:, None]
    offsets_m, moves_m = source.offsets_m[rows], source.translations_m[:, rows]
    offsets_m[zeros], moves_m[:, zeros] = 0.0, 0.0
    return replace(
        source,
        names=tuple(source.names[j] if j >= 0 else f"Pivot{-j}" for j in order),
        parents=(-1, *parents[1:]),
        offsets_m=offsets_m,
        tips_m=source.tips_m[rows],
        local_rotmats=local,
        translations_m=moves_m,
    )


def test_hips_that_turn_beside_their_joint(plain, small_body):
    # Networks that place joints write such files: deep-motion-editing's results, for one.
    source, joints = plain
    motion, _ = retarget(source, joints, small_body)
    turned = _with_pivots(source, np.full(source.n_frames, 90.0))
    joints = find_joints(turned.names, turned.parents, None, Path("a"))
    other, _ = retarget(turned, joints, small_body)
    assert "turns told from the mean pose" in other.source
    assert _apart_deg(motion, other)[JOINT["pelvis"]] < 6
    swinging = _with_pivots(source, np.where(np.arange(source.n_frames) % 2, 90.0, -90.0))
    with pytest.raises(
        BadMotionFile, match=r"the hip line would be \d+\.\d degrees off.*--joint-map"
    ):
        retarget(swinging, joints, small_body)


def test_an_animal_is_refused(plain, small_body):
    source, joints = plain
    offsets_m = source.offsets_m.copy()
    spine = [joints[JOINT[name]] for name in ("spine1", "spine2", "spine3", "neck")]
    offsets_m[spine] = offsets_m[spine][:, [0, 2, 1]]  # the trunk lies, its legs hang
    still = np.tile(np.eye(3), (3, len(source.parents), 1, 1))
    lying = replace(
        source, offsets_m=offsets_m, local_rotmats=still, translations_m=source.translations_m[:3]
    )
    with pytest.raises(BadMotionFile, match=r"beast.*stands .*neither.*nor in frame 0, nor in the"):
        retarget(lying, joints, small_body, name="beast.bvh")


def test_one_who_lies_throughout_is_told_of(plain, small_body):
    source, joints = plain
    assert is_upright(person_of(small_body, retarget(source, joints, small_body)[0]))
    local_rotmats = source.local_rotmats.copy()
    local_rotmats[:, 0] = (
        Rotation.from_euler("x", 90, degrees=True).as_matrix() @ local_rotmats[:, 0]
    )
    lying, _ = retarget(replace(source, local_rotmats=local_rotmats), joints, small_body)
    assert not is_upright(person_of(small_body, lying))


NAMINGS = {
    "lafan1": "Hips|{}UpLeg {}Leg {}Foot {}Toe|Spine Spine1 Spine2|Neck Head|"
    "{}Shoulder {}Arm {}ForeArm {}Hand",
    "hip and knee": "Hips|{}Hip {}Knee {}Ankle {}Toe|Chest Chest2 Chest3 Chest4|Neck Head|"
    "{}Collar {}Shoulder {}Elbow {}Wrist",
    "rokoko": "Hips|{}Thigh {}Shin {}Foot {}Toe|Spine1 Spine2 Spine3 Spine4|Neck Head|"
    "{}Shoulder {}Arm {}ForeArm {}Hand",
    "xsens": "Pelvis|{}UpperLeg {}LowerLeg {}Foot {}Toe|L5 L3 T12 T8|Neck Head|"
    "{}Shoulder {}UpperArm {}ForeArm {}Hand",
    "second life": "mPelvis|mHip{} mKnee{} mAnkle{} mToe{}|mTorso mChest|mNeck mHead|"
    "mCollar{} mShoulder{} mElbow{} mWrist{}",
    "soma": "Hips|{}Leg {}Shin {}Foot {}ToeBase|Spine1 Spine2 Chest|Neck1 Head|"
    "{}Shoulder {}Arm {}ForeArm {}Hand",
    "biovision": "Hips|{}UpLeg {}LowLeg {}Foot {}Toe|Chest|Neck Head|"
    "{}Collar {}UpArm {}LowArm {}Hand",
    "humanik": "Character1_Hips|Character1_{}UpLeg Character1_{}Leg Character1_{}Foot "
    "Character1_{}ToeBase|Character1_Spine|Character1_Neck Character1_Head|"
    "Character1_{}Shoulder Character1_{}Arm Character1_{}ForeArm Character1_{}Hand",
    "vrm": "Hips|{}UpperLeg {}LowerLeg {}Foot {}Toes|Spine Chest UpperChest|Neck Head|"
    "{}Shoulder {}UpperArm {}LowerArm {}Hand",
}
SHORT_NAMINGS = {
    "bandai namco": "Hips|UpperLeg_{} LowerLeg_{} Foot_{} Toes_{}|Spine Chest|Neck Head|"
    "Shoulder_{} UpperArm_{} LowerArm_{} Hand_{}",
    "3ds max": "Bip01 Pelvis|Bip01 {} Thigh,Bip01 {} Calf,Bip01 {} Foot,Bip01 {} Toe0|"
    "Bip01 Spine,Bip01 Spine1,Bip01 Spine2|Bip01 Neck,Bip01 Head|"
    "Bip01 {} Clavicle,Bip01 {} UpperArm,Bip01 {} Forearm,Bip01 {} Hand",
    "makehuman": "Root|UpLeg_{} LoLeg_{} Foot_{} Toe_{}|Spine1 Spine2 Spine3|Neck Head|"
    "Clavicle_{} UpArm_{} LoArm_{} Hand_{}",
    "reallusion": "CC_Base_Hip|CC_Base_{}_Thigh CC_Base_{}_Calf CC_Base_{}_Foot CC_Base_{}_ToeBase|"
    "CC_Base_Waist CC_Base_Spine01|CC_Base_Neck CC_Base_Head|"
    "CC_Base_{}_Clavicle CC_Base_{}_Upperarm CC_Base_{}_Forearm CC_Base_{}_Hand",
    "smpl": "Pelvis|{}_Hip {}_Knee {}_Ankle {}_Foot|Spine1 Spine2 Spine3|Neck Head|"
    "{}_Collar {}_Shoulder {}_Elbow {}_Wrist",
}
POSER = "hip|{}Thigh {}Shin {}Foot {}Toe|abdomen chest|neck head|{}Collar {}Shldr {}ForeArm {}Hand"
ALL_NAMINGS = [
    *((title, naming, ("Left", "Right")) for title, naming in NAMINGS.items()),
    *((title, naming, ("L", "R")) for title, naming in SHORT_NAMINGS.items()),
    ("poser", POSER, ("l", "r")),
    (
        "lower case",
        "hip|{}hip {}knee {}foot {}toe|abdomen|neck head|{}collar {}shoulder {}elbow {}hand",
        ("l", "r"),
    ),
    (
        "mocopi",
        "root|{}_up_leg {}_low_leg {}_foot {}_toes|torso_1 torso_2|neck_1 head|"
        "{}_shoulder {}_up_arm {}_low_arm {}_hand",
        ("l", "r"),
    ),
    ("unity", NAMINGS["lafan1"].lower(), ("left_", "right_")),
]


@pytest.mark.parametrize(("title", "naming", "sides"), ALL_NAMINGS, ids=lambda value: str(value))
def test_namings(title, naming, sides):
    pelvis, leg, spine, ends, arm = (
        part.split(",") if "," in part or "Bip01 Pelvis" in part else part.split()
        for part in naming.split("|")
    )
    names, parents = list(pelvis), [-1]

    def grow(start: int, bones: list[str]) -> None:
        for bone in bones:
            parents.append(start)
            names.append(bone)
            start = len(names) - 1

    for side in sides:
        grow(0, [bone.format(side) for bone in leg])
    grow(0, spine)
    chest = len(names) - 1
    grow(chest, ends)
    for side in sides:
        grow(chest, [bone.format(side) for bone in arm])
    found = {joint: names[bone] for joint, bone in joints_by_name(names, parents).items()}
    expected = {"pelvis": pelvis[0], "neck": ends[0], "head": ends[1]}
    for side, said in zip(("left", "right"), sides, strict=True):
        legs_and_arms = zip(
            ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist"),
            leg + arm, strict=True,
        )  # fmt: skip
        expected |= {f"{side}_{joint}": bone.format(said) for joint, bone in legs_and_arms}
    kept = spine if len(spine) < 4 else [spine[0], spine[2], spine[-1]]
    expected |= {f"spine{n}": bone for n, bone in enumerate(kept, start=1)}
    assert found == expected


def test_what_is_nobody_has_no_joints():
    names, parents = ["root", "wheel_l", "wheel_r", "door.L"], [-1, 0, 0, 0]
    assert joints_by_name(names, parents) == {}
    with pytest.raises(BadMotionFile, match="no joint is known to be pelvis"):
        find_joints(names, parents, None, Path("car.bvh"))
