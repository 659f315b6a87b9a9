"""Kill a synthetic set ten times: the command, its workers and its Blenders, at random moments.

Prints what was killed when and writes out/bench/kill_set.json.  The seed is new each time and
recorded; set GMRDATA_SEED to repeat one.
"""

import os
import secrets
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from record import OUT_DIR

from gmrdata.manifest.check import check_manifest
from gmrdata.stage.progress import console
from gmrdata.values.files import write_json
from tests.film.set_kills import (
    VICTIMS,
    contents,
    kill_and_complete,
    leftovers,
    start,
    write_recipe,
)

pytestmark = pytest.mark.bench
N_KILLS = 10
OUT = OUT_DIR / "kill_set.json"


def test_ten_kills_change_nothing(tmp_path: Path, anny: object) -> None:
    seed = int(os.environ.get("GMRDATA_SEED") or secrets.randbits(32))
    recipe, undisturbed = tmp_path / "recipe.yaml", tmp_path / "undisturbed"
    write_recipe(recipe, n_clips=4, n_frames=8)
    begin_s = time.monotonic()
    assert start(recipe, undisturbed).wait() == 0
    whole_s = time.monotonic() - begin_s
    victims = [VICTIMS[i % len(VICTIMS)] for i in range(N_KILLS)]
    killed = tmp_path / "killed"
    kills = kill_and_complete(recipe, killed, victims, whole_s, np.random.default_rng(seed))
    sets = [path for path in tmp_path.glob("killed*") if path.is_dir()]
    record = {
        "seed": seed,
        "undisturbed_s": round(whole_s, 1),
        "kills": [asdict(kill) for kill in kills],
        "sets": len(sets),
        "same_bytes": all(contents(path) == contents(undisturbed) for path in sets),
        "leftovers": [name for path in sets for name in leftovers(path)],
    }
    write_json(OUT, record)
    console.print(record)
    assert record["same_bytes"] and not record["leftovers"]
    for path in sets:
        check_manifest(path / "synthetic.yaml")
