"""Tables 5, 6 and 10 of the paper with the built-in estimator in VIBE's place, and frozen people.

`make bench-tables` runs this file alone; `--small` only tries every part.  The clips are Table 8's
trials that are at hand, rendered with the camera's motion on and off.  GMR is the network of the
package, or that of `--gmr RUN`; it was not trained on subjects 02 and 08.  The
non-sequential model is trained on videos that the command renders, or on twins of `--twins`.  What
is there is made again only where it hangs on a network that has changed, so the same command
measures a new network in minutes.  Prints tables and writes out/bench/tables.json.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record import OUT_DIR, at_least, at_most
from render.tables import show
from tables.session import TablesSession, as_far_as_seen, figures

from gmrdata.manifest.read import load_clips
from gmrdata.stage.progress import answers
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.twins.floor import REGENERATED_FOLDER, floor_of_twins
from gmrdata.twins.floor_record import Floor
from gmrdata.twins.pseudo_gt_error import FPS_HZ
from gmrdata.twins.twin_set import SET_FOLDER, TwinRecipe, make_twins
from gmrdata.values.clip import Clip
from gmrdata.values.motion import deltas
from gmrdata.values.transforms import angles_rad

pytestmark = pytest.mark.bench
MOST_DEG, MOST_MM = 0.3, 10.0
"""What frozen people may move in the world with recovered cameras, over a tenth of a second."""


@pytest.fixture(scope="module")
def session(request: pytest.FixtureRequest) -> TablesSession:
    return TablesSession(
        small=request.config.getoption("--small"),
        twins_given=request.config.getoption("--twins"),
        network_given=request.config.getoption("--gmr"),
        cmu_dir=lambda: request.getfixturevalue("cmu_dir"),
        models_dir=lambda: request.getfixturevalue("shared_data") / "models",
    )


def test_frozen_people(session: TablesSession) -> None:
    twins = frozen_twins(session.small)
    recipe = load_recipe(find_recipe("threedpw"), ThreedpwRecipe)
    floor = Floor.read(floor_of_twins(twins, recipe, twins.with_name("floor")).path)
    rows = [
        {
            "sequence": one.id,
            "camera": one.class_true,
            "accepted": one.accepted,
            "turn [deg]": one.ome_deg,
            "way [mm]": one.tme_mm,
            "scale error [%]": one.scale_error_percent,
            "kept share": one.kept_share,
        }
        for one in floor.sequences
    ]
    show("Frozen people: how they move in the world, over 0.1 s, with recovered cameras", rows)
    people = [
        largest_motion(clip)
        for clip in load_clips(twins.with_name("floor") / REGENERATED_FOLDER / "pseudo_gt.yaml")
    ]
    show("The largest motion of each of them over 0.1 s", people)
    every = twins / SET_FOLDER / "synthetic.yaml"
    seen = session.seen(every, "frozen")
    table = session.table("5", as_far_as_seen(every, seen), seen, name="frozen")
    others = [{key: row[key] for key in ("row", "ome_deg", "tme_mm")} for row in figures(table)]
    show("The same people without cameras", others)
    session.record.add(frozen=rows, frozen_largest=people, frozen_without_cameras=others)
    turn_deg = worst([one.ome_deg for one in floor.sequences])
    way_mm = worst([one.tme_mm for one in floor.sequences])
    session.record.hold(
        [
            at_most("frozen people's turn [deg]", turn_deg, MOST_DEG),
            at_most("frozen people's way [mm]", way_mm, MOST_MM),
            at_least("frozen sequences accepted", floor.overall.accepted, len(floor.sequences)),
        ]
    )


def largest_motion(clip: Clip) -> dict[str, Any]:
    """Over 0.1 s, between kept frames, in all phases."""
    step = round(clip.motion.fps_hz / FPS_HZ)
    firsts = np.arange(clip.motion.n_frames - step)
    kept = np.all([clip.valid[firsts + shift] for shift in range(step + 1)], axis=0)
    pairs = np.stack([firsts[kept], firsts[kept] + step], axis=1)
    turns, ways_m = deltas(clip.motion.root_rotmats[pairs], clip.motion.pelvis_m[pairs])
    return {
        "person": clip.id,
        "motions": len(pairs),
        "largest turn [deg]": largest(np.rad2deg(angles_rad(turns))),
        "largest way [mm]": largest(1000 * np.linalg.norm(ways_m, axis=-1)),
    }


def largest(values: np.ndarray) -> float | None:
    """None of a person of whom no motion is kept."""
    return float(values.max()) if values.size else None


def worst(values: list[float | None]) -> float | None:
    """The largest; None where one is not known."""
    known = [value for value in values if value is not None]
    return max(known) if len(known) == len(values) else None


def frozen_twins(small: bool) -> Path:
    """The twins of `twins_frozen`; short ones where only the parts are tried."""
    recipe = load_recipe(find_recipe("twins_frozen"), TwinRecipe)
    folder = (OUT_DIR / f"frozen{'_small' if small else ''}" / "twins").resolve()
    if small:
        clip = recipe.set.clips[-1].model_copy(update={"duration_s": 0.8})
        part = recipe.set.model_copy(update={"clips": (clip,)})
        recipe = recipe.model_copy(update={"set": part})
    make_twins(recipe, folder)
    return folder


def test_table_5(session: TablesSession) -> None:
    keep(session, "5", session.moving)


def test_table_6(session: TablesSession) -> None:
    keep(session, "6", session.scored)


def test_table_10(session: TablesSession) -> None:
    keep(session, "10", session.moving, videos=(session.training,), features=session.features())


def keep(session: TablesSession, number: str, scored: Path, **given: Any) -> None:
    """Make a table, show it, and write it down."""
    table = session.table(number, scored, session.seen(session.scored, "scored"), **given)
    rows = figures(table)
    show(f"Table {number}: {table.title}", rows)
    for line in table.statements:
        answers.print(line, soft_wrap=True)
    session.record.add(
        **{
            f"table{number}": {
                "rows": rows,
                "data": table.data.model_dump(mode="json"),
                "statements": list(table.statements),
            }
        }
    )
    assert not table.lacking
