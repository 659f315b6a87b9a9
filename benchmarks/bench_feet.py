"""How far the lower foot is from the ground on level walks, as they are filmed.

Prints the figures of docs/figures.md and writes out/bench/feet.json.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import Film, film_motion
from gmrdata.motion.files import find_motions, read_motion
from gmrdata.stage.progress import console
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m

pytestmark = pytest.mark.bench
WALKS_S = {"08_02": 1.4, "08_04": 4.1, "08_05": 2.5, "35_01": 3.0, "16_19": 3.0, "17_03": 3.0}
"""Seconds that the recipes film, by trial."""
MOST_CM = 2.0
OUT = Path("out/bench/feet.json")


def lower_foot_cm(body: BodyModel, motion: Motion) -> np.ndarray:
    """(T,) height of the lowest vertex that a foot carries [cm]."""
    feet = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]
    of_feet = np.isin(body.skin_weights.argmax(axis=1), feet)
    return np.asarray(100 * motion_vertices_m(body, motion)[:, of_feet, 2].min(axis=1))


def test_walkers_stand_on_the_ground(cmu_dir: Path, anny: BodyModel) -> None:
    files = {path.stem: path for path in find_motions(cmu_dir)}
    record = {}
    for trial, duration_s in WALKS_S.items():
        film = Film(duration_s=duration_s, fps_hz=10)
        height_cm = lower_foot_cm(anny, film_motion(read_motion(files[trial], anny), film))
        record[trial] = {
            "frames": len(height_cm),
            "gap_cm_mean": round(float(np.abs(height_cm).mean()), 2),
            "lowest_cm": round(float(height_cm.min()), 1),
            "highest_cm": round(float(height_cm.max()), 1),
        }
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps(record, indent=2) + "\n")
    console.print(record)
    assert max(row["gap_cm_mean"] for row in record.values()) < MOST_CM
