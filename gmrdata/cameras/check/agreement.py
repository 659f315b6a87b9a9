"""How far two solutions of the same frames agree: a right path does not depend on chance.

The second one is of a part of the keyframes, and by another seed.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import Agreement
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.mapping import hardly_travels, map_again, map_otherwise
from gmrdata.cameras.map.rotation_only import RotationOnly, solve_rotation_only
from gmrdata.cameras.map.solution import Solution
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms

FEWEST_CAMERAS = 4  # with fewer common ones two paths always agree
FEW_KEYFRAMES = 5  # mappers want more frames than the three that a model needs
WELL_MATCHED = 50
"""Matches of its neighbours without which a second solution keeps a keyframe.  Where a dancer was
taken every 20th frame they have 0 to 40, and of every second keyframe alone half of the path came
out 16 % off beside a first one that is right."""
AGREEING_SHARE = 0.03
"""Of its extent, to which two solutions of a path that hardly travels agree.  By four seeds, twins
that were right had 0.003 to 0.016; one 14 mm from its middle, 17 % off, had 0.037 to 0.28."""
STARTS = 2  # of the mapper, at most, where the camera hardly travels
MOST_OF_THEM = 0.6
"""Share of the keyframes that a model, or a second one, needs to say that another is wrong.  Of a
blurred walk a model of 8 of 33 keyframes hardly travels, and the turns that most matches fit were
444 mm off."""
ENOUGH = 0.5  # share of a second solution's keyframes, below which one of more is tried
SAME_DEG, SAME_SHARE = 1.0, 0.03  # up to which two solutions give the same path


def agreement(first: np.ndarray, second: np.ndarray, least_extent: float) -> Agreement | None:
    """How two paths (T, 4, 4), NaN where unknown, differ after the best similarity between them.

    Their worlds are turned into each other by the cameras' orientations, since places along a line
    leave a turn open.  Places are compared with the first path's extent, the diagonal of its box,
    which counts as `least_extent` at least: a camera that hardly leaves its place need not have a
    path.  None where they have fewer than four cameras in common.
    """
    both = np.isfinite(first[:, 0, 0]) & np.isfinite(second[:, 0, 0])
    if both.sum() < FEWEST_CAMERAS:
        return None
    ours, theirs = first[both], second[both]
    turns = Rotation.from_matrix(ours[:, :3, :3] @ np.swapaxes(theirs[:, :3, :3], 1, 2))
    first_from_second = turns.mean()
    turn_deg = np.rad2deg((first_from_second.inv() * turns).magnitude())
    way = ours[:, :3, 3] - ours[:, :3, 3].mean(axis=0)
    other = first_from_second.apply(theirs[:, :3, 3] - theirs[:, :3, 3].mean(axis=0))
    power = float((other**2).sum())
    # Not with a mirror: a path that runs the other way is another one.
    scale = max(0.0, float((way * other).sum()) / power) if power > 0 else 0.0
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
    middle = world_from_cam[known, :3, 3].mean(axis=0)
    return share * float(np.median(np.linalg.norm(points - middle, axis=1)))


def compare_again(
    mapped: Solution, keys: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution:
    """A model with how it agrees with one of every second keyframe.

    Of two in three where half of them hardly hold together or give another path, or the camera
    hardly travels: half of a little parallax is too little.  A model of 19 keyframes over 6 cm was
    right, and of half of them, alone, 3.9 % off; of a dancer behind filled boxes, 8.7 % off.
    """
    if hardly_travels(mapped, config.small_travel_share):
        return _started_again(mapped, keys, matches, work_dir, config)
    compared, tried = mapped, 0
    for n in (2, 3):
        rows = without_each(n, matches)
        if len(rows) < FEW_KEYFRAMES or len(rows) == tried:
            continue
        tried = len(rows)
        second, _ = map_again(mapped, rows, keys, work_dir, _reseeded(config, 1))
        found = _compared(mapped, second, rows, config)
        if not _is_enough(compared) or _is_enough(found):
            compared = found
        if _is_enough(compared) and _is_confirmed(compared):
            break
    return compared


def _is_enough(compared: Solution) -> bool:
    """Whether a second solution has enough of its keyframes to say anything."""
    return (compared.second_share or 0.0) >= ENOUGH


def _is_confirmed(compared: Solution) -> bool:
    """Whether a second solution gives the same path."""
    again = compared.agreement
    return again is None or (again.turn_deg <= SAME_DEG and again.place_share <= SAME_SHARE)


def _started_again(
    mapped: Solution, keys: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution:
    """The same where the camera hardly travels: both begin elsewhere until they agree.

    Turns and steps are hard to tell apart then, and where a mapper ends hangs on the pair that it
    begins with: one in four starts of a path of 6 cm ended with one and a half times the error of
    the others.  The best of each solution counts.
    """
    rows = without_each(3, matches)
    if len(rows) < FEW_KEYFRAMES:
        return mapped
    compared, second, held = mapped, np.empty(0), (0, -np.inf)
    for start in range(STARTS):
        if start:
            again = _reseeded(config, 2 * start)
            mapped = map_otherwise(mapped, keys, matches, work_dir, again)
        found, found_px = map_again(mapped, rows, keys, work_dir, _reseeded(config, 2 * start + 1))
        found_held = int(np.isfinite(found[:, 0, 0]).sum()), -found_px
        if not start or found_held > held:
            second, held = found, found_held
        compared = _compared(mapped, second, rows, config)
        agrees = disagreement(compared, config) <= AGREEING_SHARE
        if agrees and (compared.second_share or 0.0) >= MOST_OF_THEM:
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
    if len(rows := without_each(2, matches)) < FEW_KEYFRAMES:
        return solution
    among = [pair for pair in matches.pairs if {pair.first, pair.second} <= set(rows.tolist())]
    if not among:
        return replace(solution, second_share=0.0)
    rng = np.random.default_rng(_reseeded(config, 1).seed)
    some = replace(matches, pairs=among)
    second = solve_rotation_only(some, intrinsics_px, config.rotation_only_inlier_px, rng)
    found = agreement(_turning_cameras(turning), _turning_cameras(second), 0.0)
    return _with_second(solution, found, solution.has_camera[key_rows[rows]])


def _with_second(solution: Solution, found: Agreement | None, asked: np.ndarray) -> Solution:
    """A solution with how a second one agrees; `asked` (N,) bool: which keyframes of the second one
    have a camera in the first, as the other ones may show nothing."""
    share = 0.0 if found is None else min(1.0, found.cameras / max(1, int(asked.sum())))
    return replace(solution, second_share=share, agreement=found)


def _turning_cameras(turning: RotationOnly) -> np.ndarray:
    """(T, 4, 4) cameras at the origin; NaN where there is none."""
    cameras = transforms.rigid(turning.world_from_cam_rotmats, np.zeros(3))
    cameras[~turning.has_camera] = np.nan
    return cameras


def without_each(n: int, matches: Matches) -> np.ndarray:
    """Rows (N,) of the keyframes without each n-th, but for those whose neighbours hardly match
    each other: what is solved again must hold together as the first solution does."""
    count = matches.n_of_pair
    rows, last, kept = [0], len(matches.keypoints_px) - 1, 1
    while (row := rows[-1] + 1) <= last:
        if kept >= n - 1:
            if row == last:
                break
            if count.get((row - 1, row + 1), 0) >= WELL_MATCHED:
                rows.append(row + 1)
                kept = 1
                continue
        rows.append(row)
        kept += 1
    return np.array(rows)


def _reseeded(config: SfmConfig, by: int) -> SfmConfig:
    return config.model_copy(update={"seed": (config.seed + by) % 2**31})
