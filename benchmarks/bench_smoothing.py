"""What refining all frames together does to the camera's motions, where they are known exactly.

Films the tests' room by camera programmes, at 30 and at 10 frames/s, reconstructs with and without
the prior on acceleration, prints root mean square errors of the motions from frame to frame and
over a tenth of a second, and writes out/bench/smoothing.json.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record import OUT_DIR

from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.film.programmes import Circular, Linear, LinearPanning, Panning, Programme, camera_path
from gmrdata.stage.progress import console
from gmrdata.values.files import write_json
from gmrdata.values.transforms import fit_similarity
from tests.filming import HEIGHT_PX, WIDTH_PX, Filmed, film_cameras, motion_errors

pytestmark = pytest.mark.bench
FPS_HZ, N_FRAMES, SEED = 30, 90, 3
HAND: dict[str, Any] = {"handheld_deg": 0.6, "handheld_m": 0.02}
HARD: dict[str, Any] = {"handheld_deg": 1.5, "handheld_m": 0.05}
PLACE: dict[str, Any] = {"azimuth_deg": -90.0, "distance_m": 3.0}
PROGRAMMES: dict[str, Programme] = {
    "linear, on wheels": Linear(**PLACE, speed_m_per_s=0.3),
    "linear+panning, hand": LinearPanning(**PLACE, **HAND, speed_m_per_s=0.81),
    "linear+panning, unsteady hand": LinearPanning(**PLACE, **HARD),
    "circular": Circular(radius_m=3.0, azimuth_deg=-90.0),
    "circular, hand": Circular(radius_m=3.0, azimuth_deg=-90.0, **HAND),
    "panning, unsteady head": Panning(**PLACE, handheld_deg=0.6),
}
MOST = 1.05
"""Error with the prior over that without it; 1 where it neither helps nor harms."""
ERRORS = ("frame_deg", "tenth_s_deg", "frame_mm", "tenth_s_mm")
OUT = OUT_DIR / "smoothing.json"


def film(name: str, every: int, folder: Path) -> Filmed:
    """The room, filmed by a programme that follows a walk; every so manieth frame."""
    along = np.linspace(0, 1, N_FRAMES)
    bob_m = 0.9 + 0.02 * np.sin(12 * np.pi * along)
    pelvis_m = np.stack([-1.2 + 2.4 * along, 0.4 + 0 * along, bob_m], axis=1)
    rng = np.random.default_rng(SEED)
    path = camera_path(PROGRAMMES[name], pelvis_m, FPS_HZ, WIDTH_PX, HEIGHT_PX, 65.0, rng)
    on_floor_m = pelvis_m * [1.0, 1.0, 0.0]
    return film_cameras(folder, path.world_from_cam[::every], on_floor_m[::every])


def errors_of(filmed: Filmed, sfm_dir: Path, step: int) -> dict[str, Any]:
    """Errors of a reconstruction in the truth's scale."""
    cameras, true = load_cameras(sfm_dir), filmed.world_from_cam
    assert cameras.path.has_camera.all()
    found = cameras.path.world_from_cam.copy()
    if cameras.geometry == "full":
        fit = fit_similarity(true[:, :3, 3], found[:, :3, 3], scale=True)
        found[:, :3, 3] *= fit.scale
    result: dict[str, Any] = {"geometry": cameras.geometry}
    for key, over in (("frame", 1), ("tenth_s", step)):
        degrees, metres = motion_errors(found, true, over)
        result |= {f"{key}_deg": round(degrees, 5), f"{key}_mm": round(1e3 * metres, 3)}
    return result | {"smoothing": asdict(load_quality(sfm_dir).smoothing)}


def measure(name: str, every: int, folder: Path) -> dict[str, Any]:
    """Errors without and with the prior, by the key of a row."""
    filmed = film(name, every, folder / "film")
    none = SfmConfig(acceleration_deg=10.0, acceleration_share=1.0)
    row = {}
    for prior, config in (("without", none), ("with", SfmConfig())):
        arguments = filmed.taken(), filmed.masks_dir, filmed.lens
        out_dir = reconstruct(*arguments, folder / prior, config)
        row[prior] = errors_of(filmed, out_dir, max(1, 3 // every))
    return row


def test_the_prior_does_no_harm(tmp_path: Path) -> None:
    rows = {}
    for every in (1, 3):
        for i, name in enumerate(PROGRAMMES):
            row = measure(name, every, tmp_path / f"{i}_{every}")
            clip = f"{name}, {FPS_HZ // every} frames/s"
            rows[clip] = row
            said = [f"{key} {row['without'][key]:g} -> {row['with'][key]:g}" for key in ERRORS]
            console.print(f"{clip}: {', '.join(said)}", soft_wrap=True)
    write_json(OUT, rows)
    for clip, row in rows.items():
        for key in ERRORS:
            assert row["with"][key] <= MOST * row["without"][key], (clip, key)
