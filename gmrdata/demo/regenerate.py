"""One clip's way through the COLMAP stage, given only what a data set like 3DPW gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.body.file import read_body
from gmrdata.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.config import Config
from gmrdata.demo.paths import DemoPaths
from gmrdata.people import PersonFiles
from gmrdata.pseudogt.compose import camera_motion
from gmrdata.sequence import SequenceConfig, regenerate_sequence
from gmrdata.store import run_stage


class TruthRemovedConfig(Config):
    """Nothing to choose: the camera-frame body follows from the clip."""


def regenerate(root: Path, clip_id: str, config: SequenceConfig, redo: bool) -> Path:
    """Frames, intrinsics and camera-frame body of one clip to its world motion.

    Returns:
        The folder of the pseudo ground truth.
    """
    paths = DemoPaths(root)
    _remove_truth(paths, clip_id, redo)
    return regenerate_sequence(
        paths.frames_dir(clip_id),
        (PersonFiles(paths.camera_clip(clip_id), paths.body),),
        paths.regenerated_dir(clip_id),
        config,
        redo=redo,
    )


def _remove_truth(paths: DemoPaths, clip_id: str, redo: bool) -> None:
    """Keep only what 3DPW gives: local poses, the root in the camera's frame, and K."""

    def work(out_dir: Path) -> None:
        true = load_clip(paths.true_clip(clip_id))
        camera = camera_of(true)
        unknown = replace(
            camera,
            world_from_cam=np.full_like(camera.world_from_cam, np.nan),
            has_camera=np.zeros_like(camera.has_camera),
        )
        motion = camera_motion(true.motion, camera.world_from_cam)
        clip = Clip(clip_id, motion, true.valid, true.image_numbers, unknown)
        rest_pelvis_m = read_body(paths.body).rest_pelvis_m(motion.shape)
        save_clip(out_dir / paths.camera_clip(clip_id).name, clip, rest_pelvis_m)

    inputs = {"clip": paths.true_clip(clip_id), "body": paths.body}
    run_stage(
        "sequence", paths.sequence_dir(clip_id), TruthRemovedConfig(), inputs, work, redo=redo
    )
