"""Keyframes: as many frames as the camera's motion needs, so that not each one goes through SIFT.

Corners of the background are followed from frame to frame (Lucas and Kanade 1981, pyramids by
Bouguet).  A frame becomes a keyframe when they have moved far enough since the last one, or the
nearest of them beside what a turn of the camera explains, when half of them are lost, or after the
longest gap; a slow or short sequence gets more, evenly spread.  The frames between get their
matches by following the keyframes' features into them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.stage.jobs import made_ahead
from gmrdata.values import transforms
from gmrdata.values.errors import NoReconstruction

WINDOW_PX = 21
LEVELS = 3
RETURN_PX = 0.5  # a point that is followed there and back must come home this close
CENTRE_PX = 0.5  # our (0, 0) is the corner of the first pixel, OpenCV's its centre
CORNERS = 400
CORNER_QUALITY = 0.01
CORNER_SPACING_PX = 8
FEWEST_CORNERS = 20  # with fewer to begin with, survival says nothing
RIGID_PX = 1.0  # corners this near to their epipolar line go the way of the camera
NEAR_PERCENTILE = 80  # the nearest fifth of the background counts
FOLLOWED = "FOLLOWED"  # configuration of matches that were followed, not verified by COLMAP


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Which frames are keyframes, and what the choice was made on."""

    rows: np.ndarray
    """(K,) rows in order; the first and the last frame and both sides of a cut are among them."""
    survived: np.ndarray  # (T-1,) share of the corners of frame t that frame t + 1 shows again
    cuts: np.ndarray  # (C,) rows t after which the picture changes to another place
    featureless: np.ndarray  # (F,) rows without any background: black, even, or wholly masked

    def but_matched(self, matches: Matches) -> "Keyframes":
        """The same without cuts over which features match: frames far apart, but of one place."""
        linked = {(self.rows[pair.first], self.rows[pair.second]) for pair in matches.pairs}
        cuts = [row for row in self.cuts if (row, row + 1) not in linked]
        return replace(self, cuts=np.array(cuts, dtype=np.int64))

    def cut_after(self, key: int) -> "Keyframes":
        """The same with a cut more, after a keyframe."""
        return replace(self, cuts=np.union1d(self.cuts, self.rows[key]))


def choose_keyframes(
    frames: Frames, config: SfmConfig, tell: Callable[[Path], None] = lambda _: None
) -> Keyframes:
    """Choose keyframes by how far the background moves in the image, and how far its near parts;
    `tell` hears of most as soon as they are known.  NoReconstruction where frames are too few."""
    images, size_px = frames.images, frames.size_px
    if (n := len(images)) < config.min_frames_registered:
        raise NoReconstruction(
            f"{n} frames, but a camera path needs {config.min_frames_registered} at least; take "
            "more of the video",
            images[0].parent,
        )
    shrink = min(1.0, config.keyframe_image_size_px / max(size_px))
    steps_px = max(size_px) * shrink * np.array([config.keyframe_step, config.keyframe_parallax])
    intrinsics_px = np.diag([shrink, shrink, 1.0]) @ frames.intrinsics_px
    small = made_ahead(partial(frames.read, shrink=shrink), images)
    before, free = next(small)
    start_px = now_px = _corners(before, free)
    n_start = len(start_px)
    rows, survived, corners = [0], [], []
    tell(images[0])
    for row, (image, free) in enumerate(small, 1):
        next_px, followed = follow(before, image, now_px, free=free)
        survived.append(followed.mean() if len(followed) else 0.0)
        corners.append(len(followed))
        start_px, now_px = start_px[followed], next_px[followed]
        before = image
        late, last = row - rows[-1] >= config.keyframe_gap, row == len(images) - 1
        lost = not len(now_px) or len(now_px) < n_start / 2
        if not (late or last or lost or _moved(start_px, now_px, intrinsics_px, steps_px)):
            continue
        start_px = now_px = _corners(image, free)
        # Of frames that show nothing the first is enough: more would stand between those that do.
        if len(start_px) or n_start or last:
            rows.append(row)
            tell(images[row])
        n_start = len(start_px)
    return _as_keyframes(rows, np.array(survived), np.array([*corners, len(now_px)]), config)


def _as_keyframes(
    rows: list[int], survived: np.ndarray, corners: np.ndarray, config: SfmConfig
) -> Keyframes:
    """The rows with those that cuts and the least number of keyframes ask for."""
    cuts = np.flatnonzero((survived < config.cut_share) & (corners[:-1] >= FEWEST_CORNERS))
    chosen, least = np.union1d(np.array(rows), cuts), min(config.min_keyframes, len(corners))
    if len(chosen) < least:
        # Evenly spread ones where the motion asks for fewer.
        spread = np.linspace(0, len(corners) - 1, least).round().astype(np.int64)
        chosen = np.union1d(chosen, spread)
    return Keyframes(chosen, survived, cuts, np.flatnonzero(corners < config.featureless_corners))


def _moved(
    start_px: np.ndarray, now_px: np.ndarray, intrinsics_px: np.ndarray, steps_px: np.ndarray
) -> bool:
    """Whether points (N, 2) went one of the steps [px]: of all motion, or of parallax alone."""
    apart_px = np.linalg.norm(now_px - start_px, axis=1)
    if np.median(apart_px) >= steps_px[0]:
        return True
    # The closer look takes longer, and points that all move alike don't need it.
    if np.ptp(apart_px) < steps_px[1]:
        return False
    near_px = np.percentile(parallax_px(start_px, now_px, intrinsics_px), NEAR_PERCENTILE)
    return bool(near_px >= steps_px[1])


def parallax_px(start_px: np.ndarray, now_px: np.ndarray, intrinsics_px: np.ndarray) -> np.ndarray:
    """(N,) what a turn of the camera leaves unexplained of the motion of points (N, 2) [px].

    It is zero for points that no single motion of the camera explains, whatever their depths: a
    person who walks is not near background.
    """
    parallax = np.zeros(len(start_px))
    if len(start_px) < FEWEST_CORNERS:
        return parallax
    _, rigid = cv2.findEssentialMat(start_px, now_px, intrinsics_px, cv2.RANSAC, 0.999, RIGID_PX)
    rays, now_rays = unit_rays(start_px, intrinsics_px), unit_rays(now_px, intrinsics_px)
    threshold_rad = RIGID_PX / float(intrinsics_px[0, 0])
    turn, _ = relative_rotation(rays, now_rays, threshold_rad, np.random.default_rng(0))
    seen = rays @ turn.T @ intrinsics_px.T
    left_px = np.linalg.norm(seen[:, :2] / seen[:, 2:] - now_px, axis=1)
    return parallax if rigid is None else np.where(rigid[:, 0] > 0, left_px, parallax)


def _corners(image: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N, 2) corners of the background (Shi and Tomasi 1994) [px]."""
    corners = cv2.goodFeaturesToTrack(
        image, CORNERS, CORNER_QUALITY, CORNER_SPACING_PX, mask=free.astype(np.uint8)
    )
    return np.zeros((0, 2)) if corners is None else corners[:, 0].astype(np.float64) + CENTRE_PX


def with_frames_between(
    key_matches: Matches, key_rows: np.ndarray, frames: Frames, cuts: np.ndarray, config: SfmConfig
) -> Matches:
    """Matches of all T frames, from those of the K keyframes, but for frames between two with a cut
    (C,) between them.

    A feature is followed from frame to frame, and its place in each frame is then sought once more
    against the keyframe itself, so that errors don't add up along the way.
    """
    keypoints_px = [np.zeros((0, 2))] * len(frames.images)
    for row, points_px in zip(key_rows, key_matches.keypoints_px, strict=True):
        keypoints_px[row] = points_px
    pairs = [
        replace(pair, first=int(key_rows[pair.first]), second=int(key_rows[pair.second]))
        for pair in key_matches.pairs
    ]
    chosen = _most_matched(key_matches, config.followed_points)
    for key, (first, last) in enumerate(pairwise(key_rows)):
        # Keyframes are further apart only where frames between show nothing, of which a long
        # video may have gigabytes.
        near = 2 <= last - first <= config.keyframe_gap
        if not near or ((cuts >= first) & (cuts < last)).any():
            continue
        run = [frames.read(image) for image in frames.images[first : last + 1]]
        from_first = _follow_into(run, keypoints_px[first], chosen[key])
        from_last = _follow_into(run[::-1], keypoints_px[last], chosen[key + 1])[::-1]
        for row, ahead, behind in zip(range(first + 1, last), from_first, from_last, strict=True):
            keypoints_px[row] = np.concatenate([ahead[1], behind[1]])
            n = len(ahead[0])
            mine = np.arange(len(keypoints_px[row]))
            ends = {(first, row): (ahead[0], mine[:n]), (row, last): (mine[n:], behind[0])}
            for rows, features in ends.items():
                table = np.stack(features, axis=1).astype(np.int32)
                pairs.append(PairMatches(*rows, table, FOLLOWED))
    linked = [pair for pair in pairs if len(pair.features)]
    return Matches(keypoints_px, sorted(linked, key=lambda pair: (pair.first, pair.second)))


def _most_matched(matches: Matches, most: int) -> list[np.ndarray]:
    """For each keyframe, features that most other keyframes show as well."""
    counts = [np.zeros(len(points_px), dtype=np.int64) for points_px in matches.keypoints_px]
    for pair in matches.pairs:
        np.add.at(counts[pair.first], pair.features[:, 0], 1)
        np.add.at(counts[pair.second], pair.features[:, 1], 1)
    best = [np.argsort(-count, kind="stable")[:most] for count in counts]
    return [np.sort(at[count[at] > 0]) for at, count in zip(best, counts, strict=True)]


def _follow_into(
    frames: Sequence[tuple[np.ndarray, np.ndarray]], keypoints_px: np.ndarray, chosen: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Features (N,) of the first frame and their places (N, 2) in each of the inner frames."""
    start, _ = frames[0]
    features, places = chosen, []
    home_px = now_px = keypoints_px[chosen]
    for (before, _), (image, free) in pairwise(frames[:-1]):
        # Beside the keyframe this is the place that is sought; further on it is but a guess at it.
        now_px, followed = follow(before, image, now_px, free=free, and_back=before is start)
        features, home_px, now_px = features[followed], home_px[followed], now_px[followed]
        exact_px, sure = now_px, np.ones(len(now_px), dtype=bool)
        if before is not start:
            exact_px, sure = follow(start, image, home_px, now_px, free)
        places.append((features[sure], exact_px[sure]))
    return places


def follow(
    before: np.ndarray,
    after: np.ndarray,
    points_px: np.ndarray,
    guess_px: np.ndarray | None = None,
    free: np.ndarray | None = None,
    and_back: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Image points (N, 2) [px] in another frame, and which are found, back too, and where `free`.
    Only the finest level of the pyramid is searched where their places (N, 2) are guessed."""
    if not len(points_px):
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    start = _to_opencv(points_px)
    guess = start.copy() if guess_px is None else _to_opencv(guess_px)
    levels = LEVELS if guess_px is None else 0
    there, ok = _flow(before, after, start, guess, levels)
    if and_back:
        back, ok_back = _flow(after, before, there, start.copy(), levels)
        ok &= ok_back & (np.linalg.norm((back - start)[:, 0], axis=1) < RETURN_PX)
    there_px = there[:, 0].astype(np.float64) + CENTRE_PX
    return there_px, ok if free is None else ok & is_free(there_px, free)


def _flow(
    before: np.ndarray, after: np.ndarray, start: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
    window_px, from_guess = (WINDOW_PX, WINDOW_PX), cv2.OPTFLOW_USE_INITIAL_FLOW
    there, ok, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, guess, None, None, window_px, levels, until, from_guess
    )
    return np.asarray(there), np.asarray(ok)[:, 0] == 1


def is_free(points_px: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 2) [px] inside the frame, on its background (H, W)."""
    column, row = np.floor(points_px).astype(int).T
    inside = (row >= 0) & (row < free.shape[0]) & (column >= 0) & (column < free.shape[1])
    inside[inside] = free[row[inside], column[inside]]
    return inside


def _to_opencv(points_px: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray((points_px - CENTRE_PX)[:, None], dtype=np.float32)


HYPOTHESES = 200  # random pairs of rays that a turn is tried from


def unit_rays(points_px: np.ndarray, intrinsics_px: np.ndarray) -> np.ndarray:
    """Viewing directions (N, 3) of image points (N, 2) [px], camera frame, unit length."""
    rays = np.c_[points_px, np.ones(len(points_px))] @ np.linalg.inv(intrinsics_px).T
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def relative_rotation(
    rays_a: np.ndarray, rays_b: np.ndarray, threshold_rad: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation b_from_a (3, 3) that most matched unit rays (M, 3) agree with, and which do (M,)."""
    samples = rng.integers(0, len(rays_a), size=(HYPOTHESES, 2))
    hypotheses = _kabsch(rays_a[samples], rays_b[samples])
    # b R a for every ray and hypothesis in one product, ten times as fast as to turn every ray.
    # Chords stand for angles: the two differ by 1e-7 relative at these sizes.
    products = (rays_b[:, :, None] * rays_a[:, None]).reshape(-1, 9)
    agree = hypotheses.reshape(-1, 9) @ products.T > 1.0 - threshold_rad**2 / 2
    most = agree.sum(axis=1).argmax()
    rotation, best = hypotheses[most], agree[most]
    for _ in range(3):
        if best.sum() < 2:
            break
        rotation = _kabsch(rays_a[best][None], rays_b[best][None])[0]
        best = ((rays_a @ rotation.T - rays_b) ** 2).sum(axis=1) < threshold_rad**2
    return rotation, best


def _kabsch(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotations (H, 3, 3) that best map directions a (H, N, 3) to b."""
    return transforms.nearest_rotations(np.einsum("hni,hnj->hij", b, a))[0]
