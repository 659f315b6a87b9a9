"""One case from files to a row of the record."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from real.cases import Case
from real.ours import Solved, solve
from real.plain import solve_plain
from real.score import MOST_TURN_DEG, Errors, errors, still_error
from real.sequences import RealSequence, make_sequence

from gmrdata.cameras.recipe import CamerasVerdictConfig

MOST_STILL_SHARE = 0.01
"""Extent of the places of a camera that stays, over the background's distance."""


def measure(case: Case, clips_dir: Path, detector: Path, out_dir: Path) -> dict[str, Any]:
    """Solve a case, and plainly too where that is asked for; its files are deleted."""
    given = make_sequence(case, clips_dir, detector, out_dir / "given")
    solved = solve(given, out_dir / "sfm", case.seed)
    row = {"name": case.name, "sound": case.sound} | _figures(given, solved)
    if case.plain:
        row |= _beside(given, solved, case.seed, out_dir / "plain")
    shutil.rmtree(out_dir)
    return row


def _figures(given: RealSequence, solved: Solved) -> dict[str, Any]:
    found, true = solved.world_from_cam, given.world_from_cam
    every = np.flatnonzero(np.isfinite(found[:, 0, 0]))
    error = None if given.still else errors(found, true, _of_one_take(every, given.takes))
    quality = solved.quality
    step = quality.weakest_step if quality else None
    again = quality.agreement if quality else None
    return {
        "accepted": solved.accepted,
        "right": _right(given, solved),
        "cameras": len(every),
        "frames": len(found),
        "kept": int(solved.kept.sum()),
        **_error_figures(error),
        "seconds": _rounded(solved.seconds),
        "masks_seconds": _rounded(given.masks_s),
        "geometry": quality.geometry if quality else None,
        "mapper": quality.mapper if quality else None,
        "reprojection_px": quality.mean_reprojection_px if quality else None,
        "focal": [quality.focal_factor, quality.focal_sigma] if quality else None,
        "radial_k1": [quality.radial_k1, quality.radial_k1_sigma] if quality else None,
        "loose_share": step.loose_share if step else None,
        "moving_share": step.moving_share if step else None,
        "again_deg": again.turn_deg if again else None,
        "again_share": again.place_share if again else None,
        "second_share": quality.second_share if quality else None,
        "keyframes": len(quality.keyframes) if quality else None,
        "cuts": len(quality.cuts_after_frames) if quality else None,
        "reasons": list(solved.reasons),
    }


def _error_figures(error: Errors | None) -> dict[str, Any]:
    keys = ("ate_mm", "rpe_mm", "rpe_deg", "turn_deg", "extent_mm", "scale_drift")
    return {key: None if error is None else _rounded(getattr(error, key)) for key in keys}


def _of_one_take(rows: np.ndarray, takes: np.ndarray) -> np.ndarray:
    """The rows of the take that most of them belong to."""
    return rows[takes[rows] == np.bincount(takes[rows]).argmax()] if len(rows) else rows


LEAST_FOUND_SHARE = CamerasVerdictConfig().min_registered_share


def _right(given: RealSequence, solved: Solved) -> bool | None:
    """Whether what is kept is right, or what was found where it was refused; None if unknown.

    What is refused and lacks many frames is no right result, however exact the others are.
    """
    found = np.isfinite(solved.world_from_cam[:, 0, 0])
    rows = np.flatnonzero(solved.kept if solved.accepted else found)
    if not len(rows) or (not solved.accepted and len(rows) < LEAST_FOUND_SHARE * len(found)):
        return False
    if given.still:
        share, turn_deg = still_error(solved.world_from_cam, solved.distance, rows)
        return share <= MOST_STILL_SHARE and turn_deg <= MOST_TURN_DEG
    if np.ptp(given.takes[rows]):
        # Takes of different places in one world.
        return False
    if not np.isfinite(given.world_from_cam[rows, 0, 0]).any():
        return None
    error = errors(solved.world_from_cam, given.world_from_cam, rows)
    return error is not None and error.right


def _beside(given: RealSequence, solved: Solved, seed: int, work_dir: Path) -> dict[str, Any]:
    """The better of plain pycolmap's mappers by ATE, and the time of the faster over ours.

    A model of fewer than half of the frames is none.
    """
    figures: dict[str, Any] = {}
    right: list[tuple[float, float]] = []
    for plain in solve_plain(given, work_dir, seed):
        rows = np.flatnonzero(np.isfinite(plain.world_from_cam[:, 0, 0]))
        error = errors(plain.world_from_cam, given.world_from_cam, rows)
        figures |= {
            f"plain_{plain.mapper}_ate_mm": _rounded(error.ate_mm) if error else None,
            f"plain_{plain.mapper}_cameras": len(rows),
            f"plain_{plain.mapper}_seconds": _rounded(plain.seconds),
        }
        if error is not None and len(rows) >= len(given.takes) / 2:
            right.append((error.ate_mm, plain.seconds))
    figures["plain_ate_mm"] = _rounded(min((ate for ate, _ in right), default=None))
    fastest = min((seconds for _, seconds in right), default=None)
    known = fastest is not None and solved.seconds is not None
    figures["speedup"] = _rounded(fastest / solved.seconds) if known else None  # type: ignore[operator]
    return figures


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")
