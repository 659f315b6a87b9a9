"""kill -9 of the command, of a worker and of a Blender: the set completes, and is the same.

benchmarks/bench_kill_set.py does more of it.
"""

import time
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.render_set import render_set
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.manifest.check import check_manifest
from gmrdata.pages.sets import write_set_pages
from gmrdata.stage.recipes import load_recipe
from gmrdata.stage.run import Run
from tests.film.set_kills import (
    VICTIMS,
    contents,
    kill_and_complete,
    leftovers,
    write_recipe,
)

pytestmark = pytest.mark.slow


def test_three_kills_change_nothing(tmp_path: Path, anny: object) -> None:
    recipe, undisturbed = tmp_path / "recipe.yaml", tmp_path / "undisturbed"
    write_recipe(recipe, n_clips=2, n_frames=5)
    begin_s = time.monotonic()
    loaded = load_recipe(recipe, SyntheticRecipe)
    render_set(loaded, undisturbed, run=Run(workers=1))
    write_set_pages(loaded, undisturbed)
    whole_s = time.monotonic() - begin_s
    killed = tmp_path / "killed"
    kills = kill_and_complete(recipe, killed, VICTIMS, whole_s / 2, np.random.default_rng(1))
    assert [kill.victim for kill in kills] == list(VICTIMS)
    expected = contents(undisturbed)
    assert "synthetic.yaml" in expected and "index.html" in expected
    for folder in (path for path in tmp_path.glob("killed*") if path.is_dir()):
        assert contents(folder) == expected
        assert leftovers(folder) == []
        check_manifest(folder / "synthetic.yaml")
