"""Train the bundled GMR's recipe without two people at a time, and score it on those two.

`make bench-folds` runs this file alone; `--small` only tries every part.  The people are the
subjects of the CMU motions at hand, in the order of their numbers: first and second, third and
fourth, and so on.  Each fold trains on all others, 02 and 08 too where they are not its own.  A
fold's scores are over all motions of both people at 10 fps with true local poses, as shares of the
errors of zero motion; a trial of the paper's Table 8 is scored and never trained on.  No two of the
subjects have the same bones, so none is known to be one person under two numbers.  Writes
out/bench/folds.json.  A run that was stopped goes on with the next fold: its trainings lie in
out/bench/folds.
"""

import subprocess
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest
from gmr.cmu_ablation import changed
from gmr.cmu_data import import_motions, scored_motions
from gmr.cmu_runs import Trained, trained
from gmr.cmu_session import SMALL_SIZE
from gmr.honesty import honesty_rows, least_shares
from record import OUT_DIR, Record, at_least, at_most
from render.tables import show

from gmrdata.fusion.network_errors import held_out_motions
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.train import GmrRecipe
from gmrdata.manifest.read import read_manifest
from gmrdata.stage.recipes import find_recipe, load_recipe

pytestmark = pytest.mark.bench
MOST_OME, MOST_TME, WORST_TME = 0.34, 0.27, 0.50


@pytest.fixture(scope="session")
def cmu_more_dir(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """CMU's subjects 07, 49 and 127, unpacked."""
    root = tmp_path_factory.mktemp("cmu")
    subprocess.run(["bash", str(shared_data / "unpack"), str(root), "more"], check=True)
    return root / "cmu-more"


def test_people_left_out_two_at_a_time(
    request: pytest.FixtureRequest, cmu_dir: Path, cmu_more_dir: Path
) -> None:
    small = request.config.getoption("--small")
    recipe = load_recipe(find_recipe("gmr_bundled"), GmrRecipe).train
    config = changed(recipe, SMALL_SIZE) if small else recipe
    name = "cmu_people_small" if small else "cmu_people"
    every = import_motions([cmu_dir, cmu_more_dir], (OUT_DIR / name).resolve(), small=small)
    folds = pairs(every)
    settings = {"recipe": recipe.model_dump(mode="json")}
    record = Record(OUT_DIR / "folds.json", small, lambda: settings)
    runs = [fold(every, config, pair, OUT_DIR / "folds") for pair in folds[: 2 if small else None]]
    rows = [run.row for run in runs]
    show("People left out, two at a time", rows)
    figures = summary(rows)
    honesty = []
    if not small:  # a few short clips are too little to fit errors to
        honesty = honesty_rows({run.name: held_out_motions(run.run_dir, [every]) for run in runs})
        show("Errors within the error bars that the other folds give [%]", honesty)
    record.add(folds=rows, honesty=honesty, **figures)
    within_one, within_two = least_shares(honesty) if honesty else (0.0, 0.0)
    record.hold(
        [
            at_least("folds", len(rows), 10),
            at_most("ome_ratio", figures["ome_ratio"], MOST_OME),
            at_most("tme_ratio", figures["tme_ratio"], MOST_TME),
            at_most("tme_ratio_worst", figures["tme_ratio_worst"], WORST_TME),
            at_least("errors within one standard deviation [%]", within_one, 60),
            at_least("errors within two standard deviations [%]", within_two, 90),
        ]
    )


def pairs(every: Path) -> list[tuple[int, ...]]:
    """The subjects of a manifest, two at a time."""
    numbers = sorted(
        {int(clip.source.sequence.split("_")[0]) for clip in read_manifest(every).clips}
    )
    return [tuple(numbers[i : i + 2]) for i in range(0, len(numbers), 2)]


def fold(every: Path, config: TrainConfig, pair: tuple[int, ...], out_dir: Path) -> Trained:
    """A network, and its scores on two people on whom it was not trained."""
    data = config.data.model_copy(update={"held_out_subjects": pair})
    config = config.model_copy(update={"data": data})
    name = "subjects " + " and ".join(f"{subject:02d}" for subject in pair)
    return trained(name, scored_motions(every, config, pair), config, out_dir)


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Means over the folds, each fold alike, and the worst fold."""
    tme = [row["tme_of_zero"] for row in rows]
    return {
        "ome_ratio": round(fmean(row["ome_of_zero"] for row in rows), 4),
        "tme_ratio": round(fmean(tme), 4),
        "tme_ratio_worst": max(tme),
    }
