"""Human3.6M as two manifests of world clips with one camera: the training and test subjects."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gmrdata.manifest.current import ClipEntry, Source
from gmrdata.manifest.write import ClipAbout, ClipFiles, clip_entry, stage_recipe
from gmrdata.motion.ground import motion_of
from gmrdata.motion.library import motions_head, write_motions
from gmrdata.read import human36m as files
from gmrdata.read.bodies import keep_body
from gmrdata.read.body_file import read_body
from gmrdata.read.numbers import smpl_rotmats, usable_rows
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import NEUTRAL, BodyModel, shape_on
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadBodyFile, BadSequence
from gmrdata.values.records import Config

LICENCE = "Human3.6M's licence (academic use; not to be passed on)"


def take_clip(
    subject: int, take: files.Action, camera_number: int, camera: files.FixedCamera, body: BodyModel
) -> Clip:
    """A take at the rate of its frames: 10 Hz where, as published, each fifth frame was fitted.

    Frames without parameters, or with NaN, are rows that are not valid.  Each frame's pelvis is its
    `trans` + J0 of its own betas; the clip's shape is the mean of the betas of the valid frames.
    Image numbers count from 1, as the files' do.
    """
    clip_id = f"S{subject}.{files.ACTIONS[take.action]}.{take.subaction}"
    if body.name != NEUTRAL:
        raise BadBodyFile(
            f"{clip_id}: the betas are of SMPL's neutral body, given: {body.name}. Give --body"
            " SMPL_NEUTRAL.pkl"
        )
    step = _most_common(np.diff(take.frames)) if len(take.frames) > 1 else 1
    on_grid = take.frames % step == _most_common(take.frames % step)
    numbers = np.arange(take.frames[on_grid][0], take.frames[on_grid][-1] + 1, step)
    n_rows = len(numbers)
    usable = on_grid & usable_rows(take.poses_rad, take.shapes, take.trans_m)
    rows = (take.frames[usable] - numbers[0]) // step
    valid = np.isin(np.arange(n_rows), rows)
    shapes = np.array([shape_on(body, betas) for betas in take.shapes[usable]])
    rotmats = np.full((n_rows, 24, 3, 3), np.nan)
    pelvis_m = np.full((n_rows, 3), np.nan)
    if len(rows):
        rotmats[rows] = smpl_rotmats(take.poses_rad[usable])
        rest_pelvis_m = body.joints_template_m[0] + shapes @ body.joint_shape_dirs_m[0].T
        pelvis_m[rows] = take.trans_m[usable] + rest_pelvis_m
    source = (
        f"Human3.6M S{subject} {files.ACTIONS[take.action]} {take.subaction}: each {step}. frame of"
        f" the 50 Hz video, {n_rows - len(rows)} of {n_rows} without parameters,"
        f" {int((~on_grid).sum())} between them left out, camera {camera_number}"
    )
    shape = shapes.mean(axis=0) if len(rows) else np.zeros(body.n_shape)
    motion = motion_of(body, shape, rotmats, pelvis_m, files.VIDEO_HZ / step, source)
    world_from_cam = np.tile(camera.world_from_cam, (n_rows, 1, 1))
    lens = (camera.intrinsics_px, *files.SIZES_PX[camera_number])
    path = CameraPath(*lens, world_from_cam, np.ones(n_rows, dtype=bool))
    return Clip(clip_id, motion, valid, numbers + 1, path)


def _most_common(values: np.ndarray) -> int:
    return int(np.bincount(values).argmax())


class Human36mConfig(Config):
    """What decides a subject's clips."""

    subject: int
    camera: int = 4
    """1 to 4; the motion is the same in each.  4 is frontal (60457274): HMR and SPIN test on it."""


def make_human36m(
    root: Path, body: str, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> tuple[Path, ...]:
    """Write one clip per take; `train.yaml` (S1, S5, S6, S7, S8) and `test.yaml` (S9, S11), if any.

    The body is SMPL's neutral one.  Errors are MissingInput, BadSequence and BadBodyFile.
    """
    out_dir = out_dir.resolve()
    parameter_paths = files.find_subjects(root)
    body_path = keep_body(body, out_dir / "body", run=run)
    made = []
    for name, subjects in (("train", files.TRAINING_SUBJECTS), ("test", files.TEST_SUBJECTS)):
        there = [subject for subject in subjects if subject in parameter_paths]
        entries = [
            entry
            for subject in track(there, f"reading Human3.6M's {name} subjects")
            for entry in _entries(parameter_paths[subject], subject, body_path, out_dir, run)
        ]
        if entries:
            about = f"Human3.6M's {name} subjects in the world, with one fixed camera."
            head, path = motions_head(f"human36m_{name}", about, LICENCE), out_dir / f"{name}.yaml"
            made.append(write_motions(path, head, entries, {"subjects": there}, run=run))
    return tuple(made)


def _entries(
    parameter_path: Path, subject: int, body_path: Path, out_dir: Path, run: Run
) -> Iterator[ClipEntry]:
    config = Human36mConfig(subject=subject)
    camera_path = files.find_cameras(parameter_path, subject)

    def work(partial_dir: Path) -> None:
        body = read_body(body_path)
        cameras = files.read_cameras(camera_path)
        if config.camera not in cameras:
            known = ", ".join(map(str, files.SIZES_PX))
            raise BadSequence(f"{camera_path}: has no camera {config.camera} of {known}")
        for take in files.read_takes(parameter_path):
            clip = take_clip(subject, take, config.camera, cameras[config.camera], body)
            save_clip(partial_dir / f"{clip.id}.npz", clip, body.rest_pelvis_m(clip.motion.shape))

    inputs = {"parameters": parameter_path, "cameras": camera_path, "body": body_path}
    clips_dir = out_dir / "clips" / f"S{subject}"
    folder = run_stage("human36m", clips_dir, config, inputs, work, run=run)
    for path in sorted(folder.glob("*.npz")):
        about = ClipAbout(
            camera_motion="static",
            licence=LICENCE,
            source=Source(dataset="Human3.6M", sequence=path.stem.replace(".", "/")),
            dropped_reason="no finite SMPL parameters in the file",
            recipe=stage_recipe(folder),
        )
        yield clip_entry(out_dir, ClipFiles(path), about)
