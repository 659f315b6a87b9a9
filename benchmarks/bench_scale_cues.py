"""Metric scale of the twins' travelling cameras by each cue, without rendering.

The cameras are exact but for 2 mm and the ground is shown by simulated points, so what is measured
is what people do to the scale: as they are, and with the data set's faults.  Prints a table and
writes out/bench/scale_cues.json.
"""

from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pytest
from record import OUT_DIR, Record, at_least, at_most, machine
from render.tables import show

from gmrdata.film.set_plan import planned_clip, select
from gmrdata.read.bodies import load_body
from gmrdata.stage.recipes import load_recipe, recipe_path
from gmrdata.twins.faults import FaultConfig, dataset_side, smooth_noise, with_peak
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.recipe import ScaleConfig
from gmrdata.world.scale import SeenPerson, estimate_scale

pytestmark = pytest.mark.bench
TRAVELLING = ("circular", "linear", "linear_panning")
UNIT_M = 0.37
CAMERA_ERROR_M, GROUND_ERROR_M = 0.002, 0.01
GROUND_POINTS, GROUND_M = 400, 3.0  # within so far of the person's path
DRAWS = 6


def test_people_tell_the_scale(cmu_dir: Path, request: pytest.FixtureRequest) -> None:
    small = request.config.getoption("--small")
    record = Record(OUT_DIR / "scale_cues.json", small, machine)
    recipe, body = load_recipe(recipe_path("twins"), TwinRecipe).set, load_body("anny")
    chosen = select(recipe, cmu_dir)
    takes = [take for take in chosen.takes if take.clip.programme.kind in TRAVELLING]
    rows: list[dict[str, Any]] = []
    for take in takes[:1] if small else takes:
        clip, _ = planned_clip(take.clip, recipe, chosen.files[take.clip.trial or ""], body)
        rows += [_row(clip, body, None, 0)]
        rows += [_row(clip, body, FaultConfig(), draw) for draw in range(1 if small else DRAWS)]
    show("Scale errors of each cue [%]", [_printed(row) for row in rows])
    faulty = [row for row in rows if row["draw"] is not None]
    mean = fmean(row["fused"] for row in faulty)
    inside = fmean(abs(row["fused"]) <= 2 * row["fused_sigma"] for row in faulty)
    record.add(rows=rows, mean_fused_percent=mean, within_2sigma=inside)
    record.hold(
        [
            at_most("mean fused scale error, either way [%]", abs(mean), 0.5),
            at_least("share within two standard errors", inside, 0.9),
        ]
    )


def _row(clip: Clip, body: BodyModel, faults: FaultConfig | None, draw: int) -> dict[str, Any]:
    rng = np.random.default_rng([draw, *clip.id.encode()])
    seen = clip if faults is None else dataset_side([clip], faults, rng)[0]
    path = camera_of(clip)
    world_from_cam = path.world_from_cam.copy()
    tremble = smooth_noise(path.n_frames, clip.motion.fps_hz, 0.5, 3, rng)
    world_from_cam[:, :3, 3] += with_peak(tremble, CAMERA_ERROR_M)
    world_from_cam[:, :3, 3] /= UNIT_M
    world_from_cam[~seen.valid] = np.nan
    near_m = clip.motion.pelvis_m[rng.integers(0, path.n_frames, GROUND_POINTS)] * [1, 1, 0]
    ground_m = near_m + rng.uniform(-GROUND_M, GROUND_M, near_m.shape) * [1, 1, 0]
    points = (ground_m + rng.normal(0, GROUND_ERROR_M, ground_m.shape)) / UNIT_M
    dataset_camera = camera_of(seen).world_from_cam
    person = SeenPerson(
        motion_in_camera(seen.motion, dataset_camera),
        body,
        replace(path, world_from_cam=world_from_cam),
    )
    known = np.where(seen.valid[:, None, None], dataset_camera, np.nan)
    found = estimate_scale([person], "full", ScaleConfig(), points=points, dataset_camera=known)
    assert found.scale is not None and found.sigma is not None
    cues = {cue.name: 100 * (cue.scale / UNIT_M - 1) for cue in found.cues}
    sigmas = {f"{cue.name}_sigma": 100 * cue.sigma / UNIT_M for cue in found.cues}
    fused = {"fused": 100 * (found.scale / UNIT_M - 1), "fused_sigma": 100 * found.sigma / UNIT_M}
    return {"clip": clip.id, "draw": None if faults is None else draw} | cues | sigmas | fused


def _printed(row: dict[str, Any]) -> dict[str, Any]:
    names = ("planted_feet", "ground_contact", "short_windows", "fused")
    faults = "none" if row["draw"] is None else f"draw {row['draw']}"
    figures = {n: f"{row[n]:+.2f} ± {row[f'{n}_sigma']:.2f}" if n in row else "-" for n in names}
    return {"clip": row["clip"], "faults": faults} | figures
