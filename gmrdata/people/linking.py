"""Boxes linked over time, and which pieces of tracks are of one person.

All that is seen speaks for or against that together.  Where the second piece begins where the
first would be by then, as large, and in the same colours, each counts by how much likelier it is of
one person than of two (a sum of logarithms of ratios), so that a dancer whose colours change while
it stands in one place is still one.  A track is cut where its colours change, since who walks past
another may take it over; what goes on is then joined to whom it fits best.
"""

from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Self

import numpy as np
from pydantic import Field
from typing_extensions import TypedDict

from gmrdata.values import limits
from gmrdata.values.frame_set import USUAL_HZ
from gmrdata.values.records import Config


@dataclass(frozen=True, eq=False)
class Detections:
    """What a detector found in one frame."""

    boxes_px: np.ndarray  # (N, 4) left, top, right, bottom from the first pixel's outer corner [px]
    scores: np.ndarray  # (N,) from 0 to 1
    classes: np.ndarray  # (N,) index in COCO_NAMES

    def __len__(self) -> int:
        return len(self.scores)


Detection = TypedDict("Detection", {"box_px": list[float], "score": float, "class": int})
"""What a record says of one: left, top, right, bottom; index in COCO_NAMES."""


def detections_as_json(seen: Detections) -> list[Detection]:
    """Plain numbers: boxes to 0.01 px, scores to 0.0001."""
    rows = zip(seen.boxes_px.tolist(), seen.scores.tolist(), seen.classes.tolist(), strict=True)
    return [
        {"box_px": [round(edge, 2) for edge in box_px], "score": round(score, 4), "class": index}
        for box_px, score, index in rows
    ]


def detections_from_json(records: list[Detection]) -> Detections:
    """The inverse of `detections_as_json`."""
    boxes_px = np.array([record["box_px"] for record in records], dtype=np.float64)
    scores = np.array([record["score"] for record in records], dtype=np.float64)
    classes = np.array([record["class"] for record in records], dtype=np.int64)
    return Detections(boxes_px.reshape(-1, 4), scores, classes)


def box_iou(a_px: np.ndarray, b_px: np.ndarray) -> np.ndarray:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4); 0 where both are empty."""
    low = np.maximum(a_px[:, None, :2], b_px[None, :, :2])
    high = np.minimum(a_px[:, None, 2:], b_px[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    union = _area(a_px)[:, None] + _area(b_px)[None, :] - common
    return np.where(union > 0, common / np.where(union > 0, union, 1.0), 0.0)


def keep_best(detections: Detections, nms_iou: float) -> Detections:
    """Class by class, drop boxes that overlap one of a higher score by more than `nms_iou`."""
    import cv2

    if len(detections) == 0:
        return detections
    corners_px = detections.boxes_px.reshape(-1, 2, 2)
    as_xywh = np.concatenate([corners_px[:, 0], np.ptp(corners_px, axis=1)], axis=1)
    kept = cv2.dnn.NMSBoxesBatched(
        as_xywh.tolist(), detections.scores.tolist(), detections.classes.tolist(), 0.0, nms_iou
    )
    rows = np.asarray(kept, dtype=np.int64).reshape(-1)
    return Detections(detections.boxes_px[rows], detections.scores[rows], detections.classes[rows])


def grow(boxes_px: np.ndarray, share: float, margin_px: float) -> np.ndarray:
    """Boxes (N, 4) widened on each side by a share of their shorter side and by a margin [px]."""
    if len(boxes_px) == 0:
        return boxes_px
    width_px, height_px = (boxes_px[:, 2:] - boxes_px[:, :2]).T
    by_px = share * np.minimum(width_px, height_px) + margin_px
    return np.asarray(boxes_px + by_px[:, None] * np.array([-1.0, -1.0, 1.0, 1.0]))


def fill_boxes(boxes_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Mask (height, width) uint8, 255 on all pixels of a picture of (width, height) that a box
    (N, 4) [px] touches; boxes may lie outside the picture."""
    mask = np.zeros(size_px[::-1], dtype=np.uint8)
    low = np.clip(np.floor(boxes_px[:, :2]), 0, size_px).astype(int)
    high = np.clip(np.ceil(boxes_px[:, 2:]), 0, size_px).astype(int)
    for (left, top), (right, bottom) in zip(low, high, strict=True):
        mask[top:bottom, left:right] = 255
    return mask


def _area(boxes_px: np.ndarray) -> np.ndarray:
    return np.asarray(np.prod(np.maximum(boxes_px[:, 2:] - boxes_px[:, :2], 0.0), axis=1))


class TrackConfig(Config):
    """How detections of neighbouring frames are joined."""

    link_iou: float = Field(default=0.3, gt=0, le=1)
    """Intersection over union from which two boxes show the same object."""
    max_gap_frames: int = Field(default=5, ge=0)
    """Longest run of frames without the object over which its box is interpolated."""
    hold_frames: int = Field(default=2, ge=0)
    """Frames before a track's first and after its last box in which that box is masked too."""


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """What is masked in one frame."""

    rows: np.ndarray  # (K,) detections of the frame that belong to kept tracks
    filled_px: np.ndarray
    """(F, 4) boxes of kept tracks that have no detection here: interpolated or held [px]."""


def track(frames: list[Detections], min_score: float, config: TrackConfig) -> list[TrackedFrame]:
    """Choose and complete a sequence's boxes; tracks with a box of `min_score` or more are kept.

    Their weak boxes then count too (the idea of Zhang et al., "ByteTrack", 2022).  Frames that a
    kept track skips get a box halfway, in proportion to time.
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
    """Tracks as lists of (frame, detection); every detection is in one of them.

    A box joins the track whose last box it overlaps most, best pairs first.  Classes don't matter:
    a detector wavers between dog and horse but not between something and nothing.
    """
    tracks: list[list[tuple[int, int]]] = []
    open_tracks: list[list[tuple[int, int]]] = []
    for at, detections in enumerate(frames):
        open_tracks = [t for t in open_tracks if at - t[-1][0] <= config.max_gap_frames + 1]
        last_px = [frames[t[-1][0]].boxes_px[t[-1][1]] for t in open_tracks]
        overlap = box_iou(np.array(last_px).reshape(-1, 4), detections.boxes_px)
        taken = best_pairs(overlap, config.link_iou)
        for track_row, row in taken:
            open_tracks[track_row].append((at, row))
        matched = {row for _, row in taken}
        begun = [[(at, row)] for row in range(len(detections)) if row not in matched]
        tracks += begun
        open_tracks += begun
    return tracks


def best_pairs(overlap: np.ndarray, least: float) -> list[tuple[int, int]]:
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
    missing = np.setdiff1d(np.arange(first, last + 1), at)
    edges_px = np.stack([np.interp(missing, at, edge_px) for edge_px in boxes_px.T], axis=1)
    return list(zip(missing.tolist(), edges_px, strict=True))


class LinkConfig(Config):
    """How alike two pieces of one person are."""

    max_gap_s: float = Field(default=2.0, gt=0, le=limits.LONGEST_S)
    """Longest time without the person between them [s]."""
    shift: float = Field(default=0.2, gt=0)
    """Usual distance from where the person would have gone, in the side of its crop; it grows with
    the gap, by the same in `shift_s`."""
    shift_s: float = Field(default=1.0, gt=0, le=limits.LONGEST_S)
    size: float = Field(default=0.16, gt=0)
    """Usual difference of the two sizes' logarithms."""
    colour: float = Field(default=0.15, gt=0, le=1)
    """Usual distance of the colours, after Bhattacharyya: 0 alike, 1 none in common."""
    cut_colour: float = Field(default=0.3, gt=0, le=1)
    """Distance of the colours before and after, from which another may have taken over a track."""
    sure: float = Field(default=3.0, ge=0)
    """Evidence of e^3 to one: against one person, from which those never seen together are two; for
    one, below which a join is noted."""


STRANGERS_SIDES = 3.0  # of a crop: within so much another person may be anywhere
STRANGERS_SIZE = 0.5  # usual difference of the logarithms of two people's sizes
STRANGERS_COLOUR, STRANGERS_SPREAD = 0.55, 0.2  # mean distance of two people's colours
LOOK_ALIKES = 0.2  # share of strangers who wear the same
COLOUR_FRAMES, SPEED_FRAMES, LEAST_FRAMES = 8, 5, 3  # at usual rates; as long at higher ones


@dataclass(frozen=True, eq=False)
class Piece:
    """A person over T frames in which it was followed."""

    rows: np.ndarray  # (T,) int, rising: of the frames
    crops: np.ndarray  # (T, 4) centre x and y, side [px], turn [rad]
    colours: np.ndarray  # (T, C) shares, which sum to 1

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, start: int, stop: int | None = None) -> Self:
        """Some frames of it."""
        some = slice(start, stop)
        return type(self)(self.rows[some], self.crops[some], self.colours[some])


def cuts_in(piece: Piece, config: LinkConfig, rate_hz: float = USUAL_HZ) -> list[int]:
    """Where in a piece another person may have taken over, by the colours before and after."""
    least = _lasting(LEAST_FRAMES, rate_hz)
    off = [
        _colour_distance(piece.part(0, at), piece.part(at), rate_hz)
        for at in range(least, len(piece) - least + 1)
    ]
    if not off or max(off) <= config.cut_colour:
        return []
    at = least + int(np.argmax(off))
    before, after = (cuts_in(one, config, rate_hz) for one in (piece.part(0, at), piece.part(at)))
    return [*before, at, *(at + n for n in after)]


def join_pieces(
    pieces: list[Piece], config: LinkConfig, rate_hz: float = USUAL_HZ
) -> tuple[list[list[int]], dict[int, float]]:
    """People as numbers of pieces in order of time, every piece once, and the evidence by which a
    piece goes on from the one before it, by its number.  Best pairs are joined first, each end
    once.  The rate is that of the frames."""
    pairs = [
        (-evidence, a, b)
        for a, b in permutations(range(len(pieces)), 2)
        if (evidence := _evidence(pieces[a], pieces[b], config, rate_hz)) > 0
    ]
    after: dict[int, int] = {}
    joined_by: dict[int, float] = {}
    for against, a, b in sorted(pairs):
        if a not in after and b not in joined_by:
            after[a], joined_by[b] = b, -against
    people = []
    for start in range(len(pieces)):
        if start not in joined_by:
            line = [start]
            while line[-1] in after:
                line.append(after[line[-1]])
            people.append(line)
    return people, joined_by


def unsure_pairs(people: list[Piece], config: LinkConfig) -> list[tuple[int, int]]:
    """Pairs of people who are never seen in one frame, and whose colours don't tell them apart."""
    return [
        (a, b)
        for a, b in combinations(range(len(people)), 2)
        if not np.isin(people[a].rows, people[b].rows).any()
        and _colour_evidence(_mean_distance(people[a], people[b]), config) > -config.sure
    ]


def _evidence(a: Piece, b: Piece, config: LinkConfig, rate_hz: float) -> float:
    """Logarithm of how much likelier the second piece goes on from the first than is another's."""
    gap = int(b.rows[0] - a.rows[-1])
    most, slow = (max(1, round(rate_hz * t)) for t in (config.max_gap_s, config.shift_s))
    if not 0 < gap <= most + 1:
        return -np.inf
    last, first = a.crops[-1], b.crops[0]
    stayed_px = first[:2] - last[:2]
    moved_px = stayed_px - gap * _speed_px(a, rate_hz)
    off_px = min(np.linalg.norm(stayed_px), np.linalg.norm(moved_px))
    shift = float(off_px / np.sqrt(last[2] * first[2]))
    usual = config.shift * (1 + gap / slow)
    place = np.log(STRANGERS_SIDES**2 / (2 * np.pi * usual**2)) - 0.5 * (shift / usual) ** 2
    grown = float(np.log(first[2] / last[2]))
    size = np.log(STRANGERS_SIZE / config.size)
    size += 0.5 * grown**2 * (STRANGERS_SIZE**-2 - config.size**-2)
    return float(place + size + _colour_evidence(_colour_distance(a, b, rate_hz), config))


def _colour_evidence(distance: float, config: LinkConfig) -> float:
    """The same of the colours alone."""
    of_one = np.log(2) + _log_normal(distance, 0.0, config.colour)
    of_two = _log_normal(distance, STRANGERS_COLOUR, STRANGERS_SPREAD)
    alike, unlike = np.log(LOOK_ALIKES) + of_one, np.log(1 - LOOK_ALIKES) + of_two
    return float(of_one - np.logaddexp(alike, unlike))


def _log_normal(value: float, mean: float, deviation: float) -> float:
    return float(-0.5 * ((value - mean) / deviation) ** 2 - np.log(deviation * np.sqrt(2 * np.pi)))


def _speed_px(piece: Piece, rate_hz: float) -> np.ndarray:
    """(2,) of a piece's end [px a frame]."""
    early = -min(len(piece), _lasting(SPEED_FRAMES, rate_hz))
    steps = max(1, piece.rows[-1] - piece.rows[early])
    return np.asarray((piece.crops[-1, :2] - piece.crops[early, :2]) / steps)


def _colour_distance(before: Piece, after: Piece, rate_hz: float) -> float:
    """Of the end of one piece and the begin of another."""
    n = _lasting(COLOUR_FRAMES, rate_hz)
    return _mean_distance(before.part(-n), after.part(0, n))


def _mean_distance(a: Piece, b: Piece) -> float:
    both = np.sqrt(a.colours.mean(axis=0) * b.colours.mean(axis=0)).sum()
    return float(np.sqrt(max(0.0, 1.0 - both)))


def _lasting(frames: int, rate_hz: float) -> int:
    """Frames that last as long at a high rate as some do at the usual one; never fewer."""
    return max(frames, round(frames * rate_hz / USUAL_HZ))
