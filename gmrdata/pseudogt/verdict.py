"""Whether a pseudo ground truth can be used: the whole sequence, and each of its frames.

Every check compares one figure with one threshold of the recipe, and what fails says both.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np
from pydantic import Field

from gmrdata.clip import Clip, camera_of
from gmrdata.config import Config
from gmrdata.pseudogt.moves import angles_deg, relative_moves, window_differences
from gmrdata.sfm.scale import ScaleEstimate

ANOTHER_PLACE = "no camera was found: the picture shows another place, beyond a cut"


class VerdictConfig(Config):
    """What a sequence and its frames must keep to."""

    min_registered_share: float = Field(default=0.7, ge=0, le=1)
    """Share of the images that have a camera."""
    max_reprojection_px: float = Field(default=1.0, gt=0)
    """Mean reprojection error of the background [px]."""
    max_scale_sigma_share: float = Field(default=0.06, gt=0)
    """Standard error of the metric scale, as a share of the scale."""
    max_cue_disagreement: float = Field(default=3.5, gt=0)
    """Difference between two cues of the scale, in its standard errors."""
    max_cuts_share: float = Field(default=0.05, ge=0)
    """Share of the steps between images at which the picture changes to another place."""
    min_kept_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the frames for which the data set vouches that must be left."""
    min_inliers: int = Field(default=25, ge=0)
    """Background points or matches that hold a frame's camera."""
    max_speed_m_per_s: float = Field(default=8.0, gt=0)
    """Speed of the camera from one frame to the next [m/s]."""
    max_turn_deg_per_s: float = Field(default=500.0, gt=0)
    """Turning speed of the camera from one frame to the next [degrees/s]."""
    window_s: float = Field(default=0.5, gt=0)
    """Time over which camera motion is compared with the data set's own [s]."""
    max_window_deg: float = Field(default=4.0, gt=0)
    """Difference from the data set's own rotation over that time [degrees]."""
    max_window_m: float = Field(default=0.25, gt=0)
    """Difference from the data set's own displacement over that time [m]."""
    max_focal_deviation: float = Field(default=0.1, gt=0, lt=1)
    """Difference of the focal length that the background asks for from the given one, as a share of
    it, that is still right."""
    focal_sigmas: float = Field(default=3.0, ge=0)
    """By how many standard errors it must be larger to be called wrong."""
    min_run_s: float = Field(default=0.2, ge=0)
    """A kept range is at least this long [s]."""


@dataclass(frozen=True)
class Dropped:
    """Frames start, start + 1, ..., stop - 1 that must not be used."""

    start: int
    """First frame."""
    stop: int
    """One past the last frame."""
    reason: str
    """Why."""


@dataclass(frozen=True)
class Verdict:
    """What was decided, and on what."""

    accepted: bool
    """Whether the sequence can be used, but for the dropped ranges."""
    reasons: tuple[str, ...]
    """Why not, for a rejected one; and what a person decided, for any."""
    dropped: tuple[Dropped, ...]
    """Ranges in ascending order."""
    n_frames: int
    """Number of frames T."""

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames outside the dropped ranges."""
        kept = np.ones(self.n_frames, dtype=bool)
        for run in self.dropped:
            kept[run.start : run.stop] = False
        return kept

    @property
    def kept_share(self) -> float:
        """Share of the frames that are left, 0 to 1."""
        return float(self.kept.mean())

    @property
    def frame_reasons(self) -> list[str]:
        """T texts: why each frame is dropped; empty where it isn't."""
        reasons = [""] * self.n_frames
        for run in self.dropped:
            reasons[run.start : run.stop] = [run.reason] * (run.stop - run.start)
        return reasons

    def as_record(self, clip_id: str) -> dict[str, Any]:
        """The verdict of one clip as plain JSON."""
        return {
            "id": clip_id,
            "frames": self.n_frames,
            "kept_frames": int(self.kept.sum()),
            "kept_share": float(f"{self.kept_share:.6g}"),
            "accepted": self.accepted,
            "reasons": list(self.reasons),
            "dropped": [asdict(run) for run in self.dropped],
        }


def dropped_ranges(reasons: Sequence[str]) -> list[Dropped]:
    """Runs of frames that share a reason; frames with an empty one are in none."""
    found, start = [], 0
    for reason, group in groupby(reasons):
        stop = start + len(list(group))
        if reason:
            found.append(Dropped(start, stop, reason))
        start = stop
    return found


def judge(
    clip: Clip,
    sfm_quality: dict[str, Any],
    sfm_rows: np.ndarray,
    estimate: ScaleEstimate,
    config: VerdictConfig,
    *,
    unusable: Sequence[str] | None = None,
    doubts: Sequence[str] = (),
    tracked: np.ndarray | None = None,
) -> Verdict:
    """Judge a pseudo ground truth by its own figures.

    Args:
        clip: The pseudo ground truth: T frames, world frame, with its cameras.
        sfm_quality: The reconstruction's `quality.json`.
        sfm_rows: (T,) row of the reconstruction for each frame; -1 for a frame without an image.
        estimate: The metric scale.
        config: The thresholds.
        unusable: T texts: why the data set itself doesn't vouch for a frame; empty where it does.
        doubts: Why the data set's sequence can't be used at all.
        tracked: (T, 4, 4) metric world_from_cam of the data set; NaN where unknown.
    """
    reasons = frame_reasons(clip, sfm_quality, sfm_rows, config, unusable=unusable, tracked=tracked)
    reasons = _without_short_runs(reasons, round(config.min_run_s * clip.motion.fps_hz))
    vouched = sum(not reason for reason in unusable) if unusable is not None else len(reasons)
    kept_share = sum(not reason for reason in reasons) / max(1, vouched)
    failed = [*doubts, *_sequence_reasons(sfm_quality, estimate, kept_share, config)]
    return Verdict(not failed, tuple(failed), tuple(dropped_ranges(reasons)), len(reasons))


def frame_reasons(
    clip: Clip,
    sfm_quality: dict[str, Any],
    sfm_rows: np.ndarray,
    config: VerdictConfig,
    *,
    unusable: Sequence[str] | None = None,
    tracked: np.ndarray | None = None,
) -> list[str]:
    """Why each of the T frames must not be used; empty where it may.  Arguments as in `judge`."""
    camera, fps_hz = camera_of(clip), clip.motion.fps_hz
    n = camera.n_frames
    reasons = list(unusable) if unusable is not None else [""] * n
    _mark(reasons, sfm_rows < 0, "it has no image")
    _mark(reasons, _behind_cut(sfm_quality, sfm_rows, camera.has_camera), ANOTHER_PLACE)
    _mark(reasons, ~camera.has_camera, "no camera was found")
    _mark(reasons, ~clip.valid, "the body is not known")
    inliers = np.array(sfm_quality["inliers_per_frame"])[sfm_rows]
    # An interpolated camera has none of its own; it is marked, and held by its neighbours.
    few = (inliers < config.min_inliers) & ~np.isin(sfm_rows, sfm_quality.get("interpolated", []))
    _mark(reasons, few, f"fewer than {config.min_inliers} inliers")
    steps = relative_moves(camera.world_from_cam, 1)
    fast = np.linalg.norm(steps[:, :3, 3], axis=1) * fps_hz > config.max_speed_m_per_s
    fast |= angles_deg(steps) * fps_hz > config.max_turn_deg_per_s
    _mark(reasons, _both_sides(fast, 1, n), "the camera jumps")
    if tracked is not None:
        step = max(1, round(config.window_s * fps_hz))
        off = _disagrees(camera.world_from_cam, tracked, step, config)
        _mark(reasons, _both_sides(off, step, n), "the camera moves otherwise than the data set's")
    return reasons


def _behind_cut(
    sfm_quality: dict[str, Any], sfm_rows: np.ndarray, has_camera: np.ndarray
) -> np.ndarray:
    """(T,) bool: frames of a stretch between two cuts in which no frame has a camera."""
    cuts = np.array(sfm_quality.get("cuts_after_frames", []), dtype=int)
    stretch = np.searchsorted(cuts, sfm_rows)
    placed = np.unique(stretch[has_camera])
    return ~np.isin(stretch, placed) & (len(cuts) > 0)


def _disagrees(
    world_from_cam: np.ndarray, tracked: np.ndarray, step: int, config: VerdictConfig
) -> np.ndarray:
    """(T - step,) bool: windows in which the two cameras move differently."""
    apart_deg, apart_m = window_differences(world_from_cam, tracked, step)
    # A comparison with NaN is False: what is unknown doesn't disagree.
    return (apart_deg > config.max_window_deg) | (apart_m > config.max_window_m)


def _both_sides(steps: np.ndarray, step: int, n: int) -> np.ndarray:
    """(n,) bool: frames at either end of a marked step."""
    first, last = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    first[: n - step], last[step:] = steps, steps
    return first | last


def _mark(reasons: list[str], bad: np.ndarray, reason: str) -> None:
    for row in np.flatnonzero(bad):
        reasons[row] = reasons[row] or reason


def _without_short_runs(reasons: list[str], min_run: int) -> list[str]:
    result: list[str] = []
    for kept, group in groupby(reasons, key=lambda reason: not reason):
        run = list(group)
        short = kept and len(run) < min_run and len(run) < len(reasons)
        result += [f"only {len(run)} usable frames in a row"] * len(run) if short else run
    return result


def _sequence_reasons(
    sfm_quality: dict[str, Any],
    estimate: ScaleEstimate,
    kept_share: float,
    config: VerdictConfig,
) -> list[str]:
    registered = float(sfm_quality.get("registered_share", 1.0))
    error_px = float(sfm_quality.get("mean_reprojection_px", 0.0))
    cuts = len(sfm_quality.get("cuts_after_frames", []))
    cuts_share = cuts / max(1, int(sfm_quality.get("frames", 2)) - 1)
    checks = [
        (
            registered < config.min_registered_share,
            f"{registered:.0%} of the images have a camera, fewer than "
            f"{config.min_registered_share:.0%}",
        ),
        (
            error_px > config.max_reprojection_px,
            f"the mean reprojection error is {error_px:.2f} px, more than "
            f"{config.max_reprojection_px:g} px",
        ),
        (
            cuts_share > config.max_cuts_share,
            f"the picture changes to another place {cuts} times: images out of order, black, or "
            "of several takes",
        ),
        (
            kept_share < config.min_kept_share,
            f"{kept_share:.0%} of the data set's valid frames can be used, fewer than "
            f"{config.min_kept_share:.0%}",
        ),
    ]
    factor, sigma = sfm_quality.get("focal_factor"), sfm_quality.get("focal_sigma")
    if factor is not None and sigma is not None:
        beyond = abs(factor - 1.0) - config.max_focal_deviation
        checks.append(
            (
                beyond > config.focal_sigmas * sigma,
                f"the background asks for a focal length {factor:.2f} times the given one "
                f"(standard error {sigma:.2f}, at most {config.max_focal_deviation:.0%} off "
                "is right)",
            )
        )
    if estimate.scale is not None and estimate.sigma is not None:
        share = estimate.sigma / estimate.scale
        checks.append(
            (
                share > config.max_scale_sigma_share,
                f"the metric scale is uncertain by {share:.1%}, more than "
                f"{config.max_scale_sigma_share:.1%}",
            )
        )
    if estimate.disagreement is not None:
        checks.append(
            (
                estimate.disagreement > config.max_cue_disagreement,
                f"two cues of the scale are {estimate.disagreement:.1f} standard errors apart, "
                f"more than {config.max_cue_disagreement:g}",
            )
        )
    return [reason for fails, reason in checks if fails]
