"""Keypoint adjustment: image points of keyframes brought into line with how their patches move.

A SIFT feature is placed to a third or half of a pixel, in each keyframe by itself.  How the patch
round it moves from one keyframe to the next is seen several times as exactly (Lucas and Kanade
1981).  All image points are therefore moved at once, as little as the measured motions ask for: the
keypoint adjustment of Lindenberger et al. 2021, there by learned features.  Only neighbours are
measured: over more keyframes a patch changes its size and shape.
"""

from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.keyframes import follow, is_free
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, PairMatches
from gmrdata.stage.jobs import in_threads

PLACED_PX = 0.5  # standard deviation of a feature's place
MEASURED_PX = 0.15  # and of the motion of its patch
FARTHEST_PX = 2.0  # a patch that is found further from the matched feature is another one
AT_ONCE = 150_000  # motions of which one system is solved


@dataclass(frozen=True, eq=False)
class PatchMotions:
    """M measured motions of patches, between image points that are counted through all frames."""

    first: np.ndarray  # (M,) image point
    second: np.ndarray  # (M,) the one that matches it in the next frame
    moved_px: np.ndarray  # (M, 2) from the first to the second


def adjust_keypoints(matches: Matches, keyframes: Frames, work_dir: Path) -> Matches:
    """Move the image points of keyframes, in the matches and in COLMAP's database."""
    measured = _measure(matches, keyframes)
    everything = np.concatenate(matches.keypoints_px)
    adjusted = np.split(_fitted(everything, measured), matches.starts[1:-1])
    _write(adjusted, keyframes, work_dir / DATABASE_FILE)
    return replace(matches, keypoints_px=adjusted)


def _measure(matches: Matches, keyframes: Frames) -> PatchMotions:
    """How the patches of matches move from each keyframe to the next; none that touch a mask."""
    starts = matches.starts
    neighbours = [pair for pair in matches.pairs if pair.second == pair.first + 1]
    motions = in_threads(partial(_moved, matches, keyframes), neighbours)
    points, moved_px = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2))]
    for pair, (features, by_px) in zip(neighbours, motions, strict=True):
        points.append(starts[[pair.first, pair.second]] + features)
        moved_px.append(by_px)
    first, second = np.concatenate(points).T
    return PatchMotions(first, second, np.concatenate(moved_px))


def _moved(matches: Matches, keyframes: Frames, pair: PairMatches) -> tuple[np.ndarray, np.ndarray]:
    """Those matches (N, 2) of a pair whose patch is found again, and how it moves (N, 2) [px]."""
    before, was_free = keyframes.read(keyframes.images[pair.first])
    image, free = keyframes.read(keyframes.images[pair.second])
    from_px, to_px = matches.ends_px(pair)
    guess_px, ok = follow(before, image, from_px, to_px, free)
    found_px, rests = follow_patches(before, image, from_px, guess_px)
    ok &= rests & is_free(from_px, was_free) & is_free(found_px, free)
    ok &= np.linalg.norm(found_px - to_px, axis=1) < FARTHEST_PX
    return pair.features[ok], (found_px - from_px)[ok]


def _fitted(places_px: np.ndarray, measured: PatchMotions) -> np.ndarray:
    """Places (N, 2) with the least squares of what they move by and what the motions lack [px]."""
    if len(measured.first) <= AT_ONCE:
        return _solved(places_px, measured)
    fitted = places_px.copy()
    for some in _apart(measured, len(places_px)):
        ends = np.stack([measured.first[some], measured.second[some]])
        points, numbers = np.unique(ends, return_inverse=True)
        first, second = numbers.reshape(2, -1)
        part = PatchMotions(first, second, measured.moved_px[some])
        fitted[points] = _solved(places_px[points], part)
    return fitted


def _apart(measured: PatchMotions, n: int) -> list[np.ndarray]:
    """Motions, by their rows, in groups of about `AT_ONCE` that share none of the N image points:
    of a long video all at once would take gigabytes."""
    links = np.ones(len(measured.first)), (measured.first, measured.second)
    _, chain_of = connected_components(coo_array(links, shape=(n, n)), directed=False)
    chain = chain_of[measured.first]
    order = np.argsort(chain, kind="stable")
    starts = np.flatnonzero(np.diff(chain[order], prepend=-1))
    # The first chain that begins in each further run of so many motions.
    groups = starts[np.unique(starts // AT_ONCE, return_index=True)[1]]
    return np.split(order, groups[1:])


def _solved(places_px: np.ndarray, measured: PatchMotions) -> np.ndarray:
    n, m = len(places_px), len(measured.first)
    if not m:
        return places_px
    at, ones = np.arange(m), np.ones(m)
    entries = np.r_[-ones, ones], (np.r_[at, at], np.r_[measured.first, measured.second])
    differ = csc_array(coo_array(entries, shape=(m, n)))
    stiffness = (PLACED_PX / MEASURED_PX) ** 2
    lacking_px = measured.moved_px - differ @ places_px
    system = csc_array(eye_array(n) + stiffness * (differ.T @ differ))
    return np.asarray(places_px + splu(system).solve(stiffness * (differ.T @ lacking_px)))


def _write(keypoints_px: list[np.ndarray], keyframes: Frames, database_path: Path) -> None:
    with closing(pycolmap.Database.open(database_path)) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        for image, points_px in zip(keyframes.images, keypoints_px, strict=True):
            if len(points_px):
                table = np.array(database.read_keypoints(ids[image.name]))
                table[:, :2] = points_px
                database.update_keypoints(ids[image.name], table)


HALF_PX = 7  # half of a patch's side
GROWTH = 0.2  # standard deviation of a patch's growth, and of its turn [rad], before a look
NOISE_GREY = 3.0  # standard deviation of a grey value [of 255]
STEPS = 6
STILL_PX = 0.05  # a patch whose last step is longer is not found
CENTRE = 0.5 + 0.5j  # our (0, 0) is the corner of the first pixel, OpenCV's its centre


def follow_patches(
    before: np.ndarray, after: np.ndarray, points_px: np.ndarray, guess_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where patches round points (N, 2) of a frame (H, W) are in another one, near what is guessed
    (N, 2) [px]; and which of them (N,) bool come to rest.

    Where a camera goes ahead, what is near grows by a tenth from keyframe to keyframe, so a patch
    has the four degrees of freedom of a similarity.  Gauss and Newton's steps find them by the
    slopes of the first frame (the inverse compositional way of Baker and Matthews 2004).  Points
    and offsets are complex numbers, which a similarity multiplies.
    """
    if not len(points_px):
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    side = np.arange(-HALF_PX, HALF_PX + 1)
    offsets = (side[None] + 1j * side[:, None]).ravel()
    slopes, patches = _seen_before(before, _complex(points_px), offsets)
    known = np.diag([0.0, 0.0, *2 * [(NOISE_GREY / (GROWTH * HALF_PX)) ** 2]])
    stiffness = np.swapaxes(slopes, 1, 2) @ slopes + known + 1e-3 * np.eye(4)
    there, shape = _complex(guess_px), np.ones(len(points_px), np.complex128)
    shift = np.full_like(there, np.inf)
    for _ in range(STEPS):
        lacking = _without_mean(_sample(after, there[:, None] + shape[:, None] * offsets)) - patches
        pull = np.swapaxes(slopes, 1, 2) @ lacking[..., None]
        step = np.linalg.solve(stiffness, pull.astype(np.float64))[..., 0]
        shape = shape / (1 + _complex(step[:, 2:]) / HALF_PX)
        shift = shape * _complex(step[:, :2])
        there = there - shift
    there_px = np.stack([there.real, there.imag], axis=-1)
    return there_px, np.abs(shift) < STILL_PX


def _seen_before(
    image: np.ndarray, points: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (N, P, 4) of patches of P pixels as they shift, grow and turn; patches (N, P)."""
    across, down = (
        _sample(cv2.Scharr(image, cv2.CV_32F, *axis) / 32, points[:, None] + offsets)
        for axis in ((1, 0), (0, 1))
    )
    u, v = offsets.real / HALF_PX, offsets.imag / HALF_PX
    slopes = np.stack([across, down, across * u + down * v, down * u - across * v], axis=-1)
    slopes -= slopes.mean(axis=1, keepdims=True)
    return slopes.astype(np.float32), _without_mean(_sample(image, points[:, None] + offsets))


def _sample(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (N, P) float32 of an image (H, W) at places (N, P), by bilinear interpolation."""
    places = (places - CENTRE).astype(np.complex64)
    columns, rows = places.real.copy(), places.imag.copy()
    edge = cv2.BORDER_REPLICATE
    source = image.astype(np.float32)
    return np.asarray(cv2.remap(source, columns, rows, cv2.INTER_LINEAR, borderMode=edge))


def _without_mean(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _complex(pairs: np.ndarray) -> np.ndarray:
    return np.asarray(pairs[:, 0] + 1j * pairs[:, 1])
