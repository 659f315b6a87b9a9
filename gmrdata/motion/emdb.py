"""EMDB as manifests of clips with cameras in a z-up world: all of it, EMDB 1, and EMDB 2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.manifest.current import ClipEntry, Quality, Source
from gmrdata.manifest.write import ClipAbout, ClipFiles, clip_entry, stage_recipe
from gmrdata.motion.ground import motion_of
from gmrdata.motion.library import motions_head, write_motions
from gmrdata.read.bodies import keep_bodies
from gmrdata.read.body_file import read_body
from gmrdata.read.emdb import FPS_HZ, WORLD_FROM_EMDB, EmdbSequence, find_sequences, read_emdb
from gmrdata.read.numbers import rigid_rows, smpl_rotmats, usable_rows
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import SMPL, BodyModel, names_of, shape_on
from gmrdata.values.camera import CameraPath
from gmrdata.values.camera_motion import MotionClass, MotionClassConfig, classify
from gmrdata.values.clip import Clip, camera_of, first_reasons, load_clip, save_clip
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.records import Config, Record
from gmrdata.values.transforms import apply, invert

LICENCE = "EMDB's licence (non-commercial research; not to be passed on)"
ABOUT_FILE, CLIP_FILE = "about.json", "clip.npz"
DESCRIPTIONS = {
    "emdb": "All sequences of EMDB in the world, with their moving cameras.",
    "emdb1": "EMDB 1, the sequences on which poses are scored, in the world with their cameras.",
    "emdb2": "EMDB 2, the sequences on which global trajectories are scored, with their cameras.",
}


def sequence_clip(clip_id: str, sequence: EmdbSequence, body: BodyModel) -> Clip:
    """The person and the camera in the z-up world.

    A frame is valid where EMDB calls it good and pose and camera are finite and rigid; frames
    without finite numbers are NaN.  Image numbers are those of the files, from 0.

    The body is SMPL's of the sequence's gender, see `body_of`.
    """
    has_pose = usable_rows(sequence.poses_rad, sequence.trans_m)
    has_camera = rigid_rows(sequence.cam_from_world)
    shape = shape_on(body, sequence.betas)
    rotmats = smpl_rotmats(np.where(has_pose[:, None], sequence.poses_rad, np.nan))
    trans_m = np.where(has_pose[:, None], sequence.trans_m, np.nan)
    world_from_cam = np.full((sequence.n_frames, 4, 4), np.nan)
    world_from_cam[has_camera] = WORLD_FROM_EMDB @ invert(sequence.cam_from_world[has_camera])
    rotmats[:, 0] = WORLD_FROM_EMDB[:3, :3] @ rotmats[:, 0]
    pelvis_m = apply(WORLD_FROM_EMDB, trans_m + body.rest_pelvis_m(shape))
    motion = motion_of(body, shape, rotmats, pelvis_m, FPS_HZ, f"EMDB {sequence.name}")
    size_px = sequence.width_px, sequence.height_px
    camera = CameraPath(sequence.intrinsics_px, *size_px, world_from_cam, has_camera)
    valid = sequence.good & has_pose & has_camera
    return Clip(clip_id, motion, valid, np.arange(sequence.n_frames), camera)


def body_of(sequence: EmdbSequence, bodies: Sequence[BodyModel]) -> BodyModel:
    """SMPL's body of the sequence's gender."""
    wanted = f"{SMPL}{sequence.gender}"
    for body in bodies:
        if body.name == wanted:
            return body
    raise BadBodyFile(
        f"{sequence.name}: needs the body {wanted}, given: {names_of(bodies) or 'none'}. Give"
        " --body a folder with SMPL's models"
    )


class EmdbConfig(Config):
    """What decides a sequence's clip."""

    name: str


class EmdbAbout(Record):
    """What a sequence's file says beside its clip."""

    format: Literal["gmrdata-emdb/1"] = "gmrdata-emdb/1"
    emdb1: bool
    emdb2: bool
    reasons: list[str]
    """(N,) why each frame can't be used, empty where it can."""


def make_emdb(root: Path, body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> tuple[Path, ...]:
    """Write one clip per sequence, and those of `DESCRIPTIONS` as manifests that have clips.

    `root` holds P0 to P9; `body` is a folder with SMPL's models of the genders that the sequences
    have, or one model.  Errors are MissingInput, BadSequence, UnsafePickle and BadBodyFile.
    """
    out_dir = out_dir.resolve()
    sequence_paths = find_sequences(root)
    body_paths = keep_bodies(body, out_dir / "body", run=run)
    entries: dict[str, list[ClipEntry]] = {name: [] for name in DESCRIPTIONS}
    for path in track(sequence_paths, "reading EMDB's sequences"):
        folder = _make_sequence(path, body_paths, out_dir, run)
        about = EmdbAbout.read(folder / ABOUT_FILE)
        entry = _entry(folder, about, out_dir)
        for name, is_in in {"emdb": True, "emdb1": about.emdb1, "emdb2": about.emdb2}.items():
            if is_in:
                entries[name].append(entry)
    heads = {name: motions_head(name, DESCRIPTIONS[name], LICENCE) for name in DESCRIPTIONS}
    return tuple(
        write_motions(out_dir / f"{name}.yaml", head, entries[name], run=run)
        for name, head in heads.items()
        if entries[name]
    )


def _make_sequence(path: Path, body_paths: Mapping[str, Path], out_dir: Path, run: Run) -> Path:
    name = path.stem.removesuffix("_data")

    def work(partial_dir: Path) -> None:
        sequence = read_emdb(path)
        body = body_of(sequence, [read_body(one) for one in body_paths.values()])
        clip = sequence_clip(name, sequence, body)
        save_clip(partial_dir / CLIP_FILE, clip, body.rest_pelvis_m(clip.motion.shape))
        tests = (
            (sequence.good, "good_frames_mask is False"),
            (usable_rows(sequence.poses_rad, sequence.trans_m), "poses or trans is not finite"),
            (rigid_rows(sequence.cam_from_world), "extrinsics is no rigid transform"),
        )
        reasons = first_reasons([""] * sequence.n_frames, tests)
        about = EmdbAbout(emdb1=sequence.emdb1, emdb2=sequence.emdb2, reasons=reasons)
        about.write(partial_dir / ABOUT_FILE)

    inputs = {"sequence": path} | {f"body {key}": kept for key, kept in body_paths.items()}
    return run_stage("emdb", out_dir / "clips" / name, EmdbConfig(name=name), inputs, work, run=run)


def _entry(folder: Path, about: EmdbAbout, out_dir: Path) -> ClipEntry:
    clip = load_clip(folder / CLIP_FILE)
    rows = clip.valid
    figures = {"emdb1": float(about.emdb1), "emdb2": float(about.emdb2)}
    camera_motion: MotionClass = "static"
    if rows.any():
        cameras, pelvis_m = camera_of(clip).world_from_cam[rows], clip.motion.pelvis_m[rows]
        camera_motion = classify(cameras, pelvis_m, clip.motion.fps_hz, MotionClassConfig())[0]
        # The body's mean own axis from straight up: a wrong idea of where up is would show in it.
        axis = clip.motion.root_rotmats[rows, :, 1].mean(axis=0)
        tilt_deg = np.rad2deg(np.arccos(np.clip(axis[2] / np.linalg.norm(axis), -1.0, 1.0)))
        figures["mean_tilt_deg"] = float(tilt_deg)
    listed = ClipAbout(
        camera_motion=camera_motion,
        licence=LICENCE,
        source=Source(dataset="EMDB", sequence=clip.id.replace("_", "/", 1)),
        dropped_reason=about.reasons,
        quality=Quality(figures=figures),
        recipe=stage_recipe(folder),
    )
    return clip_entry(out_dir, ClipFiles(folder / CLIP_FILE), listed)
