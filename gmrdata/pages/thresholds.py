"""The figures behind a verdict, each against its threshold, and those behind the camera's class."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gmrdata.cameras.check.verdict import relative_moves
from gmrdata.cameras.files import CamerasQuality
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.pages.html import Cell, Table
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.pages.solved import SolvedSequence
from gmrdata.threedpw.intrinsics_check import FocalEstimate, IntrinsicsCheckConfig
from gmrdata.values.camera_motion import MotionClassConfig, MotionFigures
from gmrdata.values.records import compared
from gmrdata.values.transforms import angles_rad
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.world.recipe import PseudoGtConfig


class FigureRow(NamedTuple):
    """One figure with its unit, as plain text."""

    name: str
    value: str
    threshold: str
    met: bool | None  # whether it keeps to the threshold; None where nothing can be said


def threshold_table(rows: Iterable[FigureRow], heading: str, caption: str) -> Table:
    """Figures beside their thresholds, which `heading` names."""
    cells = [(row.name, Cell(row.value, met=row.met), row.threshold) for row in rows]
    return Table(("figure", "value", heading), cells, caption)


def verdict_rows(solved: SolvedSequence) -> list[FigureRow]:
    """What a sequence as a whole was judged by."""
    rows = camera_rows(solved.cameras, solved.config.verdict)
    if solved.is_alone:
        return rows
    rows += _scale_rows(solved.record, solved.config)
    rows += _kept_rows(solved) + _fit_rows(solved)
    if (said := solved.dataset) is not None:
        focal = None if said.people is None else said.people.focal
        rows.append(focal_row(focal, said.intrinsics))
    return rows


def camera_rows(cameras: CamerasQuality | None, config: CamerasVerdictConfig) -> list[FigureRow]:
    """What cameras were judged by, which needs nobody."""
    cuts_share = registered = error_px = step = factor = sigma = again = second = None
    if cameras is not None:
        cuts_share = len(cameras.cuts_after_frames) / max(1, cameras.frames - 1)
        registered, error_px = cameras.registered_share, cameras.mean_reprojection_px
        step, factor, sigma = cameras.weakest_step, cameras.focal_factor, cameras.focal_sigma
        again, second = cameras.agreement, cameras.second_share
    loose = moving = ratio = None
    if step is not None:
        loose, moving, ratio = step.loose_share, step.loose_moving_share, step.distance_ratio
    return [
        _share("images with a camera", registered, config.min_registered_share),
        _row("mean reprojection error [px]", error_px, config.max_reprojection_px),
        _row("steps to another place [%]", cuts_share, config.max_cuts_share, unit=100),
        _row("way that the weakest step leaves open [%]", loose, config.max_loose_share, unit=100),
        _row("the same times what moves [%]", moving, config.max_loose_moving_share, unit=100),
        _row("ratio of distances at successive keyframes", ratio, config.max_distance_ratio),
        _share(
            "keyframes of a second solution that have a camera", second, config.min_second_share
        ),
        _row(
            "turn of a second solution of the keyframes [°]",
            None if again is None else again.turn_deg,
            config.max_again_deg,
        ),
        _row(
            "its places, of the way [%]",
            None if again is None else again.place_share,
            config.max_again_share,
            unit=100,
        ),
        _focal_row(
            "the background", factor, sigma, config.max_focal_deviation, config.focal_sigmas
        ),
        *_travel_rows(cameras, config),
    ]


def _travel_rows(cameras: CamerasQuality | None, config: CamerasVerdictConfig) -> list[FigureRow]:
    """Of a camera that is said to stay in its place; none where no path was set aside for that."""
    if cameras is None or cameras.travel_set_aside is None:
        return []
    name = "way of the path that was set aside, of the background’s distance [%]"
    row = _row(name, cameras.travel_set_aside, config.max_travel_set_aside, unit=100)
    most_px = config.max_turn_wide_median_px
    if cameras.evidence.rotation_only_wide_median_px <= most_px:
        said = f"{row.threshold}, or a turn ≤ {most_px:g} px off in the worst pairs"
        row = row._replace(threshold=said, met=True)
    return [row]


def _scale_rows(record: PseudoGtQuality | None, config: PseudoGtConfig) -> list[FigureRow]:
    """Nothing is asked of the scale where none enters."""
    share = apart = None
    wrong: list[FigureRow] = []
    if record is not None and record.scale is not None and record.scale_sigma is not None:
        scale, sigma, apart = record.scale, record.scale_sigma, record.scale_disagreement
        share = sigma / abs(scale) if scale else np.inf
        if not (scale > 0 and sigma >= 0):
            said = f"{scale:.3g} ± {sigma:.2g}"
            wrong = [FigureRow("scale [m per unit of the cameras]", said, "> 0", False)]
    most = config.verdict.max_scale_sigma_share
    row = _row("standard error of the scale [%]", share, most, unit=100)
    if row.met is False and record is not None and not record.scale_matters:
        said = f"{row.threshold}, or ≤ {config.scale.slow_m_per_s:g} m/s of the camera's speed"
        row = row._replace(threshold=said, met=True)
    name = "largest difference of two cues [standard errors]"
    return [*wrong, row, _row(name, apart, config.verdict.max_cue_disagreement)]


def frame_rows(solved: SolvedSequence) -> list[FigureRow]:
    """What single frames were judged by: the worst of all frames, and how many are beyond."""
    world_from_cam, config = solved.world_from_cam, solved.config.verdict
    if world_from_cam is None:
        return []
    fps_hz = solved.fps_hz
    moves = relative_moves(world_from_cam, 1)
    speed_m_per_s = fps_hz * np.linalg.norm(moves[:, :3, 3], axis=1)
    turn_deg_per_s = fps_hz * np.rad2deg(angles_rad(moves[:, :3, :3]))
    inliers = np.array([] if solved.cameras is None else solved.cameras.inliers_per_frame, float)
    # An interpolated camera has none of its own, and its frame is kept.
    inliers[[] if solved.cameras is None else list(solved.cameras.interpolated)] = np.nan
    rows = [
        _worst("fewest inliers", inliers, config.min_inliers, least=True),
        _worst("fastest camera [m/s]", speed_m_per_s, config.max_speed_m_per_s),
        _worst("fastest turn [°/s]", turn_deg_per_s, config.max_turn_deg_per_s),
    ]
    if (apart := solved.window_differences()) is not None:
        span = f"over {config.window_s:g} s, difference from the data set’s camera"
        rows.append(_worst(f"turn {span} [°]", apart[0], config.max_window_deg))
        rows.append(_worst(f"way {span} [m]", apart[1], config.max_window_m))
    return rows


def class_rows(figures: MotionFigures, config: MotionClassConfig) -> list[FigureRow]:
    """What the camera's class was decided on; they are borders, so none is met or missed."""
    line_m, circle_m = figures.line_rms_m, figures.circle_rms_m
    share = circle_m / line_m if circle_m is not None and line_m else None
    return [
        _border("largest distance of two places [m]", figures.extent_m,
                f"travels from {config.travel_m:g}; static up to {config.static_m:g}"),
        _border("largest difference of two orientations [°]", figures.turn_deg,
                f"in place, pans above {config.pan_deg:g}, static up to {config.static_deg:g}; "
                f"travelling, turns above {config.turn_deg:g}"),
        _border("bend of the way [°]", figures.bend_deg,
                f"circular from {config.bend_deg:g}"),
        _border("circle’s residuals over a line’s", share,
                f"circular up to {config.bend_share:g}"),
        FigureRow("the person is inside the circle",
            "yes" if figures.goes_round else "no",
            "circular only if so", None),
        _border("length of the way [m]", figures.path_m, ""),
        _border("median distance to the person [m]", figures.distance_m, ""),
    ]  # fmt: skip


def _kept_rows(solved: SolvedSequence) -> list[FigureRow]:
    """Frames that the data set or the video itself doubts count for nothing."""
    rows = []
    for person, reasons in enumerate(solved.reasons if solved.is_solved else ()):
        doubts = solved.doubts[person] if person < len(solved.doubts) else len(reasons) * ("",)
        vouched = doubts.count("")
        share = sum(not reason for reason in reasons) / max(1, vouched)
        name = f"the {vouched} valid frames of person {person} that are left"
        rows.append(_share(name, share, solved.config.verdict.min_kept_share))
    return rows


def _fit_rows(solved: SolvedSequence) -> list[FigureRow]:
    """How the bodies lie on the people in the pictures."""
    rows, config = [], solved.config.verdict
    for person, fit in enumerate(() if solved.record is None else solved.record.picture_fits):
        off = gain = doubled = None
        if fit is not None:
            off, doubled = np.array([fit.off_frames, fit.doubled_frames]) / max(1, fit.frames)
            gain = fit.late_overlap - fit.overlap
        name = f"compared frames in which the body of person {person} lies on nobody [%]"
        rows.append(_row(name, off, config.max_off_share, unit=100))
        name = f"overlap that the body of person {person} gains on other frames"
        row, least = _row(name, gain, config.max_late_gain), config.off_overlap
        if row.met is False and fit is not None and fit.late_overlap < least:
            row = row._replace(threshold=f"{row.threshold}, or < {least:g} there", met=True)
        name = f"compared frames in which another body lies where that of person {person} does [%]"
        rows += [row, _row(name, doubled, config.max_doubled_share, unit=100)]
    return rows


def focal_row(focal: FocalEstimate | None, config: IntrinsicsCheckConfig) -> FigureRow:
    """What the 2D keypoints of 3DPW ask for."""
    factor, sigma = (None, None) if focal is None else (focal.factor, focal.sigma)
    return _focal_row("the 2D keypoints", factor, sigma, config.max_focal_deviation, config.sigmas)


def _focal_row(
    who: str, factor: float | None, sigma: float | None, deviation: float, sigmas: float
) -> FigureRow:
    said = f"1 ± {deviation:g}, beyond it by {sigmas:g} standard errors"
    name = f"focal length that {who} ask{'' if who.endswith('s') else 's'} for, over the given one"
    if factor is None or sigma is None:
        return FigureRow(name, NO_FIGURE, said, None)
    beyond = abs(factor - 1.0) - deviation
    return FigureRow(name, f"{factor:.3f} ± {sigma:.3f}", said, not beyond > sigmas * sigma)


def _row(
    name: str, value: float | None, threshold: float, spec: str = ".3g", *,
    least: bool = False, unit: int = 1,
) -> FigureRow:  # fmt: skip
    """A figure that must be at most (or at least) its threshold."""
    said = f"{'≥' if least else '≤'} {unit * threshold:g}"
    if value is None:
        return FigureRow(name, NO_FIGURE, said, None)
    met = value >= threshold if least else value <= threshold
    return FigureRow(name, compared("{}", unit * value, unit * threshold, spec), said, met)


def _share(name: str, value: float | None, least: float) -> FigureRow:
    return _row(f"{name} [%]", value, least, ".1f", least=True, unit=100)


def _worst(name: str, values: np.ndarray, threshold: float, *, least: bool = False) -> FigureRow:
    """The largest of a figure, or the least, and how many are beyond the threshold."""
    known = values[np.isfinite(values)]
    if not len(known):
        return _row(name, None, threshold, least=least)
    beyond = int((known < threshold if least else known > threshold).sum())
    row = _row(name, float(known.min() if least else known.max()), threshold, least=least)
    return row._replace(value=f"{row.value} ({beyond} beyond)") if beyond else row


def _border(name: str, value: float | None, borders: str) -> FigureRow:
    return FigureRow(name, NO_FIGURE if value is None else f"{value:.3g}", borders, None)
