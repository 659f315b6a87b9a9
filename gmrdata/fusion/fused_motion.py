"""The stage: a pseudo ground truth and a network's motions to one world motion with error bars.

It stands here and not in `gmrdata.world`, which knows no network: the network's motions go into the
pose graph of `gmrdata.fusion.fusion` as plain arrays.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.fusion.delta_errors import DELTA_ERRORS_FILE, DeltaErrors, seen_motions
from gmrdata.fusion.evidence import (
    FusionConfig,
    Noise,
    error_bars,
    fusion_config_of,
    known_frames,
    measured_noise,
    planted_feet,
    seen_poses,
    unseen_frames,
    widened,
    with_pace_errors,
)
from gmrdata.fusion.fusion import SamePlace, fuse
from gmrdata.fusion.like_poses import corrected_by_like_poses
from gmrdata.gmr.config import Which
from gmrdata.gmr.infer import stand
from gmrdata.gmr.predict import (
    BUNDLED,
    TrainedGmr,
    deltas_at_source_rate,
    load_gmr,
    network_dir,
)
from gmrdata.gmr.runs import check_finite
from gmrdata.motion.resample import valid_runs
from gmrdata.stage.progress import remark
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import WORLD_FROM_REST, BodyModel
from gmrdata.values.clip import Clip, clip_on_body, load_clip, save_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput, StageFailed
from gmrdata.values.files import STAGE_FILE, write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.motion_deltas import accumulate
from gmrdata.values.people import FUSED, PSEUDO_GT, person_file
from gmrdata.values.records import ArrayShapes, Config, Figure, Record, read_arrays
from gmrdata.world.quality import PseudoGtQuality

RECORD_FILE = "fusion.json"
SIGMA_FORMAT = "gmrdata-fusion-sigma/1"
_SIGMA_SHAPES: ArrayShapes = {
    "place_sigma_m": ("f", ("T", 3)),  # standard deviation of the pelvis, world axes [m]
    "turn_sigma_deg": ("f", ("T", 3)),  # and of the root about its own axes [degrees]
    "has_camera": ("b", ("T",)),  # frames whose pose a camera gave, too
}


class Loop(Config):
    """Two times at which the person stands on one spot."""

    time_s: float = Field(ge=0)  # after the clip's first frame
    other_time_s: float = Field(ge=0)


class FuseConfig(Config):
    """What is fused, and how."""

    which: Which = "latest"
    fusion: FusionConfig = FusionConfig()
    loops: tuple[Loop, ...] = ()
    loop_sigma_m: float = Field(default=0.1, gt=0)
    """How far apart the pelvis may be at the two times, seen from above (1 sigma) [m]."""


DEFAULT_CONFIG = FuseConfig()


class Gap(Config):
    """Frames in a row without a camera."""

    start: int
    """First row."""
    stop: int
    seconds: Figure
    place_sigma_m: Figure
    """Largest standard deviation in it, as the root mean square of the three axes."""
    turn_sigma_deg: Figure


class LoopFound(Config):
    """A loop, and how far apart its ends are."""

    time_s: Figure
    other_time_s: Figure
    apart_m: Figure
    """Seen from above, after all was put together."""
    network_apart_m: Figure
    """By the network's motions alone."""


class FusedPerson(Config):
    """What was made of one person."""

    id: str
    frames: int
    fps_hz: float
    frames_with_camera: int
    noise_along_m: Figure
    """Of the camera's poses from frame to frame, along its ray; as it was taken."""
    noise_across_m: Figure
    noise_turn_deg: Figure
    place_sigma_m: Figure
    """Median over the frames of the root mean square of the three axes."""
    turn_sigma_deg: Figure
    largest_place_sigma_m: Figure
    largest_turn_sigma_deg: Figure
    gaps: tuple[Gap, ...]
    loops: tuple[LoopFound, ...]


class FusionRecord(Record):
    """`fusion.json`."""

    format: Literal["gmrdata-fusion/1"] = "gmrdata-fusion/1"
    network: str
    step: int
    measured_on: tuple[str, ...]
    """People on whom the network's errors were measured."""
    people: tuple[FusedPerson, ...]


def person_clips(source: Path) -> list[Path]:
    """The clips of a pseudo ground truth, of a video's folder that holds one, or a clip itself."""
    if source.is_file():
        return [source]
    folder = source / PSEUDO_GT if (source / PSEUDO_GT).is_dir() else source
    paths: list[Path] = []
    while (path := folder / person_file(len(paths))).is_file():
        paths.append(path)
    if not paths:
        raise MissingInput(
            f"{source}: no {person_file(0)} there. Give a pseudo ground truth, a folder of `gmrdata"
            " video` that was given people, or a clip"
        )
    return paths


def errors_file(run_dir: Path, given: Path | None) -> Path:
    """The record of a network's errors: what was given, or what lies in its run's folder."""
    path = run_dir / DELTA_ERRORS_FILE if given is None else given
    if not path.is_file():
        raise MissingInput(
            f"{path}: nothing says how wrong the network is. Measure it: gmrdata delta-errors"
            f" {run_dir} --manifests MANIFEST --out {path.name}"
        )
    return path


def fuse_people(
    source: Path,
    run_dir: Path,
    body_path: Path | None,
    out_dir: Path,
    config: FuseConfig = DEFAULT_CONFIG,
    *,
    errors_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: put cameras and network together, for each person of a pseudo ground truth.

    Args:
        source: As `person_clips` takes it.  Clips are in the world; those without any camera are
            the network's path alone, bent by feet and loops.
        body_path: Body of the clips; None for the default body.
        out_dir: Gets `fusion.json`, and of each person `person_<n>.npz`, all of whose frames are
            valid, and `sigma_<n>.npz`.
        errors_path: The network's `delta_errors.json`; None for that in its run's folder.

    Errors are MissingInput, BadCheckpoint, BadRecord, BadMotionFile for a clip that is not in the
    world or too short, BadRecipe for a loop outside of it, StageFailed where nothing fits.
    """
    paths, record_path = person_clips(source), errors_file(run_dir, errors_path)
    inputs = {f"clip_{number}": path for number, path in enumerate(paths)}
    inputs |= {"run": run_dir, "errors": record_path}
    inputs |= {} if body_path is None else {"body": body_path}
    clips = [_world_clip(path) for path in paths]
    rows = [_loop_rows(clip, config) for clip in clips]
    scale_share = scale_error(paths[0].with_name(QUALITY_FILE))
    if source.is_dir():
        inputs["quality"] = paths[0].with_name(QUALITY_FILE)

    def work(partial: Path) -> None:
        from gmrdata.read.bodies import load_body

        body = load_body("anny" if body_path is None else str(body_path))
        gmr, errors = load_gmr(run_dir, config.which), DeltaErrors.read(record_path)
        people = []
        for number, (clip, loops) in enumerate(zip(clips, rows, strict=True)):
            clip = clip_on_body(clip, body)
            fused = fuse_clip(
                clip, gmr, errors, body, config.fusion, loops, scale_share=scale_share
            )
            rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
            save_clip(partial / person_file(number), fused.clip, rest_pelvis_m)
            write_npz(partial / sigma_file(number), {"format": SIGMA_FORMAT, **fused.arrays})
            people.append(_described(fused, loops))
        FusionRecord(
            network=gmr.name, step=gmr.step, measured_on=errors.people, people=tuple(people)
        ).write(partial / RECORD_FILE)

    return run_stage("fuse", out_dir, config, inputs, work, run=run)


def fuse_own_people(video_dir: Path, body_path: Path | None, *, run: Run = DEFAULT_RUN) -> None:
    """Fill `fused/` of a solved video: people of the built-in estimator, with the network of the
    package.

    Without a body, without people in the world, and where they can't be fused, which is said, none
    of an earlier run stays.  A network without a record of its errors can't be weighed, and fuses
    nobody.
    """
    fused_dir, network = video_dir / FUSED, network_dir(BUNDLED)
    there = (video_dir / PSEUDO_GT).is_dir() and (network / DELTA_ERRORS_FILE).is_file()
    if body_path is not None and there:
        config = FuseConfig(fusion=fusion_config_of(video_dir))
        try:
            fuse_people(video_dir, network, body_path, fused_dir, config, run=run)
            return
        except (BadMotionFile, StageFailed) as error:
            remark(f"without the network's motions: {error}")
    if (fused_dir / STAGE_FILE).is_file():
        shutil.rmtree(fused_dir)


def scale_error(quality_path: Path) -> float:
    """Standard error of a pseudo ground truth's scale, as a share of it; 0 where none enters, or
    the clip is no pseudo ground truth's."""
    if not quality_path.is_file():
        return 0.0
    quality = PseudoGtQuality.read(quality_path)
    if quality.scale is None or quality.scale_sigma is None:
        return 0.0
    return quality.scale_sigma / quality.scale


def sigma_file(number: int) -> str:
    """Name of the error bars of a person's frames; people are counted from 0."""
    return f"sigma_{number}.npz"


def load_sigma(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an error-bar file, as `_SIGMA_SHAPES` has them; BadRecord for another file."""
    return read_arrays(path, SIGMA_FORMAT, _SIGMA_SHAPES)


def _world_clip(path: Path) -> Clip:
    clip = load_clip(path)
    if clip.motion.frame != "world":
        raise BadMotionFile(f"{path}: the motion is not in the world. Give a pseudo ground truth")
    if clip.motion.n_frames < 3:
        raise BadMotionFile(
            f"{path}: {clip.motion.n_frames} frames are too few. Give three or more"
        )
    return clip


def _loop_rows(clip: Clip, config: FuseConfig) -> list[SamePlace]:
    """The loops by the clip's rows; BadRecipe for one that is outside, or of one moment."""
    last_s, fps_hz = (clip.motion.n_frames - 1) / clip.motion.fps_hz, clip.motion.fps_hz
    found = []
    for loop in config.loops:
        said = f"loop {loop.time_s:g}:{loop.other_time_s:g}"
        if max(loop.time_s, loop.other_time_s) > last_s + 0.5 / fps_hz:
            raise BadRecipe(f"{said}: clip {clip.id} lasts {last_s:.2f} s. Give times within it")
        row, other_row = (round(at_s * fps_hz) for at_s in (loop.time_s, loop.other_time_s))
        if row == other_row:
            raise BadRecipe(f"{said}: both are frame {row}. Give two times")
        n = clip.motion.n_frames - 1
        found.append(SamePlace(min(row, n), min(other_row, n), config.loop_sigma_m))
    return found


@dataclass(frozen=True, eq=False)
class FusedClip:
    """One person's world motion, with error bars."""

    clip: Clip  # all frames valid; cameras as they were
    arrays: dict[str, np.ndarray]  # as `_SIGMA_SHAPES` has them
    noise: Noise
    network_m: np.ndarray  # (T, 3) path by the network's motions alone, from the first pose on


def fuse_clip(
    clip: Clip,
    gmr: TrainedGmr,
    errors: DeltaErrors,
    body: BodyModel,
    config: FusionConfig,
    loops: Sequence[SamePlace] = (),
    *,
    scale_share: float = 0.0,
) -> FusedClip:
    """Put a clip's cameras, a network's motions, feet and loops together.

    `scale_share` is the standard error of the cameras' scale, as a share of it.
    """
    motion, known = clip.motion, known_frames(clip)
    check_finite(clip)
    found = deltas_at_source_rate(gmr, motion)
    motions = widened(
        seen_motions(*found, motion.fps_hz, errors), unseen_frames(clip), config.unseen_widening
    )
    if config.pace_share > 0:
        motions = with_pace_errors(motions, motion.fps_hz, config.pace_share)
    if not known.any():
        motion = stand(_placed(motion, *found, WORLD_FROM_REST, np.zeros(3), 0), body)
        clip = replace(clip, motion=motion)
    noise = measured_noise(clip, motions, config)
    seen = seen_poses(clip, noise)
    if config.like_poses:
        motions = corrected_by_like_poses(body, motion, motions, seen)
    feet = planted_feet(body, motion, motions, config) if config.feet else None
    poses = fuse(motion.fps_hz, seen, motions, feet=feet, loops=loops)
    first = int(known.argmax())
    alone = _placed(motion, *found, poses.rotmats[first], poses.pelvis_m[first], first)
    place_m, turn_deg = error_bars(poses, clip, config, scale_share)
    return FusedClip(
        replace(
            clip,
            motion=replace(
                motion,
                root_rotmats=poses.rotmats,
                pelvis_m=poses.pelvis_m,
                source=f"{motion.source}; put together with GMR {gmr.name} (step {gmr.step})",
            ),
            valid=np.ones(motion.n_frames, dtype=bool),
        ),
        {"place_sigma_m": place_m, "turn_sigma_deg": turn_deg, "has_camera": known},
        noise,
        alone.pelvis_m,
    )


def _placed(
    motion: Motion,
    delta_rotmats: np.ndarray,
    delta_m: np.ndarray,
    root_rotmat: np.ndarray,
    pelvis_m: np.ndarray,
    row: int,
) -> Motion:
    """The network's path alone, with a root (3, 3) and a pelvis (3,) [m] in one row."""
    roots, path_m = accumulate(delta_rotmats, delta_m, np.eye(3), np.zeros(3))
    world_from_start = root_rotmat @ roots[row].T
    return replace(
        motion,
        root_rotmats=world_from_start @ roots,
        pelvis_m=pelvis_m + (path_m - path_m[row]) @ world_from_start.T,
        frame="world",
    )


def _described(fused: FusedClip, loops: Sequence[SamePlace]) -> FusedPerson:
    clip, known = fused.clip, fused.arrays["has_camera"]
    fps_hz = clip.motion.fps_hz
    place_m, turn_deg = (
        overall_sigma(fused.arrays[key]) for key in ("place_sigma_m", "turn_sigma_deg")
    )
    gaps = tuple(
        Gap(
            start=start,
            stop=stop,
            seconds=(stop - start) / fps_hz,
            place_sigma_m=float(place_m[start:stop].max()),
            turn_sigma_deg=float(turn_deg[start:stop].max()),
        )
        for start, stop in valid_runs(~known)
    )
    ends = [(loop, clip.motion.pelvis_m, fused.network_m) for loop in loops]
    return FusedPerson(
        id=clip.id,
        frames=clip.motion.n_frames,
        fps_hz=fps_hz,
        frames_with_camera=int(known.sum()),
        noise_along_m=fused.noise.along_m,
        noise_across_m=fused.noise.across_m,
        noise_turn_deg=float(np.rad2deg(fused.noise.turn_rad)),
        place_sigma_m=float(np.median(place_m)),
        turn_sigma_deg=float(np.median(turn_deg)),
        largest_place_sigma_m=float(place_m.max()),
        largest_turn_sigma_deg=float(turn_deg.max()),
        gaps=gaps,
        loops=tuple(
            LoopFound(
                time_s=loop.row / fps_hz,
                other_time_s=loop.other_row / fps_hz,
                apart_m=_apart_m(path_m, loop),
                network_apart_m=_apart_m(network_m, loop),
            )
            for loop, path_m, network_m in ends
        ),
    )


def _apart_m(path_m: np.ndarray, loop: SamePlace) -> float:
    return float(np.linalg.norm((path_m[loop.other_row] - path_m[loop.row])[:2]))


def overall_sigma(sigmas: np.ndarray) -> np.ndarray:
    """(T,) root mean square over the three axes."""
    return np.asarray(np.sqrt((sigmas**2).mean(axis=1)))


HEADINGS = ("person", "frames", "rate [Hz]", "with camera", "gaps [s]", "loops")
RESULT_HEADINGS = (
    "person", "frames", "with camera", "longest gap [s]", "place, 1 sigma [mm]", "at most [mm]",
    "turn, 1 sigma [deg]", "at most [deg]",
)  # fmt: skip


def plan(
    source: Path, run_dir: Path, config: FuseConfig, *, errors_path: Path | None = None
) -> list[tuple[str, ...]]:
    """What a dry run says, person by person; errors as `fuse_people` has them for its inputs."""
    load_gmr(run_dir, config.which)
    DeltaErrors.read(errors_file(run_dir, errors_path))
    rows: list[tuple[str, ...]] = []
    for path in person_clips(source):
        clip = _world_clip(path)
        known, fps_hz = known_frames(clip), clip.motion.fps_hz
        gaps = ", ".join(f"{(stop - start) / fps_hz:.2f}" for start, stop in valid_runs(~known))
        n_loops = len(_loop_rows(clip, config))
        counts = str(len(known)), f"{fps_hz:g}", str(int(known.sum()))
        rows.append((clip.id, *counts, gaps or "none", str(n_loops)))
    return rows


def result_rows(record: FusionRecord) -> list[tuple[str, ...]]:
    """A row of `RESULT_HEADINGS` for each person."""
    return [
        (
            one.id,
            str(one.frames),
            str(one.frames_with_camera),
            f"{max((gap.seconds for gap in one.gaps), default=0.0):.2f}",
            f"{1000 * one.place_sigma_m:.0f}",
            f"{1000 * one.largest_place_sigma_m:.0f}",
            f"{one.turn_sigma_deg:.2f}",
            f"{one.largest_turn_sigma_deg:.2f}",
        )
        for one in record.people
    ]
