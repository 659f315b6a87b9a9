"""Changed files for every reader: `make fuzz`; `ARGS='--minutes 10'` says how long.

Seeds are small files as the tests write them.  Writes out/bench/fuzz.json, and the files of what
was found to out/bench/fuzz/found.  `GMRDATA_SEED` repeats the inputs of a run.
"""

import os
import secrets
from collections.abc import Sequence
from pathlib import Path

import pytest
from fuzz import runs, targets
from record import OUT_DIR, Record, at_least, at_most

from gmrdata.read.threedpw_files import SequenceArrays
from gmrdata.stage.progress import answers
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "fuzz.json"
INPUTS_A_MINUTE = 1000


def test_fuzz(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    small_body: BodyModel,
    walkers: Sequence[Clip],
    walk_arrays: SequenceArrays,
    write_person: object,
) -> None:
    small = request.config.getoption("--small")
    minutes = 0.2 if small else float(request.config.getoption("--minutes"))
    seed = int(os.environ.get("GMRDATA_SEED", secrets.randbits(32)))
    answers.print(f"seed {seed}: GMRDATA_SEED={seed} repeats these inputs")
    made = targets.targets(tmp_path, small_body, walkers, walk_arrays, write_person)
    for target in made:
        runs.without_changes(target, tmp_path / "unchanged" / target.name)
    only = request.config.getoption("--target")
    chosen = [target for target in made if only in (None, target.name)]
    workers = os.cpu_count() or 1
    folder = OUT.parent / "fuzz"
    counts, findings = runs.run(chosen, folder, seed, 60 * minutes, workers)
    inputs = sum(counts.values())
    record = Record(OUT, small, lambda: {"minutes": minutes, "seed": seed, "cores": workers})
    record.add(
        inputs=inputs,
        findings=len(findings),
        targets=counts,
        kinds=[vars(one) for one in runs.families(findings)],
    )
    answers.print(f"{inputs} inputs, {len(findings)} findings")
    record.hold(
        [
            at_least("inputs", inputs, INPUTS_A_MINUTE * minutes),
            at_most("findings", len(findings), 0),
        ]
    )
