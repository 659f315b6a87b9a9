"""Motions that are written in a format of others and read again: how far joints and turns move.

Real motions of CMU, on a body of SMPL's tree in several shapes and genders.  A format is a function
that writes a motion and gives back what its reader makes of the file; another one is one line in
`FORMATS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from open import scenes, sequences

from gmrdata.motion.files import read_motion
from gmrdata.stage.progress import track
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_rad
from gmrdata.write.amass import write_amass
from gmrdata.write.bvh import write_bvh

GENDERS = ("neutral", "female", "male")
RoundTrip = Callable[[Motion, BodyModel, Path], Motion]


def amass(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    write_amass(folder / "motion.npz", motion, body)
    return read_motion(folder / "motion.npz", body)


def bvh(motion: Motion, body: BodyModel, folder: Path) -> Motion:
    write_bvh(folder / "motion.bvh", motion, body)
    return read_motion(folder / "motion.bvh", body)


FORMATS: dict[str, RoundTrip] = {
    "amass": amass,
    "bvh": bvh,
    "3dpw": sequences.threedpw,
    "emdb": sequences.emdb,
    "wham": sequences.wham,
    "gvhmr": sequences.gvhmr,
    "glb": scenes.glb,
    "usd": scenes.usd,
}


def measured(paths: Sequence[Path], body: BodyModel, folder: Path) -> list[dict[str, Any]]:
    """Rows of figures by motion and format.

    Args:
        paths: Motion files of CMU.
        body: A body of SMPL's tree; it goes by the names of SMPL's, in turn, and has other shapes.
        folder: For the written files.
    """
    rows = []
    for number, path in enumerate(track(paths, "there and back")):
        gender, rng = GENDERS[number % len(GENDERS)], np.random.default_rng(number)
        named = replace(body, name=f"smpl-{gender}")
        shape = rng.normal(0.0, 0.7, body.n_shape)
        motion = read_motion(path, named, shape=shape)
        for name, there_and_back in FORMATS.items():
            found = there_and_back(motion, named, folder)
            rows.append({"file": path.name, "format": name, **_moved(named, motion, found)})
        recorded = scenes.recording(motion, named, folder)
        rows.append({"file": path.name, "format": "rrd", **recorded})
    return rows


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """The largest of all rows; an uneven frame count or rate is infinitely far."""
    return {
        f"round_trip_{unit}_max": max(row[f"round_trip_{unit}_max"] for row in rows)
        for unit in ("mm", "deg")
    }


def _moved(body: BodyModel, motion: Motion, found: Motion) -> dict[str, float]:
    same_rate = abs(found.fps_hz / motion.fps_hz - 1.0) < 1e-12
    if found.n_frames != motion.n_frames or not same_rate:
        return {"round_trip_mm_max": np.inf, "round_trip_deg_max": np.inf}
    off_m = motion_joints_m(body, found) - motion_joints_m(body, motion)
    turned_rad = angles_rad(motion.rotmats.swapaxes(-1, -2) @ found.rotmats)
    return {
        "round_trip_mm_max": 1000.0 * float(np.linalg.norm(off_m, axis=-1).max()),
        "round_trip_deg_max": float(np.rad2deg(turned_rad.max())),
    }
