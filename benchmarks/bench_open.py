"""Measure what the toolkit makes of other people's files, and they of its own.

`make bench-open ARGS='--bvh FOLDER'` reads the BVH files of a folder, which everyone fetches for
themselves.  Each part is a module of `open/` with a function that gives plain figures.  Prints
tables and writes out/bench/open.json.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from open import bvh
from record import Record, at_least, at_most
from render.tables import show

from gmrdata.read.bodies import load_body

pytestmark = pytest.mark.bench
OUT = Path("out/bench/open.json")
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
