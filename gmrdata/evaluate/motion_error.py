"""Errors of a recovered clip's motions against those of the true clip, motion by motion."""

from typing import NamedTuple

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import NothingToCompare
from gmrdata.evaluate.metrics import orientation_errors_deg, translation_errors_mm
from gmrdata.evaluate.vertices import posed_vertex_errors_mm
from gmrdata.gmr.motion_deltas import deltas


class MotionErrors(NamedTuple):
    """Errors per motion, (n,) each."""

    ome_deg: np.ndarray
    """[deg]."""
    tme_mm: np.ndarray
    """[mm]."""
    vme_mm: np.ndarray
    """[mm]; (0,) without a body."""


def motion_errors(
    pseudo: Clip,
    true: Clip,
    rows: np.ndarray,
    true_rows: np.ndarray,
    step: int,
    body: BodyModel | None,
) -> MotionErrors:
    """Errors of the motions between frames `step` apart, in all phases, none of them over a gap.

    Args:
        pseudo: What was recovered, in a world of its own.
        true: What was rendered.
        rows: Rows of `pseudo`, ascending, that may be used.
        true_rows: The rows of `true` that show the same images.
        step: Frames per motion.
        body: The true clip's body, for VME.

    Raises:
        NothingToCompare: there is no such motion.
    """
    phases = [
        _errors_of_neighbours(pseudo, true, rows, true_rows, phase, step, body)
        for phase in range(step)
    ]
    errors = MotionErrors(*(np.concatenate(parts) for parts in zip(*phases, strict=True)))
    if not len(errors.ome_deg):
        raise NothingToCompare(
            f"clip {pseudo.id}: no two frames in a row are valid in it and in its truth {true.id}."
            " There is nothing to compare"
        )
    return errors


def _errors_of_neighbours(
    pseudo: Clip,
    true: Clip,
    rows: np.ndarray,
    true_rows: np.ndarray,
    phase: int,
    step: int,
    body: BodyModel | None,
) -> MotionErrors:
    """Errors of the motions from frame to frame of one phase of the video."""
    chosen = np.flatnonzero(true_rows % step == phase)
    rows, true_rows = rows[chosen], true_rows[chosen]
    # Frames in between that are missing on either side would show in one of the three.
    adjacent = (np.diff(rows) == step) & (np.diff(true_rows) == step) & (np.diff(chosen) == step)
    rotmats, metres = _deltas(pseudo, rows, adjacent)
    true_rotmats, true_m = _deltas(true, true_rows, adjacent)
    vertex_mm = np.zeros(0)
    if body is not None:
        poses = true.motion.local_rotmats[true_rows[:-1][adjacent]]
        vertex_mm = posed_vertex_errors_mm(
            body, true.motion.shape, poses, rotmats, metres, true_rotmats, true_m
        )
    return MotionErrors(
        orientation_errors_deg(rotmats, true_rotmats),
        translation_errors_mm(metres, true_m),
        vertex_mm,
    )


def _deltas(clip: Clip, rows: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those motions between a clip's rows that are chosen."""
    rotmats, metres = deltas(clip.motion.root_rotmats[rows], clip.motion.pelvis_m[rows])
    return rotmats[chosen], metres[chosen]
