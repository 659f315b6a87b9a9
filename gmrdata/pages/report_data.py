"""What a report shows, as plain values; whoever makes the report fills them in.

The bars that pseudo ground truth has to meet, and the figures as text, for page and terminal.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion


@dataclass(frozen=True)
class ClipFigures:
    """How far a clip's pseudo ground truth lies from the truth."""

    ome_deg: float
    """Orientation motion error, mean over the motions (eq. 15) [deg]."""
    tme_mm: float
    """Translation motion error, mean over the motions (eq. 16) [mm]."""
    camera_rotation_deg: float | None
    """Camera rotation error, mean over the frames, after one best rotation of the recovered world
    [deg]; None without cameras."""
    scale_error_percent: float | None
    """Signed error of the metric scale [%]; None where the camera doesn't translate, so that no
    scale enters."""
    frames: int
    """Frames of the clip."""
    frames_with_camera: int
    """Frames for which a camera was recovered."""


@dataclass(frozen=True, eq=False)
class Quality:
    """What the reconstruction knows about itself, without the truth."""

    geometry: str
    """"full", "rotation_only" for a camera that only pans, or "static"."""
    scale: float | None = None
    """Metres per unit of the reconstruction; None where it doesn't enter."""
    scale_sigma: float | None = None
    """One standard deviation of `scale`, in the same unit."""
    reprojection_error_px: float | None = None
    """Mean reprojection error of the inliers [px]."""
    inliers: np.ndarray | None = None
    """(T,) int: inlier points (or matches) in each frame, by the rows of the pseudo clip."""
    notes: tuple[tuple[str, str], ...] = ()
    """Further rows for the clip's table, each a name and a value with its unit."""


@dataclass(frozen=True, eq=False)
class ClipReport:
    """One clip: the truth, what was recovered, and the pictures."""

    id: str
    """The clip's name."""
    camera_motion: str
    """The camera programme: "circular", "linear", "panning", ..."""
    true: Clip
    """World motion and camera, as they were."""
    pseudo: Clip
    """World motion and metric camera, as they were recovered."""
    true_from_pseudo: np.ndarray
    """(4, 4) rigid: maps the recovered world to the true world [m]."""
    images_dir: Path
    """The frames."""
    masks_dir: Path | None
    """Masks `<image stem>.png`, 255 = dynamic object; None draws no outline."""
    body: BodyModel
    """The body of both motions."""
    figures: ClipFigures
    """Errors of the pseudo clip."""
    quality: Quality
    """The reconstruction's own record."""
    figures_fps_hz: float | None = None
    """Rate at which the motions of `figures` were taken [Hz], of which the clips' rate is a
    multiple; None for the clips' own rate."""
    predicted: Motion | None = None
    """GMR's world motion for this clip, accumulated from the first frame, if there is one."""


@dataclass(frozen=True)
class Score:
    """Mean errors of one motion estimate over a manifest."""

    ome_deg: float
    """Orientation motion error [deg]."""
    tme_mm: float
    """Translation motion error [mm]."""
    vme_mm: float
    """Vertex motion error [mm]."""


@dataclass(frozen=True)
class ManifestScore:
    """GMR's scores on one manifest, beside those of no motion at all."""

    name: str
    """The manifest."""
    gmr: Score
    """The trained model."""
    zero_motion: Score
    """The baseline that says that the body neither turns nor moves."""


@dataclass(frozen=True, eq=False)
class RunReport:
    """How the run was made."""

    title: str
    """The page's title."""
    data_source: str
    """Where the motions came from, in a sentence."""
    seconds: Mapping[str, float]
    """Wall time per stage [s], in the order in which they ran."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Version per package."""
    recipe: str = ""
    """The whole recipe, as YAML."""
    limits: tuple[str, ...] = ()
    """Sentences on what this run's figures do not say, beside those that hold for every report."""


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything on the page."""

    run: RunReport
    """How it was made."""
    clips: tuple[ClipReport, ...]
    """The clips, in the order of the page."""
    scores: tuple[ManifestScore, ...] = ()
    """GMR's scores; empty when none was trained."""
    learning_curve: tuple[tuple[int, float], ...] = ()
    """(step, training loss) pairs."""


BARS = {"ome_deg": 0.5, "tme_mm": 15.0, "scale_error_percent": 5.0}
"""Largest error of pseudo ground truth against the truth at 10 Hz that counts as good."""

SCALE_NOT_OBSERVABLE = "not observable (pan)"
NO_FIGURE = "–"


def verdicts(figures: ClipFigures | Mapping[str, Any]) -> dict[str, bool]:
    """Which figures of a clip meet their bars, by key; `frames_with_camera` means every frame."""
    row = asdict(figures) if isinstance(figures, ClipFigures) else figures
    met = {
        key: abs(row[key]) <= bar for key, bar in BARS.items() if row[key] is not None
    }  # a NaN compares as False, so it never meets a bar
    return met | {"frames_with_camera": row["frames_with_camera"] == row["frames"]}


def figure_texts(figures: ClipFigures | Mapping[str, Any]) -> dict[str, str]:
    """A clip's figures as text, without units, by key; `cameras` is "with camera/all frames"."""
    row = asdict(figures) if isinstance(figures, ClipFigures) else figures
    scale, camera_deg = row["scale_error_percent"], row["camera_rotation_deg"]
    return {
        "cameras": f"{row['frames_with_camera']}/{row['frames']}",
        "ome_deg": f"{row['ome_deg']:.3f}",
        "tme_mm": f"{row['tme_mm']:.2f}",
        "camera_rotation_deg": NO_FIGURE if camera_deg is None else f"{camera_deg:.3f}",
        "scale_error_percent": SCALE_NOT_OBSERVABLE if scale is None else _signed(scale),
    }


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


def score_texts(score: Score | Mapping[str, Any]) -> dict[str, str]:
    """A score as text, without units, by key."""
    row = asdict(score) if isinstance(score, Score) else score
    return {
        "ome_deg": f"{row['ome_deg']:.2f}",
        "tme_mm": f"{row['tme_mm']:.1f}",
        "vme_mm": f"{row['vme_mm']:.1f}",
    }


def summary(report: ReportData) -> dict[str, Any]:
    """The report's figures as plain JSON values.

    Returns:
        `clips`: a list with `id`, `camera_motion` and the fields of ClipFigures; `gmr`: per
        manifest `ome_deg`, `tme_mm`, `vme_mm` and the same under `zero_motion`; `seconds` per
        stage.
    """
    return {
        "clips": [
            {"id": clip.id, "camera_motion": clip.camera_motion} | asdict(clip.figures)
            for clip in report.clips
        ],
        "gmr": {
            score.name: asdict(score.gmr) | {"zero_motion": asdict(score.zero_motion)}
            for score in report.scores
        },
        "seconds": {stage: float(seconds) for stage, seconds in report.run.seconds.items()},
    }
