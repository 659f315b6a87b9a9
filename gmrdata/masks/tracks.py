"""Boxes linked over time, so that an object missed in one frame is masked there all the same.

A link joins a box to the last box of the track that it overlaps most, best pairs first; classes
don't matter, for a detector wavers between dog and horse but not between something and nothing.
A track is kept if its best box is sure enough; its weak boxes then count too (the idea of Zhang et
al., "ByteTrack", 2022).  Frames that a kept track skips get a box halfway, in proportion to time.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from gmrdata.config import Config
from gmrdata.masks.boxes import Detections, box_iou


class TrackConfig(Config):
    """How detections of neighbouring frames are joined."""

    link_iou: float = Field(default=0.3, gt=0, le=1)
    """Overlap (intersection over union) from which two boxes show the same object."""
    max_gap_frames: int = Field(default=5, ge=0)
    """Longest run of frames without the object over which its box is interpolated."""
    hold_frames: int = Field(default=2, ge=0)
    """Frames before a track's first and after its last box in which that box is masked too."""


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """What is masked in one frame."""

    rows: np.ndarray
    """(K,) detections of the frame that belong to kept tracks."""
    filled_px: np.ndarray
    """(F, 4) boxes of kept tracks that have no detection here: interpolated or held [px]."""


def track(frames: list[Detections], min_score: float, config: TrackConfig) -> list[TrackedFrame]:
    """Choose and complete the boxes of a sequence.

    Args:
        frames: Detections of each frame, weak ones too.
        min_score: A track is kept if one of its boxes has this score or more.
        config: The recipe.
    """
    rows: list[list[int]] = [[] for _ in frames]
    filled: list[list[np.ndarray]] = [[] for _ in frames]
    for linked in link(frames, config):
        if max(frames[at].scores[row] for at, row in linked) < min_score:
            continue
        for at, row in linked:
            rows[at].append(row)
        for at, box_px in _fill(frames, linked, config.hold_frames):
            filled[at].append(box_px)
    return [
        TrackedFrame(np.array(sorted(kept), dtype=np.int64), np.array(boxes_px).reshape(-1, 4))
        for kept, boxes_px in zip(rows, filled, strict=True)
    ]


def link(frames: list[Detections], config: TrackConfig) -> list[list[tuple[int, int]]]:
    """Tracks as lists of (frame, detection); every detection is in one of them."""
    tracks: list[list[tuple[int, int]]] = []
    for at, found in enumerate(frames):
        open_tracks = [t for t in tracks if at - t[-1][0] <= config.max_gap_frames + 1]
        last_px = [frames[t[-1][0]].boxes_px[t[-1][1]] for t in open_tracks]
        overlap = box_iou(np.array(last_px).reshape(-1, 4), found.boxes_px)
        taken = _best_pairs(overlap, config.link_iou)
        for track_row, row in taken:
            open_tracks[track_row].append((at, row))
        matched = {row for _, row in taken}
        tracks += [[(at, row)] for row in range(len(found)) if row not in matched]
    return tracks


def _best_pairs(overlap: np.ndarray, least: float) -> list[tuple[int, int]]:
    """Pairs (row, column) of a matrix, each row and column once, largest values first."""
    rows, columns = np.nonzero(overlap >= least)
    order = np.argsort(-overlap[rows, columns], kind="stable")
    pairs: dict[int, int] = {}
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if row not in pairs and column not in pairs.values():
            pairs[row] = column
    return list(pairs.items())


def _fill(
    frames: list[Detections], linked: list[tuple[int, int]], hold_frames: int
) -> list[tuple[int, np.ndarray]]:
    """(frame, box) wherever a track has no detection of its own."""
    at = np.array([frame for frame, _ in linked])
    boxes_px = np.array([frames[frame].boxes_px[row] for frame, row in linked])
    first = max(0, at[0] - hold_frames)
    last = min(len(frames) - 1, at[-1] + hold_frames)
    missing = [frame for frame in range(first, last + 1) if frame not in set(at.tolist())]
    edges_px = np.stack([np.interp(missing, at, edge_px) for edge_px in boxes_px.T], axis=1)
    return list(zip(missing, edges_px, strict=True))
