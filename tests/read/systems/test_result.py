"""Broken results of other systems are refused with the file, whatever part of them is broken."""

import pickle  # noqa: TID251  Of plain arrays, to read them.
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.read.systems.entries import AXIS_ANGLES
from gmrdata.read.systems.result import read_system
from gmrdata.read.systems.sam3d import _JOINTS
from gmrdata.values.body import JOINT, WORLD_FROM_REST
from gmrdata.values.errors import BadMotionFile, GmrdataError, MissingInput
from gmrdata.values.people import Crop, EstimatedPeople, Part, Pinhole
from gmrdata.world.placement import assumed_place
from tests.joblib_layout import joblib_bytes
from tests.read import system_files

T = 4


def vibe(path: Path, **change: Any) -> Path:
    person = system_files.vibe_person(T)
    person = {key: person[key] for key in ("pose", "betas", "orig_cam", "frame_ids")}
    return system_files.write_joblib(path / "vibe_output.pkl", {1: _changed(person, change)})


def wham(path: Path, **change: Any) -> Path:
    person: dict[str, Any] = {"pose_world": np.zeros((T, 72)), "trans_world": np.zeros((T, 3))}
    person |= {"betas": np.zeros((T, 10)), "frame_ids": np.arange(T)}
    return system_files.write_joblib(path / "wham_output.pkl", {1: _changed(person, change)})


def gvhmr(path: Path, **change: Any) -> Path:
    params = system_files.gvhmr_params(np.zeros((T, 63)), np.zeros((T, 3)), np.zeros((T, 3)))
    person = _changed({key: one.numpy() for key, one in params.items()}, change)
    tensors = {key: torch.from_numpy(np.asarray(value)) for key, value in person.items()}
    content = {"smpl_params_global": tensors}
    return system_files.write_torch(path / "hmr4d_results.pt", content)


def gem(path: Path, **change: Any) -> Path:
    person = {"body_pose": np.zeros((T, 228)), "global_orient": np.zeros((T, 3))}
    person = _changed(person | {"transl": np.ones((T, 3))}, change)
    content = {"body_params_global": person, "body_params_incam": dict(person)}
    both = {
        key: {name: torch.from_numpy(value) for name, value in one.items()}
        for key, one in content.items()
    }
    return system_files.write_torch(path / "hpe_results.pt", both)


def sam3d(path: Path, **change: Any) -> Path:
    np.savez(path / "rows.npz", **_changed(sam3d_rows(), change))
    return path / "rows.npz"


def sam3d_rows() -> dict[str, Any]:
    """T pictures of 640x480 px of people who stand as in MHR's axes, 3 m before 500 px."""
    places_m = np.zeros((T, 127, 3))
    places_m[:, [2, 3, 18, 19]] = [[0.1, 0, 0], [0.1, 0.4, 0], [-0.1, 0, 0], [-0.1, 0.4, 0]]
    joint_from_smpl = Rotation.from_rotvec([row[1:] for row in _JOINTS]).as_matrix()
    rotmats = np.tile(np.eye(3), (T, 127, 1, 1))
    rotmats[:, [row[0] for row in _JOINTS]] = np.swapaxes(joint_from_smpl, 1, 2)
    points_m = np.random.default_rng(0).normal(0.0, 0.4, (T, 70, 3))
    shift_m = np.tile([0.2, 0.1, 3.0], (T, 1))
    seen_m = points_m + shift_m[:, None]
    return {
        "pred_global_rots": rotmats,
        "pred_joint_coords": places_m,
        "pred_cam_t": shift_m,
        "pred_keypoints_3d": points_m,
        "pred_keypoints_2d": 500.0 * seen_m[..., :2] / seen_m[..., 2:] + [320.0, 240.0],
    }


def tram(path: Path, **change: Any) -> Path:
    people = {
        "pred_rotmat": np.tile(np.eye(3), (T, 24, 1, 1)),
        "pred_shape": np.zeros((T, 10)),
        "pred_trans": np.zeros((T, 1, 3)),
        "frame": np.arange(T),
    }
    camera = {"world_cam_R": np.tile(np.eye(3), (T, 1, 1)), "world_cam_T": np.zeros((T, 3))}
    (path / "hps").mkdir(exist_ok=True)
    both = _changed(people | camera, change)
    for name, keys in (("camera.npy", camera), ("hps/hps_track_0.npy", people)):
        kept = {key: both[key] for key in keys if key in both}
        np.save(path / name, kept)  # type: ignore[arg-type]  # as TRAM does
    return path


def slahmr(path: Path, **change: Any) -> Path:
    arrays = {
        "trans": np.zeros((2, T, 3)),
        "root_orient": np.zeros((2, T, 3)),
        "pose_body": np.zeros((2, T, 63)),
        "betas": np.zeros((2, 16)),
        "cam_R": np.tile(np.eye(3), (2, T, 1, 1)),
        "cam_t": np.zeros((2, T, 3)),
    }
    tracks = ", ".join(f'"{n}": {{"index": {n}, "vis_mask": {[1] * T}}}' for n in range(2))
    meta = f'{{"seq_interval": [0, {T}], "data_interval": [0, {T}]}}'
    (path / "track_info.json").write_text(f'{{"tracks": {{{tracks}}}, "meta": {meta}}}')
    np.savez(path / "x_000040_world_results.npz", **_changed(arrays, change))
    return path / "x_000040_world_results.npz"


def amass(path: Path, **change: Any) -> Path:
    arrays = {"poses": np.zeros((T, 72)), "trans": np.zeros((T, 3)), "mocap_framerate": 30.0}
    np.savez(path / "x.npz", **_changed(arrays, change))
    return path / "x.npz"


def test_vibe_saw_a_tenth_more_than_its_box(tmp_path):
    """A box of 200 px whose middle is 100 px right of that of 640x480 px, as demo.py writes it."""
    crop, half_px = np.array([0.8, 0.1, -0.2]), np.array([320, 240])
    scales = crop[0] * 200 / (2 * half_px)
    person = {
        "pose": np.zeros((1, 72)),
        "betas": np.zeros((1, 10)),
        "orig_cam": np.r_[scales, np.array([100, 0]) / half_px / scales + crop[1:]][None],
        "pred_cam": crop[None],
        "frame_ids": np.arange(1),
    }
    box_alone = {key: value for key, value in person.items() if key != "pred_cam"}
    path = tmp_path / "vibe_output.pkl"
    path.write_bytes(joblib_bytes({1: person, 2: box_alone}))
    first, second = (one.in_camera for one in read_system(path).people)
    assert first is not None and first.in_picture is not None and second is not None
    ((*scales, tx, ty),) = first.in_picture
    # Of the crop of 220 px, a point at (X, Y) is 110 s (X + tx) right of the middle.
    assert half_px * scales == pytest.approx(110 * 0.8)
    at_px = half_px * scales * np.array([0.3 + tx, 0.4 + ty])
    assert at_px == pytest.approx([100 + 110 * 0.8 * (0.3 + 0.1), 110 * 0.8 * (0.4 - 0.2)])
    # Without `pred_cam` people stay where they are in the picture.
    wider = person["orig_cam"] * [1.1, 1.1, 1 / 1.1, 1 / 1.1]
    assert second.in_picture is not None
    np.testing.assert_allclose(second.in_picture, wider)


@pytest.mark.parametrize(
    ("name", "crop_over_box"),
    [
        ("vibe_output.pkl", 1.1),
        ("any.pkl", 1.1),
        ("tcmr_output.pkl", 1.0),
        ("GLoT/any.pkl", 1.0),
        ("output.pkl", 1.0),
        ("mpsnet_output.pkl", 1.1 / 1.2),
        ("MPS-Net/any.pkl", 1.1 / 1.2),
        ("meva_output.pkl", 1.2),
        ("glottis/any.pkl", 1.1),
    ],
)
def test_systems_with_vibes_keys_saw_other_crops(name, crop_over_box, tmp_path):
    """demo.py of TCMR and GLoT takes the box times 1.2 and writes it so; PyMAF takes the box alone;
    MPS-Net takes 1.1 and writes 1.2, MEVA takes 1.2 and writes the box.  All were 1.1."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    person = system_files.vibe_person(T) | {"bboxes": np.full((T, 4), 200.0)}
    for added, widened in (
        ({}, crop_over_box),
        ({"joints2d_img_coord": np.zeros((T, 49, 2))}, 1.1),
    ):
        (tmp_path / name).write_bytes(joblib_bytes({1: person | added}))
        (found,) = read_system(tmp_path / name, "world").people
        assert found.in_camera is not None and isinstance(found.in_camera.camera, Crop)
        np.testing.assert_allclose(found.in_camera.camera.side_px, 200 * widened)
        assert found.in_camera.in_picture is not None
        np.testing.assert_allclose(found.in_camera.in_picture[:, :2], widened)


def test_pares_poses_are_matrices_of_the_box(tmp_path):
    """They were refused as (4, 24, 3, 3), not (T, 72)."""
    person = system_files.vibe_person(T) | {"bboxes": np.full((T, 4), 200.0)}
    rotmats = system_files.rotmats(person["pose"])
    pare = person | {"pose": rotmats.astype(np.float32), "smpl_joints2d": np.zeros((T, 49, 2))}
    system_files.write_joblib(tmp_path / "pare_output.pkl", {1: pare})
    (found,) = read_system(tmp_path, "world").people
    assert found.in_camera is not None and isinstance(found.in_camera.camera, Crop)
    np.testing.assert_allclose(found.in_camera.root_rotmats, rotmats[:, 0], atol=1e-6)
    np.testing.assert_allclose(found.local_rotmats, rotmats[:, 1:], atol=1e-6)
    np.testing.assert_allclose(found.in_camera.camera.side_px, 200)
    system_files.write_joblib(tmp_path / "pare_output.pkl", {1: pare | {"pose": 2 * rotmats}})
    with pytest.raises(BadMotionFile, match="pose of person_1 holds matrices that are no rot"):
        read_system(tmp_path)


@pytest.mark.parametrize(
    ("folder", "first", "expected"),
    [("outputs//_DEMO/walk/img", 1, 0), ("outputs//_DEMO/walk/img", 101, 100), ("walk", 101, 0)],
)
def test_phalp_that_began_later_is_counted_by_its_images(folder, first, expected, tmp_path):
    """With phalp.start_frame=100 its times begin at 0, and image 101 was taken for frame 0."""
    poses = system_files.phalp_poses(T)
    frames = [system_files.phalp_frame(n, {1: poses[n]}) for n in range(T)]
    content = {f"{folder}/{first + n:06d}.jpg": frame for n, frame in enumerate(frames)}
    found = read_system(system_files.write_joblib(tmp_path / "demo_walk.pkl", content))
    np.testing.assert_array_equal(found.people[0].frame_numbers, expected + np.arange(T))
    assert found.n_frames == expected + T


def test_gem_x_is_off_somas_t_pose_and_has_two_necks(tmp_path):
    """LeftArm is SOMA's joint 12, Neck1 and Neck2 are 4 and 5, RightToeBase is 75."""
    pose = np.zeros((T, 77, 3))
    pose[:, 12], pose[:, 4], pose[:, 5], pose[:, 75] = (
        [0, 0, 1],
        [0.2, 0, 0],
        [0.3, 0, 0],
        [0, 1, 0],
    )
    params = {"body_pose": pose[:, 1:].reshape(T, -1), "global_orient": pose[:, 0]}
    params["transl"] = np.tile([1.0, 2.0, 3.0], (T, 1))
    tensors = {key: torch.from_numpy(value) for key, value in params.items()}
    content = {"body_params_global": tensors, "net_outputs": {"static_conf_logits": None}}
    path = system_files.write_torch(tmp_path / "hpe_results.pt", content)
    (person,) = read_system(path, "world").people
    turns = Rotation.from_matrix(person.local_rotmats[0]).as_rotvec()
    expected = np.zeros((24, 3))
    expected[JOINT["left_shoulder"]], expected[JOINT["neck"]] = [0, 0, 1], [0.5, 0, 0]
    expected[JOINT["right_foot"]] = [0, 1, 0]
    np.testing.assert_allclose(turns, expected[1:], atol=1e-6)
    assert person.in_world is not None and person.lacks["camera"]
    # transl is where the hips are, y up.
    assert person.rest_pelvis_m == pytest.approx(0)
    z_up = person.in_world.z_up_from_file[0, :3, :3]
    assert z_up @ person.in_world.transl_m[0] == pytest.approx([1, -3, 2])


def test_gem_smpl_has_gem_xs_keys_and_gvhmrs_body(tmp_path):
    """scripts/demo/demo_smpl_hpe.py of NVlabs/GENMO saves these keys, body_pose (T, 63)."""
    pose, at = np.full((T, 63), 0.1), np.ones((T, 3))
    params = system_files.gvhmr_params(pose, at, at)
    content = {"body_params_incam": params, "body_params_global": params}
    content["K_fullimg"] = torch.tensor([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]).repeat(T, 1, 1)
    found = read_system(system_files.write_torch(tmp_path / "smpl_params.pt", content), "camera")
    as_gvhmr = {
        key.replace("body", "smpl") if "body" in key else key: one for key, one in content.items()
    }
    path = system_files.write_torch(tmp_path / "hmr4d_results.pt", as_gvhmr)
    one, other = found.people[0], read_system(path, "camera").people[0]
    assert found.system == "gem-smpl" and one.in_world is not None and one.in_camera is not None
    np.testing.assert_array_equal(one.local_rotmats, other.local_rotmats)
    assert one.rest_pelvis_m is other.rest_pelvis_m and one.in_camera.size_px == (640, 480)
    segments = [{"start": 0, "end": T, "type": "video", "video_path": "a.mp4"}]
    system_files.write_torch(path, content | {"segment_info": segments})
    assert read_system(path, "camera").n_frames == T
    segments.append({"start": 3, "end": T, "type": "text", "caption": "a person walks"})
    system_files.write_torch(path, content | {"segment_info": segments})
    with pytest.raises(BadMotionFile, match=r"holds 2 videos or motions of a text"):
        read_system(path)


def test_amass_in_parts_is_no_slahmr(tmp_path):
    """Many tools write AMASS's motions without `poses`; and genders as str() writes bytes."""
    pose = system_files.some_poses(T, 22)
    parts = {"root_orient": pose[:, :3], "pose_body": pose[:, 3:], "trans": np.ones((T, 3))}
    np.savez(
        tmp_path / "x.npz", **parts, betas=np.zeros(16), gender="b'female'", mocap_frame_rate=30
    )
    found = read_system(tmp_path / "x.npz", "world")
    (person,) = found.people
    assert (found.system, found.fps_hz, person.betas_body) == ("amass", 30.0, "smpl-female")
    np.testing.assert_allclose(
        person.local_rotmats[:, :21], system_files.rotmats(pose)[:, 1:], atol=1e-6
    )
    np.savez(tmp_path / "x.npz", **parts, floor_plane=np.zeros(4))
    with pytest.raises(BadMotionFile, match=r"HuMoR's motion before the camera, which leans"):
        read_system(tmp_path / "x.npz", "world")


@pytest.mark.parametrize("key", ["gender", "betas"])
def test_whose_body_it_is_does_not_get_lost(key, tmp_path):
    """Saved as an object it was left out, and a woman's betas were taken for a neutral body's."""
    content: dict[str, Any] = {"poses": np.zeros((T, 156)), "trans": np.zeros((T, 3))}
    content |= {"betas": np.zeros(16), "gender": "female", "mocap_framerate": 30.0}
    path = tmp_path / "X.NPZ"
    with path.open("wb") as stream:
        np.savez(stream, **content)
    assert read_system(path, "world").people[0].betas_body == "smpl-female"
    with path.open("wb") as stream:
        np.savez(stream, **(content | {key: np.array(content[key], dtype=object)}))
    with pytest.raises(BadMotionFile, match=r"X\.NPZ: .*save each array of theirs by its name"):
        read_system(path, "world")


def test_poses_by_joint_are_as_those_in_a_row(tmp_path):
    """Motion capture of (T, J, 3) was read, and a result of that form was refused."""
    poses, trans = system_files.some_poses(T), np.ones((T, 3))
    np.savez(tmp_path / "row.npz", poses=poses, trans=trans)
    np.savez(tmp_path / "joints.npz", poses=poses.reshape(T, 24, 3), trans=trans)
    # 22 joints without hands, as those who make GVHMR's results into .npz write them.
    np.savez(tmp_path / "body.npz", poses=poses[:, :66].reshape(T, 22, 3), trans=trans)
    one, other, body = (
        read_system(tmp_path / f"{name}.npz").people[0].local_rotmats
        for name in ("row", "joints", "body")
    )
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(body[:, :21], one[:, :21])
    np.testing.assert_array_equal(body[:, 21:], np.tile(np.eye(3), (T, 2, 1, 1)))


def test_what_whams_api_returns_is_read_as_its_demos_file(tmp_path):
    pose = system_files.some_poses(T)
    world = np.concatenate([pose[:, :3] + 0.5, pose[:, 3:]], axis=1)
    shared = {"trans_world": np.ones((T, 3)), "betas": np.zeros((T, 10))}
    demo = shared | {"pose": pose, "pose_world": world, "frame_ids": np.arange(T) + 2}
    api = shared | {
        "poses_body": system_files.rotmats(pose)[:, 1:].astype(np.float32),
        "poses_root_cam": system_files.rotmats(pose)[:, :1],
        "poses_root_world": system_files.rotmats(world)[:, :1],
        "frame_id": np.arange(T) + 2,
    }
    path = system_files.write_joblib(tmp_path / "results.pkl", {0: demo, 1: api})
    one, other = read_system(path, "world").people
    tensors = {key: torch.from_numpy(value) for key, value in demo.items()}
    again = read_system(system_files.write_torch(tmp_path / "wham.pt", {0: tensors}), "world")
    np.testing.assert_array_equal(again.people[0].local_rotmats, one.local_rotmats)
    assert other.lacks["camera"] == "no 'trans'" and one.in_world and other.in_world
    assert other.frame_numbers.tolist() == one.frame_numbers.tolist()
    np.testing.assert_allclose(other.local_rotmats, one.local_rotmats, atol=1e-6)
    for key in ("root_rotmats", "z_up_from_cam"):
        np.testing.assert_allclose(
            getattr(other.in_world, key), getattr(one.in_world, key), atol=1e-6
        )


def prompthmr(path: Path, person: Any, camera: Any) -> Path:
    return system_files.write_joblib(
        path / "results.pkl", {"people": {2: person}, "camera": {}, "camera_world": camera}
    )


def prompthmr_person() -> dict[str, Any]:
    parts = {
        key: {"pose": np.zeros((T, 3 * n)), "trans": np.ones((T, 3))}
        for key, n in (("smplx_cam", 25), ("smplx_world", 55))
    }
    return {"frames": np.arange(T) + 3} | parts


def test_prompthmr_stands_before_its_camera(tmp_path):
    lens = {"img_focal": np.float32(700.0), "img_center": np.array([252.0, 448.0])}
    found = read_system(prompthmr(tmp_path, prompthmr_person(), lens), "camera")
    (person,) = found.people
    seen = person.in_camera
    assert person.name == "person_2" and person.frame_numbers.tolist() == [3, 4, 5, 6]
    assert seen is not None and seen.size_px == (504, 896) and isinstance(seen.camera, Pinhole)
    assert person.in_world is not None and not person.in_world.has_camera_path


@pytest.mark.parametrize(
    ("change", "camera", "said"),
    [
        (lambda one: 0, {}, "person_2 has no 'frames'"),
        (lambda one: {"frames": one["frames"]}, {}, "person_2 has no 'smplx_cam'"),
        (lambda one: one | {"smplx_world": 0}, {}, "smplx_world of person_2 has no 'pose'"),
        (lambda one: one | {"smplx_world": one["smplx_cam"]}, {}, r"is \(4, 75\), not \(4, 165\)"),
        (lambda one: one, 0, "person_2 has no 'img_focal', so no motion before the camera"),
        (
            lambda one: one,
            {"Rcw": np.tile(np.eye(3), (3, 1, 1)), "Tcw": np.zeros((3, 3))},
            "frames to 6, but results.pkl has 3 cameras",
        ),
    ],
)
def test_prompthmrs_parts_that_lack(change, camera, said, tmp_path):
    path = prompthmr(tmp_path, change(prompthmr_person()), camera)
    with pytest.raises(BadMotionFile, match=said) as caught:
        read_system(path, "camera")
    assert str(path) in str(caught.value)


def test_the_joints_of_mhr_lie_along_the_limbs():
    """MHR's limbs lie along their joints' own x axis; a T-pose's are down, or to the sides."""
    sides = {"left": 1.0, "right": -1.0}
    for side, sign in sides.items():
        bones = {"hip": [0, -1, 0], "knee": [0, -1, 0], "shoulder": [sign, 0, 0]}
        for part, bone in (bones | {"elbow": [sign, 0, 0]}).items():
            turn = Rotation.from_rotvec(_JOINTS[JOINT[f"{side}_{part}"]][1:])
            assert turn.apply(bone) == pytest.approx([sign, 0, 0], abs=0.04), (side, part)


def test_sam_3d_body_shows_the_camera_and_stands(tmp_path):
    rows = sam3d_rows()
    (person,) = read_system(sam3d(tmp_path), "camera").people
    assert person.in_camera is not None and isinstance(person.in_camera.camera, Pinhole)
    np.testing.assert_allclose(person.in_camera.camera.focal_px, 500.0)
    assert person.in_camera.size_px == (640, 480)
    np.testing.assert_allclose(person.local_rotmats, np.tile(np.eye(3), (T, 23, 1, 1)), atol=1e-9)
    assert person.in_camera.root_rotmats[0] == pytest.approx(np.diag([1.0, -1.0, -1.0]))
    assert person.in_camera.transl_m is not None
    assert person.in_camera.transl_m[0] == pytest.approx([0.2, 0.1 - 0.045, 3.0 - 0.008])
    # The same as dicts by picture, one of them without anybody.
    pictures: list[Any] = [[{key: value[t] for key, value in rows.items()}] for t in range(T)]
    path = system_files.write_joblib(tmp_path / "rows.pkl", [*pictures[:2], [], *pictures[2:]])
    (again,) = read_system(path, "camera").people
    assert again.frame_numbers.tolist() == [0, 1, 3, 4]
    np.testing.assert_array_equal(again.local_rotmats, person.local_rotmats)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: [[rows, rows]], "picture 0 has 2 people, and nothing tells who is who"),
        (
            lambda rows: [[rows | {"person_id": 1}, rows | {"person_id": 1}]],
            "person_1 is twice in picture 0",
        ),
        (
            lambda rows: [
                rows | {"pred_global_rots": np.diag([1, -1, -1]) @ rows["pred_global_rots"]}
            ],
            "pred_global_rots and pred_joint_coords of person_0 are not of the same axes",
        ),
        (
            lambda rows: [rows | {"pred_keypoints_2d": rows["pred_keypoints_2d"][::-1]}],
            "are not of one camera|the focal length in the keypoints",
        ),
    ],
)
def test_rows_of_sam_3d_body_that_are_unclear(change, said, tmp_path):
    """facebookresearch/sam-3d-body#32, #68, MHR#38: somebody turned one of two that go together."""
    rows = {key: value[0] for key, value in sam3d_rows().items()}
    path = system_files.write_joblib(tmp_path / "rows.pkl", change(rows))
    with pytest.raises(BadMotionFile, match=said):
        read_system(path, "camera")


WRITERS: dict[str, tuple[Callable[..., Path], tuple[str, ...]]] = {
    "vibe": (vibe, ("pose", "betas", "orig_cam", "frame_ids")),
    "wham": (wham, ("pose_world", "trans_world", "betas", "frame_ids")),
    "gvhmr": (gvhmr, ("body_pose", "global_orient", "transl")),
    "gem-x": (gem, ("body_pose", "global_orient", "transl")),
    "sam-3d-body": (sam3d, tuple(sam3d_rows())),
    "tram": (
        tram,
        ("pred_rotmat", "pred_shape", "pred_trans", "frame", "world_cam_R", "world_cam_T"),
    ),
    "slahmr": (slahmr, ("trans", "root_orient", "pose_body", "betas", "cam_R", "cam_t")),
    "amass": (amass, ("poses", "trans", "mocap_framerate")),
}
OPTIONAL = {"frame", "mocap_framerate", "cam_R", "cam_t"}
PARTS = [(system, key) for system, (_, keys) in WRITERS.items() for key in keys]
BROKEN = [(*part, how) for part in PARTS for how in ("nan", "short", "flat", "gone")]
BROKEN += [("wham", key, how) for key in WRITERS["wham"][1] for how in ("wide", "text")]
BROKEN += [("wham", "frame_ids", "not rising"), ("vibe", "frame_ids", "not rising")]
TAKEN = [("wham", "betas", "wide")]  # SMPL has up to 300 coefficients
TAKEN += [(system, key, "gone") for system, key in PARTS if key in OPTIONAL]


def _changed(arrays: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    for key, how in change.items():
        value = np.asarray(arrays[key], dtype=float)
        if how == "nan":
            arrays[key] = np.where(np.arange(value.size).reshape(value.shape) == 0, np.nan, value)
        elif how == "short":
            arrays[key] = value[:-1] if value.ndim else np.zeros(3)
        elif how == "flat":
            arrays[key] = value.ravel()[:-1] if value.ndim else np.zeros(0)
        elif how == "degrees":
            arrays[key] = np.full(value.shape, 60.0)
        elif how == "wide":
            arrays[key] = np.zeros((T, 73))
        elif how == "text":
            arrays[key] = "abc"
        elif how == "not rising":
            arrays[key] = -np.ones(T + 1)
        else:
            del arrays[key]
    return arrays


def _part(system: str) -> Part:
    return "camera" if system == "sam-3d-body" else "world"


@pytest.mark.parametrize("system", WRITERS)
def test_whole_results_are_read(system, tmp_path):
    found = read_system(WRITERS[system][0](tmp_path), _part(system))
    assert found.system == system
    assert [len(one.frame_numbers) for one in found.people] == [T] * len(found.people)


@pytest.mark.parametrize("system", ["vibe", "gvhmr", "gem-x", "tram"])
def test_the_folder_that_a_system_made_for_a_video_is_read(system, tmp_path):
    """It was taken in a batch, and refused for one video as no folder of TRAM's."""
    WRITERS[system][0](tmp_path)
    assert read_system(tmp_path, "world").system == system


@pytest.mark.parametrize(("system", "key", "how"), BROKEN)
def test_a_broken_part_is_refused(system, key, how, tmp_path):
    path = WRITERS[system][0](tmp_path, **{key: how})
    if (system, key, how) in TAKEN:
        assert read_system(path, _part(system)).people
        return
    with pytest.raises(GmrdataError, match=str(path)) as refused:
        read_system(path, _part(system))
    assert type(refused.value) in (BadMotionFile, MissingInput)


@pytest.mark.parametrize("system", [system for system in WRITERS if system != "tram"])
def test_a_file_that_is_cut_off_is_refused(system, tmp_path):
    path = WRITERS[system][0](tmp_path)
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 50, dtype=int):
        path.write_bytes(whole[:length])
        with pytest.raises(GmrdataError, match=f"{path}: "):
            read_system(path, _part(system))


@pytest.mark.parametrize(("system", "key"), [part for part in PARTS if part[1] in AXIS_ANGLES])
def test_axis_angles_in_degrees_are_refused(system, key, tmp_path):
    path = WRITERS[system][0](tmp_path, **{key: "degrees"})
    with pytest.raises(BadMotionFile, match=f"turns of up to 104 in .*{key}.*: degrees, where"):
        read_system(path, "world")


def test_a_folder_that_is_no_result_is_named(tmp_path):
    with pytest.raises(
        MissingInput, match=r"no camera\.npy and hps/.*\. Known are results of VIBE"
    ):
        read_system(tmp_path)
    np.savez(tmp_path / "x.npz", other=np.zeros(3))
    with pytest.raises(BadMotionFile, match=r"x\.npz: not TRAM's .* it has other"):
        read_system(tmp_path / "x.npz")
    np.savez(tmp_path / "romp.npz", results=np.array({"smpl_thetas": np.zeros(72)}, dtype=object))
    with pytest.raises(BadMotionFile, match="holds Python's objects; save each array"):
        read_system(tmp_path / "romp.npz")
    (tmp_path / "x.pkl").write_bytes(joblib_bytes({1: {"pose": np.zeros((T, 72))}}))
    with pytest.raises(BadMotionFile, match=r"x\.pkl: person_1 has no 'frame_ids\'"):
        read_system(tmp_path / "x.pkl")


@pytest.mark.parametrize(
    ("name", "begin"),
    [
        ("opencap.trc", "PathFileType\t4\t(X/Y/Z)\ta.trc\n"),
        ("opencap.mot", "Coordinates\nversion=1\nnRows=5\n"),
        ("easymocap.json", '[{"id": 0, "Rh": [[0, 0, 0]], "poses": [[0]]}]'),
        ("mot.txt", "1, 2, 3.0, 4, 5, 6, 1, -1, -1, -1\n"),
        ("take.fbx", "Kaydara FBX Binary  \0"),
        ("page.pkl", "<!DOCTYPE html>"),
        ("motionx.npy", "\x93NUMPY\1\0v\0{'descr': '<f4', 'shape': (9, 322), "),
    ],
)
def test_what_is_no_pickle_is_not_called_a_broken_or_an_unsafe_one(name, begin, tmp_path):
    """A .trc asked for an outside object, as P is a step of a pickle; others were truncated."""
    (tmp_path / name).write_text(begin, "latin-1")
    with pytest.raises(BadMotionFile, match=rf"{name}: holds no poses\. Known are results of"):
        read_system(tmp_path / name)
    (tmp_path / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    with pytest.raises(BadMotionFile, match="holds no poses; it is a Git LFS pointer: fetch"):
        read_system(tmp_path / name)


@pytest.mark.parametrize("protocol", range(6))
def test_pickles_of_all_protocols_are_read(protocol, tmp_path):
    person = {"pose_world": np.zeros((T, 72)), "trans_world": np.zeros((T, 3))}
    person |= {"betas": np.zeros((T, 10)), "frame_ids": np.arange(T)}
    (tmp_path / "x.pkl").write_bytes(pickle.dumps({1: person}, protocol))
    assert read_system(tmp_path / "x.pkl", "world").system == "wham"


def test_two_tracks_of_one_number_are_refused(tmp_path):
    """One of them was left out without a word."""
    folder = tram(tmp_path)
    shutil.copy(folder / "hps/hps_track_0.npy", folder / "hps/hps_track_00.npy")
    with pytest.raises(BadMotionFile, match=r"hps_track_0\.npy and hps_track_00\.npy are of one"):
        read_system(folder)


def test_tram_on_emdb_has_emdbs_own_lens(tmp_path):
    """Its centre is some pixels off the pictures' middle, and both of its files have a focal length
    (scripts/emdb): the people's is the mean of both axes'."""
    shared = {"img_center": np.array([727.0, 951.0])}
    people = {"pred_rotmat": np.tile(np.eye(3), (T, 24, 1, 1)), "pred_shape": np.zeros((T, 10))}
    people |= {"pred_trans": np.ones((T, 1, 3)), "img_focal": np.array(1450.0)} | shared
    camera = {"world_cam_R": np.tile(np.eye(3), (T, 1, 1)), "world_cam_T": np.zeros((T, 3))}
    for name, arrays in (("smpl", people), ("camera", camera | shared | {"img_focal": 1440.0})):
        (tmp_path / name).mkdir()
        np.savez(tmp_path / name / "09_outdoor_walk.npz", **arrays)
    path = tmp_path / "smpl/09_outdoor_walk.npz"
    seen = read_system(path, "camera").people[0].in_camera
    assert seen is not None
    before = assumed_place(seen, (1440, 1920), path).camera
    assert before is not None and before.focal_px[0] == 1450.0
    np.testing.assert_array_equal(before.centre_px[0], shared["img_center"])


@pytest.mark.parametrize("content", [0, 1.5, "x", None, [], [[1]], {"pred_joint_coords": 1}])
def test_pictures_that_are_none(content, tmp_path):
    """Found by changed files: a picture that is a number, or a row that lacks its places."""
    rows = {key: value[0] for key, value in sam3d_rows().items()}
    path = system_files.write_joblib(tmp_path / "rows.pkl", [rows, content])
    if content == []:
        assert len(read_system(path).people[0].frame_numbers) == 1
        return
    with pytest.raises(BadMotionFile, match=r"rows\.pkl: "):
        read_system(path)


def test_a_dict_that_numpy_saved_is_the_same(tmp_path):
    """`np.save(path, result)`, as people keep any system's result."""
    rows = {key: value[0] for key, value in sam3d_rows().items()}
    np.save(tmp_path / "rows.npy", {"0.jpg": [rows]})
    (person,) = read_system(tmp_path / "rows.npy", "camera").people
    assert person.frame_numbers.tolist() == [0]


def test_the_keys_of_a_dict_of_pictures_are_their_numbers(tmp_path):
    """Read in the dict's order, names of a plain sort gave a motion out of order, and numbers with
    a gap one that was too short."""
    row = {key: value[0] for key, value in sam3d_rows().items()}

    def read(pictures: dict[Any, float]) -> EstimatedPeople:
        """Of pictures by key, each with somebody so far before the camera [m]."""
        content = {
            key: [row | {"pred_cam_t": np.array([0.0, 0.0, depth_m])}] if depth_m else []
            for key, depth_m in pictures.items()
        }
        for rows in content.values():
            for one in rows:
                seen_m = one["pred_keypoints_3d"] + one["pred_cam_t"]
                one["pred_keypoints_2d"] = 500.0 * seen_m[:, :2] / seen_m[:, 2:] + [320.0, 240.0]
        return read_system(system_files.write_joblib(tmp_path / "rows.pkl", content), "camera")

    def depths_m(found: EstimatedPeople) -> list[float]:
        (person,) = found.people
        assert person.in_camera is not None and person.in_camera.transl_m is not None
        return person.in_camera.transl_m[:, 2].round(3).tolist()

    sorted_names = {"img/0.jpg": 3.008, "img/1.jpg": 4.008, "img/10.jpg": 13.008}
    sorted_names |= {f"img/{n}.jpg": 3.008 + n for n in range(2, 10)}
    found = read(sorted_names)
    assert depths_m(found) == [3.0 + n for n in range(11)] and found.n_frames == 11
    assert depths_m(read({"left": 4.008, "right": 3.008})) == [4.0, 3.0]
    assert depths_m(read({np.int64(2): 4.008, 1: 3.008})) == [3.0, 4.0]
    found = read({101: 4.008, 100: 0.0} | dict.fromkeys(range(100), 0.0))
    assert found.people[0].frame_numbers.tolist() == [101] and found.n_frames == 102
    for pictures, said in (
        ({0: 3.0, 1: 3.0, 40: 3.0}, r"picture 40 follows on picture 1\. Give an empty list for a"),
        ({5: 3.0, 6: 3.0}, "picture 5 follows on picture 0"),
        ({"1.jpg": 3.0, "01.png": 3.0}, "picture 1 follows on picture 1.* each number once"),
        ({"1.jpg": 3.0, "cover.jpg": 3.0}, "1 of its 2 pictures have no number"),
    ):
        with pytest.raises(BadMotionFile, match=rf"rows\.pkl: {said}"):
            read(pictures)


def test_pickled_motions_of_mosh_and_aist_are_read(tmp_path):
    """AIST++'s world has y up, and its path is as large as its scaling says."""
    rng = np.random.default_rng(0)
    poses, trans = rng.normal(0, 0.3, (5, 72)), rng.normal(0, 1, (5, 3))
    path = tmp_path / "motion.pkl"
    details = {"mocap_frame_rate": 60.0, "cfg": {"surface_model": {"gender": "female"}}}
    mosh = {"fullpose": poses, "trans": trans, "betas": np.zeros(10)}
    mosh |= {"stageii_debug_details": details}
    aist = {"smpl_poses": poses, "smpl_trans": 90.0 * trans, "smpl_scaling": np.array([90.0])}
    found = {}
    for name, content in {"mosh": mosh, "aist": aist}.items():
        path.write_bytes(joblib_bytes(content))
        people = read_system(path)
        assert people.fps_hz == (60.0 if name == "mosh" else None)
        (found[name],) = people.people
    one, other = found["mosh"], found["aist"]
    assert one.betas_body == "smpl-female"  # her shape was taken for a neutral body's
    np.testing.assert_allclose(other.local_rotmats, one.local_rotmats, atol=1e-12)
    assert one.in_world is not None and other.in_world is not None
    np.testing.assert_array_equal(one.in_world.transl_m, trans)
    turned = WORLD_FROM_REST @ one.in_world.root_rotmats
    np.testing.assert_allclose(other.in_world.root_rotmats, turned, atol=1e-12)
    steps_m = np.diff(trans, axis=0) @ WORLD_FROM_REST.T
    np.testing.assert_allclose(np.diff(other.in_world.transl_m, axis=0), steps_m, atol=1e-12)
    path.write_bytes(joblib_bytes(aist | {"smpl_scaling": np.zeros(1)}))
    with pytest.raises(BadMotionFile, match="smpl_scaling is 0"):
        read_system(path)
    path.write_bytes(joblib_bytes(mosh | {"betas": [[1.0, 2.0], [3.0]]}))
    with pytest.raises(BadMotionFile, match="betas of the motion does not hold numbers"):
        read_system(path)
