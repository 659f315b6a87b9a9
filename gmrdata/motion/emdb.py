"""EMDB as manifests of world clips with cameras: all sequences, EMDB 1, and EMDB 2.

A sequence of EMDB as a clip: person and camera in one z-up world.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry, created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.read.bodies import keep_body, load_body, read_body
from gmrdata.read.emdb import FPS_HZ, EmdbSequence, find_sequences, read_emdb, rigid_rows
from gmrdata.read.numbers import usable_rows
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.camera_motion import MotionClass, MotionClassConfig, classify
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadBodyFile, MissingInput
from gmrdata.values.files import read_json, write_json
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config
from gmrdata.values.transforms import apply, invert, rigid

WORLD_FROM_EMDB = rigid(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
"""(4, 4): EMDB's world is y-up, ours z-up."""


def sequence_clip(clip_id: str, sequence: EmdbSequence, body: BodyModel) -> Clip:
    """The person and the camera in the z-up world.

    A frame is valid where EMDB calls it good and pose and camera are finite and rigid; frames
    without finite numbers are NaN.

    Args:
        clip_id: The clip's name.
        sequence: The sequence.
        body: SMPL's body of its gender, see `body_of`.

    Returns:
        The clip; its image numbers are those of the files, from 0.
    """
    has_pose = usable_rows(sequence.poses_rad, sequence.trans_m)
    has_camera = rigid_rows(sequence.cam_from_world)
    n_frames = sequence.n_frames
    shape = sequence.betas[: body.n_shape].copy()
    rotmats = np.full((n_frames, 24, 3, 3), np.nan)
    if has_pose.any():
        rotvecs = sequence.poses_rad[has_pose].reshape(-1, 3)
        rotmats[has_pose] = Rotation.from_rotvec(rotvecs).as_matrix().reshape(-1, 24, 3, 3)
    pelvis_emdb_m = np.where(has_pose[:, None], sequence.trans_m, np.nan) + body.rest_pelvis_m(
        shape
    )
    world_from_cam = np.full((n_frames, 4, 4), np.nan)
    world_from_cam[has_camera] = WORLD_FROM_EMDB @ invert(sequence.cam_from_world[has_camera])
    motion = Motion(
        local_rotmats=rotmats[:, 1:],
        root_rotmats=WORLD_FROM_EMDB[:3, :3] @ rotmats[:, 0],
        pelvis_m=apply(WORLD_FROM_EMDB, pelvis_emdb_m),
        shape=shape,
        fps_hz=FPS_HZ,
        body=body.name,
        gender=sequence.gender,
        frame="world",
        source=f"EMDB {sequence.name}",
    )
    camera = CameraPath(
        sequence.intrinsics_px,
        sequence.width_px,
        sequence.height_px,
        world_from_cam,
        has_camera,
    )
    valid = sequence.good & has_pose & has_camera
    return Clip(clip_id, motion, valid, np.arange(n_frames), camera)


def dropped_reasons(sequence: EmdbSequence) -> list[str]:
    """Why each frame can't be used: (N,) texts, empty where it can."""
    has_pose = usable_rows(sequence.poses_rad, sequence.trans_m)
    has_camera = rigid_rows(sequence.cam_from_world)
    tests = (
        (sequence.good, "good_frames_mask is False"),
        (has_pose, "poses or trans is not finite"),
        (has_camera, "extrinsics is no rigid transform"),
    )
    reasons = [""] * sequence.n_frames
    for passed, why in tests:
        reasons = [old or ("" if good else why) for old, good in zip(reasons, passed, strict=True)]
    return reasons


def body_of(sequence: EmdbSequence, bodies: Sequence[BodyModel]) -> BodyModel:
    """SMPL's body of the sequence's gender.

    Raises:
        BadBodyFile: it is not among them, or has more shape coefficients than the file.
    """
    wanted = f"smpl-{sequence.gender}"
    fits = [b for b in bodies if b.name == wanted and b.n_shape <= len(sequence.betas)]
    if not fits:
        given = ", ".join(f"{b.name} with {b.n_shape} coefficients" for b in bodies) or "none"
        raise BadBodyFile(
            f"{sequence.name}: needs the body {wanted} with up to {len(sequence.betas)} shape"
            f" coefficients, given: {given}. Give --body a folder with SMPL's models"
        )
    return fits[0]


def tilt_deg(clip: Clip) -> float:
    """Angle of the body's mean own axis from straight up [deg]: what a wrong idea of where up is
    would show in; NaN without valid frames."""
    if not clip.valid.any():
        return float("nan")
    axis = clip.motion.root_rotmats[clip.valid, :, 1].mean(axis=0)
    return float(np.rad2deg(np.arccos(np.clip(axis[2] / np.linalg.norm(axis), -1.0, 1.0))))


LICENCE = "EMDB's licence (non-commercial research; not to be passed on)"
ABOUT_FILE, CLIP_FILE = "about.json", "clip.npz"
DESCRIPTIONS = {
    "emdb": "All sequences of EMDB in the world, with their moving cameras.",
    "emdb1": "EMDB 1, the sequences on which poses are scored, in the world with their cameras.",
    "emdb2": "EMDB 2, the sequences on which global trajectories are scored, with their cameras.",
}


class EmdbConfig(Config):
    """What decides a sequence's clip."""

    name: str
    """The sequence."""


def make_emdb(root: Path, body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> tuple[Path, ...]:
    """Write one clip per sequence, and `emdb.yaml`, `emdb1.yaml` and `emdb2.yaml`.

    Args:
        root: The folder that holds P0 to P9.
        body: A folder with SMPL's models of the genders that the sequences have, or one model.
        out_dir: Folder to make.

    Returns:
        The manifests that have clips.

    Raises:
        MissingInput: no sequences, or no bodies.
        BadSequence: a file is broken, or laid out otherwise.
        UnsafePickle: a file wants to run something; nothing was run.
        BadBodyFile: a gender's body is missing.
    """
    out_dir = out_dir.resolve()
    sequence_paths = find_sequences(root)
    body_paths = _keep_bodies(body, out_dir, run)
    entries: dict[str, list[ClipEntry]] = {name: [] for name in DESCRIPTIONS}
    for path in track(sequence_paths, "reading EMDB's sequences"):
        folder = _make_sequence(path, body_paths, out_dir, run)
        about = read_json(folder / ABOUT_FILE)
        entry = _entry(folder, about, out_dir)
        for name in ("emdb", *(part for part in ("emdb1", "emdb2") if about[part])):
            entries[name].append(entry)
    return tuple(
        write_manifest(
            out_dir / f"{name}.yaml",
            name=name,
            version="1.0.0",
            description=description,
            kind="motions",
            licence=LICENCE,
            clips=entries[name],
            created_by=created_by(),
            redo=run.redo,
        )
        for name, description in DESCRIPTIONS.items()
        if entries[name]
    )


def _keep_bodies(body: str, out_dir: Path, run: Run) -> dict[str, Path]:
    """Files of the given bodies by their names, kept beside the clips."""
    given = Path(body)
    specs = (
        [str(path) for path in sorted(given.iterdir()) if path.suffix in (".pkl", ".npz")]
        if given.is_dir()
        else [body]
    )
    if not specs:
        raise MissingInput(f"{given}: holds no SMPL models (.pkl or .npz)")
    kept: dict[str, Path] = {}
    for spec in specs:
        name = load_body(spec).name
        if name in kept:
            raise BadBodyFile(f"{given}: holds two files of the body {name}. Leave one there")
        kept[name] = keep_body(spec, out_dir / "body" / name, run=run)
    return kept


def _make_sequence(path: Path, body_paths: Mapping[str, Path], out_dir: Path, run: Run) -> Path:
    name = path.stem.removesuffix("_data")

    def work(partial_dir: Path) -> None:
        sequence = read_emdb(path)
        body = body_of(sequence, [read_body(kept) for kept in body_paths.values()])
        clip = sequence_clip(name, sequence, body)
        save_clip(partial_dir / CLIP_FILE, clip, body.rest_pelvis_m(clip.motion.shape))
        about = {
            "emdb1": sequence.emdb1,
            "emdb2": sequence.emdb2,
            "reasons": dropped_reasons(sequence),
        }
        write_json(partial_dir / ABOUT_FILE, about)

    inputs = {"sequence": path} | {f"body {key}": kept for key, kept in body_paths.items()}
    return run_stage("emdb", out_dir / "clips" / name, EmdbConfig(name=name), inputs, work, run=run)


def _entry(folder: Path, about: dict[str, list[str]], out_dir: Path) -> ClipEntry:
    clip = load_clip(folder / CLIP_FILE)
    off_deg = tilt_deg(clip)
    return clip_entry(
        out_dir,
        clip_path=folder / CLIP_FILE,
        camera_motion=_camera_motion(clip),
        licence=LICENCE,
        source=Source(dataset="EMDB", sequence=clip.id.replace("_", "/", 1)),
        dropped_reason=about["reasons"],
        quality=None if math.isnan(off_deg) else Quality(figures={"mean_tilt_deg": off_deg}),
        recipe=stage_recipe(folder),
    )


def _camera_motion(clip: Clip) -> MotionClass:
    if not clip.valid.any():
        return "static"
    path, motion = camera_of(clip), clip.motion
    rows = clip.valid
    return classify(
        path.world_from_cam[rows], motion.pelvis_m[rows], motion.fps_hz, MotionClassConfig()
    )[0]
