"""The stage: a pseudo ground truth and a network's motions to one world motion with error bars."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.fusion.camera_evidence import (
    EXACT,
    FusionConfig,
    Noise,
    WorldErrors,
    error_bars,
    fusion_config_of,
    hidden_frames,
    known_frames,
    measured_noise,
    planted_feet,
    seen_poses,
    unseen_frames,
)
from gmrdata.fusion.network_evidence import (
    DELTA_ERRORS_FILE,
    DeltaErrors,
    corrected_by_like_poses,
    free_where_hidden,
    seen_motions,
    steps_of,
    widened,
    with_pace_errors,
)
from gmrdata.fusion.record import (
    RECORD_FILE,
    SIGMA_FORMAT,
    FusedPerson,
    FusionRecord,
    Gap,
    LoopFound,
    overall_sigma,
    sigma_file,
)
from gmrdata.fusion.smoothing import SamePlace, smooth
from gmrdata.gmr.config import BUNDLED, Which, network_dir, weights_dir
from gmrdata.gmr.infer import stand
from gmrdata.gmr.predict import TrainedGmr, deltas_at_source_rate, held, load_gmr
from gmrdata.gmr.runs import check_finite, check_rate, given_body
from gmrdata.motion.resample import between_known, valid_runs
from gmrdata.read.bodies import body_inputs, load_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import WORLD_FROM_REST, BodyModel
from gmrdata.values.clip import Clip, clip_on_body, load_clip, save_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, BadRecord, MissingInput, StageFailed
from gmrdata.values.files import STAGE_FILE, write_npz
from gmrdata.values.motion import Motion, accumulate
from gmrdata.values.people import BODIES, DOUBTS_FILE, FUSED, PSEUDO_GT, person_file
from gmrdata.values.records import MAKE_AGAIN, Config
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.world.recipe import Doubts

AROUND_S = 1.0
"""About the time in which a person is seen: the motion before and after counts for the network, and
nothing says where the person is in a film's other minutes."""
HEADINGS = ("person", "frames", "rate [Hz]", "with camera", "gaps [s]", "loops")


class Loop(Config):
    """Two times at which the person stands on one spot."""

    time_s: float = Field(ge=0)  # after the clip's first frame
    other_time_s: float = Field(ge=0)


class FuseConfig(Config):
    """How cameras and a network are fused."""

    which: Which = "latest"
    fusion: FusionConfig = FusionConfig()
    loops: tuple[Loop, ...] = ()
    loop_sigma_m: float = Field(default=0.1, gt=0)
    """How far apart the pelvis may be at the two times, seen from above (1 sigma) [m]."""


@dataclass(frozen=True)
class FusedInputs:
    """What a pseudo ground truth and a network are fused of, as files."""

    clip_paths: tuple[Path, ...]  # by person, in the world
    network_dir: Path
    errors_path: Path
    quality_path: Path | None  # of a pseudo ground truth; None of other clips
    doubts_path: Path | None  # the same

    @cached_property
    def quality(self) -> PseudoGtQuality | None:
        """The record, read once for all people: that of a long film is large."""
        return None if self.quality_path is None else PseudoGtQuality.read(self.quality_path)

    @cached_property
    def doubts(self) -> Doubts | None:
        """The same of what speaks against frames."""
        return None if self.doubts_path is None else Doubts.read(self.doubts_path)

    @cached_property
    def has_world(self) -> bool:
        """Whether any of the clips has a camera somewhere."""
        cameras = (load_clip(path).camera for path in self.clip_paths)
        return any(camera is not None and camera.has_camera.any() for camera in cameras)

    @classmethod
    def of(
        cls,
        source: str | Path,
        network: str | Path = BUNDLED,
        errors_path: str | Path | None = None,
    ) -> "FusedInputs":
        """Of a source as `person_clips` takes it; MissingInput for what is not there."""
        folder = network_dir(network)
        paths = tuple(path.absolute() for path in person_clips(Path(source)))
        beside = paths[0].with_name(QUALITY_FILE), paths[0].parent.with_name(DOUBTS_FILE)
        is_solved = person_number(paths[0]) is not None and beside[0].is_file()
        there = (path if is_solved and path.is_file() else None for path in beside)
        return cls(paths, folder, errors_file(folder, errors_path), *there)

    def files(self, body_path: str | Path | None) -> dict[str, Path | None]:
        """By role, for the stage's record."""
        paths: dict[str, Path | None] = {
            "run": weights_dir(self.network_dir), "errors": self.errors_path,
            "quality": self.quality_path, "doubts": self.doubts_path, **body_inputs(body_path),
        }  # fmt: skip
        for n, path in enumerate(self.clip_paths):
            paths |= {f"clip_{n}": path, f"seen_{n}": seen_path(path)}
        return paths


def seen_path(clip_path: Path) -> Path | None:
    """The clip of a person before the camera, whose frames are those with a pose of their own; None
    where there is none beside the world's."""
    path = clip_path.parent.parent / BODIES / clip_path.name
    return path if clip_path.parent.name == PSEUDO_GT and path.is_file() else None


def person_number(clip_path: Path) -> int | None:
    """Which person of a folder a clip is, by its name; None for one that is named otherwise."""
    digits = clip_path.stem.removeprefix("person_")
    is_one = digits.isdecimal() and clip_path.name == person_file(int(digits))
    return int(digits) if is_one else None


def person_clips(source: Path) -> list[Path]:
    """The clips of a pseudo ground truth, of a video's folder that holds one, or a clip itself."""
    if source.is_file():
        return [source]
    folder = source / PSEUDO_GT if (source / PSEUDO_GT).is_dir() else source
    numbers = {person_number(path) for path in folder.glob("person_*.npz")} - {None}
    paths = [folder / person_file(number) for number in range(max(1, len(numbers)))]
    for path in paths:
        if not path.is_file():
            others = f" beside {len(numbers)} others" if numbers else ""
            raise MissingInput(
                f"{source}: no {path.name} there{others}. Give a pseudo ground truth, a folder of"
                " `gmrdata video` that was given people, or a clip"
            )
    return paths


def errors_file(run_dir: Path, given: str | Path | None) -> Path:
    """The record of a network's errors: what was given, or what lies in its run's folder."""
    path = run_dir / DELTA_ERRORS_FILE if given is None else Path(given)
    if not path.is_file():
        raise MissingInput(
            f"{path}: nothing says how wrong the network is. Measure it: gmrdata delta-errors"
            f" MANIFEST --network {run_dir} --out {path}"
        )
    return path


def fuse(
    source: str | Path,
    out_dir: str | Path,
    *,
    network: str | Path = BUNDLED,
    body_path: str | Path | None = None,
    config: FuseConfig | None = None,
    errors_path: str | Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: put cameras and network together, for each person of a pseudo ground truth.

    Args:
        source: A pseudo ground truth, a video's folder that holds one, or a clip in the world.
            One without any camera is the network's path alone, bent by feet and loops.
        out_dir: Gets `fusion.json`, and of each person `sigma_<n>.npz` and `person_<n>.npz`, with a
            pose in each frame.  `valid` are those in which the person was seen at steady times.
            A person without a usable camera is valid nowhere in a world with cameras.
        network: Run folder of a trained network, or "bundled" for the one of the package.
        body_path: Body of the clips; None for the default body.
        config: When None, settings that suit the system that saw the people.
        errors_path: The network's `delta_errors.json`; None for that in its run's folder.

    Errors are MissingInput, BadCheckpoint, BadRecord, BadMotionFile for a clip that is not in the
    world, too short or of another body, BadRecipe for a loop outside of it or of several people,
    StageFailed where nothing fits.
    """
    given = FusedInputs.of(source, network, errors_path)
    config = FuseConfig(fusion=fusion_config_of(Path(source))) if config is None else config

    def work(partial: Path) -> None:
        body = load_body(body_path)
        weighed = WeighedGmr.load(given, config.which)
        said = []
        level, fusion = given.quality and given.quality.level, config.fusion
        if level and level.remark:  # on steps, a slope or a platform feet would be pulled to z = 0
            fusion = fusion.model_copy(update={"ground": False})
        for number, person in enumerate(_people(given, config)):
            fused = fuse_person(person, weighed, body, fusion)
            if not known_frames(person.clip).any() and given.has_world:
                fused = fused.shown_nowhere
            rest_pelvis_m = body.rest_pelvis_m(fused.clip.motion.shape)
            save_clip(partial / person_file(number), fused.clip, rest_pelvis_m)
            write_npz(partial / sigma_file(number), {"format": SIGMA_FORMAT, **fused.arrays})
            said.append(_described(fused, person.loops))
        gmr, errors = weighed.gmr, weighed.errors
        FusionRecord(
            network=gmr.name, step=gmr.step, measured_on=errors.people, people=tuple(said)
        ).write(partial / RECORD_FILE)

    return run_stage("fuse", Path(out_dir), config, given.files(body_path), work, run=run)


def fuse_own_people(
    video_dir: Path, body_path: Path | None, *, run: Run = DEFAULT_RUN
) -> str | None:
    """Fill `fused/` of a solved video: people of the built-in estimator, with the network of the
    package.  Gives in words why they can't be fused; None where they are, or there are none.

    Without a body, without people in the world, and where they can't be fused, none of an earlier
    run stays.  A network without a record of its errors can't be weighed, and fuses nobody.
    """
    fused_dir, network = video_dir / FUSED, network_dir(BUNDLED)
    failed = None
    there = (video_dir / PSEUDO_GT).is_dir() and (network / DELTA_ERRORS_FILE).is_file()
    if body_path is not None and there:
        try:
            fuse(video_dir, fused_dir, network=network, body_path=body_path, run=run)
            return None
        except (BadMotionFile, StageFailed) as error:
            failed = f"people are without the network's motions, in no `{FUSED}`: {error}"
    if (fused_dir / STAGE_FILE).is_file():
        shutil.rmtree(fused_dir)
    return failed


def world_errors(quality: PseudoGtQuality | None, number: int = 0) -> WorldErrors:
    """What a pseudo ground truth says of its scale, its level and a person's distance; nothing of a
    clip that is no pseudo ground truth's.  A camera at rest has the error of the distance."""
    if quality is None:
        return EXACT
    away, share, level = quality.distance_sigmas[number], quality.scale_share, quality.level
    errors = WorldErrors(away if share is None else share, away)
    if level is None:
        return errors
    floor_at_m = None if level.remark is None else level.floor_at_m
    return replace(
        errors,
        level_deg=level.sigma_deg,
        floor_at_m=floor_at_m,
        floor_sigma_m=level.floor_sigma_m,
    )


def _unusable_rows(given: FusedInputs, number: int) -> list[int]:
    """Rows in which a body of a pseudo ground truth lies on nobody in the picture, as far as that
    was checked, or whose times are no steps of its rate.  What is said of all rows is said of the
    person."""
    fit = None if given.quality is None else given.quality.picture_fits[number]
    doubted = () if given.doubts is None else given.doubts.frames[number]
    rows = [] if all(doubted) else [row for row, doubt in enumerate(doubted) if doubt]
    return rows if fit is None else [*rows, *fit.off_rows]


@dataclass(frozen=True, eq=False)
class WorldPerson:
    """One person of a pseudo ground truth, and what else is known of the path."""

    clip: Clip
    seen: np.ndarray  # (T,) bool: frames in which somebody saw the person; all valid ones are
    loops: tuple[SamePlace, ...] = ()
    errors: WorldErrors = EXACT

    @property
    def rows(self) -> slice:
        """From the first frame that tells of the person to the last one, and `AROUND_S` about them;
        all frames where none does."""
        ends = [end for loop in self.loops for end in loop[:2]]
        there = np.r_[np.flatnonzero(self.seen), np.array(ends, dtype=int)]
        if not len(there):
            return slice(0, len(self.seen))
        around = round(AROUND_S * self.clip.motion.fps_hz)
        first, last = int(there.min()), int(there.max())
        return slice(max(0, first - around), min(len(self.seen), last + around + 1))

    def take(self, rows: slice) -> "WorldPerson":
        """The same of some frames, which hold all loops."""
        first = rows.start
        loops = tuple(
            SamePlace(one.row - first, one.other_row - first, one.sigma_m) for one in self.loops
        )
        return replace(self, clip=self.clip.take(rows), seen=self.seen[rows], loops=loops)


@dataclass(frozen=True, eq=False)
class WeighedGmr:
    """A network, and how wrong it is."""

    gmr: TrainedGmr
    errors: DeltaErrors

    @classmethod
    def load(cls, given: FusedInputs, which: Which) -> "WeighedGmr":
        """BadRecipe for errors of networks of another frame rate, which grow otherwise."""
        gmr, errors = load_gmr(given.network_dir, which), DeltaErrors.read(given.errors_path)
        if abs(errors.fps_hz / gmr.fps_hz - 1) > 1e-6:
            raise BadRecipe(
                f"{given.errors_path}: of networks of {errors.fps_hz:g} fps, and {gmr.name} is of"
                f" {gmr.fps_hz:g} fps. Measure its own with gmrdata delta-errors"
            )
        return cls(gmr, errors)


def _people(given: FusedInputs, config: FuseConfig) -> Iterator[WorldPerson]:
    """One by one: each holds all frames of a film, for whoever is seen for a moment too."""
    if config.loops and len(given.clip_paths) > 1:
        raise BadRecipe(f"--loops is of one person: give its clip, like {given.clip_paths[0]}")
    for path in given.clip_paths:
        yield _person(given, path, config)


def _person(given: FusedInputs, path: Path, config: FuseConfig) -> WorldPerson:
    clip, before_camera = _world_clip(path), seen_path(path)
    before = None if before_camera is None else load_clip(before_camera).valid
    if before is not None and len(before) != len(clip.valid):
        what = f"is of other frames than clip {clip.id}; make both again"
        raise BadMotionFile(f"{before_camera}: {what}")
    number, loops = person_number(path) or 0, tuple(_loop_rows(clip, config))
    if given.quality is not None and number >= len(given.quality.distance_sigmas):
        raise BadRecord(f"{given.quality_path}: knows no person {number}; {MAKE_AGAIN}")
    told = given.doubts and given.doubts.frames[number : number + 1]
    if told is not None and [*map(len, told)] != [len(clip.valid)]:
        raise BadRecord(f"{given.doubts_path}: is of other people or frames; {MAKE_AGAIN}")
    errors = world_errors(given.quality, number)
    seen = seen_frames(clip) if before is None else before
    unusable = np.isin(np.arange(len(seen)), _unusable_rows(given, number))
    seen = seen & ~unusable | clip.valid
    return WorldPerson(clip, seen, loops, errors)


def seen_frames(clip: Clip) -> np.ndarray:
    """(T,) bool: frames of a clip alone in which the person was seen: those that are valid, and
    those between them in which the camera is not known, which say nothing of the person."""
    rows = np.flatnonzero(clip.valid)
    if not len(rows):
        return np.ones(len(clip.valid), dtype=bool)
    between = np.zeros(len(clip.valid), dtype=bool)
    between[rows[0] : rows[-1] + 1] = clip.camera is not None
    return clip.valid | (between & ~unseen_frames(clip))


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
    loops = []
    for loop in config.loops:
        said = f"loop {loop.time_s:g}:{loop.other_time_s:g}"
        if max(loop.time_s, loop.other_time_s) > last_s + 0.5 / fps_hz:
            raise BadRecipe(f"{said}: clip {clip.id} lasts {last_s:.2f} s. Give times within it")
        row, other_row = (round(at_s * fps_hz) for at_s in (loop.time_s, loop.other_time_s))
        if row == other_row:
            raise BadRecipe(f"{said}: both are frame {row}. Give two times")
        n = clip.motion.n_frames - 1
        loops.append(SamePlace(min(row, n), min(other_row, n), config.loop_sigma_m))
    return loops


@dataclass(frozen=True, eq=False)
class FusedClip:
    """One person's world motion, with error bars."""

    clip: Clip  # a pose in every frame, valid where the person was seen; cameras as they were
    arrays: dict[str, np.ndarray]  # as `gmrdata.fusion.record` has them
    noise: Noise
    network_m: np.ndarray  # (T, 3) path by the network's motions alone, from the first pose on

    def within(self, whole: Clip, rows: slice) -> "FusedClip":
        """These frames as some of a whole clip's: the person stays as in the first of them before,
        and as in the last one after, with no error bar (NaN)."""
        n = whole.motion.n_frames
        nearest = np.clip(np.arange(n) - rows.start, 0, self.clip.motion.n_frames - 1)
        outside = np.ones(n, dtype=bool)
        outside[rows] = False
        arrays = {key: of[nearest] for key, of in self.arrays.items()}
        for key, of in arrays.items():
            of[outside] = False if key == "has_camera" else np.nan
        valid = self.clip.valid[nearest] & ~outside
        clip = replace(whole, motion=self.clip.motion.take(nearest), valid=valid)
        return replace(self, clip=clip, arrays=arrays, network_m=self.network_m[nearest])

    @property
    def shown_nowhere(self) -> Self:
        """The same of a world of one's own, which nothing ties to that of the cameras."""
        return replace(self, clip=replace(self.clip, valid=np.zeros_like(self.clip.valid)))


def fuse_person(
    person: WorldPerson, network: WeighedGmr, body: BodyModel, config: FusionConfig
) -> FusedClip:
    """Put a clip's cameras, a network's motions, feet and loops together, in the person's time."""
    rows = person.rows
    try:
        return _fused(person.take(rows), network, body, config).within(person.clip, rows)
    except StageFailed as error:
        raise StageFailed(f"{person.clip.id}: {error}") from None


def _fused(
    person: WorldPerson, network: WeighedGmr, body: BodyModel, config: FusionConfig
) -> FusedClip:
    remedy = "Give the clip's own with --body"
    given_body(person.clip.motion, [body], BadMotionFile, f"clip {person.clip.id}: of", remedy)
    clip, gmr = _posed(clip_on_body(person.clip, body)), network.gmr
    motion, known = clip.motion, known_frames(clip)
    check_finite(clip)
    predicted = deltas_at_source_rate(gmr, motion)
    path = held(gmr, motion.local_rotmats, predicted[:2], motion.fps_hz)
    motions = seen_motions(predicted, motion.fps_hz, network.errors)
    hidden = hidden_frames(person.seen, motion.fps_hz)
    # With a camera or without: a hand over the lens hides the person too.
    motions = widened(motions, unseen_frames(clip) | ~person.seen, config.unseen_widening)
    motions = free_where_hidden(motions, hidden)
    if config.pace_share > 0:
        motions = with_pace_errors(motions, motion.fps_hz, config.pace_share)
    if not known.any():
        motion = stand(_placed(motion, *path, WORLD_FROM_REST, np.zeros(3), 0), body)
        clip = replace(clip, motion=motion)
    noise = measured_noise(clip, motions, config)
    seen = seen_poses(clip, noise, config)
    if config.like_poses:
        motions = corrected_by_like_poses(body, motion, motions, seen)
    feet = None
    if config.feet:  # which stand is clearer where soles hold the motion
        corrected = motions.delta_rotmats, motions.delta_m
        deltas = held(gmr, motion.local_rotmats, corrected, motion.fps_hz)
        feet = planted_feet(body, motion, deltas, config)
        feet = replace(feet, still=feet.still & ~steps_of(hidden))
    poses = smooth(motion.fps_hz, seen, motions, feet=feet, loops=person.loops)
    first = int(known.argmax())
    alone = _placed(motion, *path, poses.rotmats[first], poses.pelvis_m[first], first)
    sigmas = error_bars(poses, clip, config, person.errors)
    source = f"{motion.source}; put together with GMR {gmr.name} (step {gmr.step})"
    motion = replace(motion, root_rotmats=poses.rotmats, pelvis_m=poses.pelvis_m, source=source)
    return FusedClip(
        replace(clip, motion=motion, valid=person.seen),
        {**sigmas, "has_camera": known},
        noise,
        alone.pelvis_m,
    )


def _posed(clip: Clip) -> Clip:
    """The same with poses made up between those of the nearest frames where frames that are not
    valid hold none: a network sees all frames in a row."""
    local_rotmats = clip.motion.local_rotmats
    there = np.isfinite(local_rotmats).all((1, 2, 3))
    lacking = np.flatnonzero(~there & ~clip.valid)
    if not len(lacking) or not there.any():
        return clip
    between = between_known(np.flatnonzero(there), lacking)
    made_up = between.turned(local_rotmats[there])
    local_rotmats = local_rotmats.copy()
    local_rotmats[lacking] = made_up
    return replace(clip, motion=replace(clip.motion, local_rotmats=local_rotmats))


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


def _described(fused: FusedClip, loops: tuple[SamePlace, ...]) -> FusedPerson:
    clip, known = fused.clip, fused.arrays["has_camera"]
    fps_hz = clip.motion.fps_hz
    place_m, turn_deg = (
        overall_sigma(fused.arrays[key]) for key in ("place_sigma_m", "turn_sigma_deg")
    )
    there = np.isfinite(place_m)
    gaps = tuple(
        Gap(
            start=start,
            stop=stop,
            seconds=(stop - start) / fps_hz,
            place_sigma_m=float(place_m[start:stop].max()),
            turn_sigma_deg=float(turn_deg[start:stop].max()),
        )
        for start, stop in valid_runs(~known & there)
    )
    return FusedPerson(
        id=clip.id,
        frames=clip.motion.n_frames,
        fps_hz=fps_hz,
        frames_with_camera=int(known.sum()),
        noise_along_m=fused.noise.along_m,
        noise_across_m=fused.noise.across_m,
        noise_turn_deg=float(np.rad2deg(fused.noise.turn_rad)),
        place_sigma_m=float(np.median(place_m[there])),
        turn_sigma_deg=float(np.median(turn_deg[there])),
        largest_place_sigma_m=float(place_m[there].max()),
        largest_turn_sigma_deg=float(turn_deg[there].max()),
        gaps=gaps,
        loops=tuple(
            LoopFound(
                time_s=loop.row / fps_hz,
                other_time_s=loop.other_row / fps_hz,
                apart_m=_apart_m(clip.motion.pelvis_m, loop),
                network_apart_m=_apart_m(fused.network_m, loop),
            )
            for loop in loops
        ),
    )


def _apart_m(path_m: np.ndarray, loop: SamePlace) -> float:
    return float(np.linalg.norm((path_m[loop.other_row] - path_m[loop.row])[:2]))


def plan(
    source: str | Path,
    *,
    network: str | Path = BUNDLED,
    config: FuseConfig,
    errors_path: str | Path | None = None,
) -> list[tuple[str, ...]]:
    """What a dry run says, person by person; errors as `fuse` has them for its inputs."""
    given = FusedInputs.of(source, network, errors_path)
    gmr, rows = WeighedGmr.load(given, config.which).gmr, list[tuple[str, ...]]()
    for person in _people(given, config):
        clip, fps_hz = person.clip, person.clip.motion.fps_hz
        check_rate(clip.id, fps_hz, gmr.fps_hz)
        known = known_frames(clip)
        runs = valid_runs(~known[person.rows])
        gaps = ", ".join(f"{(stop - start) / fps_hz:.2f}" for start, stop in runs)
        counts = str(len(known)), f"{fps_hz:g}", str(int(known.sum()))
        rows.append((clip.id, *counts, gaps or "none", str(len(person.loops))))
    return rows
