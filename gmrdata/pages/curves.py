"""Figures over time: a clip's errors and inliers, the scales, and the training loss.

Errors of a recovered clip per frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gmrdata.pages.report_data import BARS, SCALE_NOT_OBSERVABLE, ClipReport
from gmrdata.pages.style import COLOURS, quiet
from gmrdata.values.alignment import mean_rotation
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadFrames
from gmrdata.values.motion import Motion
from gmrdata.values.motion_deltas import deltas
from gmrdata.values.motion_metrics import angles_rad, orientation_errors_deg, translation_errors_mm


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors over time, NaN where the pseudo clip has no camera."""

    times_s: np.ndarray
    """(T,) time of each frame [s]."""
    motion_times_s: np.ndarray
    """(n,) middle of each motion [s]; at a lower rate than the clip's they overlap."""
    ome_deg: np.ndarray
    """(n,) orientation motion error of each motion [deg]."""
    tme_mm: np.ndarray
    """(n,) translation motion error of each motion [mm]."""
    camera_rotation_deg: np.ndarray
    """(T,) angle between the recovered and the true camera, after one best rotation of the
    recovered world [deg]."""


def paired_rows(true: Clip, pseudo: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two clips that show the same image, in the order of the images' numbers.

    Raises:
        BadFrames: no image is in both.
    """
    numbers, true_rows, pseudo_rows = np.intersect1d(
        true.image_numbers, pseudo.image_numbers, return_indices=True
    )
    with_image = numbers >= 0
    if not with_image.any():
        raise BadFrames(
            f"clip {pseudo.id}: its truth and its pseudo ground truth have no image in common;"
            " give both the numbers of their images"
        )
    return true_rows[with_image], pseudo_rows[with_image]


def usable(pseudo: Clip) -> np.ndarray:
    """(T,) bool: frames of a pseudo clip with a valid motion and a camera."""
    if pseudo.camera is None:
        return pseudo.valid.astype(bool)
    return pseudo.valid.astype(bool) & pseudo.camera.has_camera.astype(bool)


def frames_per_motion(clip: Clip, fps_hz: float | None) -> int:
    """How many frames later a motion ends than it begins; None stands for the clip's own rate.

    Raises:
        BadFrames: the clip's rate is no multiple of `fps_hz`.
    """
    if fps_hz is None:
        return 1
    ratio = clip.motion.fps_hz / fps_hz
    step = round(ratio)
    if step < 1 or abs(ratio - step) > 1e-6 * ratio:
        raise BadFrames(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no multiple of the {fps_hz:g} fps at"
            " which its errors are shown; resample it"
        )
    return step


def error_series(true: Clip, pseudo: Clip, fps_hz: float | None = None) -> ErrorSeries:
    """Errors per frame of a pseudo clip, over the images that both clips have.

    Their means are `gmrdata.twins.pseudo_gt_error.compare_clips`' figures at the same rate.

    Args:
        true: What was rendered.
        pseudo: What was recovered.
        fps_hz: Rate at which motions are taken [Hz], one from each frame; None for the clips' own.

    Raises:
        BadFrames: the clips have no image in common, or their rate is no multiple of `fps_hz`.
    """
    step = frames_per_motion(true, fps_hz)
    true_rows, rows = paired_rows(true, pseudo)
    good = usable(pseudo)[rows] & true.valid[true_rows].astype(bool)
    delta_rotmats, delta_m = _motions(pseudo.motion, rows, step)
    true_rotmats, true_m = _motions(true.motion, true_rows, step)
    # Every frame of the span must be good: no motion goes over a gap.
    both = np.lib.stride_tricks.sliding_window_view(good, step + 1).all(axis=1)
    both &= (true_rows[step:] - true_rows[:-step] == step) & (rows[step:] - rows[:-step] == step)
    times_s = (true_rows - true_rows[0]) / true.motion.fps_hz
    return ErrorSeries(
        times_s=times_s,
        motion_times_s=0.5 * (times_s[step:] + times_s[:-step]),
        ome_deg=np.where(both, orientation_errors_deg(delta_rotmats, true_rotmats), np.nan),
        tme_mm=np.where(both, translation_errors_mm(delta_m, true_m), np.nan),
        camera_rotation_deg=_camera_rotation_deg(true, pseudo, true_rows, rows),
    )


def _motions(motion: Motion, rows: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """dR (n, 3, 3) and dT (n, 3) [m] from each row to the one `step` rows later."""
    pairs = np.stack([rows[:-step], rows[step:]], axis=1)
    delta_rotmats, delta_m = deltas(motion.root_rotmats[pairs], motion.pelvis_m[pairs])
    return delta_rotmats[:, 0], delta_m[:, 0]


def _camera_rotation_deg(
    true: Clip, pseudo: Clip, true_rows: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    errors_deg = np.full(len(rows), np.nan)
    if true.camera is None or pseudo.camera is None:
        return errors_deg
    both = usable(pseudo)[rows] & true.camera.has_camera[true_rows].astype(bool)
    if not both.any():
        return errors_deg
    true_rotmats = true.camera.world_from_cam[true_rows[both], :3, :3]
    rotmats = pseudo.camera.world_from_cam[rows[both], :3, :3]
    true_from_pseudo = mean_rotation(true_rotmats @ np.swapaxes(rotmats, 1, 2))
    residuals = np.swapaxes(true_rotmats, 1, 2) @ true_from_pseudo @ rotmats
    errors_deg[both] = np.rad2deg(angles_rad(residuals))
    return errors_deg


def error_panels(figure: Figure, clip: ClipReport) -> None:
    """OME, TME, camera rotation and inliers of a clip over time, in four panels."""
    series = error_series(clip.true, clip.pseudo, clip.figures_fps_hz)
    between_s = series.motion_times_s
    panels = figure.subplots(2, 2, sharex=True)
    _error(panels[0, 0], between_s, series.ome_deg, "person", "Orientation motion error [°]")
    _error(panels[0, 1], between_s, series.tme_mm, "person", "Translation motion error [mm]")
    _error(
        panels[1, 0], series.times_s, series.camera_rotation_deg, "camera",
        "Camera rotation error [°]",
    )  # fmt: skip
    _inliers(panels[1, 1], clip)
    for axes in panels[1]:
        axes.set_xlabel("time [s]")


def _error(axes: Axes, times_s: np.ndarray, errors: np.ndarray, role: str, title: str) -> None:
    axes.set_title(title)
    quiet(axes)
    known = np.isfinite(errors)
    if known.any():
        mean = float(errors[known].mean())
        axes.fill_between(
            times_s, 0, errors, color=COLOURS[role + "-pale"], alpha=0.45, linewidth=0
        )
        axes.plot(times_s, errors, color=COLOURS[role], linewidth=1.5)
        axes.axhline(mean, color=COLOURS["muted"], linewidth=1, linestyle=(0, (4, 3)))
        axes.set_title(f"mean {mean:.3g}", loc="right", fontsize=9, color=COLOURS["muted"])
        axes.set_ylim(0, 1.15 * float(errors[known].max()) or 1.0)
    else:
        _nothing(axes, "no frame with a camera")
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _inliers(axes: Axes, clip: ClipReport) -> None:
    axes.set_title("Inliers per frame")
    quiet(axes)
    counts = clip.quality.inliers
    if counts is None or not len(counts):
        _nothing(axes, "not recorded")
        return
    times_s = np.arange(len(counts)) / clip.pseudo.motion.fps_hz
    good = usable(clip.pseudo)
    roles = ["camera-pale" if ok else "bad" for ok in good]
    axes.bar(
        times_s, counts, width=0.72 / clip.pseudo.motion.fps_hz, color=[COLOURS[r] for r in roles]
    )
    axes.set_ylim(0, 1.1 * max(1.0, float(np.max(counts))))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _nothing(axes: Axes, why: str) -> None:
    axes.text(
        0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=COLOURS["muted"]
    )


def scale_panel(figure: Figure, clips: Sequence[ClipReport]) -> None:
    """Error of each metric scale with its own sigma [%], beside the bar that it has to meet."""
    axes = figure.subplots()
    bar = BARS["scale_error_percent"]
    axes.axvspan(-bar, bar, color=COLOURS["rule"], alpha=0.5, linewidth=0)
    axes.axvline(0, color=COLOURS["muted"], linewidth=1)
    reach = bar
    for row, clip in enumerate(clips):
        error, sigma = clip.figures.scale_error_percent, relative_sigma_percent(clip)
        if error is None:
            axes.annotate(
                SCALE_NOT_OBSERVABLE, (0, row), xytext=(8, 0), textcoords="offset points",
                va="center", color=COLOURS["muted"],
            )  # fmt: skip
            continue
        role = "good" if abs(error) <= bar else "bad"
        axes.errorbar(
            error,
            row,
            xerr=sigma,
            fmt="o",
            color=COLOURS[role],
            markersize=6,
            linewidth=2,
            capsize=4,
        )
        reach = max(reach, abs(error) + (sigma or 0.0))
    axes.set_yticks(range(len(clips)), [clip.id for clip in clips])
    axes.tick_params(axis="y", labelcolor=COLOURS["ink"])
    axes.set_ylim(len(clips) - 0.4, -0.6)
    axes.set_xlim(-1.15 * reach, 1.15 * reach)
    axes.set_xlabel("error of the metric scale [%], with ± one sigma of its own estimate")
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    quiet(axes)


def relative_sigma_percent(clip: ClipReport) -> float | None:
    """The scale's own standard deviation [%]; None where there is no scale or no sigma."""
    quality = clip.quality
    if quality.scale is None or quality.scale_sigma is None or quality.scale == 0:
        return None
    return 100 * quality.scale_sigma / abs(quality.scale)


def learning_curve(figure: Figure, points: Sequence[tuple[int, float]]) -> None:
    """Training loss by step: every value pale, their running median on top, on a log scale."""
    steps, losses = (np.array(column, dtype=float) for column in zip(*points, strict=True))
    axes = figure.subplots()
    axes.plot(steps, losses, color=COLOURS["muted"], alpha=0.45, linewidth=0.8)
    axes.plot(steps, _running_median(losses), color=COLOURS["gmr"], linewidth=1.8)
    if (losses > 0).all():
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}" if losses.max() < 12 * losses.min() else "")
    axes.set_xlabel("step")
    axes.set_ylabel("training loss")
    quiet(axes)
    axes.tick_params(which="minor", length=0)


def _running_median(values: np.ndarray) -> np.ndarray:
    half = max(1, len(values) // 40)
    return np.array(
        [np.median(values[max(0, i - half) : i + half + 1]) for i in range(len(values))]
    )
