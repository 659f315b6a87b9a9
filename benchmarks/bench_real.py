"""Measure the COLMAP stage on real clips with known cameras, beside plain pycolmap, and broken.

`make bench-real ARGS='--clips FOLDER'` runs this file alone; `real/layout.py` makes the folder.
`--small` tries one case of each group, `-k focal-dance0` picks cases by name, `--ours-alone` leaves
plain pycolmap out.  A case is kept in out/bench/real.jsonl as soon as it is done, and `--resume`
takes up what the same code found before.  Prints a table and writes out/bench/real.json.
"""

import pytest
from real.bars import real_bars
from real.cases import Case, clip_cases, fault_cases, small
from real.session import RealSession
from render.tables import show

pytestmark = pytest.mark.bench
CASES = [*clip_cases(), *fault_cases()]
SMALL = {case.name: case for case in small(CASES)}
COLUMNS = ("name", "accepted", "right", "cameras", "frames", "ate_mm", "rpe_mm", "rpe_deg",
           "again_deg", "again_share", "plain_ate_mm", "speedup", "seconds")  # fmt: skip


def test_clips_are_there(real: RealSession) -> None:
    real.require_clips()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(real: RealSession, case: Case) -> None:
    if real.small and case.name not in SMALL:
        pytest.skip("one of each group is enough to try every part")
    row = real.measure(SMALL[case.name] if real.small else case)
    show(case.name, [{key: row.get(key) for key in COLUMNS[1:]}])
    if row["reasons"]:
        show("Reasons", [{"rejected for": reason} for reason in row["reasons"]])


def test_bars(real: RealSession) -> None:
    show("Real clips", [{key: row.get(key) for key in COLUMNS} for row in real.rows.values()])
    summary = real.summary()
    show("Together", [summary])
    real.record.hold(list(real_bars(CASES, real.rows, summary)))
