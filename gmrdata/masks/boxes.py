"""Boxes round objects in one picture, and the masks that they fill."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Detections:
    """What a detector found in one frame."""

    boxes_px: np.ndarray
    """(N, 4) left, top, right, bottom; (0, 0) is the outer corner of the first pixel [px]."""
    scores: np.ndarray
    """(N,) from 0 to 1."""
    classes: np.ndarray
    """(N,) index in COCO_NAMES."""

    def __len__(self) -> int:
        """Number N of boxes."""
        return len(self.scores)


def detections_as_json(found: Detections) -> list[dict[str, Any]]:
    """Plain numbers: boxes to 0.01 px, scores to 0.0001."""
    return [
        {
            "box_px": [round(float(edge), 2) for edge in box_px],
            "score": round(float(score), 4),
            "class": int(class_index),
        }
        for box_px, score, class_index in zip(
            found.boxes_px, found.scores, found.classes, strict=True
        )
    ]


def detections_from_json(records: list[dict[str, Any]]) -> Detections:
    """The inverse of `detections_as_json`."""
    return Detections(
        np.array([record["box_px"] for record in records], dtype=np.float64).reshape(-1, 4),
        np.array([record["score"] for record in records], dtype=np.float64),
        np.array([record["class"] for record in records], dtype=np.int64),
    )


def box_iou(a_px: np.ndarray, b_px: np.ndarray) -> np.ndarray:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4); 0 where both are empty."""
    low = np.maximum(a_px[:, None, :2], b_px[None, :, :2])
    high = np.minimum(a_px[:, None, 2:], b_px[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    union = _area(a_px)[:, None] + _area(b_px)[None, :] - common
    return np.where(union > 0, common / np.where(union > 0, union, 1.0), 0.0)


def keep_best(found: Detections, nms_iou: float) -> Detections:
    """Class by class, drop boxes that overlap one of a higher score by more than `nms_iou`."""
    import cv2

    if len(found) == 0:
        return found
    as_xywh = np.concatenate([found.boxes_px[:, :2], np.ptp(_corners(found.boxes_px), axis=1)], 1)
    kept = cv2.dnn.NMSBoxesBatched(
        as_xywh.tolist(), found.scores.tolist(), found.classes.tolist(), 0.0, nms_iou
    )
    rows = np.asarray(kept, dtype=np.int64).reshape(-1)
    return Detections(found.boxes_px[rows], found.scores[rows], found.classes[rows])


def grow(boxes_px: np.ndarray, share: float, margin_px: float) -> np.ndarray:
    """Boxes (N, 4) widened on each side by a share of their shorter side and by a margin [px]."""
    if len(boxes_px) == 0:
        return boxes_px
    width_px, height_px = (boxes_px[:, 2:] - boxes_px[:, :2]).T
    by_px = share * np.minimum(width_px, height_px) + margin_px
    return np.asarray(boxes_px + by_px[:, None] * np.array([-1.0, -1.0, 1.0, 1.0]))


def fill_boxes(boxes_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Mask of all pixels that a box (N, 4) touches.

    Args:
        boxes_px: Boxes, in the picture or not [px].
        size_px: (width, height) of the picture.

    Returns:
        (height, width) uint8, 255 inside.
    """
    width_px, height_px = size_px
    mask = np.zeros((height_px, width_px), dtype=np.uint8)
    low = np.clip(np.floor(boxes_px[:, :2]), 0, size_px).astype(int)
    high = np.clip(np.ceil(boxes_px[:, 2:]), 0, size_px).astype(int)
    for (left, top), (right, bottom) in zip(low, high, strict=True):
        mask[top:bottom, left:right] = 255
    return mask


def _corners(boxes_px: np.ndarray) -> np.ndarray:
    return boxes_px.reshape(-1, 2, 2)


def _area(boxes_px: np.ndarray) -> np.ndarray:
    return np.asarray(np.prod(np.maximum(boxes_px[:, 2:] - boxes_px[:, :2], 0.0), axis=1))
