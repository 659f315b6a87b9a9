"""The stage: a file of local poses and a trained network to world motions in usual formats.

The predicted motion has the frame rate of the poses.  The network sees them at its own rate, and
between two of its moments the root is interpolated as `gmrdata.motion.resample` does it everywhere.
Its last moment may lie up to one of its steps before the last pose.  For what is left it looks at
the poses a second time, in the phase that ends with the last one, and that last predicted step is
laid on the end: the first and the last frame are there, and nothing is extrapolated.  What happens
between its moments feet alone show: where soles have a say (`gmrdata.gmr.soles`), they hold the
motion there, too.

GMR knows no gravity.  Where the person's mass is above the feet that stand, on average over time,
is up (`gmrdata.world.level`).  A foot that stands still stands flat, nearly always: in the frames
in which its ankle and its toe joint hardly move, the direction that points out of the foot's upper
side in the rest pose points up, too; the geometric median of those directions (Weiszfeld 1937) is
taken, so a few feet on their toes do not matter.  And standing soles are on one plane, unless that
is steep.  Each counts by its error, and `infer.json` says how level the world is.  Where roll and
pitch drift, what standing shows in each moment turns them back (`gmrdata.world.upright`).  A motion
in which no foot stands (swimming, lying) keeps the world in which the pelvis is upright in the
first frame.  Last, who neither stands nor falls freely is put on the floor, z = 0
(`gmrdata.world.heights`); on stairs and slopes, or where nothing shows up, heights stay, and the
low ones of standing soles are at z = 0.  The paper does none of this: its first pose is the
identity (section 3.6), which is what `level: first_pose` gives, in a world with z up.
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from gmrdata.gmr.config import Which, network_dir, weights_dir
from gmrdata.gmr.predict import TrainedGmr, held, load_gmr, predict_world_motion
from gmrdata.gmr.runs import check_rate
from gmrdata.motion.files import input_files
from gmrdata.motion.local_poses import MIN_FRAMES, read_local_poses
from gmrdata.motion.resample import ON_A_SAMPLE, resample
from gmrdata.read.bodies import body_inputs, load_body
from gmrdata.read.systems.result import files_beside, result_file
from gmrdata.stage.progress import remark, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, check_out, run_stage
from gmrdata.values import limits, transforms
from gmrdata.values.body import WORLD_FROM_REST, BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import RECIPE_FILE, STAGE_FILE
from gmrdata.values.motion import Motion, accumulate, bent, deltas, without_root
from gmrdata.values.records import Config, Record
from gmrdata.values.transforms import smallest_rotation
from gmrdata.world.heights import held_upright, on_one_floor
from gmrdata.world.level import (
    LevelEstimate,
    UpCue,
    body_cue,
    contact_cue,
    low_soles_m,
    soles_on_floor_m,
    up_of,
)
from gmrdata.world.planted_feet import count_stances, standing_soles_m
from gmrdata.world.upright import up_of_standing_feet
from gmrdata.write.amass import write_amass
from gmrdata.write.bvh import write_bvh
from gmrdata.write.glb import write_glb


def predict_at_source_rate(gmr: TrainedGmr, motion: Motion) -> Motion:
    """World motion of a person from the local pose alone, with a row for each of the poses.

    They are at the network's frame rate or above; their root is not looked at.  In the predicted
    world the pelvis stands upright at the origin in the first frame; `stand` finds a better one.
    """
    n = motion.n_frames
    poses = without_root(motion)
    seen = predict_world_motion(gmr, poses, first_root_rotmat=WORLD_FROM_REST)
    # Only the root is wanted at the source's rate, so the joints need no interpolation.
    back = resample(replace(seen, local_rotmats=seen.local_rotmats[:, :0]), motion.fps_hz)
    world_from_root = transforms.rigid(back.root_rotmats, back.pelvis_m)[:n]
    if len(world_from_root) < n:
        world_from_root = np.concatenate(
            [world_from_root, _rest_of_the_way(gmr, poses, seen, n - len(world_from_root))]
        )
    world = replace(
        motion,
        root_rotmats=world_from_root[:, :3, :3],
        pelvis_m=world_from_root[:, :3, 3],
        frame="world",
        source=seen.source if seen.n_frames == n else f"{seen.source}, and back",
    )
    is_between = gmr.model.config.soles_hold and seen.n_frames < n
    return _held_between(gmr, world) if is_between else world


def _held_between(gmr: TrainedGmr, world: Motion) -> Motion:
    """The same, of which soles hold what happens between the network's moments."""
    n, per_moment = world.n_frames, world.fps_hz / gmr.fps_hz
    moments = (np.arange(int((n - 1) / per_moment) + 1) * per_moment + ON_A_SAMPLE).astype(int)
    kept = np.unique(np.append(moments, n - 1))
    root_rotmats, pelvis_m = world.root_rotmats.copy(), world.pelvis_m.copy()
    turns, steps_m = held(gmr, world.local_rotmats, deltas(root_rotmats, pelvis_m), world.fps_hz)
    for start, stop in pairwise(kept):
        first, last = ((root_rotmats[at], pelvis_m[at]) for at in (start, stop))
        path = accumulate(turns[start:stop], steps_m[start:stop], *first)
        root_rotmats[start : stop + 1], pelvis_m[start : stop + 1] = bent(*path, *last)
    return replace(world, root_rotmats=root_rotmats, pelvis_m=pelvis_m)


def _rest_of_the_way(gmr: TrainedGmr, poses: Motion, seen: Motion, n_missing: int) -> np.ndarray:
    """(n_missing, 4, 4) world_from_root of the frames after the network's last moment."""
    end_s = (poses.n_frames - 1) / poses.fps_hz
    n_steps = int(end_s * gmr.fps_hz + ON_A_SAMPLE)
    late = predict_world_motion(
        gmr, resample(poses, gmr.fps_hz, start_s=max(0.0, end_s - n_steps / gmr.fps_hz))
    )
    start, end = transforms.rigid(late.root_rotmats[-2:], late.pelvis_m[-2:])
    frames = np.arange(poses.n_frames - n_missing, poses.n_frames)
    times_s = np.array([(seen.n_frames - 1) / gmr.fps_hz, *(frames / poses.fps_hz)])
    shares = 1.0 - (end_s - times_s[:, None]) * gmr.fps_hz
    turn = transforms.rotvecs_from_rotmats(start[:3, :3].T @ end[:3, :3])
    rotmats = start[:3, :3] @ transforms.rotmats_from_rotvecs(shares * turn)
    late_from_root = transforms.rigid(rotmats, start[:3, 3] + shares * (end - start)[:3, 3])
    joint = transforms.rigid(seen.root_rotmats[-1], seen.pelvis_m[-1])
    world_from_late = joint @ transforms.invert(late_from_root[0])
    return np.asarray(world_from_late @ late_from_root[1:])


UP = np.eye(3)[2]
FEET_SIGMA_RAD = np.deg2rad(4.0)
"""Of the direction that standing feet show, along each axis: 5.9 degrees in all on 13 of CMU's
motions, whose balance shows it to 3.5."""
STANCE_SIGMA_M = 0.1  # of a standing sole from the plane of all of them: a network's path drifts
LEAST_PRECISION = np.deg2rad(10.0) ** -2.0  # of a balance that is believed; of one who stands


def stand(motion: Motion, body: BodyModel) -> Motion:
    """A motion in a z-up world with the floor of its feet at z = 0, from above the origin on."""
    return stand_and_say(motion, body)[0]


def stand_and_say(motion: Motion, body: BodyModel) -> tuple[Motion, LevelEstimate | None]:
    """The same, and how level it is; None where nothing shows it."""
    up, level = _up_of(motion, body) or (UP, None)
    level_from_world = smallest_rotation(up, UP)
    root_rotmats = level_from_world @ motion.root_rotmats
    pelvis_m = (motion.pelvis_m - motion.pelvis_m[0]) @ level_from_world.T
    motion = replace(motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    if level is None:
        motion = _moved_to_floor(motion, *standing_soles_m(body, motion), NO_FOOT_STANDS)
        return motion, None
    how = f"up from feet that stand and the mass above them, to {level.sigma_deg:.1f} deg"
    motion = held_upright(body, motion)
    heights_m = motion.pelvis_m[:, 2]
    on_floor = on_one_floor(body, motion)
    if on_floor is None:
        how = f"{how}; on more than one floor"
        motion = _moved_to_floor(motion, *standing_soles_m(body, motion), how)
    else:
        change_m = float(np.std(on_floor.pelvis_m[:, 2] - heights_m))
        how = f"{motion.source}; {how}; on one floor, by {change_m:.2f} m (RMS)"
        motion = replace(on_floor, source=how)
    soles_m, still = standing_soles_m(body, motion)
    return motion, level.with_soles(soles_m[still][:, 2])


def _moved_to_floor(motion: Motion, soles_m: np.ndarray, still: np.ndarray, how: str) -> Motion:
    """The motion as it is, with the low ones of standing soles at z = 0."""
    standing_m = soles_m[still]
    if len(standing_m):
        low_m = low_soles_m(standing_m, UP)
    else:
        low_m = soles_on_floor_m(standing_m, soles_m, UP)
    pelvis_m = motion.pelvis_m - np.median(low_m @ UP) * UP
    return replace(motion, pelvis_m=pelvis_m, source=f"{motion.source}; {how}")


NO_FOOT_STANDS = "no foot stands still; up from the first pelvis"


def _up_of(motion: Motion, body: BodyModel) -> tuple[np.ndarray, LevelEstimate] | None:
    """Up (3,) by balance, feet and the soles' plane, and how sure that is."""
    balance, feet_up = body_cue([body], [motion]), up_of_standing_feet(motion, body)
    if balance.precision[0, 0] < LEAST_PRECISION and feet_up is None:
        return None
    soles_m, still = standing_soles_m(body, motion)
    plane = contact_cue([soles_m[still]], count_stances(still), balance.up, STANCE_SIGMA_M)
    ground = [] if plane is None else [plane]
    if feet_up is not None:
        ground.append(UpCue("feet", feet_up, np.eye(3) / FEET_SIGMA_RAD**2))
    return up_of([balance], ground)


RECORD_FILE = "infer.json"
Level = Literal["standing_feet", "first_pose"]


class NetworkUsed(Config):
    """Which network predicted: its run's folder, training steps behind its weights, frame rate."""

    run: str
    step: int
    fps_hz: float


class InferredMotion(Config):
    """What was made of an unbroken run of a person."""

    frames: int
    fps_hz: float
    first_frame: int  # number of its first image; -1 without images
    last_frame: int
    filled_frames: int  # of gaps
    path_m: float  # length of the pelvis's path over the ground [m]
    level_sigma_deg: float | None
    """Standard error of the angle between z and up; null where nothing shows it."""
    soles_above_m: float | None
    """How high above z = 0 the highest tenth of standing soles stand; null where none stands."""
    source: str


class InferRecord(Record):
    """`infer.json`."""

    format: Literal["gmrdata-infer/3"] = "gmrdata-infer/3"
    poses: str  # name of the file of poses
    body: str
    model: NetworkUsed
    level: Level
    translation: Literal["pelvis"]  # what T is in the world; the paper's eq. 1 has SMPL's `trans`
    motions: dict[str, InferredMotion]  # by folder
    left_out: dict[str, str]  # runs of frames that are too short, and why


class InferConfig(Config):
    """How world motions are made of a file of poses."""

    fps_hz: float | None = Field(default=None, gt=0.0, le=1000.0)
    """True rate of the poses; None: the file's."""
    bridge_frames: int = Field(default=0, ge=0, le=limits.MOST_FRAMES)
    """Longest gap of a person's track that is filled, by slerp of the joints [frames].  At longer
    ones a new motion begins, with a world of its own."""
    which: Which = "latest"
    level: Level = "standing_feet"
    """Where the world is: level and on the floor by feet that stand, or as the paper has it, with
    the first pelvis upright at the origin: G_1 is the identity, here turned from y up to z up."""
    video: bool = True  # of width x height, which takes longer to draw than all else
    width_px: int = Field(default=640, ge=64, le=4096)
    height_px: int = Field(default=480, ge=64, le=4096)


DrawMotion = Callable[[Path, Clip, BodyModel, InferConfig], None]
"""Adds pictures of a world motion to its folder; keeps those that are there."""


def infer(
    network: Path | str,
    poses_path: Path | str,
    out_dir: Path | str,
    config: InferConfig | None = None,
    *,
    body_path: Path | str | None = None,
    joint_map: Path | str | None = None,
    draw: DrawMotion | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Predict the world motion of each person of a file and write it in usual formats.

    Args:
        network: As `load_gmr` takes it.
        poses_path: Local poses: docs/inference.md lists the formats.
        out_dir: Gets `infer.json` and a folder for each unbroken run of each person: `clip.npz`,
            `amass.npz`, `motion.bvh`, `body.glb`, and what `draw` adds.  People and runs do not
            share a world: each starts above the origin of its own.
        body_path: The body that stands for the people, as `load_body` takes it; None for the
            default body.
        joint_map: For a BVH or AMC with unknown joint names.
        draw: Adds pictures; None for none.

    Errors are MissingInput, BadCheckpoint, BadMotionFile for poses that are broken, or too short or
    slow for the network, UnsafePickle and BrokenPickle; StaleOutput before anything is predicted,
    where `out_dir` was made otherwise or holds an input.
    """
    run_dir, source, out_dir = network_dir(network), result_file(Path(poses_path)), Path(out_dir)
    config = config or InferConfig()
    config = config if draw is not None else config.model_copy(update={"video": False})
    poses = input_files(source) | files_beside(source)
    map_path = None if joint_map is None else Path(joint_map)
    inputs = {"run": weights_dir(run_dir), "joint_map": map_path, **body_inputs(body_path)}
    inputs |= {f"poses_{role}": path for role, path in poses.items()}
    if check_out("infer", out_dir, config, inputs, run):
        return out_dir
    # Before anything is written, so that a bad file leaves nothing behind.
    body = load_body(body_path)
    gmr = load_gmr(run_dir, config.which)
    worlds, left_out = _predict(gmr, source, body, config, map_path)

    def work(partial_dir: Path) -> None:
        record = _record(gmr, source, body, config.level, worlds, left_out)
        record.write(partial_dir / RECORD_FILE)
        for name, world in track(worlds.items(), "writing motions", total=len(worlds)):
            _write_files(partial_dir / name, world.clip, body)
        if draw is not None:
            for name, world in worlds.items():
                draw(partial_dir / name, world.clip, body, config)

    return run_stage("infer", out_dir, config, inputs, Resumable(work), run=run)


PLAN_HEADINGS = ("motion", "frames", "of the video", "rate [Hz]", "what")


def plan_infer(
    network: Path | str,
    poses_path: Path | str,
    config: InferConfig,
    *,
    body_path: Path | str | None = None,
    joint_map: Path | str | None = None,
) -> list[tuple[str, ...]]:
    """Rows of `PLAN_HEADINGS`: the motions that `infer` would predict; errors as there."""
    gmr, rows = load_gmr(network_dir(network), config.which), list[tuple[str, ...]]()
    source, body = Path(poses_path), load_body(body_path)
    joint_map = None if joint_map is None else Path(joint_map)
    runs = read_local_poses(
        source, config.fps_hz, body=body, joint_map=joint_map, bridge_frames=config.bridge_frames
    )
    reasons = [too_short(run.motion, gmr.fps_hz, f"{run.id} of {source}") for run in runs]
    if all(reasons):
        raise _all_too_short(source, runs[0].id, reasons[0])
    for run, reason in zip(runs, reasons, strict=True):
        first, last = int(run.image_numbers[0]), int(run.image_numbers[-1])
        frames, rate = str(run.motion.n_frames), f"{run.motion.fps_hz:g}"
        rows.append((run.id, frames, f"{first}-{last}", rate, reason or "to predict"))
    return rows


class _World(NamedTuple):
    """One unbroken run of a person."""

    clip: Clip
    level: LevelEstimate | None  # None where nothing shows it


def _record(
    gmr: TrainedGmr,
    source: Path,
    body: BodyModel,
    level: Level,
    worlds: Mapping[str, _World],
    left_out: dict[str, str],
) -> InferRecord:
    return InferRecord(
        poses=source.name,
        body=body.name,
        model=NetworkUsed(run=gmr.name, step=gmr.step, fps_hz=gmr.fps_hz),
        level=level,
        translation="pelvis",
        motions={name: _described(world) for name, world in worlds.items()},
        left_out=left_out,
    )


def _predict(
    gmr: TrainedGmr, source: Path, body: BodyModel, config: InferConfig, joint_map: Path | None
) -> tuple[dict[str, _World], dict[str, str]]:
    """World motions by folder, and why runs of frames were left out."""
    runs = read_local_poses(
        source, config.fps_hz, body=body, joint_map=joint_map, bridge_frames=config.bridge_frames
    )
    worlds: dict[str, _World] = {}
    left_out: dict[str, str] = {}
    for run in track(runs, "predicting", total=len(runs)):
        taken = {RECORD_FILE, STAGE_FILE, RECIPE_FILE, *worlds, *left_out}
        name = _folder_name(run.id, taken)
        if reason := too_short(run.motion, gmr.fps_hz, f"{run.id} of {source}"):
            left_out[name] = reason
            continue
        world = predict_at_source_rate(gmr, run.motion)
        level = None
        if config.level == "standing_feet":
            world, level = stand_and_say(world, body)
        worlds[name] = _World(Clip(name, world, run.valid, run.image_numbers, None), level)
    if not worlds:
        raise _all_too_short(source, *next(iter(left_out.items())))
    for name, one in worlds.items():
        if one.level is not None and one.level.remark is not None:
            remark(f"{name}: {one.level.remark}")
    for name, reason in left_out.items():
        remark(f"left out {name}: {reason}")
    return worlds, left_out


def too_short(motion: Motion, fps_hz: float, name: str) -> str:
    """Why a motion has no two frames at a rate [Hz]; empty if it has.  BadMotionFile, which calls
    it by a name, where its own rate is lower."""
    if motion.n_frames >= MIN_FRAMES:
        check_rate(name, motion.fps_hz, fps_hz)
        if (motion.n_frames - 1) / motion.fps_hz * fps_hz > 1 - ON_A_SAMPLE:
            return ""
    frames = "1 frame" if motion.n_frames == 1 else f"{motion.n_frames} frames"
    return f"{frames} at {motion.fps_hz:g} fps: less than two at {fps_hz:g} fps"


def _all_too_short(source: Path, name: str, reason: str) -> BadMotionFile:
    return BadMotionFile(
        f"{source}: no run of frames is long enough ({name}: {reason}). Give a longer sequence, or"
        " the true frame rate with --fps-hz"
    )


def _write_files(folder: Path, clip: Clip, body: BodyModel) -> None:
    """All but the pictures; each file is written as a whole, so what is there is kept."""
    if not (clip_path := folder / "clip.npz").exists():
        save_clip(clip_path, clip, body.rest_pelvis_m(clip.motion.shape))
    writers = {"amass.npz": write_amass, "motion.bvh": write_bvh, "body.glb": write_glb}
    for file_name, write in writers.items():
        if not (folder / file_name).exists():
            write(folder / file_name, clip.motion, body)


def _described(world: _World) -> InferredMotion:
    clip = world.clip
    steps_m = np.linalg.norm(np.diff(clip.motion.pelvis_m[:, :2], axis=0), axis=1)
    return InferredMotion(
        frames=clip.motion.n_frames,
        fps_hz=clip.motion.fps_hz,
        first_frame=int(clip.image_numbers[0]),
        last_frame=int(clip.image_numbers[-1]),
        filled_frames=int((~clip.valid).sum()),
        path_m=round(float(steps_m.sum()), 4),
        level_sigma_deg=None if world.level is None else world.level.sigma_deg,
        soles_above_m=None if world.level is None else world.level.soles_above_m,
        source=clip.motion.source,
    )


def _folder_name(clip_id: str, taken: Collection[str]) -> str:
    """A name that leads nowhere and is not taken yet, on no disk: some see no case."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", clip_id).strip(".")[:100] or "motion"
    number, folded = 2, {one.casefold() for one in taken}
    while name.casefold() in folded:
        name, number = f"{name}_{number}", number + 1
    return name
