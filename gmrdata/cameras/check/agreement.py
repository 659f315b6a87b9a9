"""How far two solutions of the same frames agree: a right path does not depend on chance.

The second one is of a part of the keyframes, and by another seed.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras.files import Agreement
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.mapping import hardly_travels, map_again, map_otherwise
from gmrdata.cameras.map.models import aligned
from gmrdata.cameras.map.refinement import background_distance
from gmrdata.cameras.map.rotation_only import RotationOnly, solve_rotation_only
from gmrdata.cameras.map.solution import Solution
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms

FEWEST_CAMERAS = 4  # with fewer common ones two paths always agree


def agreement(first: np.ndarray, second: np.ndarray, least_extent: float) -> Agreement | None:
    """How two paths (T, 4, 4), NaN where unknown, differ after the best similarity between them.

    Places are compared with the first path's extent, the diagonal of its box, which counts as
    `least_extent` at least: a camera that hardly leaves its place need not have a path.  None where
    they have fewer than four cameras in common.
    """
    both = np.isfinite(first[:, 0, 0]) & np.isfinite(second[:, 0, 0])
    if both.sum() < FEWEST_CAMERAS:
        return None
    ours, theirs = first[both], second[both]
    turns = ours[:, :3, :3] @ np.swapaxes(theirs[:, :3, :3], 1, 2)
    turn_deg = np.rad2deg(transforms.turns_about_mean_rad(turns))
    _, scale, way, other = aligned(ours, theirs)
    apart = np.sqrt(((way - scale * other) ** 2).sum(axis=1).mean())
    extent = max(float(np.linalg.norm(np.ptp(way, axis=0))), least_extent)
    return Agreement(
        cameras=int(both.sum()),
        turn_deg=float(np.sqrt((turn_deg**2).mean())),
        place_share=float(apart) / extent if extent > 0 else 0.0,
    )


def least_extent(world_from_cam: np.ndarray, points: np.ndarray, share: float) -> float:
    """A share of the median distance of points (N, 3) from cameras (T, 4, 4); 0 without points."""
    known = np.isfinite(world_from_cam[:, 0, 0])
    if not len(points) or not known.any():
        return 0.0
    return share * background_distance(world_from_cam[known, :3, 3], points)


def compare_again(
    mapped: Solution, keys: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution:
    """A model with how it agrees with one of every second keyframe.

    Of two in three where half of them hardly hold together or give another path, or the camera
    hardly travels: half of a little parallax is too little.
    """
    if hardly_travels(mapped, config.small_travel_share):
        return _started_again(mapped, keys, matches, work_dir, config)
    compared, tried, of = mapped, 0, config.second
    for n in (2, 3):
        rows = without_each(n, matches, of.well_matched)
        if len(rows) < of.few_keyframes or len(rows) == tried:
            continue
        tried = len(rows)
        second, _ = map_again(mapped, rows, keys, matches, work_dir, config.reseeded(1))
        latest = _compared(mapped, second, rows, config)
        # With too few of its keyframes a second solution says nothing.
        if not compared.is_confirmed_by(of.enough_share) or latest.is_confirmed_by(of.enough_share):
            compared = latest
        again = compared.agreement
        same = again is None or (
            again.turn_deg <= of.same_deg and again.place_share <= of.same_share
        )
        if compared.is_confirmed_by(of.enough_share) and same:
            break
    return compared


def _started_again(
    mapped: Solution, keys: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution:
    """The same where the camera hardly travels: both begin elsewhere until they agree.

    Turns and steps are hard to tell apart then, and where a mapper ends hangs on the pair that it
    begins with.  The best of each solution counts.
    """
    of = config.second
    rows = without_each(3, matches, of.well_matched)
    if len(rows) < of.few_keyframes:
        return mapped
    compared, second, held = mapped, np.empty(0), (0, -np.inf)
    for start in range(of.starts):
        if start:
            again = config.reseeded(2 * start)
            mapped = map_otherwise(mapped, keys, matches, work_dir, again)
        again = config.reseeded(2 * start + 1)
        poses, error_px = map_again(mapped, rows, keys, matches, work_dir, again)
        poses_held = int(np.isfinite(poses[:, 0, 0]).sum()), -error_px
        if not start or poses_held > held:
            second, held = poses, poses_held
        compared = _compared(mapped, second, rows, config)
        agrees = disagreement(compared, config) <= of.agreeing_share
        if agrees and compared.is_confirmed_by(of.most_of_them):
            break
    return compared


def _compared(
    mapped: Solution, second: np.ndarray, rows: np.ndarray, config: SfmConfig
) -> Solution:
    """A model with how the cameras (T, 4, 4) of a second one, of some rows (N,), agree with it."""
    first = mapped.world_from_cam
    least = least_extent(first, mapped.points, config.small_travel_share)
    return _with_second(mapped, agreement(first, second, least), mapped.has_camera[rows])


def disagreement(mapped: Solution, config: SfmConfig) -> float:
    """How far a second solution is from a model's cameras, as a share of their own extent, however
    small that is; 0 where there is none."""
    if mapped.agreement is None:
        return 0.0
    cameras = mapped.world_from_cam[mapped.has_camera]
    extent = float(np.linalg.norm(np.ptp(cameras[:, :3, 3], axis=0)))
    least = least_extent(cameras, mapped.points, config.small_travel_share)
    return mapped.agreement.place_share * max(extent, least) / extent if extent > 0 else np.inf


def compare_turned_again(
    solution: Solution,
    turning: RotationOnly,
    matches: Matches,
    key_rows: np.ndarray,
    intrinsics_px: np.ndarray,
    config: SfmConfig,
) -> Solution:
    """The same of a camera that only turns."""
    rows = without_each(2, matches, config.second.well_matched)
    if len(rows) < config.second.few_keyframes:
        return solution
    kept = set(rows.tolist())
    among = [pair for pair in matches.pairs if {pair.first, pair.second} <= kept]
    if not among:
        return replace(solution, second_share=0.0)
    rng = np.random.default_rng(config.reseeded(1).seed)
    some = replace(matches, pairs=among)
    second = solve_rotation_only(some, intrinsics_px, config.rotation_only_inlier_px, rng)
    agree = agreement(turning.world_from_cam, second.world_from_cam, 0.0)
    return _with_second(solution, agree, solution.has_camera[key_rows[rows]])


def _with_second(solution: Solution, agree: Agreement | None, asked: np.ndarray) -> Solution:
    """A solution with how a second one agrees; `asked` (N,) bool: which keyframes of the second one
    have a camera in the first, as the other ones may show nothing."""
    share = 0.0 if agree is None else min(1.0, agree.cameras / max(1, int(asked.sum())))
    return replace(solution, second_share=share, agreement=agree)


def without_each(n: int, matches: Matches, well_matched: int) -> np.ndarray:
    """Rows (N,) of the keyframes without each n-th, but for those whose neighbours have fewer
    matches: what is solved again must hold together as the first solution does."""
    count = matches.n_of_pair
    rows, last, kept = [0], len(matches.keypoints_px) - 1, 1
    while (row := rows[-1] + 1) <= last:
        if kept >= n - 1:
            if row == last:
                break
            if count.get((row - 1, row + 1), 0) >= well_matched:
                rows.append(row + 1)
                kept = 1
                continue
        rows.append(row)
        kept += 1
    return np.array(rows)
