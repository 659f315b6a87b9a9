"""What a phone felt as up, in each app's axes, against a measured floor; and what is refused."""

import json
import tarfile
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.read.frames import read_frames, write_image
from gmrdata.read.gravity import read_gravity
from gmrdata.read.video import VideoConfig, as_frames
from gmrdata.values.errors import BadIntrinsics, MissingInput
from gmrdata.values.frame_set import FrameSet
from tests.frame_sets import frame_set
from tests.read.videos import make_video, picture

FRAMES = [0, 2, 5]
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])


def of_video(numbers: Sequence[int], n_frames: int | None = None) -> FrameSet:
    return frame_set(np.array(numbers), (64, 48), 30.0, n_frames)


@pytest.fixture(scope="module")
def cameras() -> np.ndarray:
    """(6, 3, 3) rotations of six cameras in OpenCV's axes to a world with y up."""
    turns = Rotation.from_euler(
        "yxz", [[20 * i, 5 * i, 30 - 7 * i] for i in range(6)], degrees=True
    )
    return np.asarray(turns.as_matrix() @ OPENGL_FROM_OPENCV)


def record3d(cameras: np.ndarray) -> dict[str, Any]:
    """Poses from the first frame, and its own, in OpenGL's axes."""
    opengl = cameras @ OPENGL_FROM_OPENCV
    from_first = opengl[0].T @ opengl
    quaternions = Rotation.from_matrix(np.concatenate([opengl[:1], from_first])).as_quat()
    rows = np.c_[quaternions, np.zeros((len(quaternions), 3))].tolist()
    return {"initPose": rows[0], "poses": rows[1:], "K": [1.0] * 9}


def odometry(cameras: np.ndarray) -> str:
    rows = [
        f"{n / 60}, {n:06d}, 0.1, 0.2, 0.3, {', '.join(map(str, quaternion))}"
        for n, quaternion in enumerate(Rotation.from_matrix(cameras).as_quat())
    ]
    return "\n".join(["timestamp, frame, x, y, z, qx, qy, qz, qw", *rows])


def table(cameras: np.ndarray) -> str:
    pulls = -9.81 * cameras[:, 1]
    rows = [f"{n},{x},{y},{z}" for n, (x, y, z) in enumerate(pulls)]
    return "\r\n".join(["\ufeffframe,x,y,z", *rows])


@pytest.mark.parametrize("kind", ["record3d", "odometry", "table"])
def test_up_is_in_the_cameras_axes(kind, cameras, tmp_path):
    texts = {
        "record3d": json.dumps(record3d(cameras)),
        "odometry": odometry(cameras),
        "table": table(cameras),
    }
    (tmp_path / "felt").write_text(texts[kind], encoding="utf-8")
    up_cam = read_gravity(tmp_path / "felt", of_video([0, 2, 5, 6]))
    assert np.allclose(up_cam[:3], cameras[FRAMES, 1], atol=1e-9)
    assert np.isnan(up_cam[3]).all()  # the file ends before


def test_an_upright_camera_has_up_at_minus_y(tmp_path):
    (tmp_path / "a.csv").write_text("frame,x,y,z\n0,0,9.8,0\n1,0,1,0\n")
    assert read_gravity(tmp_path / "a.csv", of_video(range(2))).tolist() == [[0, -1, 0]] * 2


def test_a_phone_feels_the_floor_that_its_lidar_measured(shared_path, tmp_path):
    with tarfile.open(shared_path("video/dance.tar")) as tar:
        content = tar.extractfile("dance/metadata")
        assert content is not None
        (tmp_path / "metadata").write_bytes(content.read())
    up_cam = read_gravity(tmp_path / "metadata", of_video(range(626), n_frames=626))
    with np.load(shared_path("real/dance_lidar.npz")) as measured:
        up_world, cameras = measured["up"], measured["world_from_cam"][:, :3, :3]
    felt = np.einsum("nij,nj->ni", cameras, up_cam)
    off_deg = np.rad2deg(np.arccos(felt @ up_world))
    assert off_deg == pytest.approx(0.381, abs=0.001)  # the world of its poses is off by 10.4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "columns"),
        ("frame,x,y\n0,1,2\n", "columns frame, x, y"),
        ("frame,x,y,z\n", "no rows"),
        ("frame,x,y,z\n0,1,2,nan\n", "finite"),
        ("frame,x,y,z\n0,1,2\n", "float"),
        ("frame,x,y,z\n0,0,0,0\n", "zeros"),
        ("frame,x,y,z\n0,0,1,0\n0,0,1,0\n", "each once"),
        ("frame,x,y,z\n0.5,0,1,0\n", "whole numbers"),
        ("frame,x,y,z\n90,0,1,0\n91,0,1,0\n", "hardly any of the video's frames 0-5"),
        ('{"poses": [[0, 0, 0, 1, 0, 0, 0]]}', "no initPose"),
        ('{"initPose": [0, 0, 0, 1, 0, 0, 0], "poses": [[0, 0, 0, 1]]}', "seven numbers"),
        ('{"initPose": [0, 0, 0, 0, 0, 0, 0], "poses": [[0, 0, 0, 1, 0, 0, 0]]}', "zero norm"),
        ('{"initPose": [0, 0, 0, 1, 0, 0, 0], "poses": []}', "seven numbers"),
        ('{"initPose"', "delimiter"),
        ('{"a":' * 100_000, "recursion"),
        ('{"initPose": [0, 0, 0, 1, 0, 0, 0], "poses": [[1' + "0" * 400 + "]]}", "too large"),
        (f"frame,x,y,z\n{'1' * 200_000},0,1,0\n", "field larger"),
    ],
)
def test_what_is_no_gravity_is_refused(text, said, tmp_path):
    path = tmp_path / "felt.csv"
    path.write_text(text)
    with pytest.raises(BadIntrinsics) as caught:
        read_gravity(path, of_video(FRAMES))
    assert said in str(caught.value) and str(path) in str(caught.value)


def test_images_out_of_a_longer_recording_do_not_get_the_gravity_of_its_start(cameras, tmp_path):
    felt, images = tmp_path / "metadata", tmp_path / "images"
    images.mkdir()
    for number in range(100, 106):
        write_image(images / f"{number}.jpg", picture(0))
    folder = read_frames(images)
    felt.write_text(json.dumps(record3d(np.tile(cameras, (3, 1, 1)))))
    said = (
        "metadata: has gravity up to frame 17, and there are 6 frames; give the whole video with "
        "--from and --to, or a .csv whose frame 0 is the first"
    )
    with pytest.raises(BadIntrinsics, match=said):
        read_gravity(felt, folder)
    video = make_video(tmp_path / "a.mp4", [picture(number) for number in range(18)])
    part = as_frames(video, tmp_path / "part", VideoConfig(from_s=0.08, to_s=0.2))
    assert np.allclose(read_gravity(felt, part), cameras[2:6, 1], atol=1e-9)

    for n_poses in (6, 7):  # and a last pose without a picture
        felt.write_text(json.dumps(record3d(np.tile(cameras, (2, 1, 1))[:n_poses])))
        assert np.allclose(read_gravity(felt, folder), cameras[:, 1], atol=1e-9)


def test_other_bytes_and_no_file_are_refused(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"\x00\x00\x00\x18ftyp\xff\xfe")
    with pytest.raises(BadIntrinsics, match="record3d's metadata"):
        read_gravity(tmp_path / "a.mp4", of_video(FRAMES))
    with pytest.raises(MissingInput, match="no such file"):
        read_gravity(tmp_path / "gone", of_video(FRAMES))
