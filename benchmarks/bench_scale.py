"""Measure what many clips and many processes cost, and that shares lose nothing.

`make bench-scale` prints tables and writes out/bench/scale.json; `ARGS=--small` only tries every
part.  Each part is a module of `scale/` with a function that gives plain figures.
"""

import os
from pathlib import Path

import pytest
from record import OUT_DIR, Record, at_least, at_most
from render.tables import show
from scale import hosts, jobs, manifests, sharing

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "scale.json"


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    small = request.config.getoption("--small")
    return Record(OUT, small, lambda: {"small": small, "cores": os.cpu_count()})


def test_jobs(record: Record, tmp_path: Path) -> None:
    n = 200 if record.small else 10_000
    found = jobs.milliseconds(n, tmp_path)
    show(f"{n} empty jobs", [found])
    sizes = (20, 200) if record.small else (500, 5000)
    rows = [{"stages": k} | jobs.stage_milliseconds(k, tmp_path / f"{k}") for k in sizes]
    show("Empty stages in one folder", rows)
    record.add(**found, stages=rows)
    record.hold(
        [
            at_most("an empty job by Dask [ms]", found["job_ms_dask"], 15.0),
        ]
    )


def test_manifests(record: Record, tmp_path: Path) -> None:
    rows = [manifests.measured(n, tmp_path) for n in ((100, 2000) if record.small else manifests.N)]
    show("Manifests", rows)
    last = rows[-1]
    figures = {"manifest_100k_read_s": last["read_s"], "manifest_100k_mib": last["read_mib"]}
    record.add(manifests=rows, **figures)
    record.hold(
        [
            at_most("reading 100,000 clips [s]", last["read_s"], 20.0),
            at_most("memory for that [MiB]", last["read_mib"], 1024.0),
            at_most("checking 100,000 clips without files [s]", last["check_s"], 60.0),
        ]
    )


def test_shards(record: Record, tmp_path: Path, cmu_dir: Path) -> None:
    n = 8 if record.small else 200
    motions = sharing.motion_files(cmu_dir / "bvh", tmp_path / "motions", n)
    killed = sharing.killed_and_started_again(motions, tmp_path)
    found = killed | sharing.speedups(motions, tmp_path)
    show(f"{n} motions in shares", [found])
    record.add(**found)
    record.hold(
        [
            at_least("bytes of four shares, one killed, are those of one process",
                     float(found["shard_bytes_equal"]), 1.0),
            at_least("two processes beside one", found["two_process_speedup"], 1.7),
        ]
    )  # fmt: skip


def test_hosts(record: Record, tmp_path: Path, cmu_dir: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root, for network namespaces")
    motions = sharing.motion_files(cmu_dir / "bvh", tmp_path / "motions", 40)
    names = list(hosts.FAULTS)[:1] if record.small else list(hosts.FAULTS)
    with hosts.network():
        expected = hosts.undisturbed(motions, tmp_path / "undisturbed")
        rows = [
            hosts.survived(name, motions, expected, tmp_path / f"fault{number}")
            for number, name in enumerate(names)
        ]
    show("Three hosts", rows)
    n_survived = sum(bool(row["survived"]) for row in rows)
    record.add(hosts=rows, host_faults_survived=n_survived, host_faults_tried=len(rows))
    record.hold([at_least("faults of three hosts survived", n_survived, len(rows))])
