"""Frame rates: which number is believed, and why."""

import re
from pathlib import Path

from gmrdata.errors import BadMotionFile

CMU_60_HZ_SUBJECTS = frozenset({33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89, 136})
"""Subjects that CMU's index lists with 60 fps, whatever their files say; all others have 120."""

CMU_TRIAL = re.compile(r"^(\d{2,3})_(\d{2})(?:_|$)")
"""CMU's file names: subject_trial; AMASS appends `_poses` or `_stageii`."""

LOWEST_HZ, HIGHEST_HZ = 1.0, 1000.0


def cmu_subject(path: Path) -> int | None:
    """Subject number in a file name like CMU's `02_03.amc` or `62_11_poses.npz`, else None."""
    match = CMU_TRIAL.match(path.stem)
    return int(match.group(1)) if match else None


def cmu_rate_hz(path: Path) -> float:
    """Frame rate of a CMU file by its subject: 60 or 120 [Hz]."""
    return 60.0 if cmu_subject(path) in CMU_60_HZ_SUBJECTS else 120.0


def rate_of_frame_time_hz(text: str, path: Path, line_number: int) -> float:
    """Frame rate of a BVH `Frame Time`, with the rounding of the printed number undone.

    `.0083333` stands for everything from .00833325 to .00833335, and 120 Hz lies in there; so does
    29.97 Hz and no whole rate in .0333667.

    Raises:
        BadMotionFile: not a number, or no rate from 1 to 1000 Hz.
    """
    try:
        frame_time_s = float(text)
    except ValueError:
        raise BadMotionFile(
            f"{path}:{line_number}: frame time {text[:40]!r} is not a number"
        ) from None
    if not 1 / HIGHEST_HZ <= frame_time_s <= 1 / LOWEST_HZ:
        raise BadMotionFile(
            f"{path}:{line_number}: a frame time of {text[:40]} s is no rate from {LOWEST_HZ:g} to "
            f"{HIGHEST_HZ:g} Hz; give the true rate with fps_hz"
        )
    mantissa, _, exponent = text.strip().lower().partition("e")
    decimals = len(mantissa.partition(".")[2]) - (int(exponent) if exponent else 0)
    # 1/256 lies exactly in the middle of two numbers of 7 digits; what is computed, beside it.
    half_step_s = 0.5 * 10.0**-decimals * (1 + 1e-6)
    nearest_hz = round(1 / frame_time_s)
    return (
        float(nearest_hz) if abs(1 / nearest_hz - frame_time_s) <= half_step_s else 1 / frame_time_s
    )


def check_rate_hz(fps_hz: float, path: Path) -> float:
    """The rate as a float.

    Raises:
        BadMotionFile: no rate from 1 to 1000 Hz.
    """
    if not LOWEST_HZ <= fps_hz <= HIGHEST_HZ:
        raise BadMotionFile(
            f"{path}: a frame rate of {fps_hz:g} Hz is not from {LOWEST_HZ:g} to {HIGHEST_HZ:g} "
            "Hz; "
            "give the true rate with fps_hz"
        )
    return float(fps_hz)
