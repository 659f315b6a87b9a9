"""Kill, fill and unplug, again and again, and compare the bytes with those of undisturbed runs.

`make soak` takes an hour, `ARGS='--hours 8'` longer.  In turn it runs motions in shards, render,
threedpw, train, and evaluate at small sizes, and as root motions on three hosts too.  Each run is
hit by a fault at a random moment and started again until it ends well.  Then all of its files must
be those of the undisturbed run.  Writes out/bench/soak.json; the seed is new each time and in it.
"""

import os
import secrets
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from film.set_kills import write_recipe
from record import Record, at_least, at_most
from scale import hosts, sharing
from soak.faults import FAULTS, Hit, end_well, in_turn
from soak.works import Work, contents_of

from gmrdata.manifest.read import read_manifest
from gmrdata.stage.progress import answers

pytestmark = pytest.mark.bench
OUT = Path("out/bench/soak.json")
FAULTS_AN_HOUR = 200
GMR = {
    "model": {"layers": 1, "hidden": 16}, "loss": {"n_vertices": 20}, "steps": 120, "seed": 3,
    "checkpoint_every": 10, "batch_size": 8, "windows": {"frames": 16},
}  # fmt: skip


@pytest.fixture(scope="module")
def works(
    tmp_path_factory: pytest.TempPathFactory,
    cmu_dir: Path,
    filmed_set: object,
    small_body: object,
) -> list[Work]:
    """The verbs, each with its input made."""
    root = tmp_path_factory.mktemp("input")
    motions = sharing.motion_files(cmu_dir / "bvh", root / "motions", 12)
    write_recipe(root / "set.yaml", n_clips=2, n_frames=5)
    recipe = filmed_set.recipe(recipe="threedpw", workers=2)  # type: ignore[attr-defined]
    (root / "threedpw.yaml").write_text(yaml.safe_dump(recipe.model_dump(mode="json")))
    (root / "gmr.yaml").write_text(yaml.safe_dump({"recipe": "gmr", "train": GMR}))
    library = Work("motions", ("motions", str(motions)), root / "library")
    assert end_well(library.start()) == 0
    manifest = root / "library" / "motions.yaml"
    assert len(read_manifest(manifest).clips) == 12
    trained = Work(
        "train", ("train", str(manifest), "--recipe", str(root / "gmr.yaml")), root / "run"
    )
    assert end_well(trained.start()) == 0
    data = filmed_set.root  # type: ignore[attr-defined]
    return [
        Work("shards", ("motions", str(motions)), shards=2),
        Work("render", ("render", str(root / "set.yaml"))),
        Work("threedpw", ("threedpw", "regenerate", "--root", str(data),
                          "--recipe", str(root / "threedpw.yaml"))),
        Work("train", trained.command),
        Work("evaluate", ("evaluate", str(root / "run"), str(manifest))),
    ]  # fmt: skip


def test_soak(
    request: pytest.FixtureRequest, works: list[Work], tmp_path: Path, cmu_dir: Path
) -> None:
    small = request.config.getoption("--small")
    hours = 0.01 if small else float(request.config.getoption("--hours"))
    seed = int(os.environ.get("GMRDATA_SEED", secrets.randbits(32)))
    rng = np.random.default_rng(seed)
    record = Record(OUT, small, lambda: {"hours": hours, "seed": seed, "cores": os.cpu_count()})
    expected = {}
    for work in works:
        whole = work.into(tmp_path / f"undisturbed_{work.name}" / "out")
        started_s = time.monotonic()
        assert end_well(whole.start()) == 0, whole.said()
        expected[work.name] = contents_of(whole.out), time.monotonic() - started_s
    hits: list[Hit] = []
    lost, different, loops, begin_s = 0, 0, 0, time.monotonic()
    while time.monotonic() - begin_s < 3600 * hours:
        for work, fault in in_turn(works, FAULTS, rng):
            if time.monotonic() - begin_s > 3600 * hours:
                break
            wanted, whole_s = expected[work.name]
            mine = work.into(tmp_path / "now" / "out")  # the name of a folder is in manifests
            hits += fault(mine, whole_s, rng)
            ended = any(end_well(mine.start()) == 0 for _ in range(3))
            found = contents_of(mine.out)
            lost += not ended or bool(wanted.keys() - found.keys())
            different += found != wanted
            if found != wanted:
                shutil.move(mine.out, tmp_path / f"different_{len(hits)}")
                answers.print(f"{work.name}: files differ after {hits[-1]}")
            mine.clear()
            record.add(
                faults=len(hits), survived=len(hits) - different, lost=lost, different=different,
                loops=loops, hits=[hit._asdict() for hit in hits],
            )  # fmt: skip
        loops += 1
    if os.geteuid() == 0 and not small:
        hits_of_hosts(tmp_path, cmu_dir, record)
    answers.print(
        f"{len(hits)} faults in {(time.monotonic() - begin_s) / 3600:.2f} h: "
        f"{len(hits) - different} survived, {lost} lost, {different} with different bytes"
    )
    record.hold(
        [
            at_least("faults", len(hits), FAULTS_AN_HOUR * hours),
            at_most("lost", lost, 0),
            at_most("different", different, 0),
        ]
    )


def hits_of_hosts(tmp_path: Path, cmu_dir: Path, record: Record) -> None:
    """The faults of three hosts, once."""
    motions = sharing.motion_files(cmu_dir / "bvh", tmp_path / "of_hosts", 40)
    with hosts.network():
        expected = hosts.undisturbed(motions, tmp_path / "hosts")
        rows = [
            hosts.survived(name, motions, expected, tmp_path / f"hosts{number}")
            for number, name in enumerate(hosts.FAULTS)
        ]
    record.add(hosts=rows)
    record.hold([at_least("faults of hosts survived", sum(bool(row["survived"]) for row in rows),
                          len(rows))])  # fmt: skip
