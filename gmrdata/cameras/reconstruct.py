"""Stage: cameras up to scale from frames, masks and intrinsics, in a geometry that fits."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gmrdata.cameras import files
from gmrdata.cameras.check.agreement import compare_again, compare_turned_again, disagreement
from gmrdata.cameras.check.dissolve import dissolve_after
from gmrdata.cameras.files import CamerasQuality, Evidence
from gmrdata.cameras.frames import Frames, Timeline, cuts_in_words, reduced
from gmrdata.cameras.map.covered import without_seen_again
from gmrdata.cameras.map.focal import turning_focal
from gmrdata.cameras.map.mapping import (
    hardly_travels,
    map_frames,
    place_between,
    refine_mapped,
    travel_share,
)
from gmrdata.cameras.map.models import weakest_step, zoom_spread
from gmrdata.cameras.map.rotation_only import (
    RotationOnly,
    refine_turning,
    require_cover,
    solve_rotation_only,
    weigh,
    zooms,
)
from gmrdata.cameras.map.solution import Solution, fill_short_gaps, quality_of, turning_solution
from gmrdata.cameras.match.features import FeatureFinder
from gmrdata.cameras.match.keyframes import choose_keyframes, with_frames_between
from gmrdata.cameras.match.keypoint_adjustment import adjust_keypoints
from gmrdata.cameras.match.matches import Matches, match_behind_masks, match_frames, parted
from gmrdata.cameras.match.tracks import (
    TRACKS_FILE,
    Tracks,
    errors_px,
    mean_over_points,
    save_tracks,
    tracks_of,
)
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.read.video_faults import changes_between, say_repeats
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.errors import BadRecipe, NoReconstruction
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import Config, compared

IMAGES_FACT = "images_dir"
"""Fact of the stage's record: the folder of images; a video's lie beside the cameras."""


class _SfmRecipe(Config):
    """What the stage's record holds: the recipe, and the intrinsics that it was given."""

    sfm: SfmConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial_k1: float


class _TwoTermRecipe(_SfmRecipe):
    """The same of a lens with two terms of distortion."""

    radial_k2: float


def reconstruct(
    frames: FrameSet,
    masks_dir: Path | None,
    lens: Lens,
    out_dir: Path,
    config: SfmConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Find the camera of every frame, up to one similarity of the world.

    Args:
        masks_dir: Masks (255 = dynamic), one per frame; None to use whole frames.  Inside a mask
            only points count that other frames show outside of theirs.
        lens: Kept fixed.  Where it has distortion, cameras are sought in frames as a pinhole would
            show them.
        out_dir: Folder to make: `cameras.npz`, `points.npz`, `tracks.npz`, `quality.json`.

    Raises:
        BadFrames: frames or masks are missing, of different sizes, or not images.
        NoReconstruction: no camera path can be had from these frames; the message says why.
    """
    _require_usable(lens, frames)
    rows = tuple(tuple(row) for row in lens.matrix_px.tolist())
    k1, k2 = lens.radial
    recipe = _SfmRecipe(sfm=config, intrinsics_px=rows, radial_k1=k1)
    if k2:
        recipe = _TwoTermRecipe(**dict(recipe), radial_k2=k2)

    def work(partial: Path) -> dict[str, str]:
        if frames.video is None:  # else it was said where they were taken
            changes = changes_between(frames.paths)
            say_repeats(frames.folder, changes, frames.numbers.tolist())
        try:
            leave_cameras(partial, frames, masks_dir, lens, config)
        except NoReconstruction as error:
            # The reduced frames are gone when somebody reads this.
            raise error.of(frames.folder) from None
        return {} if frames.video_path else {IMAGES_FACT: str(frames.folder.resolve())}

    inputs = {**frames.inputs, "masks": masks_dir}
    return run_stage("sfm", out_dir, recipe, inputs, work, run=run)


def leave_cameras(
    folder: Path, shown: FrameSet, masks_dir: Path | None, lens: Lens, config: SfmConfig
) -> None:
    """Find the cameras of frames, and write them and what holds them into a folder; arguments and
    errors as of `reconstruct`."""
    given = Frames(list(shown.paths), masks_dir, lens.matrix_px, lens.size_px)
    # COLMAP's files lie in the unfinished folder: a killed run leaves nothing elsewhere.
    work_dir = folder / "colmap"
    work_dir.mkdir()
    frames = reduced(given, config.max_image_size_px, work_dir / "reduced", lens.radial)
    # Features of the first keyframes are found while the last ones are chosen.
    with FeatureFinder(frames, work_dir, config) as finder:
        solution, quality = solve(finder, work_dir, shown.numbers_in_time)
    shutil.rmtree(work_dir)
    cameras = solution.world_from_cam
    path = CameraPath(lens.matrix_px, *lens.size_px, cameras, solution.has_camera)
    filled = np.isin(np.arange(len(cameras)), quality.interpolated)
    sfm_cameras = files.SfmCameras(path, solution.geometry, given.numbers, filled)
    files.save_cameras(folder / files.CAMERAS_FILE, sfm_cameras)
    files.save_points(folder / files.POINTS_FILE, solution.points, solution.track_lengths)
    tracks = _tracks_in(solution.tracks, given, frames)
    if not lens.is_pinhole:
        tracks = replace(tracks, image_px=lens.seen_px(tracks.image_px))
        quality = quality.model_copy(update={"lens": _whole_distortion(lens.radial, quality.lens)})
    save_tracks(folder / TRACKS_FILE, tracks)
    quality.write(folder / files.QUALITY_FILE)


def known_radial(sfm_dir: Path) -> tuple[float, float]:
    """The distortion that a reconstruction was given; none where an older version made it."""
    said = StageRecord.of(sfm_dir).config
    return float(str(said.get("radial_k1", 0.0))), float(str(said.get("radial_k2", 0.0)))


def _whole_distortion(
    radial: tuple[float, float], left: files.Distortion | None
) -> files.Distortion:
    """The known distortion, and what was found beside it, as one: to the fifth power of r."""
    k1, k2 = radial
    if left is None:
        return files.Distortion(k1, k2, 0.0)
    return files.Distortion(k1 + left.k1, k2 + left.k2 + 3 * k1 * left.k1, left.explains)


def _tracks_in(tracks: Tracks | None, given: Frames, worked_on: Frames) -> Tracks:
    """Tracks in the pixels of the given frames; without observations where there are none."""
    names = tuple(image.name for image in given.images)
    if tracks is None:
        return tracks_of({}, (), np.zeros(len(names), dtype=bool), names)
    larger = np.divide(given.size_px, worked_on.size_px)
    return replace(tracks, image_px=tracks.image_px * larger, image_names=names)


def _require_usable(lens: Lens, frames: FrameSet) -> None:
    if not np.isfinite(lens.matrix_px).all() or min(lens.focal_px) <= 0:
        raise BadRecipe(f"intrinsics {lens.matrix_px.tolist()}: no lens has these [px]")
    if lens.size_px != frames.size_px:
        what = f"a lens of {lens.size_px} px"
        raise BadRecipe(f"{frames.folder}: {what}; give that of these frames")


def solve(
    finder: FeatureFinder, work_dir: Path, in_time: np.ndarray
) -> tuple[Solution, CamerasQuality]:
    """Choose keyframes, solve, fill short gaps; a cut is named where nothing can be solved.
    `in_time` (T,) are numbers of the frames as of `FrameSet.numbers_in_time`."""
    frames, config = finder.frames, finder.config
    keys = choose_keyframes(frames, config, finder.begin)
    # Neither the prior nor the filling reaches over what looks like a cut, matched or not.
    timeline = Timeline(in_time, keys.cuts)
    keyframes = frames.some(keys.rows)
    try:
        matches = match_frames(keyframes, work_dir, config, finder)
        matches = match_behind_masks(matches, keyframes, work_dir, config)
        matches = adjust_keypoints(matches, keyframes, work_dir)
        keys = keys.but_matched(matches)
        while (after := dissolve_after(matches, frames.size_px, config.dissolve)) is not None:
            matches = parted(matches, keyframes, after, work_dir, work_dir / "parted")
            keys, work_dir = keys.cut_after(after), work_dir / "parted"
            timeline = Timeline(in_time, np.union1d(timeline.cuts, keys.cuts))
        mapped = without_seen_again(matches, config.mapping)
        keyed = _Keyed(frames, keys.rows, mapped, matches, timeline, config)
        solution, evidence, set_aside = _solve_keyframes(keyed, work_dir)
    except NoReconstruction as error:
        why = f"{error.why}{cuts_in_words(frames.numbers[keys.cuts])}"
        raise NoReconstruction(why, error.frames_dir) from None
    filled, marks = fill_short_gaps(solution.world_from_cam, timeline, config.max_gap_frames)
    quality = quality_of(solution, marks, evidence, keys, set_aside, frames.size_px)
    return replace(solution, world_from_cam=filled), quality


@dataclass(frozen=True, eq=False)
class _Keyed:
    """Frames and the matches of their keyframes, from which all cameras come."""

    frames: Frames
    rows: np.ndarray  # (K,) of the keyframes
    mapped: np.ndarray  # (M,) which of the K are mapped; the others see what these see
    matches: Matches  # Of the K keyframes
    timeline: Timeline
    config: SfmConfig

    @property
    def mapped_rows(self) -> np.ndarray:
        """(M,) the same among all frames."""
        return self.rows[self.mapped]

    @cached_property
    def mapped_matches(self) -> Matches:
        """Of the M keyframes, with each other."""
        return self.matches.some(self.mapped)

    def turning(self, of: Matches) -> RotationOnly:
        rng, config = np.random.default_rng(self.config.seed), self.config
        return solve_rotation_only(
            of, self.frames.intrinsics_px, config.rotation_only_inlier_px, rng
        )


def _solve_keyframes(keyed: _Keyed, work_dir: Path) -> tuple[Solution, Evidence, float | None]:
    """All frames by their keyframes; the evidence; and how far the camera travels in a bent model
    that was set aside."""
    config, turning = keyed.config, keyed.turning(keyed.matches)
    evidence = weigh(turning, keyed.matches, config)
    turns = evidence.verdict == "rotation_only"
    if evidence.verdict == "full" and zooms(keyed.matches, keyed.frames.intrinsics_px, config):
        raise NoReconstruction(
            "a camera that zooms and turns in its place explains all that the pictures show, so "
            "that they tell no path; film without zooming, and more than one wall",
            keyed.frames.images[0].parent,
        )
    mapped, matches = _mapped(keyed, work_dir, turns=turns)
    bent = mapped is not None and is_bent(mapped, turning, config)
    unsure = evidence.verdict == "either"
    if turns or bent or (unsure and not explains_better(mapped, turning, config)):
        set_aside = travel_share(mapped) if mapped is not None and bent else None
        return _as_turning(keyed, turning, matches), evidence, set_aside
    if mapped is None or mapped.has_camera.sum() < config.min_frames_registered:
        raise NoReconstruction(
            f"{len(keyed.matches.pairs)} pairs of frames match, but no mapper could build a model; "
            f"{_why_unsolved(len(keyed.rows), evidence, config)}",
            keyed.frames.images[0].parent,
        )
    return _as_mapped(keyed, mapped, matches), evidence, None


def _mapped(keyed: _Keyed, work_dir: Path, *, turns: bool) -> tuple[Solution | None, Matches]:
    """A model of the keyframes that are mapped, unless the camera only turns, with what a second
    one says of it; and the matches of all frames."""
    config, matches, cuts = keyed.config, keyed.mapped_matches, keyed.timeline.cuts
    keys = keyed.frames.some(keyed.mapped_rows)
    # Mapping takes one core.  No second mapping is run beside it: of two at once pycolmap 4.2.1 now
    # and then gives another model.
    with ThreadPoolExecutor(1) as beside:
        between = beside.submit(
            with_frames_between, keyed.matches, keyed.rows, keyed.frames, cuts, config
        )
        mapped = None if turns else map_frames(keys, matches, work_dir, config)
        if mapped is not None:
            mapped = compare_again(mapped, keys, matches, work_dir, config)
        return mapped, between.result()


def _as_turning(keyed: _Keyed, turning: RotationOnly, matches: Matches) -> Solution:
    """Cameras of all frames that only turn, by the matches of all, where that explains them."""
    config, intrinsics_px = keyed.config, keyed.frames.intrinsics_px
    require_cover(turning, keyed.matches, keyed.frames, config)
    focal = turning_focal(turning, keyed.matches, intrinsics_px)
    refined, smoothing = refine_turning(keyed.turning(matches), keyed.timeline, config)
    focal_px = float(intrinsics_px[0, 0])
    solution = turning_solution(refined, smoothing, focal, focal_px, config)
    return compare_turned_again(solution, turning, keyed.matches, keyed.rows, intrinsics_px, config)


def _as_mapped(keyed: _Keyed, mapped: Solution, matches: Matches) -> Solution:
    """Cameras of all frames by a model of the keyframes and the matches of all."""
    config, intrinsics_px = keyed.config, keyed.frames.intrinsics_px
    rows, both = keyed.mapped_rows, (keyed.mapped_matches, matches)
    of_keys, straight = (of.without(mapped.lens, intrinsics_px) for of in both)
    spread, most = zoom_spread(mapped, of_keys, intrinsics_px), config.mapping.most_zoom_spread
    if spread > most:
        what = "single pictures ask for focal lengths that differ by {}, more than {}"
        raise NoReconstruction(
            f"{compared(what, spread, most, '.1%')}: the camera zooms while it moves, "
            "or the path is wrong; film without zooming",
            keyed.frames.images[0].parent,
        )
    step = weakest_step(mapped, of_keys, rows, intrinsics_px, config.max_reprojection_px)
    others = np.setdiff1d(keyed.rows, rows)
    mapped = replace(mapped, weakest_step=step)
    placed = place_between(mapped, rows, others, straight, intrinsics_px)
    solution = refine_mapped(placed, straight, intrinsics_px, keyed.timeline, config)
    return _with_tracks(solution, matches, keyed.frames)


def _why_unsolved(n_keyframes: int, evidence: Evidence, config: SfmConfig) -> str:
    """What may keep matched frames from becoming a model, the likeliest alone where it is clear."""
    if n_keyframes < config.second.few_keyframes:
        return f"{n_keyframes} frames are too few for one, take more of the video"
    if evidence.rotation_only_share >= config.choice.nearly_turns:
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
    tracks = tracks_of(solution.seen, matches.keypoints_px, adjusted, names)
    held, cameras = tracks.of_adjusted(), solution.world_from_cam
    found_px = errors_px(held, points, cameras, frames.intrinsics_px, solution.lens)
    mean_px = mean_over_points(found_px, held.points)
    return replace(solution, tracks=tracks, errors_px=found_px, mean_error_px=mean_px)


def explains_better(mapped: Solution | None, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether six degrees of freedom are worth it where a pure rotation fits as well."""
    if mapped is None or mapped.has_camera.mean() < turning.has_camera.mean():
        return False
    agree_px = turning.residuals_px[turning.residuals_px < config.rotation_only_inlier_px]
    return bool(np.median(mapped.errors_px) < config.choice.clearly_better * np.median(agree_px))


def is_bent(mapped: Solution, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether a model of a camera that hardly travels is less to be trusted than a pure rotation.

    Over a way that is short beside the distance of the background, turning and travelling look
    alike, and a mapper may trade one for the other.  Such a model asks for another focal length
    than the true one, or a part of the keyframes gives another path; where no part says which, it
    can't tell the focal length.  One of few keyframes does not tell how far the camera travels over
    all.
    """
    if mapped.has_camera.mean() < config.second.most_of_them:
        return False
    turns_px = np.median(turning.residuals_px)
    if turns_px > config.small_travel_median_px:
        return False
    if not hardly_travels(mapped, config.small_travel_share):
        return False
    confirmed = mapped.is_confirmed_by(config.second.most_of_them)
    if confirmed and disagreement(mapped, config) > config.second.agreeing_share:
        return True
    if (focal := mapped.focal) is None:
        return True
    # A part that gives the same path says more than a short way can of the focal length.
    if not confirmed and focal.sigma > config.choice.vague_focal:
        return True
    return abs(focal.factor - 1.0) > 3 * focal.sigma
