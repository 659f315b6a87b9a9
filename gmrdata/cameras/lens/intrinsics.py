"""Stage: the lens, as somebody gives it, the camera notes it, or the frames show it."""

import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt, model_validator
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.files import CamerasQuality
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.lens.rolling_shutter import READOUT_S
from gmrdata.cameras.lens.self_calibration import (
    ENOUGH_FRAMES,
    SelfCalibration,
    SelfCalibrationConfig,
    StartTried,
    self_calibrate,
)
from gmrdata.cameras.lens.vanishing_points import (
    USUAL_FOCAL,
    USUAL_SIGMA,
    LinesConfig,
    focal_of_lines,
)
from gmrdata.read.intrinsics import (
    GIVEN_SIGMA,
    exif_lens,
    read_intrinsics,
    require_shape,
    video_lens,
)
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import ASSUMED, GIVEN, Lens, Origin, Source
from gmrdata.values.errors import BadIntrinsics, BadRecord, MissingInput
from gmrdata.values.files import as_text, read_json
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import PART, Config, Figure, Record

INTRINSICS_FILE = "intrinsics.json"
RIGHT_SIGMAS = 2.0  # standard errors within which cameras find a focal length right
LARGEST_CORNER = 3.0  # from the principal point, in focal lengths: 143 degrees across


class GivenIntrinsics(Config):
    """A lens as it was given: one of the three."""

    focal_px: PositiveFloat | None = None
    """Focal length [px]."""
    fov_deg: float | None = Field(default=None, gt=1, lt=170)
    """Horizontal field of view: from the left edge of the picture to the right [degrees]."""
    file: Path | None = None
    """A calibration, in a format of `gmrdata.read.intrinsics`, or our own record of one."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(value is not None for value in (self.focal_px, self.fov_deg, self.file)) != 1:
            raise ValueError("give one of focal length, field of view and file")
        return self


class IntrinsicsConfig(Config):
    """Where the lens may come from, and how it is sought."""

    self_calibration: SelfCalibrationConfig = SelfCalibrationConfig()
    lines: LinesConfig = LinesConfig(frames=6)
    """Which straight lines are asked where the camera's motion does not show the focal length."""
    look_in_frames: bool = True
    """Seek the lens in the frames, which also checks one that is given or noted; if not, one that
    is neither is guessed."""
    doubt_sigmas: float = Field(default=2.0, gt=0)
    """By how many standard errors the frames must ask for another lens to say so."""
    object_sigmas: float = Field(default=3.0, gt=0)
    """And to object to one that is given: one right lens of 400 would be refused by chance, one of
    20 by two standard errors.  The finished cameras are asked too, in their own verdict."""
    object_share: float = Field(default=0.03, gt=0)
    """And by how much of it."""


@part(frozen=True, config=PART)
class AskedLens:
    """The lens that the frames ask for, whatever is taken."""

    focal_px: Figure
    focal_sigma: Figure
    """As a share of it."""
    radial_k1: Figure
    radial_k1_sigma: Figure
    motion: Literal["full", "rotation_only"]
    """What the camera does, by which it was found."""


@part(frozen=True, config=PART)
class AskedByLines:
    """The focal length that straight lines of the place ask for, whatever is taken."""

    focal_px: Figure
    focal_sigma: Figure
    """As a share of it."""


class Intrinsics(Record):
    """`intrinsics.json`: a pinhole, square or oblong pixels, and up to two terms of distortion."""

    format: Literal["gmrdata-intrinsics/2"] = "gmrdata-intrinsics/2"
    source: Source
    width_px: PositiveInt
    height_px: PositiveInt
    focal_px: float = Field(gt=0)
    """Focal length along x [px]."""
    focal_y_px: float = Field(gt=0)
    """The same along y [px]: another one where pixels are not square."""
    focal_sigma: float = Field(gt=0)
    """Standard error of the focal length, as a share of it."""
    centre_px: tuple[float, float]
    """Principal point: the picture's middle unless it was given [px]."""
    radial_k1: float
    """A point at r, in units of the focal length, is seen at r + k1 r^3; 0 for none."""
    radial_k1_sigma: float | None
    """Its standard error; null where it was not measured."""
    radial_k2: float
    """And to + k2 r^5; only of a lens that was given."""
    focal_observable: bool | None
    """Whether the frames hold the focal length; null where they were not asked."""
    asked: AskedLens | None
    """What the frames ask for; null where they say nothing, or were not asked."""
    asked_by_lines: AskedByLines | None
    """What straight lines ask for; null where they tell nothing, or the camera's motion does."""
    starts: tuple[StartTried, ...]
    objections: tuple[str, ...]
    """Why the lens that was taken can't be trusted; a verdict must say them."""
    notes: tuple[str, ...]
    """Where it comes from and what it means, in sentences for a page."""

    @property
    def lens(self) -> Lens:
        centre = ASSUMED if self.source != "given" else GIVEN
        bends = self.radial_k1 or self.radial_k2
        radial = Origin(self.source if bends else centre.source, self.radial_k1_sigma)
        return Lens(
            focal_px=(self.focal_px, self.focal_y_px),
            centre_px=self.centre_px,
            size_px=(self.width_px, self.height_px),
            radial=(self.radial_k1, self.radial_k2),
            focal_from=Origin(self.source, self.focal_sigma),
            centre_from=centre,
            radial_from=radial,
        )

    @property
    def is_guess(self) -> bool:
        """Whether nobody knows the focal length: every figure that hangs on it is as uncertain."""
        return self.source == "prior"


def load_intrinsics(folder: Path) -> Intrinsics:
    """The lens in a folder that `find_intrinsics` made."""
    return Intrinsics.read(folder / INTRINSICS_FILE)


def beside_cameras(lens: Intrinsics, quality: CamerasQuality) -> Intrinsics:
    """The lens, once the cameras are there: an objection to its focal length may become a note.

    Of a long video the lens is sought in a part alone, which may hold it less firmly than it says.
    Cameras of the whole that hold it more firmly, and find the given one right, then count.  Of a
    shorter video both see the same frames, and cameras lean on the lens that they were given.
    """
    asked = lens.asked or lens.asked_by_lines
    factor, sigma = quality.focal_factor, quality.focal_sigma
    if quality.frames <= ENOUGH_FRAMES or asked is None or factor is None or sigma is None:
        return lens
    withdrawn = tuple(one for one in lens.objections if one.endswith(NOT_THEIRS))
    if not withdrawn or sigma >= asked.focal_sigma or abs(factor - 1) > RIGHT_SIGMAS * sigma:
        return lens
    firmer = f"The cameras of all frames are firmer: {factor:.2f} times, ± {100 * sigma:.1f} %."
    left = tuple(one for one in lens.objections if one not in withdrawn)
    notes = (*lens.notes, *(f"In a part of the video: {one} {firmer}" for one in withdrawn))
    return lens.model_copy(update={"objections": left, "notes": notes})


class _IntrinsicsRecipe(Config):
    """What the stage's record holds; the file that was given is an input."""

    config: IntrinsicsConfig
    focal_px: float | None
    fov_deg: float | None
    rate_hz: float | None
    """Of images that came from no video: how fast they follow says what a rolling shutter does."""


def find_intrinsics(
    frames: FrameSet,
    masks_dir: Path | None,
    out_dir: Path,
    config: IntrinsicsConfig,
    *,
    given: GivenIntrinsics | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Find the lens of a sequence: given, else noted by the camera, else shown by the frames.

    What is given or noted is held against what the frames ask for, by the camera's motion, else by
    straight lines of the place.  Where nobody says it, it is guessed by these and by what is usual.

    Args:
        frames: All frames; the file of a video that they are of may name the lens.
        masks_dir: Masks (255 = dynamic), one per frame; None to use whole frames.
        out_dir: Folder to make: `intrinsics.json`.
        given: What is known of the lens; None for nothing.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        BadIntrinsics: what is given can't be the lens of these frames.
    """

    def work(partial: Path) -> None:
        known = _known(given, frames)
        motion, lines = None, None
        if config.look_in_frames:
            work_dir = partial / "colmap"
            work_dir.mkdir()
            usual_px = USUAL_FOCAL * max(frames.size_px)
            start_px = usual_px if known is None else known[0].focal_px[0]
            guess_px = Lens.centred(start_px, frames.size_px).matrix_px
            sought = Frames(list(frames.paths), masks_dir, guess_px, frames.size_px)
            of_number = READOUT_S * frames.known_or_usual_hz * np.median(np.diff(frames.numbers))
            motion = self_calibrate(sought, work_dir, config.self_calibration, float(of_number))
            shutil.rmtree(work_dir)
            own = None if known is None else known[0]
            if not motion.observable and (asked := focal_of_lines(sought, own, config.lines)):
                lines = AskedByLines(asked.focal * max(frames.size_px), asked.focal_sigma)
        shown = _Shown(motion, lines)
        _decided(known, shown, frames.size_px, config).write(partial / INTRINSICS_FILE)

    free_rate = config.look_in_frames and frames.video is None and np.isfinite(frames.rate_hz)
    recipe = _IntrinsicsRecipe(
        config=config,
        focal_px=None if given is None else given.focal_px,
        fov_deg=None if given is None else given.fov_deg,
        rate_hz=frames.rate_hz if free_rate else None,
    )
    inputs = {**frames.inputs, "masks": masks_dir}
    inputs |= {"file": None if given is None else given.file, "video": frames.video_path}
    return run_stage("intrinsics", out_dir, recipe, inputs, work, run=run)


class _Shown(NamedTuple):
    """What the frames show of the lens."""

    motion: SelfCalibration | None
    """By the camera's motion; None where they were not asked."""
    lines: AskedByLines | None


def _known(given: GivenIntrinsics | None, frames: FrameSet) -> tuple[Lens, str] | None:
    """The lens that is given, else noted by the camera, and how that is said."""
    if given is not None:
        return given_lens(given, frames.size_px)
    noted = _noted(frames)
    if noted is None:
        return None
    focal_px, percent = noted.focal_px[0], 100 * (noted.focal_from.sigma or 0.0)
    words = f"The camera notes a lens of {focal_px:.0f} px, which is right to {percent:.0f} %."
    return noted, words


def _noted(frames: FrameSet) -> Lens | None:
    """The lens that a video's file notes; else the pictures, whose notes differ where it zooms."""
    if frames.video_path is not None:
        return video_lens(frames.video_path, frames.size_px)
    lenses = [one for path in frames.paths if (one := exif_lens(path, frames.size_px)) is not None]
    if not lenses:
        return None
    each_px = np.array([one.focal_px[0] for one in lenses])
    focal_px = float(np.median(each_px))
    apart = float(np.sqrt((np.log(each_px / focal_px) ** 2).mean()))
    sigma = float(np.hypot(lenses[0].focal_from.sigma or 0.0, apart))
    return Lens.centred(focal_px, frames.size_px, Origin("metadata", sigma))


def given_lens(given: GivenIntrinsics, size_px: tuple[int, int]) -> tuple[Lens, str]:
    """The lens that is given, for pictures of this size, and how that is said; BadIntrinsics for
    one that sees too wide or folds the picture, and what else reading its file raises."""
    if given.file is not None:
        words = f"The lens is that of {as_text(given.file.name)}."
        lens = _lens_of_file(given.file, size_px)
    elif given.fov_deg is not None:
        words = f"A field of view of {given.fov_deg:g}° was given."
        focal_px = 0.5 * size_px[0] / float(np.tan(np.deg2rad(given.fov_deg) / 2))
        lens = Lens.centred(focal_px, size_px, Origin("given", GIVEN_SIGMA))
    else:
        assert given.focal_px is not None
        words = f"A focal length of {given.focal_px:g} px was given."
        lens = Lens.centred(given.focal_px, size_px, Origin("given", GIVEN_SIGMA))
    if lens.corner_radius > LARGEST_CORNER or max(lens.focal_px) > 100 * max(size_px):
        what = f"{words} No camera sees that of {size_px[0]}x{size_px[1]} px"
        raise BadIntrinsics(f"{what}; the focal length is in pixels of these frames")
    if lens.folds:
        what = f"{words} Its distortion of {lens.radial[0]:g} folds the corners of the picture"
        raise BadIntrinsics(f"{what}; calibrate again, or undistort the frames")
    return lens, words


def _lens_of_file(path: Path, size_px: tuple[int, int]) -> Lens:
    """A calibration, or our own record; of a picture of another size it is scaled."""
    path = path / INTRINSICS_FILE if (path / INTRINSICS_FILE).is_file() else path
    if not _is_own(path):
        return read_intrinsics(path, size_px)
    record = Intrinsics.read(path)
    own = record.lens
    if record.is_guess:
        what = f"its focal length is but a guess, to {100 * record.focal_sigma:.0f} %"
        raise BadIntrinsics(f"{path}: {what}; leave it out, or give one that somebody measured")
    require_shape(path, own, size_px)
    # As uncertain as it was found: by a camera's note to 5 %, in a short turn to 8 %.
    focal_from = Origin("given", max(GIVEN_SIGMA, record.focal_sigma))
    radial_from = ASSUMED if own.is_pinhole else Origin("given", record.radial_k1_sigma)
    return replace(own.at_size(size_px), focal_from=focal_from, radial_from=radial_from)


def _is_own(path: Path) -> bool:
    """Whether a file is a record of this stage, of whatever version and name; other programs too
    have an `intrinsics.json`."""
    with suppress(MissingInput, BadRecord):
        value = read_json(path) if path.suffix == ".json" else None
        said = value.get("format") if isinstance(value, dict) else None
        return str(said).startswith("gmrdata-intrinsics/")
    return False


def _decided(
    known: tuple[Lens, str] | None,
    shown: _Shown,
    size_px: tuple[int, int],
    config: IntrinsicsConfig,
) -> Intrinsics:
    """The record of the lens that is taken."""
    motion, lines = shown
    asked = None if motion is None else _asked(motion, size_px)
    taken, words = _taken(known, asked, shown, size_px)
    notes, objections = [words], [FOLDED] if taken.folds else []
    sigma = taken.focal_from.sigma or 0.0
    other_bend = "" if known is None or motion is None else _other_bend(known[0], motion, config)
    if other_bend:
        objections.append(other_bend)
    if known is not None and (says := asked or lines) is not None:
        one = known[0]
        apart, both_sigma = _apart(one, says)
        words = _compared(one, says)
        if abs(apart) <= max(config.doubt_sigmas * both_sigma, config.object_share):
            notes.append(f"{words}, which agrees." if not other_bend else f"{words}.")
            if one.focal_from.source == "metadata" and asked is None:
                sigmas = one.focal_from.sigma or 0.0, says.focal_sigma
                focal_px, sigma = _averaged((one.focal_px[0], says.focal_px), sigmas)
                taken = Lens.centred(focal_px, size_px, Origin("metadata", sigma))
                notes.append(f"Together they make {focal_px:.0f} px.")
        elif one.focal_from.source == "given" and abs(apart) <= config.object_sigmas * both_sigma:
            notes.append(f"{words}: the two disagree, but not by enough to object.")
        elif one.focal_from.source == "given":
            objections.append(f"{words}: {NOT_THEIRS}")
        else:
            notes.append(f"{words}: the two disagree.")
            sigma = float(np.hypot(sigma, apart))
    if motion is not None and asked is None:
        notes.append(f"The camera's motion does not show the focal length: {motion.reason}.")
    return Intrinsics(
        source=taken.focal_from.source,
        width_px=size_px[0],
        height_px=size_px[1],
        focal_px=taken.focal_px[0],
        focal_y_px=taken.focal_px[1],
        focal_sigma=sigma,
        centre_px=taken.centre_px,
        radial_k1=taken.radial[0],
        radial_k1_sigma=taken.radial_from.sigma,
        radial_k2=taken.radial[1],
        focal_observable=None if motion is None else asked is not None,
        asked=asked,
        asked_by_lines=lines,
        starts=() if motion is None else motion.starts,
        objections=tuple(objections),
        notes=tuple(notes),
    )


def _averaged(focals: tuple[float, ...], sigmas: tuple[float, ...]) -> tuple[float, float]:
    """The mean of focal lengths' logarithms, by variance, and its standard error, as a share."""
    weights = np.array(sigmas) ** -2
    log_focal = np.average(np.log(focals), weights=weights)
    return float(np.exp(log_focal)), float(weights.sum() ** -0.5)


def _apart(known: Lens, asked: AskedLens | AskedByLines) -> tuple[float, float]:
    """How far what is asked for lies from a known focal length, and the standard error of both
    together, as shares."""
    apart = float(np.log(asked.focal_px / known.focal_px[0]))
    return apart, float(np.hypot(asked.focal_sigma, known.focal_from.sigma or 0.0))


def _other_bend(known: Lens, by_motion: SelfCalibration, config: IntrinsicsConfig) -> str:
    """Why a distortion that is given is not that of the frames; empty where none is, or it is.

    Frames may show it where they hold no focal length.
    """
    if known.radial_from.source != "given" or by_motion.focal is None:
        return ""
    given_k1, asked_k1 = known.radial[0], by_motion.radial_k1
    # k1 goes with the square of the focal length.
    own_sigma = float(np.hypot(by_motion.radial_k1_sigma, 2 * asked_k1 * by_motion.focal_sigma))
    sigma = float(np.hypot(own_sigma, known.radial_from.sigma or 0.0))
    # Frames that know of no k2 say it by their k1, by as much as it moves the corner at most.
    apart = max(0.0, abs(given_k1 - asked_k1) - abs(known.radial[1]) * known.corner_radius**2)
    # At the corner a point moves by k1 r^2 of its distance from the middle.
    if apart <= max(config.object_sigmas * sigma, config.object_share / known.corner_radius**2):
        return ""
    given = f"The distortion k1 of {given_k1:g} that is given is not that of these frames"
    return f"{given}, which ask for {asked_k1:.3f} ± {own_sigma:.3f}."


def _taken(
    known: tuple[Lens, str] | None,
    asked: AskedLens | None,
    shown: _Shown,
    size_px: tuple[int, int],
) -> tuple[Lens, str]:
    """What is given; else what is firmer, the camera's own note or the frames; else a guess."""
    if known is not None and not _is_firmer(asked, known[0]):
        return known
    if asked is None:
        return _guess(shown, size_px)
    lens = Lens.centred(asked.focal_px, size_px, Origin("self_calibrated", asked.focal_sigma))
    k1_from = Origin("self_calibrated", asked.radial_k1_sigma)
    lens = replace(lens, radial=(asked.radial_k1, 0.0), radial_from=k1_from)
    how = "the camera turns" if asked.motion == "rotation_only" else "the camera moves"
    return lens, f"The lens was found in the frames, as {how}: {_lens_in_words(asked)}."


def _guess(shown: _Shown, size_px: tuple[int, int]) -> tuple[Lens, str]:
    """A usual lens, drawn to what lines ask for, or to the little that the camera's motion
    shows."""
    motion, lines = shown
    focal, sigma, why = USUAL_FOCAL, USUAL_SIGMA, NOTHING_SHOWS
    if lines is not None:
        # They know already what is usual.
        focal, sigma, why = lines.focal_px / max(size_px), lines.focal_sigma, LINES_SHOW
    elif motion is not None and motion.focal is not None and motion.focal_sigma < USUAL_SIGMA:
        focal, sigma = _averaged((focal, motion.focal), (sigma, motion.focal_sigma))
        why = LITTLE_SHOWS
    focal_px = focal * max(size_px)
    words = f"{why} {GUESSED.format(focal_px=focal_px, sigma=100 * sigma)}"
    return Lens.centred(focal_px, size_px, Origin("prior", sigma)), words


def _is_firmer(asked: AskedLens | None, known: Lens) -> bool:
    """Whether the frames say more than a camera's own note."""
    source, sigma = known.focal_from
    return source == "metadata" and asked is not None and asked.focal_sigma < (sigma or 0.0)


def _asked(by_motion: SelfCalibration, size_px: tuple[int, int]) -> AskedLens | None:
    """What the frames ask for in their own pixels; None where they don't show it."""
    if not by_motion.observable or by_motion.focal is None or by_motion.motion is None:
        return None
    return AskedLens(
        focal_px=by_motion.focal * max(size_px),
        focal_sigma=by_motion.focal_sigma,
        radial_k1=by_motion.radial_k1,
        radial_k1_sigma=by_motion.radial_k1_sigma,
        motion=by_motion.motion,
    )


def _compared(known: Lens, asked: AskedLens | AskedByLines) -> str:
    is_given = known.focal_from.source == "given"
    whose = "the given one" if is_given else "what the camera notes"
    factor = asked.focal_px / known.focal_px[0]
    who = "The frames ask" if isinstance(asked, AskedLens) else "Straight lines ask"
    return f"{who} for {_lens_in_words(asked)}, {factor:.3f} times {whose}"


def _lens_in_words(asked: AskedLens | AskedByLines) -> str:
    focal = f"a focal length of {asked.focal_px:.0f} px ± {100 * asked.focal_sigma:.1f} %"
    if isinstance(asked, AskedByLines):
        return focal
    if asked.radial_k1 == 0:
        return f"{focal}, without distortion"
    return f"{focal}, and a distortion k1 of {asked.radial_k1:.3f} ± {asked.radial_k1_sigma:.3f}"


NOT_THEIRS = "the lens that is given is not that of these frames."
FOLDED = (
    "The distortion that was found in the frames folds the corners of the picture, which no lens "
    "does: give --intrinsics, or undistort the frames."
)
NOTHING_SHOWS = "Nothing shows the focal length: a usual one was taken."
LINES_SHOW = (
    "Where straight lines of the place meet tells the focal length, if they run along three "
    "directions at right angles."
)
LITTLE_SHOWS = "A usual focal length was taken together with the little that the frames show of it."
GUESSED = (
    "It is {focal_px:.0f} px, and may be off by {sigma:.0f} %. The distance from the camera, the "
    "motion along the line of sight and the camera's turns are as uncertain. Give --focal, --fov "
    "or --intrinsics."
)
