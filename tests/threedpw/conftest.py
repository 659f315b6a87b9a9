"""A small dataset in 3DPW's layout: two people, one circling camera, one second."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_joints_m
from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.programmes import Circular, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.motion.motion import Motion
from gmrdata.threedpw.arrays import SequenceArrays
from gmrdata.threedpw.build import sequence_arrays
from gmrdata.threedpw.keypoints import KeypointConfig, detected_keypoints
from gmrdata.threedpw.write import write_sequence

WIDTH_PX, HEIGHT_PX = 90, 160
N_FRAMES = 30
NAME = "courtyard_walk_00"

MakeDataset = Callable[..., Path]


@pytest.fixture(scope="session")
def walkers(small_body: BodyModel) -> list[Clip]:
    """Two people of different shapes in one world, filmed by one camera."""
    rng = np.random.default_rng(5)
    motions = [make_gait("walk", N_FRAMES / 30, 30.0, small_body, rng) for _ in range(2)]
    beside_m = motions[0].pelvis_m[15] - motions[1].pelvis_m[15] + np.array([0.7, 0.5, 0.0])
    motions[1] = replace(
        motions[1],
        pelvis_m=motions[1].pelvis_m + beside_m * (1.0, 1.0, 0.0),
        shape=motions[1].shape + 0.2,
    )
    motions = [cut(motion) for motion in motions]
    programme = Circular(distance_m=5.0, azimuth_deg=40.0)
    camera = camera_path(
        programme, motions[0].pelvis_m, 30.0, WIDTH_PX, HEIGHT_PX, 45.0, np.random.default_rng(1)
    )
    valid = np.ones(N_FRAMES, dtype=bool)
    valid[10:13] = False
    numbers = np.arange(N_FRAMES)
    return [
        Clip("walk.p0", motions[0], valid, numbers, camera),
        Clip("walk.p1", motions[1], ~np.zeros(N_FRAMES, dtype=bool), numbers, camera),
    ]


def cut(motion: Motion) -> Motion:
    rows = slice(0, N_FRAMES)
    return replace(
        motion,
        local_rotmats=motion.local_rotmats[rows],
        root_rotmats=motion.root_rotmats[rows],
        pelvis_m=motion.pelvis_m[rows],
    )


@pytest.fixture(scope="session")
def walk_arrays(walkers: list[Clip], small_body: BodyModel) -> SequenceArrays:
    """What 3DPW's file would hold for the walkers."""
    exact = KeypointConfig(noise_px=0.0)
    points_px = [
        detected_keypoints(
            motion_joints_m(small_body, clip.motion),
            camera_of(clip),
            exact,
            np.random.default_rng(2),
        )
        for clip in walkers
    ]
    return sequence_arrays(NAME, walkers, small_body, ["female", "male"], points_px)


@pytest.fixture(scope="session")
def jpeg() -> Callable[[int, int], bytes]:
    """A JPEG of a width and height."""

    def make(width_px: int, height_px: int) -> bytes:
        _, encoded = cv2.imencode(".jpg", np.full((height_px, width_px, 3), 128, dtype=np.uint8))
        return encoded.tobytes()

    return make


@pytest.fixture
def make_dataset(
    tmp_path: Path, walk_arrays: SequenceArrays, jpeg: Callable[[int, int], bytes]
) -> MakeDataset:
    """Writes a sequence, by default the walkers', with its images; gives the dataset's root."""

    def make(
        arrays: SequenceArrays = walk_arrays,
        split: str = "train",
        size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX),
    ) -> Path:
        root = tmp_path / "3DPW"
        files = write_sequence(root, split, arrays)
        files.image_dir.mkdir(parents=True)
        for row in range(arrays.n_frames):
            files.image_path(row).write_bytes(jpeg(*size_px))
        return root

    return make
