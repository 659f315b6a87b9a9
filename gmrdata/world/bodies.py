"""Stage: the people of another system's file, placed before a video's camera, as clips."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass as part

from gmrdata.motion.resample import between_known
from gmrdata.read.bodies import load_body
from gmrdata.read.systems import phalp, prompthmr
from gmrdata.read.systems.entries import AGAIN
from gmrdata.read.systems.result import read_system
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import NEUTRAL, BodyModel, gender_of, shape_on
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.values.motion import Motion
from gmrdata.values.people import (
    POSES_FILE,
    EstimatedPeople,
    EstimatedPerson,
    LocalPosesRecord,
    PersonFiles,
    System,
    person_file,
)
from gmrdata.values.records import PART, Config, Figure, Record
from gmrdata.world.placement import PlacedBody, assumed_place, place_body
from gmrdata.world.size import (
    ESTIMATED_SIGMA,
    EVERYBODY,
    UNKNOWN_SIGMA,
    HeightConfig,
    can_grow,
    height_m,
    height_of,
    of_height,
    told_sigma,
)

BODIES_FILE = "bodies.json"
NOT_SEEN = "the file of bodies has nobody there"
NEAREST_M, FURTHEST_M = 0.1, 1000.0
"""Distances of a pelvis along the camera's axis that a picture can be of [m]."""
LONGEST_BETWEEN_S = 0.101
"""Time between two poses over which those between are good enough to be used: of a walk, sampled at
5 Hz, the pelvis between is off by up to 4 cm, which grows with the square of the time.  Three
frames of 29.97 Hz take 0.1001 s, and clocks of phones err [s]."""
SAME_LENS = 0.01
"""Difference of two lenses' rays, as a share, up to which one places people as the other does: it
moves them by less than a height that is told may be off."""
ODD_FRAMES = 2
"""Frames by which the counts of two decoders may differ, at a video's end."""


class BodiesConfig(Config):
    """How the rows of a file belong to the frames of a video."""

    frames_per_row: int = Field(default=1, ge=1, le=1000)
    """The file was made from every n-th frame of the video; poses between are interpolated."""
    min_images: int = Field(default=10, ge=2)
    """Who is seen in fewer images is left out; the one seen in most of them never is."""
    heights: tuple[HeightConfig, ...] = ()
    """Who is how tall, where it is known."""


@part(frozen=True, config=PART)
class BodyFacts:
    """One person of the file."""

    name: str
    """As the file counts: "person_<number>"."""
    images: PositiveInt
    """In which the person has a pose."""
    first_image: int
    last_image: int
    median_depth_m: Figure
    """Distance of the pelvis along the camera's axis."""
    median_depth_in_file_m: Figure
    """The same before the camera that the file assumes."""
    height_m: Figure
    """Of the body that stands for the person."""
    size_sigma: Figure
    """Standard error of its size, as a share; distances and the scale hang on it."""


class BodiesRecord(Record):
    """`bodies.json`: who was read from which file, and on what body."""

    format: Literal["gmrdata-bodies/2"] = "gmrdata-bodies/2"
    estimator: System
    file: str
    body: str
    people: tuple[BodyFacts, ...]
    """In the order of `person_<n>.npz`."""
    left_out: tuple[str, ...]
    """Who is seen in too few images, or does not stand before the camera."""
    notes: tuple[str, ...]
    """What one should know of the bodies' sizes, and of odd counts."""


class _BodiesRecipe(Config):
    bodies: BodiesConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial: tuple[float, float]
    size_px: tuple[int, int]
    fps_hz: float
    image_numbers: tuple[int, ...]
    frame_numbers: tuple[int, ...]


def make_bodies(
    poses_path: Path,
    filmed: Filmed,
    body_path: Path,
    out_dir: Path,
    config: BodiesConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> tuple[PersonFiles, ...]:
    """Write `person_<n>.npz`, clips in the camera's frame with a row for every image.

    Rows without a pose are filled between their neighbours; they are not valid, but for those
    between two rows of a file of every n-th frame that are at most 0.1 s apart.

    Raises:
        MissingInput, BadMotionFile, BrokenPickle, UnsafePickle: as `read_system`; or the file is of
            another video, by its frames or its pictures; or the built-in estimator's, of another
            lens or body.
    """
    estimated, (frames, lens) = read_system(poses_path, "camera"), filmed
    recipe = _BodiesRecipe(
        bodies=config,
        intrinsics_px=tuple(tuple(row) for row in lens.matrix_px.tolist()),
        radial=lens.radial,
        size_px=frames.size_px,
        fps_hz=frames.rate_hz,
        image_numbers=tuple(frames.numbers.tolist()),
        frame_numbers=tuple(frames.frame_numbers.tolist()),
    )

    def work(partial: Path) -> None:
        _write(estimated, poses_path, filmed, load_body(body_path), config, partial)

    inputs = {"body": body_path} | {f"poses_{n}": path for n, path in enumerate(estimated.files)}
    run_stage("bodies", out_dir, recipe, inputs, work, run=run)
    people = BodiesRecord.read(out_dir / BODIES_FILE).people
    return tuple(PersonFiles(out_dir / person_file(n), body_path) for n in range(len(people)))


def check_people(
    results: EstimatedPeople, poses_path: Path, frames: FrameSet, config: BodiesConfig
) -> None:
    """Refuse people of other frames or pictures; errors as of `make_bodies`, if they tell."""
    _check_frames(results, poses_path, frames, config)
    for person, _ in _seen_enough(results, poses_path, frames, config)[0]:
        assert person.in_camera is not None
        assumed_place(person.in_camera, frames.size_px, poses_path)


def _write(
    found: EstimatedPeople,
    poses_path: Path,
    filmed: Filmed,
    body: BodyModel,
    config: BodiesConfig,
    folder: Path,
) -> None:
    frames, lens = filmed
    if found.system == "gmrdata":
        _require_same_view(poses_path, lens, body)
    notes = [*_check_frames(found, poses_path, frames, config), *_size_notes(found, body, config)]
    people, left_out = _seen_enough(found, poses_path, frames, config)
    facts: list[BodyFacts] = []
    nowhere = np.full((n := len(frames.paths), 4, 4), np.nan)
    unknown = CameraPath(lens.matrix_px, *frames.size_px, nowhere, np.zeros(n, bool))
    for person, numbers in people:
        placed = place_body(person, body, lens, frames.size_px, poses_path)
        depths_m = placed.pelvis_m[:, 2]
        known = np.flatnonzero((depths_m > NEAREST_M) & (depths_m < FURTHEST_M))
        valid = _seen(frames, numbers[known], config.frames_per_row)
        if valid.sum() < 2:
            left_out.append(f"{person.name} does not stand before the camera")
            continue
        source = f"{poses_path.name} ({found.system}), {person.name}"
        at = between_known(numbers[known], frames.frame_numbers)
        motion = at.moved(_motion(person, placed, body, frames.rate_hz, source).take(known))
        told_m = height_of(person.name, config.heights)
        motion = motion if told_m is None else of_height(motion, body, told_m)
        clip = Clip(person.name, motion, valid, frames.numbers, unknown)
        path = folder / person_file(len(facts))
        save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
        own_sigma = ESTIMATED_SIGMA if person.has_betas_of(body.name) else UNKNOWN_SIGMA
        sigma = own_sigma if told_m is None else told_sigma(told_m)
        facts.append(_facts(clip, at.placed(placed.assumed_depths_m[known])[valid], body, sigma))
    if not facts:
        raise BadMotionFile(f"{poses_path}: {'; '.join(left_out)}. {AGAIN}")
    BodiesRecord(
        estimator=found.system,
        file=poses_path.name,
        body=body.name,
        people=tuple(facts),
        left_out=tuple(left_out),
        notes=tuple(notes),
    ).write(folder / BODIES_FILE)


def _require_same_view(poses_dir: Path, lens: Lens, body: BodyModel) -> None:
    """Refuse places of the built-in estimator that are by another lens, or of another body: they
    are for its own, so nothing brings them to this one."""
    made = LocalPosesRecord.read(poses_dir / POSES_FILE)
    grid = np.meshgrid(*(np.linspace(0, side_px, 9) for side_px in lens.size_px))
    rays, its_rays = (one.rays(np.stack(grid, axis=-1)) for one in (lens, made.lens))
    said, here = (
        f"the body {name} before a lens of {one.focal_px[0]:.0f} px, k1 {one.radial[0]:.3g}"
        for name, one in ((made.body, made.lens), (body.name, lens))
    )
    apart = np.linalg.norm(its_rays - rays) / np.linalg.norm(rays)
    if made.body != body.name or (apart > SAME_LENS and made.size_px == lens.size_px):
        what = f"was made for {said}, and here it is {here}"
        raise BadMotionFile(f"{poses_dir}: {what}. Leave --poses out, so that it is made anew")


def _check_frames(
    results: EstimatedPeople, path: Path, frames: FrameSet, config: BodiesConfig
) -> list[str]:
    """Refuse a file of another video or rate, as far as its frames tell; small differences."""
    if results.system == "vibe":
        _require_even(path, frames)
    step, is_part = config.frames_per_row, frames.n_frames is None
    n_video = frames.n_frames or int(frames.frame_numbers[-1]) + 1  # or more, of a part
    if min(int(person.frame_numbers[0]) for person in results.people) < 0:
        raise BadMotionFile(f"{path}: frame numbers below 0. {AGAIN}")
    n_file = results.n_frames or 1 + max(int(person.frame_numbers[-1]) for person in results.people)
    says = f"{path}: is of {n_file} frames" + ("" if results.n_frames else " or more")
    remedy = "If it was made of every n-th frame, say --poses-every n; else give the video's own"
    for_it = -((_first_frame(results, frames, step) - n_video) // step)
    if phalp.ends_early(results, for_it):
        return [f"PHALP ended after {n_file} frames: for the others run it with {phalp.ALL_FRAMES}"]
    if results.system == "phalp" and n_file < for_it:
        remedy += f", or run PHALP with {phalp.ALL_FRAMES}"
    is_longer = n_file > for_it + ODD_FRAMES and not is_part
    if is_longer or (results.n_frames and n_file < for_it - ODD_FRAMES):
        like = f", about every {n_video / n_file:.2g}th" if n_file < n_video else ""
        like = ", as of the part alone" if is_part else like
        taken = f"the video has {n_video}" + " or more" * is_part
        taken += f", every {step}th of them {for_it}" * (step > 1)
        raise BadMotionFile(f"{says}, and {taken}{like}: another video's, or rate. {remedy}")
    if results.n_frames and n_file != for_it and not is_part:
        return [f"the file of bodies is of {n_file} frames, the video has {for_it}"]
    return []


def _require_even(path: Path, frames: FrameSet) -> None:
    """Refuse VIBE's file of a video whose times are off one rate by more frames than counts may
    differ: VIBE gets its images from ffmpeg, which repeats and leaves out frames until they have
    one, from the video's first on.  Phones are off by a frame or so in a minute."""
    video_hz = frames.video_hz
    off_s = float(np.ptp([0.0, *(frames.times_s - frames.frame_numbers / video_hz)]))
    if off_s > ODD_FRAMES / video_hz:
        what = f"the video's frames are up to {off_s:.2f} s off a steady {video_hz:.5g} Hz"
        steady = f"ffmpeg -i VIDEO -vf fps={video_hz:.5g} STEADY"
        remedy = f"Make it steady first ({steady}), and give that to both"
        raise BadMotionFile(f"{path}: {what}, and VIBE numbers images of a steady video. {remedy}")


def _first_frame(results: EstimatedPeople, frames: FrameSet, step: int) -> int:
    """Which of the video's frames is the first of a file of every n-th: the first of n, but the
    last where PromptHMR itself left out the others."""
    by_itself = results.system == "prompt-hmr" and step == prompthmr.taken_every(frames.video_hz)
    return step - 1 if by_itself else 0


def _size_notes(results: EstimatedPeople, body: BodyModel, config: BodiesConfig) -> list[str]:
    """Whose size people have, where it is not their own or not one; and heights of nobody."""
    names = [one.name for one in results.people]
    notes = [
        f"a height of {one.height_m:g} m was told of {one.person}, and nobody has that name"
        for one in config.heights
        if one.person not in (EVERYBODY, *names)
    ]
    spreads = {one.name: _size_spread(one, body) for one in results.people}
    notes += [
        f"{name}: sizes in the file vary by {spread:.0%}, as of several people who are taken for"
        " one; scale and places are by their mean"
        for name, spread in spreads.items()
        if spread > ESTIMATED_SIGMA
    ]
    of_mean = [
        one
        for one in results.people
        if height_of(one.name, config.heights) is None and not one.has_betas_of(body.name)
    ]
    if not of_mean:
        return notes
    size = f"people have the size of the mean {body.name} body, not their own"
    ways = ["a height with --height-m"] if can_grow(body) else []
    if any(one.has_betas_of(NEUTRAL) for one in of_mean):
        ways.append("SMPL's neutral model with --body")
    carry = f"scale and places carry that error, {100 * UNKNOWN_SIGMA:.0f} %"
    return [*notes, f"{size}: {carry}" + (f" (give {', or '.join(ways)})" if ways else "")]


def _size_spread(person: EstimatedPerson, body: BodyModel) -> float:
    """Standard deviation of the size that frames say, as a share; 0 where they say none."""
    if person.betas is None or not person.has_betas_of(body.name):
        return 0.0
    each_m = (body.rest_joints_m(shape_on(body, betas))[:, 1] for betas in person.betas)
    sizes_m = np.array([np.ptp(up_m) for up_m in each_m])
    return float(sizes_m.std() / sizes_m.mean())


def _seen_enough(
    results: EstimatedPeople, path: Path, frames: FrameSet, config: BodiesConfig
) -> tuple[list[tuple[EstimatedPerson, np.ndarray]], list[str]]:
    """People and which of the video's frames their rows are of; and who was left out, in words."""
    step = config.frames_per_row
    first = _first_frame(results, frames, step)
    numbers = [first + step * one.frame_numbers for one in results.people]
    counts = [int(_seen(frames, one, step).sum()) for one in numbers]
    if max(counts) < 2:
        spans = ", ".join(
            f"{one.name}: {own[0]}-{own[-1]}"
            for one, own in zip(results.people[:5], numbers[:5], strict=True)
        )
        mine = f"{frames.frame_numbers[0]}-{frames.frame_numbers[-1]}"
        what = f"no person has a pose in two of the video's frames {mine} (the file has {spans})"
        raise BadMotionFile(f"{path}: {what}. Give the video's own file")
    kept, left_out = [], []
    for person, of_rows, count in zip(results.people, numbers, counts, strict=True):
        if count >= config.min_images or count == max(counts):
            kept.append((person, of_rows))
        else:
            left_out.append(f"{person.name} is seen in {count} images alone")
    return kept, left_out


def _motion(
    person: EstimatedPerson, placed: PlacedBody, body: BodyModel, fps_hz: float, source: str
) -> Motion:
    """The motion in the file's own rows."""
    return Motion(
        local_rotmats=person.local_rotmats,
        root_rotmats=placed.root_rotmats,
        pelvis_m=placed.pelvis_m,
        shape=placed.shape,
        fps_hz=fps_hz,
        body=body.name,
        gender=gender_of(body),
        frame="camera",
        source=source,
    )


def _seen(frames: FrameSet, known: np.ndarray, frames_per_row: int) -> np.ndarray:
    """(T,) bool: images that are of known frames (K,), or between two of them that follow each
    other in a file of every n-th frame and are near enough in time."""
    if not len(known):
        return np.zeros(len(frames.numbers), bool)
    step = min(frames_per_row, max(1, int(LONGEST_BETWEEN_S * frames.video_hz)))
    before = np.searchsorted(known, frames.frame_numbers, side="right") - 1
    after = np.searchsorted(known, frames.frame_numbers, side="left")
    between = (before >= 0) & (after < len(known))
    gaps = known[np.minimum(after, len(known) - 1)] - known[np.maximum(before, 0)]
    return np.asarray(between & (gaps <= step))


def _facts(
    clip: Clip, depths_in_file_m: np.ndarray, body: BodyModel, size_sigma: float
) -> BodyFacts:
    seen = clip.image_numbers[clip.valid]
    return BodyFacts(
        name=clip.id,
        images=len(seen),
        first_image=int(seen[0]),
        last_image=int(seen[-1]),
        median_depth_m=float(np.median(clip.motion.pelvis_m[clip.valid, 2])),
        median_depth_in_file_m=float(np.median(depths_in_file_m)),
        height_m=height_m(body, clip.motion.shape),
        size_sigma=size_sigma,
    )
