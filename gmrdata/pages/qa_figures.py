"""The figures behind a verdict, each against its threshold, and those behind the camera's class."""

from typing import Any, NamedTuple

import numpy as np

from gmrdata.pages.qa_data import Found
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.threedpw.intrinsics_check import IntrinsicsConfig
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.world.frame_checks import angles_deg, relative_moves, window_differences
from gmrdata.world.recipe import PseudoGtConfig, VerdictConfig


class Row(NamedTuple):
    """One figure, as plain text."""

    name: str
    """What it is, with its unit."""
    value: str
    """The figure."""
    limit: str
    """Its threshold."""
    met: bool | None
    """Whether it keeps to it; None where nothing can be said."""


def verdict_rows(found: Found, recipe: ThreedpwRecipe) -> list[Row]:
    """What the sequence as a whole was judged by."""
    pseudo_gt, record = recipe.of_sequence(found.name).pseudo_gt, found.record
    config = pseudo_gt.verdict
    cuts_share = None
    if "frames" in record:
        cuts = len(record.get("cuts_after_frames", ()))
        cuts_share = cuts / max(1, record["frames"] - 1)
    rows = [
        _share("images with a camera", record.get("registered_share"), config.min_registered_share),
        _most("mean reprojection error [px]", record.get("mean_reprojection_px"),
              config.max_reprojection_px),
        _most("steps to another place [%]", cuts_share, config.max_cuts_share, percent=True),
        *_scale_rows(record, pseudo_gt),
        *_kept_rows(found, config),
    ]  # fmt: skip
    return [*rows, focal_row(found.people.get("focal"), recipe.intrinsics)]


def _scale_rows(record: dict[str, Any], config: PseudoGtConfig) -> list[Row]:
    """What the scale was judged by; nothing is asked where none enters."""
    sigma, scale = record.get("scale_sigma"), record.get("scale")
    share = None if sigma is None or scale is None else sigma / scale
    limit = config.verdict.max_scale_sigma_share
    row = _most("standard error of the scale [%]", share, limit, percent=True)
    if row.met is False and not record.get("scale_matters", True):
        said = f"{row.limit}, or ≤ {config.scale.slow_m_per_s:g} m/s of the camera's speed"
        row = row._replace(limit=said, met=True)
    apart = None if share is None else record.get("scale_disagreement")
    name = "largest difference of two cues [standard errors]"
    return [row, _most(name, apart, config.verdict.max_cue_disagreement)]


def frame_rows(found: Found, config: VerdictConfig) -> list[Row]:
    """What single frames were judged by: the worst of all frames, and how many are beyond."""
    world_from_cam = found.world_from_cam
    if world_from_cam is None:
        return []
    fps_hz = next(iter(found.clips.values())).motion.fps_hz
    moves = relative_moves(world_from_cam, 1)
    speed_m_per_s = fps_hz * np.linalg.norm(moves[:, :3, 3], axis=1)
    inliers = np.array(found.record.get("inliers_per_frame", []), dtype=float)
    rows = [
        _worst("fewest inliers", inliers, config.min_inliers, least=True),
        _worst("fastest camera [m/s]", speed_m_per_s, config.max_speed_m_per_s),
        _worst("fastest turn [°/s]", fps_hz * angles_deg(moves), config.max_turn_deg_per_s),
    ]
    if found.tracked is None:
        return rows
    step = max(1, round(config.window_s * fps_hz))
    apart_deg, apart_m = window_differences(world_from_cam, found.tracked, step)
    span = f"over {config.window_s:g} s, difference from the data set’s camera"
    return [
        *rows,
        _worst(f"turn {span} [°]", apart_deg, config.max_window_deg),
        _worst(f"way {span} [m]", apart_m, config.max_window_m),
    ]


def class_rows(figures: dict[str, Any], config: MotionClassConfig) -> list[Row]:
    """What the camera's class was decided on; the thresholds are borders, not limits."""
    line_m, circle_m = figures.get("line_rms_m"), figures.get("circle_rms_m")
    share = circle_m / line_m if circle_m is not None and line_m else None
    goes_round = figures.get("goes_round")
    return [
        _border("largest distance of two places [m]", figures.get("extent_m"),
                f"travels from {config.travel_m:g}; static up to {config.static_m:g}"),
        _border("largest difference of two orientations [°]", figures.get("turn_deg"),
                f"in place, pans above {config.pan_deg:g}, static up to {config.static_deg:g}; "
                f"travelling, turns above {config.turn_deg:g}"),
        _border("bend of the way [°]", figures.get("bend_deg"),
                f"circular from {config.bend_deg:g}"),
        _border("circle’s residuals over a line’s", share,
                f"circular up to {config.bend_share:g}"),
        Row("the person is inside the circle",
            NO_FIGURE if goes_round is None else "yes" if goes_round else "no",
            "circular only if so", None),
        _border("length of the way [m]", figures.get("path_m"), ""),
        _border("median distance to the person [m]", figures.get("distance_m"), ""),
    ]  # fmt: skip


def _kept_rows(found: Found, config: VerdictConfig) -> list[Row]:
    rows = []
    for person, reasons in enumerate(found.reasons if found.is_solved else ()):
        vouched = len(reasons)
        if person < len(found.doubts):
            vouched = sum(not doubt for doubt in found.doubts[person])
        share = sum(not reason for reason in reasons) / max(1, vouched)
        name = f"the data set’s {vouched} valid frames of person {person} that are left"
        rows.append(_share(name, share, config.min_kept_share))
    return rows


def focal_row(focal: dict[str, Any] | None, config: IntrinsicsConfig) -> Row:
    limit = f"1 ± {config.max_focal_deviation:g}, beyond it by {config.sigmas:g} standard errors"
    name = "focal length that the 2D keypoints ask for, over the given one"
    if focal is None:
        return Row(name, NO_FIGURE, limit, None)
    factor, sigma = focal["factor"], focal["sigma"]
    beyond = abs(factor - 1.0) - config.max_focal_deviation
    met = not beyond > config.sigmas * sigma
    return Row(name, f"{factor:.3f} ± {sigma:.3f}", limit, met)


def _share(name: str, value: float | None, least: float) -> Row:
    if value is None:
        return Row(f"{name} [%]", NO_FIGURE, f"≥ {100 * least:g}", None)
    return Row(f"{name} [%]", f"{100 * value:.1f}", f"≥ {100 * least:g}", value >= least)


def _most(name: str, value: float | None, most: float, *, percent: bool = False) -> Row:
    unit = 100 if percent else 1
    if value is None:
        return Row(name, NO_FIGURE, f"≤ {unit * most:g}", None)
    return Row(name, f"{unit * value:.3g}", f"≤ {unit * most:g}", value <= most)


def _worst(name: str, values: np.ndarray, limit: float, *, least: bool = False) -> Row:
    """The largest of a figure, or the least."""
    said = f"≥ {limit:g}" if least else f"≤ {limit:g}"
    known = values[np.isfinite(values)]
    if not len(known):
        return Row(name, NO_FIGURE, said, None)
    beyond = int((known < limit if least else known > limit).sum())
    worst = known.min() if least else known.max()
    return Row(name, f"{worst:.3g}" + (f" ({beyond} beyond)" if beyond else ""), said, not beyond)


def _border(name: str, value: float | None, borders: str) -> Row:
    return Row(name, NO_FIGURE if value is None else f"{value:.3g}", borders, None)
