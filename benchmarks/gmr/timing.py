"""Steps timed in turn: other work on the machine then slows both sides alike."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gmr.steps import Step


def paired(a: Step, b: Step, pairs: int, names: Sequence[str], *, device: str = "cpu") -> Any:
    """Median seconds of both sides, and the median, least and greatest of the ratio a : b.

    The first pair of steps is not counted.
    """
    seconds = np.array([[_timed(side, n, device) for side in (a, b)] for n in range(pairs + 1)])[1:]
    ratios = seconds[:, 0] / seconds[:, 1]
    return {
        f"{names[0]}_s": float(np.median(seconds[:, 0])),
        f"{names[1]}_s": float(np.median(seconds[:, 1])),
        "ratio": float(np.median(ratios)),
        "ratio_min": float(ratios.min()),
        "ratio_max": float(ratios.max()),
        "pairs": pairs,
    }


def _timed(step: Step, number: int, device: str) -> float:
    _wait(device)
    begin_s = time.perf_counter()
    step(number)
    _wait(device)
    return time.perf_counter() - begin_s


def _wait(device: str) -> None:
    if device == "cuda":
        torch.cuda.synchronize()
