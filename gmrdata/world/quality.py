"""`quality.json` of a pseudo ground truth, and what a manifest says of it."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal, Self, TypeVar

import numpy as np
from pydantic import model_validator

from gmrdata.cameras.files import QUALITY_FILE, CamerasQuality
from gmrdata.manifest.current import Quality
from gmrdata.values.camera_motion import MotionClass, MotionFigures, classify
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.records import Figure, Record, figure
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import CueEstimate, PseudoGtConfig
from gmrdata.world.scale import NO_SCALE, ScaleEstimate
from gmrdata.world.verdict import Verdict


class PseudoGtQuality(Record):
    """The reconstruction's figures, those of the scale, the camera's class, and each verdict."""

    format: Literal["gmrdata-pseudo-gt-quality/1"] = "gmrdata-pseudo-gt-quality/1"
    cameras: CamerasQuality | None
    """Figures of the reconstruction; null where there is none."""
    scale: Figure | None
    """Metres per unit of the reconstruction; null where scale does not enter."""
    scale_sigma: Figure | None
    scale_matters: bool
    scale_disagreement: Figure | None
    """In standard errors; null for fewer than two cues."""
    scale_cues: tuple[CueEstimate, ...]
    camera_motion: MotionClass | Literal["none"]
    """Class of the camera's motion; "none" without a reconstruction."""
    camera_motion_figures: MotionFigures | None
    people: tuple[Verdict, ...]
    picture_fits: tuple[PictureFit | None, ...]
    """By person, how the body lies on the people in the pictures; null where it was not checked,
    for want of masks that were made without it."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if (self.scale is None) != (self.scale_sigma is None):
            raise ValueError("of scale and scale_sigma only one is null")
        class_unknown = self.camera_motion == "none", self.camera_motion_figures is None
        if len(self.picture_fits) != len(self.people):
            raise ValueError("picture_fits and people are not of the same people")
        if set(class_unknown) != {self.cameras is None}:
            raise ValueError("cameras and camera_motion do not say alike whether there is a camera")
        return self


def quality_of(
    clips: Sequence[Clip],
    verdicts: Sequence[Verdict],
    estimate: ScaleEstimate,
    cameras: CamerasQuality,
    config: PseudoGtConfig,
    fits: Sequence[PictureFit | None] | None = None,
) -> PseudoGtQuality:
    """The record of a pseudo ground truth; of clips in the world, before frames were dropped.
    How bodies lie in the pictures was not checked where `fits` is left out."""
    unchecked = [None] * len(verdicts)
    # The class of the one camera is told round the person who is known in most frames.
    clip = max(clips, key=lambda clip: clip.valid.sum())
    valid, motion = clip.valid, clip.motion
    cameras_m, pelvis_m = camera_of(clip).world_from_cam[valid], motion.pelvis_m[valid]
    camera_motion, figures = classify(cameras_m, pelvis_m, motion.fps_hz, config.motion_class)
    return _record(cameras, estimate, camera_motion, _rounded(figures), verdicts, fits or unchecked)


def unsolved_quality(verdicts: Sequence[Verdict]) -> PseudoGtQuality:
    """The record of a sequence without a reconstruction."""
    return _record(None, NO_SCALE, "none", None, verdicts, [None] * len(verdicts))


def _record(
    cameras: CamerasQuality | None,
    estimate: ScaleEstimate,
    camera_motion: MotionClass | Literal["none"],
    figures: MotionFigures | None,
    verdicts: Sequence[Verdict],
    fits: Sequence[PictureFit | None],
) -> PseudoGtQuality:
    return PseudoGtQuality(
        cameras=cameras,
        scale=estimate.scale,
        scale_sigma=estimate.sigma,
        scale_matters=estimate.matters,
        scale_disagreement=estimate.disagreement,
        scale_cues=tuple(_rounded(cue) for cue in estimate.cues),
        camera_motion=camera_motion,
        camera_motion_figures=figures,
        people=tuple(verdicts),
        picture_fits=tuple(None if fit is None else _rounded(fit) for fit in fits),
    )


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
    for cue in record.scale_cues:
        name = cue.name if cue.person is None else f"{cue.name}_p{cue.person}"
        yield f"scale_{name}", cue.scale
        yield f"scale_{name}_sigma", cue.sigma
