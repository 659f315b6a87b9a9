"""Names, units and meanings of all metrics, for tables and pages."""

from typing import NamedTuple


class MetricWords(NamedTuple):
    """What a metric is called."""

    title: str
    """Its short name."""
    unit: str
    """Its unit."""
    digits: int
    """Decimals that are shown."""
    meaning: str
    """What it says, in a sentence."""


METRIC_WORDS = {
    "ome_deg": MetricWords(
        "OME", "°", 2, "Angle between the predicted and the true turn from frame to frame."
    ),
    "tme_mm": MetricWords(
        "TME", "mm", 1, "Distance between the predicted and the true step, seen from the body."
    ),
    "vme_mm": MetricWords(
        "VME", "mm", 1, "Distance of the body's vertices after one predicted and one true motion."
    ),
    "w_mpjpe_mm": MetricWords(
        "W-MPJPE", "mm", 1, "Distance of the joints after a segment's first frames were aligned."
    ),
    "wa_mpjpe_mm": MetricWords(
        "WA-MPJPE", "mm", 1, "Distance of the joints after all frames of a segment were aligned."
    ),
    "rte_percent": MetricWords(
        "RTE",
        "%",
        2,
        "Distance of the roots after one rigid alignment of the whole path, per length of the "
        "true path.",
    ),
    "roe_deg": MetricWords(
        "ROE", "°", 1, "Angle between the roots' orientations after the first ones were made equal."
    ),
    "erve_mm_per_frame": MetricWords(
        "ERVE", "mm/frame", 1, "Error of the root's step as the body sees it."
    ),
    "jitter_10m_per_s3": MetricWords(
        "jitter", "10 m/s³", 1, "Mean length of the joints' jerk; the true motion has some too."
    ),
    "foot_sliding_mm": MetricWords(
        "foot sliding", "mm", 1, "Step of points on the predicted feet while the true ones stand."
    ),
}
"""By key in `scores.json`."""


def heading(metric: str) -> str:
    """A column's heading: name and unit."""
    words = METRIC_WORDS[metric]
    return f"{words.title} [{words.unit}]"


def figure_text(metric: str, value: float | None) -> str:
    """A figure without its unit; a dash where there is none."""
    return "–" if value is None else f"{value:.{METRIC_WORDS[metric].digits}f}"


def interval_text(metric: str, ends: list[float] | tuple[float, float] | None) -> str:
    """An interval without its unit, like `3.1 to 4.2`; empty where there is none."""
    if ends is None:
        return ""
    return f"{figure_text(metric, ends[0])} to {figure_text(metric, ends[1])}"
