"""A small data set on disk, as a stage would leave it, and its manifest."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gmrdata.manifest.current import Quality
from gmrdata.manifest.write import ClipFiles, clip_entry, made_by, write_manifest
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, save_clip
from tests.clip_manifests import Edit, a_head, a_walk
from tests.motions import random_motion

REST_PELVIS_M = np.array([0.001, -0.24, 0.03])
N_FRAMES = 6


@pytest.fixture(scope="session")
def walk_clip() -> Clip:
    """Six frames with a camera; row 2 is not valid and has no camera."""
    motion = random_motion(np.random.default_rng(7), N_FRAMES)
    world_from_cam = np.tile(np.eye(4), (N_FRAMES, 1, 1))
    world_from_cam[:, :3, :3] = Rotation.random(N_FRAMES, random_state=5).as_matrix()
    world_from_cam[2] = np.nan
    known = np.arange(N_FRAMES) != 2
    camera = CameraPath(intrinsics_from_fov(60, 64, 48), 64, 48, world_from_cam, known)
    return Clip("walk", motion, known, np.arange(N_FRAMES), camera)


@pytest.fixture(scope="session")
def finished_data_set(walk_clip, tmp_path_factory) -> Path:
    """Folder with two clips (one without a camera), images, masks, listings and `set.yaml`."""
    root = tmp_path_factory.mktemp("finished_data_set")
    save_clip(root / "clips" / "walk.npz", walk_clip, REST_PELVIS_M)
    for number in range(N_FRAMES):
        for folder, suffix in (("frames", "jpg"), ("masks", "png")):
            (root / folder).mkdir(exist_ok=True)
            image = np.full((48, 64), number, np.uint8)
            assert cv2.imwrite(str(root / folder / f"{number:05d}.{suffix}"), image)
    bare = replace(
        walk_clip, id="bare", camera=None, image_numbers=np.full(N_FRAMES, -1, dtype=np.int64)
    )
    save_clip(root / "clips" / "bare.npz", bare, REST_PELVIS_M)
    walk = clip_entry(
        root,
        ClipFiles(root / "clips" / "walk.npz", images=root / "frames", masks=root / "masks"),
        a_walk(
            dropped_reason="no camera found",
            quality=Quality(
                geometry="exact", registered_share=5 / 6, figures={"speed_m_per_s": 1.2}
            ),
        ),
    )
    still = clip_entry(root, ClipFiles(root / "clips" / "bare.npz"), a_walk("none"))
    by = made_by({"seed": 7}, {"all": 7})
    write_manifest(root / "set.yaml", a_head("set"), [walk, still], created_by=by)
    return root


@pytest.fixture
def data_set(finished_data_set, tmp_path) -> Path:
    """A copy of the data set that a test may damage."""
    return Path(shutil.copytree(finished_data_set, tmp_path / "set"))


@pytest.fixture
def edit(data_set) -> Edit:
    """Change the manifest's data as a person with an editor would, past the models."""

    def change(how: Callable[[dict], object]) -> Path:
        path = data_set / "set.yaml"
        data = yaml.safe_load(path.read_text())
        how(data)
        path.write_text(yaml.safe_dump(data, sort_keys=False))
        return path

    return change
