"""The stage: a file of local poses and a trained network to world motions in usual formats."""

import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadMotionFile
from gmrdata.gmr.config import Which
from gmrdata.infer.amass_out import write_amass
from gmrdata.infer.bvh_out import write_bvh
from gmrdata.infer.glb_out import write_glb
from gmrdata.infer.source_rate import predict_at_source_rate
from gmrdata.infer.upright import stand
from gmrdata.local_pose.read import MIN_FRAMES, read_local_poses
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import input_files
from gmrdata.motion.resample import ON_A_SAMPLE
from gmrdata.progress import console, track
from gmrdata.store import is_made, run_stage, write_json

if TYPE_CHECKING:
    from gmrdata.gmr.infer import TrainedGmr

FORMAT = "gmrdata-infer/1"
CLIP_FILE, AMASS_FILE = "clip.npz", "amass.npz"
BVH_FILE, GLB_FILE = "motion.bvh", "body.glb"
PATH_FILE, VIDEO_FILE = "path.png", "body.mp4"
RECORD_FILE = "infer.json"


class InferConfig(Config):
    """What is made of a file of poses."""

    fps_hz: float | None = Field(default=None, gt=0.0)
    """True frame rate of the poses [Hz]; None for the file's own."""
    bridge_frames: int = Field(default=0, ge=0)
    """Longest gap of a person's track that is filled, by slerp of the joints [frames].  At longer
    ones a new motion begins, with a world of its own."""
    which: Which = "latest"
    """Which weights of the network are used."""
    video: bool = True
    """Whether to draw the video, which takes longer than all else."""
    width_px: int = Field(default=640, ge=64, le=4096)
    """Width of the video [px]."""
    height_px: int = Field(default=480, ge=64, le=4096)
    """Height of the video [px]."""


def infer_world_motion(
    run_dir: Path,
    source: Path,
    body_spec: str,
    out_dir: Path,
    config: InferConfig | None = None,
    *,
    joint_map: Path | None = None,
    redo: bool = False,
) -> Path:
    """Stage: predict the world motion of each person of a file and write it in usual formats.

    Args:
        run_dir: A finished training run.
        source: Local poses, as `gmrdata.local_pose` lists the formats.
        body_spec: The body that stands for the people, as `load_body` takes it.
        out_dir: Gets `infer.json` and a folder for each unbroken run of each person: `clip.npz`,
            `amass.npz`, `motion.bvh`, `body.glb`, `path.png` and `body.mp4`.  People and runs do
            not share a world: each starts above the origin of its own.
        config: The recipe; None for its defaults.
        joint_map: For a BVH or AMC with unknown joint names.
        redo: Throw away a result of another recipe.

    Returns:
        `out_dir`.

    Raises:
        MissingInput: a file is not there.
        BadCheckpoint: the run's checkpoint is broken.
        BadMotionFile: the poses are broken, or too short or slow for the network.
        UnsafePickle: the poses' file wants to run something.
        BrokenPickle: it is truncated.
    """
    from gmrdata.body.load import load_body

    config = config or InferConfig()
    inputs = {"run": run_dir} | _pose_inputs(source)
    if joint_map is not None:
        inputs["joint_map"] = joint_map
    if body_spec != "anny":
        inputs["body"] = Path(body_spec)
    if out_dir.is_dir() and is_made("infer", out_dir, config, inputs):
        return out_dir
    # Before anything is written, so that a bad file leaves nothing behind.
    body = load_body(body_spec)
    gmr, worlds, left_out = _predict(run_dir, source, body, config, joint_map)

    def work(partial_dir: Path) -> None:
        write_json(partial_dir / RECORD_FILE, _record(gmr, source, body, worlds, left_out))
        for name, world in track(worlds.items(), "writing motions", total=len(worlds)):
            _write_files(partial_dir / name, world, body)
        if config.video:
            _write_videos(partial_dir, worlds, body, config)

    return run_stage("infer", out_dir, config, inputs, work, resumable=True, redo=redo)


def _pose_inputs(source: Path) -> dict[str, Path]:
    """The files that the poses are read from, by role."""
    return {f"poses_{role}": path for role, path in input_files(source).items()}


def _predict(
    run_dir: Path, source: Path, body: BodyModel, config: InferConfig, joint_map: Path | None
) -> tuple["TrainedGmr", dict[str, Clip], dict[str, str]]:
    """The network, the world motions by folder, and why runs of frames were left out."""
    from gmrdata.gmr.infer import load_gmr

    gmr = load_gmr(run_dir, config.which)
    runs = read_local_poses(
        source, config.fps_hz, body=body, joint_map=joint_map, bridge_frames=config.bridge_frames
    )
    worlds: dict[str, Clip] = {}
    left_out: dict[str, str] = {}
    for run in track(runs, "predicting", total=len(runs)):
        name = _folder_name(run.id, worlds.keys() | left_out.keys())
        if reason := _too_short(run.motion, gmr.fps_hz):
            left_out[name] = reason
            continue
        world = stand(predict_at_source_rate(gmr, run.motion), body)
        worlds[name] = Clip(name, world, run.valid, run.image_numbers, None)
    if not worlds:
        name, reason = next(iter(left_out.items()))
        raise BadMotionFile(
            f"{source}: no run of frames is long enough ({name}: {reason}). Give a longer sequence,"
            " or the true frame rate with --fps-hz"
        )
    for name, reason in left_out.items():
        console.print(f"left out {name}: {reason}", markup=False, soft_wrap=True)
    return gmr, worlds, left_out


def _too_short(motion: Motion, fps_hz: float) -> str:
    """Why a motion has no two frames at a rate [Hz]; empty if it has, or if its rate is lower."""
    steps = (motion.n_frames - 1) / motion.fps_hz * fps_hz
    if motion.n_frames >= MIN_FRAMES and (steps > 1 - ON_A_SAMPLE or motion.fps_hz < fps_hz):
        return ""
    return (
        f"{motion.n_frames} frame{'' if motion.n_frames == 1 else 's'} at {motion.fps_hz:g} fps:"
        f" less than two at {fps_hz:g} fps"
    )


def _write_files(folder: Path, clip: Clip, body: BodyModel) -> None:
    """All but the video; each file is written as a whole, so what is there is kept."""
    from gmrdata.infer.pictures import write_top_view

    motion = clip.motion
    writers: dict[str, Callable[[Path], None]] = {
        CLIP_FILE: lambda path: save_clip(path, clip, body.rest_pelvis_m(motion.shape)),
        AMASS_FILE: lambda path: write_amass(path, motion, body),
        BVH_FILE: lambda path: write_bvh(path, motion, body),
        GLB_FILE: lambda path: write_glb(path, motion, body),
        PATH_FILE: lambda path: write_top_view(path, motion),
    }
    for file_name, write in writers.items():
        if not (folder / file_name).exists():
            write(folder / file_name)


def _write_videos(
    out_dir: Path, worlds: dict[str, Clip], body: BodyModel, config: InferConfig
) -> None:
    from gmrdata.infer.pictures import write_body_video

    for name, clip in worlds.items():
        path = out_dir / name / VIDEO_FILE
        if not path.exists():
            size_px = (config.width_px, config.height_px)
            write_body_video(path, clip.motion, body, size_px, name)


def _record(
    gmr: "TrainedGmr",
    source: Path,
    body: BodyModel,
    worlds: dict[str, Clip],
    left_out: dict[str, str],
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "poses": source.name,
        "body": body.name,
        "model": {"run": gmr.name, "step": gmr.step, "fps_hz": gmr.fps_hz},
        "motions": {
            name: {
                "frames": clip.motion.n_frames,
                "fps_hz": clip.motion.fps_hz,
                "first_frame": int(clip.image_numbers[0]),
                "last_frame": int(clip.image_numbers[-1]),
                "filled_frames": int((~clip.valid).sum()),
                "path_m": _length_m(clip.motion.pelvis_m),
                "source": clip.motion.source,
            }
            for name, clip in worlds.items()
        },
        "left_out": left_out,
    }


def _length_m(pelvis_m: np.ndarray) -> float:
    """Length of the pelvis's path over the ground [m]."""
    return round(float(np.linalg.norm(np.diff(pelvis_m[:, :2], axis=0), axis=1).sum()), 4)


def _folder_name(clip_id: str, taken: Collection[str]) -> str:
    """A name of letters, digits, `_`, `-` and `.` that leads nowhere and is not taken yet."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", clip_id).strip(".")[:100] or "motion"
    number = 2
    while name in taken:
        name, number = f"{name}_{number}", number + 1
    return name
