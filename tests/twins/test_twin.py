"""A twin on disk: the dataset's side has the faults, the images and the truth are exact."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.frames import read_color
from gmrdata.read.threedpw import read_sequence
from gmrdata.read.threedpw_files import SequenceFiles
from gmrdata.threedpw.clips import camera_clip, world_clip
from gmrdata.twins.faults import ExposureConfig, FaultConfig
from gmrdata.twins.twin_set import FilmedPeople, TwinConfig, write_twin
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import BadFrames, BadSequence
from gmrdata.world.compose import motion_in_camera
from tests.motions import with_motion

CONFIG = TwinConfig(
    faults=FaultConfig(invalid_frames=(2, 5)), exposure=ExposureConfig(gain=(1.0, 1.0))
)
EXPOSURE = ExposureConfig(gain=(0.7, 1.4))
Write = Callable[..., SequenceFiles]


def light_of(value: float) -> float:
    return float(((value / 255 + 0.055) / 1.055) ** 2.4)


@pytest.fixture
def frames(tmp_path, jpeg) -> list[Path]:
    paths = [tmp_path / "rendered" / f"{row:05d}.jpg" for row in range(30)]
    paths[0].parent.mkdir()
    for row, path in enumerate(paths):
        path.write_bytes(jpeg(90, 160) + bytes([row]))  # each image is another one
    return paths


@pytest.fixture
def write(tmp_path, walkers, frames, small_body) -> Write:
    def make(
        out: str = "a",
        clips: list[Clip] = walkers,
        seed: int = 0,
        frames: list[Path] = frames,
        config: TwinConfig = CONFIG,
        name: str = "twin_00",
    ) -> SequenceFiles:
        files = SequenceFiles(tmp_path / out / "3DPW", name, "test")
        filmed = FilmedPeople(clips, frames, ["female", "male"], small_body)
        rng = np.random.default_rng(seed)
        return write_twin(files, filmed, tmp_path / out / "truth", config, rng)

    return make


def test_the_dataset_side_drifts_and_its_camera_frame_bodies_are_nearly_right(
    write, walkers, small_body
):
    files = write()
    sequence = read_sequence(files.root, "twin_00")
    assert sequence.problems == ()
    for person, exact in enumerate(walkers):
        clip = camera_clip(sequence, person, [small_body])
        true = motion_in_camera(exact.motion, camera_of(exact).world_from_cam)
        off_m = np.linalg.norm(clip.motion.pelvis_m - true.pelvis_m, axis=1)
        assert off_m[clip.valid].max() <= 0.010 + 1e-9
        assert 0 < (~clip.valid).sum() < 30
        assert (exact.valid | ~clip.valid).all()  # what was not valid stays so
        drifted = world_clip(sequence, person, [small_body])
        assert np.linalg.norm(drifted.motion.pelvis_m - exact.motion.pelvis_m, axis=1)[-1] > 0.15


def test_the_truth_is_kept_and_the_images_are_those_that_were_rendered(
    write, walkers, frames, tmp_path
):
    files = write()
    for person, exact in enumerate(walkers):
        truth = load_clip(tmp_path / "a" / "truth" / f"twin_00.p{person}.npz")
        assert truth.id == f"twin_00.p{person}" and truth.motion.frame == "world"
        assert np.abs(truth.motion.pelvis_m - exact.motion.pelvis_m).max() < 1e-12
        assert np.array_equal(camera_of(truth).world_from_cam, camera_of(exact).world_from_cam)
        assert np.array_equal(truth.image_numbers, np.arange(30))
    for row, frame in enumerate(frames):
        assert files.image_path(row).read_bytes() == frame.read_bytes()


def test_exposure_changes_the_images_as_planned_and_nothing_else(write, tmp_path):
    plain, exposed = write("a"), write("b", config=CONFIG.model_copy(update={"exposure": EXPOSURE}))
    assert plain.pickle_path.read_bytes() == exposed.pickle_path.read_bytes()
    gains = np.load(tmp_path / "b" / "truth" / "twin_00.exposure.npz")["gains"]
    assert gains.shape == (30,) and np.ptp(gains) > 0.2
    grey = np.array([read_color(exposed.image_path(row)).mean() for row in range(30)])
    light = np.array([light_of(value) for value in grey])
    np.testing.assert_allclose(light, gains * light_of(128), rtol=0.02)
    assert (np.load(tmp_path / "a" / "truth" / "twin_00.exposure.npz")["gains"] == 1.0).all()


def test_the_keypoints_are_those_of_the_true_person(write, walkers, small_body):
    from gmrdata.read.openpose import OPENPOSE_JOINTS
    from gmrdata.values.camera import project
    from gmrdata.values.skinning import motion_joints_m

    sequence = read_sequence(write().root, "twin_00")
    for person, exact in zip(sequence.arrays.people, walkers, strict=True):
        joints_m = motion_joints_m(small_body, exact.motion)[:, list(OPENPOSE_JOINTS.values())]
        camera = camera_of(exact)
        true_px = project(camera.world_from_cam, joints_m, camera.intrinsics_px)
        found = person.poses2d_px[:, list(OPENPOSE_JOINTS)]
        seen = found[..., 2] > 0
        assert (found[..., :2] - true_px)[seen].std() == pytest.approx(2.0, rel=0.15)


def test_the_same_seed_gives_the_same_bytes(write):
    one, two, other = write("a"), write("b"), write("c", seed=1)
    data = [files.pickle_path.read_bytes() for files in (one, two, other)]
    assert data[0] == data[1] != data[2]


def test_frames_that_are_not_the_cameras_are_refused_and_no_sequence_is_left(
    write, frames, jpeg, tmp_path
):
    with pytest.raises(BadFrames, match="29 images for 30 frames"):
        write(frames=frames[:-1])
    with pytest.raises(BadFrames, match=r"3DPW's images are \.jpg"):
        write(frames=[*frames[:-1], frames[-1].with_suffix(".png")])
    with pytest.raises(BadSequence, match="no name of a sequence"):
        write(name="../twin")
    for frame in frames:
        frame.write_bytes(jpeg(160, 90))
    with pytest.raises(BadFrames, match="160x90 px, the camera of walk.p0 has 90x160 px"):
        write()
    assert not list((tmp_path / "a").rglob("*.pkl"))


def test_clips_of_another_rate_are_refused(write, walkers):
    with pytest.raises(BadSequence, match="at 10 Hz"):
        write(clips=[with_motion(clip, fps_hz=10.0) for clip in walkers])
