"""What a report shows, as plain values, and the thresholds that pseudo ground truth has to meet."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Self

import numpy as np

from gmrdata.cameras.files import CamerasQuality
from gmrdata.score.records import PaperMetrics
from gmrdata.twins.pseudo_gt_error import PseudoGtError, has_camera
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config, Record
from gmrdata.world.judge import PseudoGtQuality


class ClipAccuracy(Config):
    """How far a clip's pseudo ground truth lies from the truth."""

    ome_deg: float
    """Mean over the motions (eq. 15)."""
    tme_mm: float
    """Mean over the motions (eq. 16)."""
    camera_rotation_deg: float | None
    """Mean over the frames, after a best rotation of the recovered world; None without cameras."""
    scale_error_percent: float | None
    """Signed error of the metric scale; None where the camera doesn't translate."""
    frames: int
    frames_with_camera: int

    @classmethod
    def of(cls, error: PseudoGtError, frames: int) -> Self:
        named = cls.model_fields.keys() - {"frames"}
        return cls(frames=frames, **{name: getattr(error, name) for name in named})


@dataclass(frozen=True, eq=False)
class ClipReport:
    """One clip: the truth, what was recovered, and the pictures."""

    id: str
    camera_motion: str
    true: Clip
    pseudo: Clip
    true_from_pseudo: np.ndarray  # (4, 4) rigid [m]
    images_dir: Path
    masks_dir: Path | None  # `<image stem>.png`, 255 = dynamic object; None draws no outline
    body: BodyModel
    figures: ClipAccuracy
    quality: PseudoGtQuality  # what was found out without the truth
    cameras: CamerasQuality  # the same of the reconstruction
    figures_fps_hz: float | None = None  # a whole part of the clips' rate; None for that rate
    predicted: Motion | None = None  # GMR's, accumulated from the first frame

    @property
    def has_camera(self) -> np.ndarray:
        """(T,) bool: frames of the pseudo clip with a valid motion and a camera, if it has any."""
        return has_camera(self.pseudo)


class GmrSummary(PaperMetrics[float]):
    """GMR's errors on one manifest."""

    zero_motion: PaperMetrics[float]
    """Those of a body that neither turns nor moves."""


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything on the page, and how the run was made."""

    title: str
    data_source: str  # where the motions came from, in a sentence
    seconds: Mapping[str, float]  # wall time per stage, in the order in which they ran
    clips: tuple[ClipReport, ...]
    versions: Mapping[str, str] = field(default_factory=dict)
    recipe: str = ""  # all of it, as YAML
    scores: Mapping[str, GmrSummary] = field(default_factory=dict)  # GMR's, by manifest
    learning_curve: tuple[tuple[int, float], ...] = ()  # (step, training loss)


THRESHOLDS = {"ome_deg": 0.5, "tme_mm": 15.0, "scale_error_percent": 5.0}
"""Largest error of pseudo ground truth against the truth at 10 Hz that counts as good."""

SCALE_NOT_OBSERVABLE = "not observable (pan)"
NO_FIGURE = "–"


def verdicts(figures: ClipAccuracy) -> dict[str, bool]:
    """Which figures of a clip keep to their thresholds; `frames_with_camera` means every frame."""
    values = {key: getattr(figures, key) for key in THRESHOLDS}
    met = {
        key: abs(value) <= THRESHOLDS[key] for key, value in values.items() if value is not None
    }  # a NaN compares as False, so it never keeps to one
    return met | {"frames_with_camera": figures.frames_with_camera == figures.frames}


def figure_texts(figures: ClipAccuracy) -> dict[str, str]:
    """A clip's figures as text, without units, by key; the first is "with camera/all frames"."""
    scale, camera_deg = figures.scale_error_percent, figures.camera_rotation_deg
    return {
        "frames_with_camera": f"{figures.frames_with_camera}/{figures.frames}",
        "ome_deg": f"{figures.ome_deg:.3f}",
        "tme_mm": f"{figures.tme_mm:.2f}",
        "camera_rotation_deg": NO_FIGURE if camera_deg is None else f"{camera_deg:.3f}",
        "scale_error_percent": (
            SCALE_NOT_OBSERVABLE if scale is None else f"{scale:+.2f}".replace("-", "−")
        ),
    }


def score_texts(score: PaperMetrics[float]) -> dict[str, str]:
    """A score as text, without units, by key."""
    digits = {"ome_deg": 2, "tme_mm": 1, "vme_mm": 1}
    return {key: f"{getattr(score, key):.{n}f}" for key, n in digits.items()}


class ClipSummary(ClipAccuracy):
    """One clip of a summary."""

    id: str
    camera_motion: str


class Summary(Record):
    """`summary.json`: the report's figures."""

    format: Literal["gmrdata-summary/1"] = "gmrdata-summary/1"
    clips: tuple[ClipSummary, ...]
    gmr: dict[str, GmrSummary]
    """By manifest."""
    seconds: dict[str, float]
    """Wall time per stage [s]."""


def summary(report: ReportData) -> Summary:
    return Summary(
        clips=tuple(
            ClipSummary(id=clip.id, camera_motion=clip.camera_motion, **clip.figures.model_dump())
            for clip in report.clips
        ),
        gmr=dict(report.scores),
        seconds={stage: float(seconds) for stage, seconds in report.seconds.items()},
    )
