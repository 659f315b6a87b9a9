"""Retrieval: which frames of a long video may show a place again, by how alike they look.

A frame is described by what its SIFT descriptors differ by from the nearest of a few words, summed
by word (VLAD, Jegou et al. 2010), each word's part of length 1 (Arandjelovic and Zisserman 2013).
The words are the video's own.  What looks alike is but tried: its matches are verified as all are.
"""

from collections.abc import Iterable

import cv2
import numpy as np

WORDS = 32
LEARNED_FROM = 20_000  # descriptors, evenly from all frames
MOST_OF_A_FRAME = 500  # descriptors; more hardly change what a frame looks like
ROUNDS = 20
AT_ONCE = 256  # frames that are compared with all


def alike_before(
    descriptors: Iterable[np.ndarray], apart: int, most: int, seed: int
) -> list[tuple[int, int]]:
    """For each of T frames the `most` that look like it the most, of those that are more than
    `apart` before it; pairs of rows in order, by descriptors (N, 128) uint8 of each frame."""
    # A copy: a view would hold the whole table.
    thinned = [_thinned(table, MOST_OF_A_FRAME).copy() for table in descriptors]
    looks, pairs = _looks(thinned, seed), []
    shown = np.abs(looks).max(axis=1, initial=0.0) > 0
    for start in range(0, len(looks), AT_ONCE):
        likeness = np.where(shown, looks[start : start + AT_ONCE] @ looks.T, -np.inf)
        for row, alike in enumerate(likeness, start):
            best = np.argsort(-alike[: max(0, row - apart)], kind="stable")[:most]
            pairs += [(int(first), row) for first in best if shown[first] and shown[row]]
    return sorted(pairs)


def _looks(descriptors: list[np.ndarray], seed: int) -> np.ndarray:
    """(T, D) of length 1; 0 of a frame without descriptors."""
    looks = np.zeros((len(descriptors), WORDS, 128), np.float32)
    of_each = -(-LEARNED_FROM // len(descriptors))
    sample = _roots(np.concatenate([_thinned(table, of_each) for table in descriptors]))
    if len(sample) < WORDS:
        return looks.reshape(len(looks), -1)
    cv2.setRNGSeed(seed)
    until = (cv2.TERM_CRITERIA_COUNT, ROUNDS, 0.0)
    _, _, words = cv2.kmeans(sample, WORDS, None, until, 1, cv2.KMEANS_PP_CENTERS)  # type: ignore[call-overload]
    for look, table in zip(looks, map(_roots, descriptors), strict=True):
        # The nearest word: |a - b|^2 without what is the same for all words.
        of = ((words**2).sum(axis=1) - 2 * table @ words.T).argmin(axis=1)
        np.add.at(look, of, table - words[of])
    looks /= np.maximum(np.linalg.norm(looks, axis=2, keepdims=True), 1e-9)
    whole = looks.reshape(len(looks), -1)
    return np.asarray(whole / np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), 1e-9))


def _roots(table: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(table.astype(np.float32)))


def _thinned(table: np.ndarray, most: int) -> np.ndarray:
    """At most so many rows of a table, evenly spread."""
    return table[:: max(1, -(-len(table) // most))]
