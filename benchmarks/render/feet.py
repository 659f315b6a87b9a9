"""How far the lower foot is off the ground, on level walks."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.motion.files import read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.motion.resample import resample
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m

WALKS = (
    "02_01", "02_02", "05_01", "08_01", "08_02", "08_03", "08_04", "08_05", "08_06", "08_08",
    "08_09", "08_10", "16_15", "16_16", "16_31", "16_32", "35_01", "35_02", "35_03", "35_04",
)  # fmt: skip
"""CMU's trials of straight level walking; those that are there are measured."""
GAIT_SEEDS = (0, 1, 2)
FPS_HZ = 10.0


def measure_feet(body: BodyModel, cmu_dir: Path | None) -> list[dict[str, Any]]:
    """Mean over the frames of each walk, as it is filmed at 10 fps."""
    rows = []
    for name, motion in _walks(body, cmu_dir):
        gaps_cm = 100 * sole_gaps_m(body, resample(motion, FPS_HZ))
        rows.append(
            {
                "walk": name,
                "frames": len(gaps_cm),
                "gap_cm_mean": round(float(np.abs(gaps_cm).mean()), 3),
                "float_cm_max": round(float(gaps_cm.max()), 2),
                "penetration_cm_max": round(float(-gaps_cm.min()), 2),
            }
        )
    return rows


def sole_gaps_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """(T,) height of the lower foot's lowest vertex over the ground; negative below it [m]."""
    carrier = body.skin_weights.argmax(axis=1)
    names = [f"{side}_{part}" for side in ("left", "right") for part in ("ankle", "foot")]
    on_foot = np.isin(carrier, [JOINT[name] for name in names])
    return np.asarray(motion_vertices_m(body, motion)[:, on_foot, 2].min(axis=1))


def _walks(body: BodyModel, cmu_dir: Path | None) -> Iterator[tuple[str, Motion]]:
    for seed in GAIT_SEEDS:
        rng = np.random.default_rng(seed)
        yield f"embedded walk {seed}", make_gait("walk", 5.0, 30.0, body, rng)
    if cmu_dir is None:
        return
    for trial in WALKS:
        for path in (cmu_dir / "amc" / f"{trial}.amc", cmu_dir / "bvh" / f"{trial}.bvh"):
            if path.is_file():
                yield f"CMU {path.name}", read_motion(path, body)
                break  # the other file holds the same walk
