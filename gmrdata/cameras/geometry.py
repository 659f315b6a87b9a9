"""Which geometry the matches speak for, a camera that only turns or also moves; solved in it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras.check.agreement import agreement, least_extent
from gmrdata.cameras.check.coverage import covered_share
from gmrdata.cameras.files import Agreement, CamerasQuality, Evidence
from gmrdata.cameras.frames import Frames, Timeline, cuts_in_words
from gmrdata.cameras.map.focal import turning_focal
from gmrdata.cameras.map.mapping import (
    hardly_travels,
    map_again,
    map_frames,
    map_otherwise,
    place_between,
    refine_mapped,
)
from gmrdata.cameras.map.one_scale import weakest_step
from gmrdata.cameras.map.rotation_only import RotationOnly, refine_turning, solve_rotation_only
from gmrdata.cameras.map.solution import Solution, fill_short_gaps, quality_of, turning_solution
from gmrdata.cameras.match.behind_masks import match_behind_masks
from gmrdata.cameras.match.keyframes import choose_keyframes, with_frames_between
from gmrdata.cameras.match.keypoint_adjustment import adjust_keypoints
from gmrdata.cameras.match.matches import Matches, match_frames
from gmrdata.cameras.match.tracks import errors_px, mean_over_points, tracks_of
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.records import figure

PANORAMIC = ("PANORAMIC", "PLANAR_OR_PANORAMIC")
PARALLAX_GROWTH = 2.5
"""Residuals of the worst tenth of pairs over those of the best, above which parallax may show.
Measured: 1.2 for a still camera, 1.5-1.7 for pans, 3.4 for a hand-held one that moves by 3 cm."""
PARALLAX_PX = 0.5  # residuals of the worst tenth of pairs below which parallax does no harm
CLEARLY_BETTER = 0.7  # share of the median residual that makes six degrees of freedom worth it
FEW_KEYFRAMES = 5  # mappers want more frames than the three that a model needs
NEARLY_TURNS = 0.6  # share of the matches that make a pure rotation the likeliest
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
LEAST_COVERED = 0.5
"""Share of the picture's cells that a camera explains that stays in its place.  Measured: 0.93 and
more where it does, 0.14 where a camera goes round a fox and a logo covers a fifth of its frames."""
VAGUE_FOCAL = 0.02  # a model whose focal length is more uncertain is held by little parallax


def solve(frames: Frames, work_dir: Path, config: SfmConfig) -> tuple[Solution, CamerasQuality]:
    """Choose keyframes, solve, fill short gaps; a cut is named where nothing can be solved."""
    if (n := len(frames.images)) < config.min_frames_registered:
        raise NoReconstruction(
            f"{frames.images[0].parent}: {n} frames, but a camera path needs "
            f"{config.min_frames_registered} at least; take more of the video"
        )
    keys = choose_keyframes(frames, config)
    # Neither the prior nor the filling reaches over what looks like a cut, matched or not.
    timeline = Timeline(frames.numbers, keys.cuts)
    keyframes = frames.some(keys.rows)
    try:
        matches = match_frames(keyframes, work_dir, config)
        matches = match_behind_masks(matches, keyframes, work_dir, config)
        matches = adjust_keypoints(matches, keyframes, work_dir)
        keys = keys.but_matched(matches)
        solution, evidence, bent = _solve_keyframes(
            keys.rows, matches, timeline, work_dir, frames, config
        )
    except NoReconstruction as error:
        raise NoReconstruction(f"{error}{cuts_in_words(keys.cuts)}") from None
    filled, marks = fill_short_gaps(solution.world_from_cam, timeline, config.max_gap_frames)
    quality = quality_of(solution, marks, evidence, keys, bent, frames.size_px)
    return replace(solution, world_from_cam=filled), quality


def _solve_keyframes(
    key_rows: np.ndarray,
    matches: Matches,
    timeline: Timeline,
    work_dir: Path,
    frames: Frames,
    config: SfmConfig,
) -> tuple[Solution, Evidence, bool]:
    """All frames by their keyframes; the evidence; and whether a bent model was set aside."""
    keys, intrinsics_px = frames.some(key_rows), frames.intrinsics_px

    def turn(of: Matches) -> RotationOnly:
        rng = np.random.default_rng(config.seed)
        return solve_rotation_only(of, intrinsics_px, config.rotation_only_inlier_px, rng)

    turning = turn(matches)
    evidence = weigh(turning, matches, config)
    turns, unsure = evidence.verdict == "rotation_only", evidence.verdict == "either"
    # Mapping takes one core.  No second mapping is run beside it: of two at once pycolmap 4.2.1 now
    # and then gives another model.
    with ThreadPoolExecutor(1) as beside:
        between = beside.submit(with_frames_between, matches, key_rows, frames, config)
        mapped = None if turns else map_frames(keys, matches, work_dir, config)
        if mapped is not None:
            mapped = _mapped_again(mapped, keys, matches, work_dir, config)
        everything = between.result()
    bent = mapped is not None and is_bent(mapped, turning, config)
    if turns or bent or (unsure and not explains_better(mapped, turning, config)):
        _check_cover(turning, matches, frames, config)
        focal = turning_focal(turning, matches, intrinsics_px)
        refined, smoothing = refine_turning(turn(everything), timeline, config)
        focal_px = float(intrinsics_px[0, 0])
        solution = turning_solution(refined, smoothing, focal, focal_px, config)
        solution = _turned_again(solution, turning, matches, key_rows, intrinsics_px, config)
        return solution, evidence, bent
    if mapped is None or mapped.has_camera.sum() < config.min_frames_registered:
        raise NoReconstruction(
            f"{frames.images[0].parent}: {len(matches.pairs)} pairs of frames match, but no mapper "
            f"could build a model; {_why_unsolved(len(key_rows), evidence)}"
        )
    matches, straight = (of.without(mapped.lens, intrinsics_px) for of in (matches, everything))
    step = weakest_step(mapped, matches, key_rows, intrinsics_px, config.max_reprojection_px)
    mapped = replace(mapped, weakest_step=step)
    placed = place_between(mapped, key_rows, straight, intrinsics_px)
    solution = refine_mapped(placed, straight, intrinsics_px, timeline, config)
    return _with_tracks(solution, everything, frames), evidence, bent


def _check_cover(
    turning: RotationOnly, matches: Matches, frames: Frames, config: SfmConfig
) -> None:
    """Refuse a turn that explains what stays in the picture, such as a logo, and little else."""
    most_px = config.rotation_only_inlier_px
    share = covered_share(turning, matches, frames.intrinsics_px, frames.size_px, most_px)
    if share < LEAST_COVERED:
        raise NoReconstruction(
            f"{frames.images[0].parent}: a camera that stays in its place explains {share:.0%} of "
            f"the picture only, less than {LEAST_COVERED:.0%}: something stays in the picture "
            "while all else moves, such as a logo, a subtitle or the hood of a car, which masks "
            "may keep out, or most of what is seen moves by itself"
        )


def _mapped_again(
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
        agrees = _disagreement(compared, config) <= AGREEING_SHARE
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


def _disagreement(mapped: Solution, config: SfmConfig) -> float:
    """How far a second solution is from a model's cameras, as a share of their own extent, however
    small that is; 0 where there is none."""
    if mapped.agreement is None:
        return 0.0
    cameras = mapped.world_from_cam[mapped.has_camera]
    extent = float(np.linalg.norm(np.ptp(cameras[:, :3, 3], axis=0)))
    least = least_extent(cameras, mapped.points, config.small_travel_share)
    return mapped.agreement.place_share * max(extent, least) / extent if extent > 0 else np.inf


def _turned_again(
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


def _why_unsolved(n_keyframes: int, evidence: Evidence) -> str:
    """What may keep matched frames from becoming a model, the likeliest alone where it is clear."""
    if n_keyframes < FEW_KEYFRAMES:
        return f"{n_keyframes} frames are too few for one, take more of the video"
    if evidence.rotation_only_share >= NEARLY_TURNS:
        share = f"{evidence.rotation_only_share:.0%} of the matches"
        return f"the camera hardly travels, a turn explains {share}, but not all of them"
    return (
        "the background may move itself (water, a crowd, leaves), the intrinsics be wrong, or the "
        "parallax too small"
    )


def _with_tracks(solution: Solution, matches: Matches, frames: Frames) -> Solution:
    """The solution with its tracks, and the errors of what the bundle adjustment had of them."""
    names = [image.name for image in frames.images]
    points, adjusted = solution.points, solution.adjusted
    tracks = tracks_of(solution.seen, matches.keypoints_px, points, adjusted, names)
    held, cameras = tracks.of_adjusted(), solution.world_from_cam
    found_px = errors_px(held, points, cameras, frames.intrinsics_px, solution.lens)
    mean_px = mean_over_points(found_px, held.points)
    return replace(solution, tracks=tracks, errors_px=found_px, mean_error_px=mean_px)


def weigh(turning: RotationOnly, matches: Matches, config: SfmConfig) -> Evidence:
    """Judge a pure rotation by its residuals."""
    medians_px = turning.pair_medians_px
    median_px = figure(np.median(turning.residuals_px))
    wide_px = figure(np.percentile(medians_px, 90))
    near_px = figure(np.percentile(medians_px, 10))
    share = figure(np.mean(turning.residuals_px < config.rotation_only_inlier_px))
    fits = (
        median_px <= config.rotation_only_median_px
        and wide_px <= config.rotation_only_wide_median_px
        and share >= config.rotation_only_share
    )
    panoramic = [pair.configuration in PANORAMIC for pair in matches.pairs]
    parallax = wide_px > max(PARALLAX_PX, PARALLAX_GROWTH * near_px)
    said, doubt = f"a pure rotation {'explains' if fits else 'does not explain'}", ""
    if fits and parallax:
        doubt = f", but residuals grow with the baseline (from {near_px} px), which may be parallax"
    return Evidence(
        verdict="full" if not fits else "either" if parallax else "rotation_only",
        reason=(
            f"{said} the matches: median residual {median_px} px "
            f"(threshold {config.rotation_only_median_px}), in the worst tenth of the pairs "
            f"{wide_px} px (threshold {config.rotation_only_wide_median_px}), "
            f"{100 * share:.0f} % of the matches within {config.rotation_only_inlier_px} px "
            f"(threshold {100 * config.rotation_only_share:.0f} %){doubt}"
        ),
        rotation_only_median_px=median_px,
        rotation_only_wide_median_px=wide_px,
        rotation_only_near_median_px=near_px,
        rotation_only_share=share,
        panoramic_pairs_share=float(np.mean(panoramic)),
        pairs=len(matches.pairs),
        features_per_frame=float(np.median(matches.n_free)),
    )


def explains_better(mapped: Solution | None, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether six degrees of freedom are worth it where a pure rotation fits as well."""
    if mapped is None or mapped.has_camera.sum() < turning.has_camera.sum():
        return False
    agree_px = turning.residuals_px[turning.residuals_px < config.rotation_only_inlier_px]
    return bool(np.median(mapped.errors_px) < CLEARLY_BETTER * np.median(agree_px))


def is_bent(mapped: Solution, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether a model of a camera that hardly travels is less to be trusted than a pure rotation.

    Over a way that is short beside the distance of the background, turning and travelling look
    alike, and a mapper may trade one for the other: on a hand-held pan of 39 degrees it found
    0.25 m of travel for 0.05 m, and rotations that were off by 7 %, at 0.35 px.  Such a model asks
    for another focal length than the true one, or can't tell which it needs, or a part of
    the keyframes gives another path: on a pan among people in a street it was 20 % of its way off.
    One of few keyframes does not tell how far the camera travels over all.
    """
    if mapped.has_camera.mean() < MOST_OF_THEM:
        return False
    turns_px = np.median(turning.residuals_px)
    if turns_px > config.small_travel_median_px:
        return False
    if not hardly_travels(mapped, config.small_travel_share):
        return False
    focal, enough = mapped.focal, (mapped.second_share or 0.0) >= MOST_OF_THEM
    if enough and _disagreement(mapped, config) > AGREEING_SHARE:
        return True
    return focal is None or focal.sigma > VAGUE_FOCAL or abs(focal.factor - 1.0) > 3 * focal.sigma
