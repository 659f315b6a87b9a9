"""Steps timed in turn: other work on the machine then slows both sides alike."""

import time
from typing import Any

import numpy as np
import torch
from gmr.steps import Step


def paired(a: Step, b: Step, pairs: int, names: tuple[str, str], *, device: str = "cpu") -> Any:
    """Median seconds of both sides, and the median, least and greatest of the ratio a : b.

    On the CPU the seconds are those of this process, which has one thread: on a quiet machine they
    are the wall clock's, whose ratio is beside them, and on a busy one they leave out the others.
    The first pair of steps is not counted.
    """
    seconds = np.array([[_timed(side, n, device) for side in (a, b)] for n in range(pairs + 1)])[1:]
    ratios = seconds[:, 0] / seconds[:, 1]
    medians_s = np.median(seconds, axis=0)
    counted = 1 if device == "cpu" else 0
    return {
        f"{names[0]}_s": float(medians_s[0, counted]),
        f"{names[1]}_s": float(medians_s[1, counted]),
        "ratio": float(np.median(ratios[:, counted])),
        "ratio_min": float(ratios[:, counted].min()),
        "ratio_max": float(ratios[:, counted].max()),
        "wall_ratio": float(np.median(ratios[:, 0])),
        "pairs": pairs,
    }


def _timed(step: Step, number: int, device: str) -> tuple[float, float]:
    """Seconds of a step by the wall clock, and of this process."""
    _wait(device)
    begin_s, begin_process_s = time.perf_counter(), time.process_time()
    step(number)
    _wait(device)
    return time.perf_counter() - begin_s, time.process_time() - begin_process_s


def _wait(device: str) -> None:
    if device == "cuda":
        torch.cuda.synchronize()
