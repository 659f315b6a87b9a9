"""Any system's motion with AMASS's keys, at its own rate, as `gmrdata evaluate` takes it.

A `.npz` with `poses` (T, 72, 156 or 165) axis-angle [rad], `trans` (T, 3), SMPL's transl [m] with z
up, and perhaps `betas` (S,) or (T, S), `gender`, `mocap_framerate` or `mocap_frame_rate` [Hz].
`gmrdata.motion.amass` reads such files as motion capture: onto another body, and on the floor.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import Entry, rotmats_of, turned
from gmrdata.values.body import HANDS
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InWorld

KEYS = frozenset({"poses", "trans"})
N_SMPLX = 165
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate")


def read_amass_result(arrays: dict[str, Any], path: Path) -> EstimatedPeople:
    entry = Entry(arrays, "the motion", path)
    poses = entry.array("poses", None, None)
    if poses.shape[1] not in HANDS:
        raise entry.fault(f"poses are {poses.shape}; known are (T, 72), (T, 156) and (T, 165)")
    rotmats = rotmats_of(poses)[:, [*range(22), *HANDS[poses.shape[1]]]]
    transl_m, n_rows = entry.array("trans", len(poses), 3), len(poses)
    person = EstimatedPerson(
        name="person_0",
        frame_numbers=np.arange(n_rows),
        local_rotmats=rotmats[:, 1:],
        in_world=InWorld(rotmats[:, 0], transl_m, turned(np.eye(3), n_rows)),
        betas=None if poses.shape[1] == N_SMPLX else _mean_betas(entry, n_rows),
        betas_body=f"smpl-{_gender(arrays)}",
        has_own_rate=True,
        lacks={"camera": "a motion in the world alone"},
    )
    return EstimatedPeople("amass", (path,), (person,), fps_hz=_rate_hz(entry))


def _mean_betas(entry: Entry, n_rows: int) -> np.ndarray | None:
    """(T, S) one shape for all rows, the mean over time."""
    if not entry.has("betas"):
        return None
    by_row = np.ndim(entry.values["betas"]) == 2
    betas = entry.array("betas", None, None).mean(axis=0) if by_row else entry.array("betas", None)
    return np.tile(betas, (n_rows, 1))


def _gender(arrays: dict[str, Any]) -> str:
    value = np.asarray(arrays.get("gender", "neutral")).ravel()
    word = value[0] if value.size else "neutral"
    return (word.decode("ascii", "replace") if isinstance(word, bytes) else str(word)).lower()


def _rate_hz(entry: Entry) -> float | None:
    key = next((key for key in RATE_KEYS if entry.has(key)), None)
    if key is None:
        return None
    (rate_hz,) = entry.flat(key, 1)
    if not rate_hz > 0:
        raise entry.fault(f"{key} is no frame rate")
    return float(rate_hz)
