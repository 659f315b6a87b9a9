"""A data set in 3DPW's layout whose cameras are known: a drawn room, filmed, and people in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.motion.gait import make_gait
from gmrdata.pages.qa import write_set_pages
from gmrdata.read.bodies import save_body
from gmrdata.read.threedpw_layout import SequenceFiles
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.threedpw.regenerate import regenerate_set
from gmrdata.twins.faults import KeypointConfig, detected_keypoints
from gmrdata.twins.twin import sequence_arrays
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.skinning import motion_joints_m
from gmrdata.write.threedpw import write_sequence

N_FRAMES = 36
WIDTH_PX, HEIGHT_PX = 320, 180


@dataclass(frozen=True, eq=False)
class Made:
    """A data set, and the truth of its sequences."""

    root: Path
    body_path: Path
    truth: dict[str, list[Clip]]

    def recipe(self, **changes: Any) -> ThreedpwRecipe:
        """Small, and with the small body."""
        given = {
            "recipe": "threedpw",
            "bodies": [str(self.body_path)],
            "workers": 1,
            "sequence": {
                "masks": {"sources": [{"kind": "silhouette", "dilate_px": 3}]},
                "sfm": {"max_features": 1200, "first_octave": -1},
            },
        }
        return ThreedpwRecipe.model_validate(given | changes)


@pytest.fixture(scope="session")
def filmed_set(
    film: Callable[..., Any], small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory
) -> Made:
    """`arc_00` with two people and an arc, `pan_00` with one and a camera that turns."""
    root = tmp_path_factory.mktemp("filmed") / "3DPW"
    body_path = root.with_name("body.npz")
    save_body(body_path, small_body)
    truth = {
        "arc_00": _write(root, "arc_00", film("arc", N_FRAMES, person=False), small_body, 2),
        "pan_00": _write(root, "pan_00", film("pan", N_FRAMES, person=False), small_body, 1),
    }
    return Made(root, body_path, truth)


def _write(root: Path, name: str, filmed: Any, body: BodyModel, n_people: int) -> list[Clip]:
    n = np.arange(N_FRAMES)
    camera = CameraPath(filmed.intrinsics_px, WIDTH_PX, HEIGHT_PX, filmed.world_from_cam, n >= 0)
    rng = np.random.default_rng(3)
    clips = []
    for person in range(n_people):
        motion = make_gait("walk", N_FRAMES / 30, 30.0, body, rng)
        rows = slice(0, N_FRAMES)
        place_m = np.array([0.9 * person, 0.4, 0.0]) - motion.pelvis_m[rows].mean(axis=0) * (
            1,
            1,
            0,
        )
        motion = replace(
            motion,
            local_rotmats=motion.local_rotmats[rows],
            root_rotmats=motion.root_rotmats[rows],
            pelvis_m=motion.pelvis_m[rows] + place_m,
        )
        clips.append(Clip(f"{name}.p{person}", motion, n >= 0, n, camera))
    files = write_sequence(root, "train", _arrays(name, clips, body))
    files.image_dir.mkdir(parents=True)
    for row in n:
        frame = filmed.images_dir / f"{row:05d}.jpg"
        files.image_path(int(row)).write_bytes(frame.read_bytes())
    return clips


def _arrays(name: str, clips: Sequence[Clip], body: BodyModel) -> Any:
    exact = KeypointConfig(noise_px=0.5)
    keypoints_px = [
        detected_keypoints(
            motion_joints_m(body, clip.motion), camera_of(clip), exact, np.random.default_rng(0)
        )
        for clip in clips
    ]
    return sequence_arrays(name, clips, body, ["female"] * len(clips), keypoints_px)


@pytest.fixture(scope="session")
def made_set(filmed_set: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What was regenerated from the data set; tests leave it as it is."""
    out_dir = tmp_path_factory.mktemp("regenerated") / "out"
    regenerate_set(filmed_set.recipe(), filmed_set.root, out_dir)
    write_set_pages(filmed_set.recipe(), filmed_set.root, out_dir)
    return out_dir


@pytest.fixture
def copied_set(filmed_set: Made, tmp_path: Path) -> Made:
    """The data set once more, for a test that breaks it."""
    import shutil

    shutil.copytree(filmed_set.root, tmp_path / "3DPW")
    return replace(filmed_set, root=tmp_path / "3DPW")


def files_of(made: Made, name: str) -> SequenceFiles:
    """Where a sequence is."""
    return SequenceFiles(made.root, name, "train")
