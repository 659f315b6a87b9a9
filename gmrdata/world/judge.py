"""Whether a pseudo ground truth can be used: the whole sequence, and each of its frames.

Every check compares one figure with one threshold of the recipe, and what fails says both.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from pydantic import model_validator

from gmrdata.cameras.check.verdict import (
    both_sides,
    camera_reasons,
    frame_tests,
    jump_cause,
    relative_moves,
    turns_too_fast,
)
from gmrdata.cameras.files import QUALITY_FILE, CamerasQuality, Geometry
from gmrdata.manifest.current import Quality
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.camera_motion import MotionClass, MotionFigures, classify
from gmrdata.values.clip import Clip, camera_of, first_reasons, text_runs
from gmrdata.values.records import Figure, Record, compared, figure
from gmrdata.world.level import LevelEstimate
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import (
    CueEstimate,
    Doubts,
    PseudoGtConfig,
    Verdict,
    VerdictConfig,
    overridden,
    verdict_of,
)
from gmrdata.world.scale import NO_SCALE, ScaleEstimate
from gmrdata.world.vertical_lines import Lines


class PseudoGtQuality(Record):
    """The reconstruction's figures, those of the scale, the camera's class, and each verdict."""

    format: Literal["gmrdata-pseudo-gt-quality/2"] = "gmrdata-pseudo-gt-quality/2"
    cameras: CamerasQuality | None
    """Figures of the reconstruction; null where there is none."""
    scale: Figure | None
    """Metres per unit of the reconstruction; null where scale does not enter."""
    scale_sigma: Figure | None
    scale_matters: bool
    scale_disagreement: Figure | None
    """Largest difference of two, in the standard errors that are as unlikely for one pair; null for
    fewer than two cues."""
    scale_cues: tuple[CueEstimate, ...]
    level: LevelEstimate | None
    """How level the world is; null where there is none."""
    distance_sigmas: tuple[Figure, ...]
    """By person: standard error of the distance from the camera, as a share: of size and lens."""
    camera_motion: MotionClass | Literal["none"]
    """Class of the camera's motion; "none" without a reconstruction."""
    camera_motion_figures: MotionFigures | None
    people: tuple[Verdict, ...]
    picture_fits: tuple[PictureFit | None, ...]
    """By person, how the body lies on the people in the pictures; null where it was not checked,
    for want of masks that were made without it."""

    @property
    def scale_share(self) -> float | None:
        """Standard error of the metric scale, as a share of it; None where none is known."""
        if not self.scale or self.scale_sigma is None:
            return None
        return abs(self.scale_sigma / self.scale)

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if (self.scale is None) != (self.scale_sigma is None):
            raise ValueError("of scale and scale_sigma only one is null")
        class_unknown = self.camera_motion == "none", self.camera_motion_figures is None
        if not len(self.picture_fits) == len(self.distance_sigmas) == len(self.people):
            raise ValueError("picture_fits, distance_sigmas and people are not of the same people")
        frames = {n for one in self.people for n in (one.frames, len(one.frame_reasons))}
        if len(frames) > 1:
            raise ValueError("people are not of the same frames, or frames are dropped beyond them")
        if set(class_unknown) != {self.cameras is None}:
            raise ValueError("cameras and camera_motion do not say alike whether there is a camera")
        return self


def quality_of(
    clips: Sequence[Clip],
    verdicts: Sequence[Verdict],
    cameras: "SolvedCameras",
    config: PseudoGtConfig,
    fits: Sequence[PictureFit | None],
) -> PseudoGtQuality:
    """The record of a pseudo ground truth; of clips in the world, before frames were dropped."""
    # The class of the one camera is told round the person who is known in most frames.
    clip = max(clips, key=lambda clip: clip.valid.sum())
    valid, motion = clip.valid, clip.motion
    cameras_m, pelvis_m = camera_of(clip).world_from_cam[valid], motion.pelvis_m[valid]
    camera_motion, figures = classify(cameras_m, pelvis_m, motion.fps_hz, config.motion_class)
    return PseudoGtQuality(
        cameras=cameras.quality,
        **_scale_figures(cameras.scale),
        level=cameras.level,
        distance_sigmas=cameras.distance_sigmas or len(verdicts) * (0.0,),
        camera_motion=camera_motion,
        camera_motion_figures=_rounded(figures),
        people=tuple(verdicts),
        picture_fits=tuple(None if fit is None else _rounded(fit) for fit in fits),
    )


def unsolved_quality(verdicts: Sequence[Verdict]) -> PseudoGtQuality:
    """The record of a sequence without a reconstruction."""
    return PseudoGtQuality(
        cameras=None,
        **_scale_figures(NO_SCALE),
        level=None,
        distance_sigmas=len(verdicts) * (0.0,),
        camera_motion="none",
        camera_motion_figures=None,
        people=tuple(verdicts),
        picture_fits=len(verdicts) * (None,),
    )


def _scale_figures(estimate: ScaleEstimate) -> dict[str, Any]:
    """What the record says of the scale, by key."""
    return {
        "scale": estimate.scale,
        "scale_sigma": estimate.sigma,
        "scale_matters": estimate.matters,
        "scale_disagreement": estimate.disagreement,
        "scale_cues": tuple(_rounded(cue) for cue in estimate.cues),
    }


Part = TypeVar("Part", CueEstimate, MotionFigures, PictureFit)


def _rounded(part: Part) -> Part:
    values = asdict(part)
    values |= {key: figure(v) for key, v in values.items() if isinstance(v, float)}
    return replace(part, **values)


def load_record(pseudo_gt_dir: Path) -> PseudoGtQuality:
    """Read `quality.json` of a pseudo ground truth."""
    return PseudoGtQuality.read(pseudo_gt_dir / QUALITY_FILE)


def quality_record(record: PseudoGtQuality, person: int) -> Quality:
    """What a manifest says of one person, counted from 0."""
    judged, cameras = record.people[person], record.cameras
    return Quality(
        geometry=None if cameras is None else cameras.geometry,
        verdict="accepted" if judged.accepted else "rejected",
        reasons=judged.reasons,
        scale=record.scale,
        scale_sigma=record.scale_sigma,
        registered_share=None if cameras is None else cameras.registered_share,
        reprojection_error_px=None if cameras is None else cameras.mean_reprojection_px,
        inliers=None if cameras is None else float(np.mean(cameras.inliers_per_frame)),
        figures=dict(_figures(record, judged, record.picture_fits[person])),
    )


def _figures(
    record: PseudoGtQuality, judged: Verdict, fit: PictureFit | None
) -> Iterator[tuple[str, float]]:
    """The class's figures and the scale's cues by name, as far as they are known."""
    yield "kept_share", judged.kept_share
    if fit is not None:
        yield "body_overlap", fit.overlap
    if record.camera_motion_figures is not None:
        for name, value in asdict(record.camera_motion_figures).items():
            if value is not None and not isinstance(value, bool):
                yield f"camera_{name}", value
    if record.cameras is not None:
        yield "interpolated_frames", float(len(record.cameras.interpolated))
    if record.scale_disagreement is not None:
        yield "scale_disagreement_sigma", record.scale_disagreement
    if record.level is not None:
        yield "level_sigma_deg", record.level.sigma_deg
    for cue in record.scale_cues:
        name = cue.name if cue.person is None else f"{cue.name}_p{cue.person}"
        yield f"scale_{name}", cue.scale
        yield f"scale_{name}_sigma", cue.sigma


@dataclass(frozen=True, eq=False)
class SolvedCameras:
    """The cameras of a sequence in the T rows of its people, and what else is known of them."""

    path: CameraPath  # up to scale; NaN where there is no camera
    geometry: Geometry
    points: np.ndarray  # (N, 3) background points, in the unit of the path
    quality: CamerasQuality
    rows: np.ndarray  # (T,) row of the reconstruction; -1 for a frame without an image
    scale: ScaleEstimate = NO_SCALE
    dataset_camera: np.ndarray | None = None
    """(T, 4, 4) metric world_from_cam of the data set; NaN where unknown."""
    up_cam: np.ndarray | None = None  # (T, 3) what a phone felt, in the camera's axes; or NaN
    lines: Lines | None = None  # of the background
    level: LevelEstimate | None = None  # None before it is known
    distance_sigmas: tuple[float, ...] = ()  # by person, as a share; none for exact ones


def judge_people(
    clips: Sequence[Clip],
    cameras: SolvedCameras,
    config: PseudoGtConfig,
    doubts: Doubts,
    fits: Sequence[PictureFit | None],
) -> PseudoGtQuality:
    """The verdict on each of the people in the world, by thresholds and by whoever looked at them,
    and the figures behind it.

    Args:
        doubts: Why the data set doesn't vouch for frames, or for its sequence.
        fits: How each body lies on the person in the pictures; None where nothing could tell.
    """
    verdicts = []
    for clip, unusable, fit in zip(clips, doubts.frames, fits, strict=True):
        verdict = judge(
            clip, cameras, config.verdict, Doubts(frames=(unusable,), sequence=doubts.sequence), fit
        )
        if config.override is not None:
            verdict = overridden(verdict, config.override, ~clip.valid)
        verdicts.append(verdict)
    return quality_of(clips, verdicts, cameras, config, fits)


def judge(
    clip: Clip,
    cameras: SolvedCameras,
    config: VerdictConfig,
    doubts: Doubts,
    fit: PictureFit | None = None,
) -> Verdict:
    """Judge one person of a pseudo ground truth, a clip of T frames in the world, by its figures;
    `doubts` are of this person alone."""
    own, quality = doubts.frames[0], cameras.quality
    reasons = frame_reasons(clip, cameras, config, own, fit)
    reasons = without_short_runs(reasons, round(config.min_run_s * clip.motion.fps_hz))
    kept_share = sum(not reason for reason in reasons) / max(1, own.count(""))
    undoubted = [why for why, doubt in zip(reasons, own, strict=True) if why and not doubt]
    often = Counter(undoubted or filter(None, reasons)).most_common(1)
    jump_share = float(np.mean(jumps(clip, config))) if len(reasons) > 1 else 0.0
    failed = [
        *doubts.sequence,
        *camera_reasons(quality, config),
        *_body_reasons(clip, quality, jump_share, config),
        *_frames_reasons(kept_share, often, config),
        *_scale_reasons(cameras.scale, config),
        *_stiff_reasons(clip, config),
        *([] if fit is None else _fit_reasons(fit, config)),
    ]
    return verdict_of(clip.id, not failed, failed, reasons)


def telling_rows(
    clips: Sequence[Clip],
    doubts: Doubts,
    fits: Sequence[PictureFit | None],
    config: VerdictConfig,
) -> list[np.ndarray]:
    """By person (T,) bool: frames of bodies by which the world's scale and level are told.

    A body that does not lie on the person says nothing of the world: neither in some frames, nor as
    a whole, nor where all frames are doubted.  What is nobody, such as a bottle that was taken for
    a person, would spoil the world of all others.  Where nobody is left, everybody tells.
    """
    telling = []
    for clip, doubted, fit in zip(clips, doubts.frames, fits, strict=True):
        rows = clip.valid.copy()
        if fit is not None:
            rows[list(fit.off_rows)] = False
        if all(np.array(doubted)[clip.valid]) or (fit and any(_fit_reasons(fit, config))):
            rows[:] = False
        telling.append(rows)
    return telling if np.sum(telling) > 1 else [clip.valid for clip in clips]


def _body_reasons(
    clip: Clip,
    quality: CamerasQuality,
    jump_share: float,
    config: VerdictConfig,
) -> Iterator[str]:
    if jump_share > config.max_cuts_share:
        at = f"at {jump_share:.0%} of the steps between images"
        yield (
            f"the camera jumps {at}: {jump_cause(camera_of(clip).world_from_cam, quality, config)}"
        )


def _frames_reasons(
    kept_share: float, often: Sequence[tuple[str, int]], config: VerdictConfig
) -> Iterator[str]:
    if kept_share < config.min_kept_share:
        can = "{} of the frames with an undoubted pose can be used, fewer than {}"
        why = "".join(f"; in {frames}: {reason}" for reason, frames in often)
        yield compared(can, kept_share, config.min_kept_share, ".0%") + why


def _scale_reasons(estimate: ScaleEstimate, config: VerdictConfig) -> Iterator[str]:
    # No scale: the camera stays in place.  Where it moves and no cue tells, nothing is judged.
    if estimate.scale is None or estimate.sigma is None:
        return
    if not estimate.scale > 0 or not estimate.sigma >= 0:
        yield (
            f"the metric scale is {estimate.scale:.3g} ± {estimate.sigma:.2g} m per unit of the "
            "cameras, which no camera has: body and cameras do not belong together"
        )
        return
    share, most = estimate.sigma / estimate.scale, config.max_scale_sigma_share
    if estimate.matters and share > most:
        yield compared("the metric scale is uncertain by {}, more than {}", share, most, ".1%")
    apart, furthest = estimate.disagreement or 0.0, config.max_cue_disagreement
    if apart > furthest:
        what = "two cues of the scale are {} standard errors apart, more than {}"
        yield compared(what, apart, furthest, ".1f")


def _fit_reasons(fit: PictureFit, config: VerdictConfig) -> Iterator[str]:
    late, gain = fit.late_frames, fit.late_overlap - fit.overlap
    if gain > config.max_late_gain and fit.late_overlap >= config.off_overlap:
        yield (
            f"the body is {abs(late)} frames {'late' if late > 0 else 'early'}: it lies on the "
            f"person in the picture by {fit.late_overlap:.0%} then, and by {fit.overlap:.0%} now"
        )
    elif fit.off_frames > config.max_off_share * fit.frames:
        yield (
            "the body does not lie on the person in the picture in "
            f"{fit.off_frames} of {fit.frames} frames"
        )
    if fit.doubled_frames > config.max_doubled_share * fit.frames:
        yield (
            "another body lies on the same person in the picture in "
            f"{fit.doubled_frames} of {fit.frames} frames"
        )


def _stiff_reasons(clip: Clip, config: VerdictConfig) -> Iterator[str]:
    """Reasons of a body that is moved about like a statue."""
    if not clip.valid.any():
        return
    motion = clip.motion
    travel_m = float(np.linalg.norm(np.ptp(motion.pelvis_m[clip.valid], axis=0)))
    if travel_m < config.stiff_travel_m:
        return
    rotmats = motion.local_rotmats[clip.valid]
    # Chord instead of angle: |R - mean| = sqrt(8) sin(angle / 2), nearly, for small angles.
    chord = np.linalg.norm(rotmats - rotmats.mean(axis=0), axis=(-2, -1))
    turn_deg = float(np.rad2deg(np.percentile(chord, 95) / np.sqrt(2)))
    if turn_deg < config.min_joint_deg:
        stiff = "the body is stiff: its joints turn by {} degrees, less than {}"
        turn = compared(stiff, turn_deg, config.min_joint_deg, ".1f")
        yield f"{turn}, while it travels {travel_m:.1f} m"


def frame_reasons(
    clip: Clip,
    cameras: SolvedCameras,
    config: VerdictConfig,
    unusable: Sequence[str],
    fit: PictureFit | None = None,
) -> list[str]:
    """Why each of the T frames must not be used; empty where it may.  `unusable` are T texts: why
    the data set itself doesn't vouch for a frame."""
    dataset_camera = cameras.dataset_camera
    camera = camera_of(clip)
    n = camera.n_frames
    *before, enough = frame_tests(cameras.quality, cameras.rows, camera.has_camera, config)
    tests = [
        *before,
        (clip.valid, "the body is not known"),
        enough,
        (~both_sides(jumps(clip, config), 1, n), "the camera jumps"),
        (~both_sides(body_jumps(clip, config), 1, n), "the body jumps"),
    ]
    if fit is not None:
        lies = np.ones(n, dtype=bool)
        lies[list(fit.off_rows)] = False
        tests.append((lies, "the body does not lie on the person in the picture"))
    if dataset_camera is not None:
        step = max(1, round(config.window_s * clip.motion.fps_hz))
        apart_deg, apart_m = window_differences(camera.world_from_cam, dataset_camera, step)
        # A comparison with NaN is False: what is unknown doesn't disagree.
        off = (apart_deg > config.max_window_deg) | (apart_m > config.max_window_m)
        tests.append((~both_sides(off, step, n), "the camera moves otherwise than the data set's"))
    return first_reasons(unusable, tests)


def jumps(clip: Clip, config: VerdictConfig) -> np.ndarray:
    """(T - 1,) bool: steps between frames that are too far for a camera that somebody holds."""
    world_from_cam, fps_hz = camera_of(clip).world_from_cam, clip.motion.fps_hz
    steps_m = np.linalg.norm(relative_moves(world_from_cam, 1)[:, :3, 3], axis=1)
    # A comparison with NaN is False: an unknown step is no jump.
    too_far = steps_m * fps_hz > config.max_speed_m_per_s
    return np.asarray(too_far | turns_too_fast(world_from_cam, fps_hz, config))


def body_jumps(clip: Clip, config: VerdictConfig) -> np.ndarray:
    """(T - 1,) bool: steps between known frames that are too far, or too much of a turn, for a
    person."""
    motion, known = clip.motion, clip.valid[1:] & clip.valid[:-1]
    far_m = np.linalg.norm(np.diff(motion.pelvis_m, axis=0), axis=1)
    turns = motion.root_rotmats[:-1].swapaxes(1, 2) @ motion.root_rotmats[1:]
    turned_deg = np.rad2deg(transforms.angles_rad(turns))
    most_m = max(config.max_body_speed_m_per_s / motion.fps_hz, config.body_step_m)
    most_deg = np.clip(config.max_body_turn_deg_per_s / motion.fps_hz, *config.body_step_deg)
    beyond = (far_m > most_m) | (turned_deg > most_deg)
    return np.asarray(known & beyond)


def without_short_runs(reasons: list[str], min_run: int) -> list[str]:
    """The reasons, with one more for runs of fewer usable frames than `min_run`."""
    n = len(reasons)
    for start, stop, reason in text_runs(reasons):
        if not reason and stop - start < min(min_run, n):
            short = f"only {stop - start} usable frames in a row"
            reasons = [*reasons[:start], *[short] * (stop - start), *reasons[stop:]]
    return reasons


def window_differences(
    world_from_cam: np.ndarray, dataset_camera: np.ndarray, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """How differently two cameras (T, 4, 4) turn and move over `step` frames, (T - step,) [deg, m];
    NaN where one is unknown."""
    ours, theirs = relative_moves(world_from_cam, step), relative_moves(dataset_camera, step)
    apart_m = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    apart_rad = transforms.angles_rad((transforms.invert(ours) @ theirs)[:, :3, :3])
    return np.rad2deg(apart_rad), apart_m
