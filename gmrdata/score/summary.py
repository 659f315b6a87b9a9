"""Scores of clips put together: per class of camera motion, per type of motion, overall."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from gmrdata.score.clip_errors import METHODS, METRICS, ClipErrors
from gmrdata.score.intervals import mean_intervals, ratio_interval, resampled_counts

Samples = Callable[[ClipErrors], dict[str, dict[str, np.ndarray]]]
Draws = Callable[[int], np.ndarray]
"""How often each of n clips is drawn in each resample: n -> (resamples, n)."""


def summarise(
    scored: Sequence[ClipErrors], fps_hz: float, resamples: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Scores per clip, per class, per type and overall, as JSON values.

    Intervals are of 95 %, by bootstrap over clips; None for fewer than two clips.  A figure that no
    clip has is None.

    Args:
        scored: The clips, at least one.
        fps_hz: Rate of their motions [Hz].
        resamples: How often the clips are drawn for an interval.
        rng: Draws them.
    """

    @cache
    def draws(n_clips: int) -> np.ndarray:
        # Groups of as many clips share their draws, so that equal groups get equal intervals.
        return resampled_counts(n_clips, resamples, rng)

    return {
        "clips": [_clip(one) for one in scored],
        "overall": _group(scored, draws),
        "over_time": over_time(scored, fps_hz, draws),
        "camera_motion": _groups(scored, lambda one: one.camera_motion, draws),
        "motion_type": _groups(scored, lambda one: one.motion_type, draws),
    }


def over_time(scored: Sequence[ClipErrors], fps_hz: float, draws: Draws) -> dict[str, Any]:
    """Mean over clips of the vertex error after t seconds (fig. 5).

    It goes as far as half of the clips last, and is of those clips alone: with others at its start
    it would jump where they end.

    Args:
        scored: The clips.
        fps_hz: Rate of their frames [Hz].
        draws: How often clips are drawn.

    Returns:
        `times_s`, the `clips` that last, and by method `vertex_mm` and the two ends of
        `interval95_mm`.
    """
    lengths = sorted((len(one.over_time_mm["predicted"]) for one in scored), reverse=True)
    n_frames = lengths[(len(scored) - 1) // 2]
    lasting = [one for one in scored if len(one.over_time_mm["predicted"]) >= n_frames]
    found: dict[str, Any] = {
        "times_s": [frame / fps_hz for frame in range(n_frames)],
        "clips": [one.clip_id for one in lasting],
    }
    for method in METHODS:
        values = np.array([one.over_time_mm[method][:n_frames] for one in lasting])
        ends = mean_intervals(values, draws(len(lasting)))
        found[method] = {
            "vertex_mm": values.mean(axis=0).tolist(),
            "interval95_mm": None if ends is None else ends.tolist(),
        }
    return found


def _clip(one: ClipErrors) -> dict[str, Any]:
    row: dict[str, Any] = {
        "id": one.clip_id,
        "camera_motion": one.camera_motion,
        "motion_type": one.motion_type,
        "n_motions": one.n_motions,
        "dropped_frames": one.dropped_frames,
    }
    row |= _pooled([one], _paper)
    if one.protocol_fps_hz is not None:
        row |= {"protocol": _pooled([one], _protocol), "protocol_fps_hz": one.protocol_fps_hz}
    return row


def _groups(
    scored: Sequence[ClipErrors],
    name_of: Callable[[ClipErrors], str | None],
    draws: Draws,
) -> dict[str, Any]:
    """Groups by name, sorted; clips without a name are in none."""
    members: dict[str, list[ClipErrors]] = defaultdict(list)
    for one in scored:
        name = name_of(one)
        if name is not None:
            members[name].append(one)
    return {name: _group(members[name], draws) for name in sorted(members)}


def _group(scored: Sequence[ClipErrors], draws: Draws) -> dict[str, Any]:
    counts = draws(len(scored))
    group = {
        "n_clips": len(scored),
        "n_motions": sum(one.n_motions for one in scored),
        "pooled_over_motions": _pooled(scored, _paper),
        "pooled_interval95": _intervals(scored, _paper, counts, clips_alike=False),
        "mean_of_clips": _mean_of_clips(scored, _paper),
        "mean_of_clips_interval95": _intervals(scored, _paper, counts, clips_alike=True),
    }
    if scored[0].protocol_fps_hz is not None:
        group |= {
            "protocol": _pooled(scored, _protocol),
            "protocol_interval95": _intervals(scored, _protocol, counts, clips_alike=False),
        }
    return group


def _paper(one: ClipErrors) -> dict[str, dict[str, np.ndarray]]:
    return {
        method: {metric: one.errors[method][metric] for metric in METRICS} for method in METHODS
    }


def _protocol(one: ClipErrors) -> dict[str, dict[str, np.ndarray]]:
    return one.protocol


def _pooled(scored: Sequence[ClipErrors], samples: Samples) -> dict[str, Any]:
    """Means of all clips' samples."""

    def figure(method: str, metric: str) -> float | None:
        values = np.concatenate([samples(one)[method][metric] for one in scored])
        return float(values.mean()) if len(values) else None

    return _each(samples(scored[0]), figure)


def _mean_of_clips(scored: Sequence[ClipErrors], samples: Samples) -> dict[str, Any]:
    def figure(method: str, metric: str) -> float:
        return float(np.mean([samples(one)[method][metric].mean() for one in scored]))

    return _each(samples(scored[0]), figure)


def _intervals(
    scored: Sequence[ClipErrors], samples: Samples, counts: np.ndarray, *, clips_alike: bool
) -> dict[str, Any]:
    """Ends of the intervals of the pooled means, or of the means of the clips' means."""

    def ends(method: str, metric: str) -> list[float] | None:
        values = [samples(one)[method][metric] for one in scored]
        sums = np.array([part.sum() for part in values])
        weights = np.array([float(len(part)) for part in values])
        if clips_alike:
            known = weights > 0
            sums, weights = sums / np.where(known, weights, 1.0), known.astype(float)
        found = ratio_interval(sums, weights, counts)
        return None if found is None else list(found)

    return _each(samples(scored[0]), ends)


def _each(
    like: dict[str, dict[str, np.ndarray]], figure: Callable[[str, str], Any]
) -> dict[str, Any]:
    return {
        method: {metric: figure(method, metric) for metric in metrics}
        for method, metrics in like.items()
    }
