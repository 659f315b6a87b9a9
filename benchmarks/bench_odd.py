"""Run the files of public reports through the command line, as each one's README says.

`make bench-odd` reads the files of `odd/` beside the other real data; `ARGS='-k mkv'` picks some.
Prints a table and writes out/bench/odd.json: how many were `tried`, came out `right`, were
`refused_rightly` (with the error that was asked for) or `wrong`, and of each what happened.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from odd.cases import CASES
from odd.run import Case, tried
from record import OUT_DIR, Record, at_most
from render.tables import show

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "odd.json"
ENDS = ("right", "refused_rightly", "wrong")


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    return Record(OUT, bool(request.config.getoption("--small")), dict)


@pytest.fixture(scope="module")
def rows() -> list[dict[str, str]]:
    return []


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.folder}/{case.file}")
def test_odd(
    case: Case,
    record: Record,
    rows: list[dict[str, str]],
    shared_path: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    folder = tmp_path / case.folder
    shutil.copytree(shared_path(f"odd/{case.folder}"), folder)
    end, what = tried(case, folder, shared_path("models"))
    rows.append({"folder": case.folder, "file": case.file, "end": end, "what": what})
    counts = {one: sum(row["end"] == one for row in rows) for one in ENDS}
    record.add(tried=len(rows), **counts, inputs=rows)
    assert end != "wrong", what


def test_none_was_wrong(record: Record, rows: list[dict[str, str]]) -> None:
    show("Odd files", rows)
    record.hold([at_most("wrong", sum(row["end"] == "wrong" for row in rows), 0)])
