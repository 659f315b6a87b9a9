"""How far the lower foot is from the ground on level walks, as they are filmed; and the heights
that `infer` gives people.

Prints the figures of docs/figures.md and writes out/bench/feet.json and heights.json.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from record import OUT_DIR
from render.feet import sole_gaps_m

import gmrdata.gmr.infer
from gmrdata.film.programmes import Film, film_motion
from gmrdata.gmr.augmentation import turned
from gmrdata.gmr.config import WindowConfig
from gmrdata.gmr.infer import predict_at_source_rate, stand
from gmrdata.gmr.predict import TrainedGmr, load_gmr
from gmrdata.motion.files import find_motions, read_motion
from gmrdata.stage.progress import console
from gmrdata.values.body import BodyModel
from gmrdata.values.files import read_json, write_json
from gmrdata.values.motion import Motion, deltas

pytestmark = pytest.mark.bench
WALKS_S = {"08_02": 1.4, "08_04": 4.1, "08_05": 2.5, "35_01": 3.0, "16_19": 3.0, "17_03": 3.0}
"""Seconds that the recipes film, by trial."""
MOST_CM = 2.0
OUT = OUT_DIR / "feet.json"


def test_walkers_stand_on_the_ground(cmu_dir: Path, anny: BodyModel) -> None:
    files = {path.stem: path for path in find_motions(cmu_dir)}
    record = {}
    for trial, duration_s in WALKS_S.items():
        film = Film(duration_s=duration_s, fps_hz=10)
        filmed = film_motion(read_motion(files[trial], anny), film)
        height_cm = 100 * sole_gaps_m(anny, filmed)
        record[trial] = {
            "frames": len(height_cm),
            "gap_cm_mean": round(float(np.abs(height_cm).mean()), 2),
            "lowest_cm": round(float(height_cm.min()), 1),
            "highest_cm": round(float(height_cm.max()), 1),
        }
    write_json(OUT, record)
    console.print(record)
    assert max(row["gap_cm_mean"] for row in record.values()) < MOST_CM


KINDS = {
    "walk": ("07_*", "08_*", "12_*", "16_1[1-9]", "16_2*", "16_3[1-4]", "16_47", "35_0*", "35_1*"),
    "run": ("02_03", "09_*", "16_3[56]", "16_4[5689]", "16_5[0-7]", "35_2*"),
    "jump": ("02_04", "16_0[1-79]", "16_10", "49_02", "49_03", "49_04", "49_05"),
}
NOISE = WindowConfig(fps_hz=30.0, pose_noise_deg=3.0, pose_noise_time_s=0.5)
IN_THE_AIR_M = 0.05


def heights(body: BodyModel, gmr: TrainedGmr, true: Motion) -> list[float]:
    """Of a network's motion: error of the pelvis's height [cm], TME [mm], of up [deg], share of
    frames in the air [%]; and that share of the true motion."""
    local = turned(true.local_rotmats, NOISE, np.random.default_rng(0))
    found = stand(predict_at_source_rate(gmr, replace(true, local_rotmats=local)), body)
    apart_m = np.abs(found.pelvis_m[:, 2] - true.pelvis_m[:, 2]).mean()
    steps_m = [deltas(m.root_rotmats[::3], m.pelvis_m[::3])[1] for m in (found, true)]
    tme_m = np.linalg.norm(np.subtract(*steps_m), axis=1).mean()
    up = (found.root_rotmats @ true.root_rotmats.swapaxes(-1, -2))[:, 2, 2]
    up_deg = np.rad2deg(np.arccos(np.clip(up, -1.0, 1.0))).mean()
    shares = [(sole_gaps_m(body, m) > IN_THE_AIR_M).mean() for m in (found, true)]
    return [100 * apart_m, 1000 * tme_m, up_deg, *(100 * share for share in shares)]


@pytest.mark.parametrize("kind", KINDS)
def test_heights(
    kind: str, cmu_dir: Path, anny: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    gmr, files = load_gmr("bundled"), find_motions(cmu_dir)
    motions = []
    for path in sorted({p.stem: p for pattern in KINDS[kind] for p in files if p.match(
        f"{pattern}.*")}.values()):  # fmt: skip
        motion = read_motion(path, anny)
        apart = round(motion.fps_hz / 30)
        motions.append(motion.take(slice(0, 600 * apart, apart), motion.fps_hz / apart))
    held = np.mean([heights(anny, gmr, motion) for motion in motions], axis=0)
    monkeypatch.setattr(gmrdata.gmr.infer, "held_upright", lambda _, motion: motion)
    monkeypatch.setattr(gmrdata.gmr.infer, "on_one_floor", lambda *_: None)
    before = np.mean([heights(anny, gmr, motion) for motion in motions], axis=0)
    what = ("height_cm", "tme_mm", "up_deg", "in_the_air_percent", "in_the_air_true_percent")
    found = {key: [round(b, 2), round(h, 2)] for key, b, h in zip(what, before, held, strict=True)}
    path = OUT.with_name("heights.json")
    record = read_json(path) if path.exists() else {}
    record[kind] = {"motions": len(motions), **found}
    write_json(path, record)
    console.print(record[kind])
    assert held[0] < before[0] and held[1] < 1.01 * before[1]
