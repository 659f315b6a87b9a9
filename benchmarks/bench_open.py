"""Measure what the toolkit makes of other people's files, and they of its own.

`make bench-open ARGS='--bvh FOLDER'` reads the BVH files of a folder, which everyone fetches for
themselves; `--released FOLDER` names clones of evaluators, `yohanshin+WHAM` and the like.  Each
part is a module of `open/` with a function that gives plain figures.  Prints
tables and writes out/bench/open.json.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from open import bvh, colmap, protocols, round_trips
from record import OUT_DIR, Record, at_least, at_most
from render.tables import show

from gmrdata.read.bodies import load_body
from gmrdata.score.clip_errors import foot_vertices
from gmrdata.values.body import BodyModel

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "open.json"
FEWEST_FILES, FEWEST_RIGHT = 20, 18
BVH_COLUMNS = ("file", "found", "names", "frames", "fps_hz", "up", "limbs_deg", "hips_deg",
               "shoulders_deg", "trunk_deg", "hands_deg", "feet_deg", "why")  # fmt: skip


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    small = request.config.getoption("--small")
    return Record(OUT, small, lambda: {"small": small, "body": "anny"})


def keep(record: Record, figures: Mapping[str, Any]) -> None:
    """Add figures of one part; of `..._max` that several parts have, the largest counts."""
    content = record.content
    largest = {
        key: max(value, content.get(key, value))
        for key, value in figures.items()
        if key.endswith("_max")
    }
    record.add(**{**figures, **largest})


def test_bvh_files(request: pytest.FixtureRequest, record: Record) -> None:
    folder = request.config.getoption("--bvh")
    if folder is None:
        pytest.skip("ARGS='--bvh FOLDER' names a folder of BVH files")
    body = load_body("anny")
    rows = [bvh.measured(path, body) for path in sorted(folder.rglob("*.bvh"))]
    show("BVH files", [{key: row.get(key) for key in BVH_COLUMNS} for row in rows])
    counts = bvh.figures(rows)
    keep(record, counts | {"bvh": rows})
    record.hold(
        [
            at_least("BVH files that were tried", counts["bvh_tried"], FEWEST_FILES),
            at_least("read right", counts["bvh_right"], FEWEST_RIGHT),
            at_most("read wrongly", counts["bvh_wrong"], 0),
        ]
    )


def test_round_trips(record: Record, cmu_dir: Path, small_body: BodyModel, tmp_path: Path) -> None:
    files = sorted(cmu_dir.glob("bvh/*.bvh"))[:: 45 if record.small else 5]
    rows = round_trips.measured(files, small_body, tmp_path)
    show("There and back", rows)
    found = round_trips.figures(rows)
    keep(record, found | {"round_trips": rows})
    record.hold(
        [
            at_most("joints after a round trip [mm]", found["round_trip_mm_max"], 0.1),
            at_most("rotations after a round trip [deg]", found["round_trip_deg_max"], 0.01),
        ]
    )


def test_protocols(
    request: pytest.FixtureRequest, record: Record, small_body: BodyModel, tmp_path: Path
) -> None:
    folder = request.config.getoption("--released")
    if folder is None:
        pytest.skip("ARGS='--released FOLDER' names a folder of clones of evaluators")
    found = protocols.compared(folder, small_body, foot_vertices(small_body), tmp_path)
    show("Protocols beside released code", found["protocols"])
    keep(record, found)
    largest = found["protocol_difference_max"]
    record.hold([at_most("relative difference to released figures", largest, 1e-6)])


def test_colmap_models(made_set: Path, record: Record, tmp_path: Path) -> None:
    found = colmap.compared(made_set, tmp_path)
    show("Mean reprojection error", found["reprojection"])
    keep(record, found)
    share = found["reprojection_difference_share"]
    record.hold([at_most("COLMAP's mean error beside the stage's", share, 0.01)])
