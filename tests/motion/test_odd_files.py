"""Files as other programs write them: hung on another joint, with other separators, in parts."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.motion.files import find_motions, read_file, read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import DEFAULT_READING, ReadConfig, SourceMotion
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.joint_names import CMU_BVH, is_cmu, joints_by_name, line_to
from gmrdata.values.transforms import angles_rad, rigid
from gmrdata.write.amass import write_amass
from gmrdata.write.bvh import frame_time, write_bvh
from tests.fixtures.command_line import fails_cleanly
from tests.motions import moved

SIX = ("Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation")


@pytest.fixture
def walk_path(tmp_path, small_body) -> Path:
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(0), shape=np.zeros(10))
    write_bvh(tmp_path / "walk.bvh", walk, small_body)
    return tmp_path / "walk.bvh"


def _save(
    write: Callable[..., Path], path: Path, source: SourceMotion, parents: Sequence[int]
) -> Path:
    """The same places and global rotations on another tree, each joint with six channels."""
    order: list[int] = []

    def add(joint: int) -> None:
        order.append(joint)
        for child in (n for n, parent in enumerate(parents) if parent == joint):
            add(child)

    add(parents.index(-1))
    frames, places_m = source.posed()
    rest_m = source.rest_joints_m()
    offsets, rows = [], []
    for joint in order:
        above = parents[joint]
        over = frames[:, above] if above >= 0 else np.eye(3)[None]
        start_m, rest_start_m = (
            x[..., above, :] if above >= 0 else 0.0 for x in (places_m, rest_m)
        )
        moved_m = np.einsum("tlk,tl->tk", np.broadcast_to(over, frames[:, joint].shape),
                            places_m[:, joint] - start_m)  # fmt: skip
        local = Rotation.from_matrix(over.swapaxes(-1, -2) @ frames[:, joint])
        rows.append(np.c_[100 * moved_m, local.as_euler("ZXY", degrees=True)])
        offsets.append(100 * (rest_m[joint] - rest_start_m))
    new = [order.index(parents[joint]) if parents[joint] >= 0 else -1 for joint in order]
    names = [source.names[joint] for joint in order]
    table, channels = np.concatenate(rows, axis=1), [SIX] * len(order)
    return write(path, names, new, np.array(offsets), channels, table, frame_time="0.0333333")


@pytest.mark.parametrize(
    "root", ["Head", "Neck", "Spine2", "Spine", "LeftHand", "RightFoot", "LeftUpLeg", "Reference"]
)
def test_the_pelvis_is_where_legs_and_trunk_meet(write_bvh, walk_path, small_body, root):
    plain = read_bvh(walk_path)
    plain = replace(plain, offsets_m=plain.offsets_m * 1.01)  # no body's own skeleton
    parents = list(plain.parents)
    if root == "Reference":  # a joint on the floor that carries pelvis and spine
        n, still = len(parents), np.tile(np.eye(3), (plain.n_frames, 1, 1, 1))
        parents = [-1, *(parent + 1 for parent in parents)]
        zeros_m = np.zeros((plain.n_frames, 1, 3))
        hung = replace(
            plain,
            names=("Reference", *plain.names),
            parents=tuple(parents),
            offsets_m=np.concatenate([np.zeros((1, 3)), plain.offsets_m]),
            tips_m=np.concatenate([np.full((1, 3), np.nan), plain.tips_m]),
            local_rotmats=np.concatenate([still, plain.local_rotmats], axis=1),
            translations_m=np.concatenate([zeros_m, plain.translations_m], axis=1),
        )
        assert len(parents) == n + 1
        parents[1 + plain.names.index("Spine")] = 0
    else:
        hung = plain
        line = line_to(plain.names.index(root), parents)
        for above, below in pairwise(line):
            parents[above] = below
        parents[line[-1]] = -1
    here = walk_path.parent
    wanted = read_motion(_save(write_bvh, here / "a.bvh", plain, plain.parents), small_body)
    found = read_motion(_save(write_bvh, here / "b.bvh", hung, parents), small_body)
    np.testing.assert_allclose(found.root_rotmats, wanted.root_rotmats, atol=1e-6)
    np.testing.assert_allclose(found.pelvis_m, wanted.pelvis_m, atol=1e-5)
    np.testing.assert_allclose(found.local_rotmats, wanted.local_rotmats, atol=1e-5)
    _check_rest_file(here / "b.bvh", small_body)


def _check_rest_file(path: Path, body: BodyModel) -> None:
    """The first frame as a file of its own, on a tree that it was refused for, says the same."""
    head, _, table = path.read_text().partition("MOTION\n")
    rate, first = re.search(r"Frame Time: .*\n", table), table.splitlines()[2]  # type: ignore[union-attr]
    assert rate is not None
    rest = path.with_name("rest.bvh")
    rest.write_text(f"{head}MOTION\nFrames: 1\n{rate[0]}{first}\n")
    told, wanted = (read_motion(path, body, rest_pose=said) for said in (rest, "first_frame"))
    assert "turns told from the first frame of rest_pose's file" in told.source
    np.testing.assert_allclose(told.rotmats, wanted.rotmats, atol=1e-12)
    np.testing.assert_allclose(told.pelvis_m, wanted.pelvis_m, atol=1e-12)


@pytest.mark.parametrize(("root", "joint"), [("Head", "head"), ("RightFoot", "right_ankle")])
def test_a_root_whose_frame_is_that_of_the_bone_it_holds(
    write_bvh, walk_path, small_body, root, joint
):
    """What the file does not say of the foot or the head is told of."""
    plain = replace(read_bvh(walk_path), offsets_m=1.01 * read_bvh(walk_path).offsets_m)
    parents = list(plain.parents)
    frames, places_m = plain.posed()
    turned = frames.copy()
    for above, below in pairwise(line_to(plain.names.index(root), parents)):
        parents[above], turned[:, below] = below, frames[:, above]
    parents[plain.names.index(root)] = -1
    over = np.maximum(plain.parents, 0)
    turns = turned[:, over].swapaxes(-1, -2)
    turns[:, 0] = np.eye(3)
    moves_m = np.einsum("tjkl,tjl->tjk", turns, places_m - places_m[:, over])
    moves_m[:, 0] = places_m[:, 0]
    hung = replace(plain, local_rotmats=turns @ turned, translations_m=moves_m)
    wanted = read_motion(
        _save(write_bvh, walk_path.parent / "a.bvh", plain, plain.parents), small_body
    )
    path = _save(write_bvh, walk_path.parent / "b.bvh", hung, parents)
    found = read_file(path, small_body, ReadConfig())
    _check_rest_file(path, small_body)
    turns_deg = np.rad2deg(angles_rad(wanted.rotmats.swapaxes(-1, -2) @ found.motion.rotmats))
    off = set(np.flatnonzero(turns_deg.max(axis=0) > 2.0).tolist())
    ends = {JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")}
    assert JOINT[joint] in off and off <= {*ends, JOINT["neck"], JOINT["head"]}
    np.testing.assert_allclose(found.motion.pelvis_m, wanted.pelvis_m, atol=0.05)
    assert [one for one in found.remarks if one.endswith(f"the file lacks the turn of {root}")]


@pytest.mark.parametrize(
    ("old", "new"),
    [(".", ","), (" ", ","), (" ", ", "), (" ", ";"), (" ", "; "), (" ", "\t"), (" -", "-")],
    ids=["decimal comma", "comma", "comma and space", "semicolon", "and space", "tab", "glued"],
)
def test_separators_of_numbers(walk_path, old, new):
    plain = read_bvh(walk_path)
    head, motion, table = walk_path.read_text().partition("Frame Time: ")
    rate, _, rows = table.partition("\n")
    if new == ",":
        rate = rate.replace(old, new)
    if old == ".":
        head = head.replace(old, new)
    walk_path.write_text(f"{head}{motion}{rate}\n{rows.replace(old, new)}")
    again = read_bvh(walk_path)
    np.testing.assert_array_equal(again.local_rotmats, plain.local_rotmats)
    np.testing.assert_array_equal(again.translations_m, plain.translations_m)
    assert again.fps_hz == plain.fps_hz == 30.0


@pytest.mark.parametrize("name", ["Spine.001", "Spine1.001"])
def test_a_point_in_a_name_is_no_decimal_one(walk_path, name):
    plain = read_bvh(walk_path)
    text = walk_path.read_text().replace(".", ",")
    walk_path.write_text(text.replace(plain.names[3], name))
    again = read_bvh(walk_path)
    assert again.names == tuple(name if n == 3 else one for n, one in enumerate(plain.names))
    np.testing.assert_array_equal(again.local_rotmats, plain.local_rotmats)


def test_a_decimal_comma_in_the_frame_time_alone(walk_path):
    text = walk_path.read_text()
    for comma in ("0,0333333", ",0333333"):
        walk_path.write_text(re.sub(r"(?<=Frame Time: ).*", comma, text))
        assert read_bvh(walk_path).fps_hz == 30.0


@pytest.mark.parametrize(
    ("path_x", "turns_x", "said"),
    [
        (1.0, 1.0, None),
        (0.0, 1.0, "under a pelvis that stays: a walk in place, or a path that is missing"),
        (0.01, 1.0, "in another unit than the skeleton"),
        (1.0, np.pi / 180, "a stiff body, or angles in radians"),
    ],
)
def test_what_no_walk_is_like_gets_a_remark(tmp_path, small_body, path_x, turns_x, said):
    walk = make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(0))
    turns = Rotation.from_matrix(walk.local_rotmats.reshape(-1, 3, 3)).as_rotvec() * turns_x
    local = Rotation.from_rotvec(turns).as_matrix().reshape(walk.local_rotmats.shape)
    pelvis_m = walk.pelvis_m * [path_x, path_x, 1.0]
    write_bvh(tmp_path / "a.bvh", replace(walk, local_rotmats=local, pelvis_m=pelvis_m), small_body)
    remarks = read_file(tmp_path / "a.bvh", small_body, ReadConfig()).remarks
    assert [one for one in remarks if said and said in one] if said else remarks == ()


@pytest.mark.parametrize(("degrees", "remarked"), [(10.0, False), (30.0, True)])
def test_a_world_that_is_tilted_as_a_camera_gets_a_remark(tmp_path, small_body, degrees, remarked):
    walk = make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(0))
    tilt = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    write_bvh(tmp_path / "a.bvh", moved(walk, rigid(tilt, np.zeros(3))), small_body)
    remarks = read_file(tmp_path / "a.bvh", small_body, ReadConfig()).remarks
    assert bool([one for one in remarks if "its world is tilted" in one]) == remarked


def test_a_left_handed_skeleton_is_refused(write_bvh, walk_path, small_body):
    plain = read_bvh(walk_path)
    flip = np.diag([-1.0, 1.0, 1.0])
    mirrored = replace(
        plain,
        offsets_m=1.01 * plain.offsets_m @ flip,
        translations_m=1.01 * plain.translations_m @ flip,
        local_rotmats=flip @ plain.local_rotmats @ flip,
    )
    path = _save(write_bvh, walk_path.parent / "b.bvh", mirrored, plain.parents)
    with pytest.raises(BadMotionFile, match="feet point backwards: left and right are exchanged"):
        read_motion(path, small_body)


@pytest.mark.parametrize("form", ["cmu:{}", "Subject02:{}", "{}_01", "rig:body:{}"])
def test_cmus_names_are_known_below_a_namespace(form):
    names = [*CMU_BVH, "LHipJoint"]
    called = [form.format(name) for name in names]
    parents = [-1] * len(names)
    assert is_cmu(called) and joints_by_name(called, parents) == joints_by_name(names, parents)


def test_poses_in_degrees_are_refused(tmp_path, small_body):
    walk = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0))
    write_amass(tmp_path / "a.npz", walk, small_body)
    arrays = dict(np.load(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", **arrays | {"poses": np.rad2deg(arrays["poses"])})
    with pytest.raises(BadMotionFile, match=r"b\.npz: turns of up to \d+ in poses: degrees"):
        read_motion(tmp_path / "b.npz", small_body)


@pytest.mark.parametrize(
    ("fps_hz", "text"),
    [(30.0, "0.0333333"), (120.0, "0.0083333"), (24.0, "0.0416667"), (29.97, "0.0333667"),
     (30000 / 1001, "0.03336667"), (12.3456789, None), (100 / 3, "0.0300000")],
)  # fmt: skip
def test_a_written_frame_time_is_readable(tmp_path, small_body, fps_hz, text):
    walk = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0))
    write_bvh(tmp_path / "a.bvh", replace(walk, fps_hz=fps_hz), small_body)
    assert read_bvh(tmp_path / "a.bvh").fps_hz == pytest.approx(fps_hz, rel=1e-15)
    assert text is None or len(frame_time(fps_hz)) <= len(text) + 12


def test_a_rate_that_is_believed_in_no_header_is_written(tmp_path, small_body):
    """The writer refused it, since the reader does."""
    walk = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0))
    write_bvh(tmp_path / "a.bvh", replace(walk, fps_hz=4.0), small_body)
    assert "\nFrame Time: 0.2500000" in (tmp_path / "a.bvh").read_text()
    with pytest.raises(BadMotionFile, match=r"no rate from 5 to 1000 Hz; give .* --fps-hz"):
        read_bvh(tmp_path / "a.bvh")
    found = read_bvh(tmp_path / "a.bvh", fps_hz=4.0, drop_rest_frame=False)
    assert (found.fps_hz, len(found.local_rotmats)) == (4.0, walk.n_frames)


def test_the_skeletons_of_hdm05(shared_path, small_body):
    path = shared_path("odd/hdm05_skeleton_name") / "HDM_bd_01-01_01_120.amc"
    read = read_file(path, small_body, DEFAULT_READING)
    assert "skeleton HDM_bd.asf" in read.motion.source
    assert (read.motion.n_frames, read.motion.fps_hz, read.rate_from) == (
        40,
        120.0,
        "CMU's skeleton",
    )


def test_a_decimal_comma(shared_path, small_body):
    path = shared_path("odd/decimal_comma/a01_comma.bvh")
    plain = shared_path("odd/bvh_rest_y_up_motion_z_up/plain.bvh")
    read = [read_motion(one, small_body) for one in (path, plain)]
    np.testing.assert_array_equal(read[0].rotmats, read[1].rotmats)


def test_betas_of_each_frame(shared_path, tmp_path):
    folder = shared_path("odd/amass_betas_per_frame")
    main(["motions", str(folder / "m06_betas_per_frame.npz"), "--body", str(folder / "body"),
          "--out", str(tmp_path / "out")])  # fmt: skip
    betas = np.load(tmp_path / "out/clips/m06_betas_per_frame/clip.npz")["betas"]
    np.testing.assert_allclose(betas, [*np.linspace(1, -1, 10), *[0.0] * 6], atol=1e-12)


PARTS = {
    "root_orient": ("global_orient", 3), "pose_body": ("body_pose", 63),
    "pose_hand": ("hand_pose", 90), "pose_jaw": ("jaw_pose", 3), "pose_eye": ("eye_pose", 6),
}  # fmt: skip


@pytest.mark.parametrize("form", ["amass", "smplx", "without hands", "joints", "smpl"])
def test_poses_in_parts(tmp_path, small_body, form):
    rng = np.random.default_rng(0)
    parts = {key: rng.normal(scale=0.3, size=(6, n)) for key, (_, n) in PARTS.items()}
    hands = parts["pose_hand"] if form in ("amass", "smplx") else np.zeros((6, 90))
    face = np.zeros((6, 9))
    whole = {"poses": np.c_[parts["root_orient"], parts["pose_body"], face, hands],
             "trans": rng.normal(size=(6, 3)), "mocap_frame_rate": 30.0}  # fmt: skip
    split = {"trans": whole["trans"], "mocap_frame_rate": 30.0}
    if form == "amass":
        split |= parts
    elif form == "smplx":
        split |= {PARTS[key][0]: parts[key] for key in ("root_orient", "pose_body")}
        split |= {"left_hand_pose": hands[:, :45], "right_hand_pose": hands[:, 45:]}
        split["transl"] = split.pop("trans")
    elif form == "smpl":
        whole["poses"] = np.c_[parts["root_orient"], parts["pose_body"], hands[:, :6]]
        split |= {"global_orient": parts["root_orient"].reshape(6, 1, 3)}
        split |= {"body_pose": whole["poses"][:, 3:].reshape(6, 23, 3)}
    elif form == "joints":
        split |= {"poses": whole["poses"].reshape(6, 55, 3)}
    else:
        split |= {key: parts[key] for key in ("root_orient", "pose_body")}
    np.savez(tmp_path / "whole.npz", **whole)
    np.savez(tmp_path / "split.npz", **split)
    assert len(find_motions(tmp_path)) == 2
    read = [read_motion(tmp_path / f"{name}.npz", small_body) for name in ("split", "whole")]
    np.testing.assert_array_equal(read[0].rotmats, read[1].rotmats)
    np.testing.assert_array_equal(read[0].pelvis_m, read[1].pelvis_m)


@pytest.mark.parametrize(
    ("key", "said"),
    [("pose_body", r"poses are \(6, 3\)"), ("trans", r"trans is \(3, 6\) for 6 frames")],
)
def test_a_part_with_its_axes_exchanged_is_refused(tmp_path, small_body, key, said):
    """Its numbers were taken in the wrong order, without a word."""
    rng = np.random.default_rng(0)
    parts = {"root_orient": 3, "pose_body": 63, "trans": 3}
    arrays = {name: rng.normal(scale=0.3, size=(6, n)) for name, n in parts.items()}
    np.savez(tmp_path / "a.npz", mocap_framerate=30.0, **arrays | {key: arrays[key].T})
    with pytest.raises(BadMotionFile, match=said):
        read_motion(tmp_path / "a.npz", small_body)


def test_complex_numbers_are_no_poses(tmp_path, small_body):
    poses, trans = np.full((6, 72), 0.1 + 1j), np.zeros((6, 3))
    np.savez(tmp_path / "a.npz", poses=poses, trans=trans, mocap_framerate=30.0)
    with pytest.raises(BadMotionFile, match="poses does not hold numbers"):
        read_motion(tmp_path / "a.npz", small_body)


@pytest.mark.parametrize("gender", ["b'female'", 'b"FEMALE"', "f", " Female ", b"female"])
def test_genders(tmp_path, small_body, gender):
    arrays = {"poses": np.zeros((6, 72)), "trans": np.zeros((6, 3)), "mocap_framerate": 30.0}
    np.savez(tmp_path / "a.npz", betas=np.ones(10), gender=np.array(gender), **arrays)
    female = replace(small_body, name="smpl-female")
    assert read_motion(tmp_path / "a.npz", female, up="z").shape[0] == 1.0
    np.savez(tmp_path / "b.npz", betas=np.ones((5, 10)), gender=np.array(gender), **arrays)
    with pytest.raises(BadMotionFile, match=r"betas are \(5, 10\) for 6 frames"):
        read_motion(tmp_path / "b.npz", female)


@pytest.mark.parametrize(("rate", "fps_hz"), [(120.0, 60.0), (60.0, 60.0), (30.0, 30.0)])
def test_cmus_index_settles_60_against_120_alone(tmp_path, small_body, rate, fps_hz):
    path = tmp_path / "CMU" / "62" / "62_11_poses.npz"
    path.parent.mkdir(parents=True)
    np.savez(path, poses=np.zeros((6, 72)), trans=np.zeros((6, 3)), mocap_framerate=rate)
    read = read_file(path, small_body, ReadConfig(up="y"))
    assert (read.motion.fps_hz, read.rate_from) == (fps_hz, "CMU's index" if rate > 60 else "file")


def test_a_walk_that_is_too_fast_gets_a_remark(walk_path, small_body):
    assert read_file(walk_path, small_body, DEFAULT_READING).remarks == ()
    (remark,) = read_file(walk_path, small_body, ReadConfig(fps_hz=90)).remarks
    assert "walks at 4." in remark and remark.endswith("Give the true frame rate with --fps-hz")


def test_a_path_in_centimetres_or_without_one(tmp_path, small_body):
    trans_m = np.c_[np.arange(60) * 1.3 / 30, np.zeros((60, 2))]
    arrays = {"poses": np.zeros((60, 72)), "mocap_framerate": 30.0}
    np.savez(tmp_path / "m.npz", trans=trans_m, **arrays)
    np.savez(tmp_path / "cm.npz", trans=100 * trans_m, **arrays)
    (remark,) = read_file(tmp_path / "cm.npz", small_body, ReadConfig(up="y")).remarks
    assert remark.startswith("goes at") and "another unit" in remark and "--unit-m" in remark
    read = [read_motion(tmp_path / f"{name}.npz", small_body, up="y", unit_m=unit_m)
            for name, unit_m in (("m", None), ("cm", 0.01))]  # fmt: skip
    np.testing.assert_allclose(read[0].pelvis_m, read[1].pelvis_m, atol=1e-12)
    np.savez(tmp_path / "romp.npz", global_orient=np.zeros((6, 3)), body_pose=np.zeros((6, 69)))
    with pytest.raises(BadMotionFile, match="no AMASS motion, it has no array 'trans'"):
        read_motion(tmp_path / "romp.npz", small_body)


def test_a_joint_map_may_have_the_missing_names_alone(walk_path, small_body):
    wanted = read_motion(walk_path, small_body)
    text = walk_path.read_text().replace("LeftLeg\n", "Bone7\n").replace("RightFoot\n", "Bone9\n")
    walk_path.write_text(text)
    with pytest.raises(BadMotionFile, match="known to be left_knee.*--joint-map"):
        read_motion(walk_path, small_body)
    names = {"Bone7": "left_knee", "Bone9": "right_ankle"}
    np.testing.assert_array_equal(
        read_motion(walk_path, small_body, joint_map=names).rotmats, wanted.rotmats
    )


def test_a_missing_path_is_told_first(tmp_path, monkeypatch, gmrdata):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.bvh").write_text("HIERARCHY\n")
    for words, said in (
        (("nothere", "--body", "nobody.npz"), "gmrdata: nothere: no such file or folder\n"),
        (("bad.bvh",), "gmrdata: 1 of 1 files could not be read:\n  bad.bvh: no BVH file"),
    ):
        fails_cleanly(gmrdata("motions", *words), said)
    with pytest.raises(MissingInput, match="no such file"):
        read_motion(tmp_path / "a.npz", None)  # type: ignore[arg-type]
