"""How long a rerun takes in which nothing changed: inputs hashed again by each stage, or known.

Writes 8 folders of 150 files of 250 kB to the temporary folder, and lets 4 stages read each of
them, as those of a sequence do.  Prints the seconds of three reruns: one that knows the files from
the run before, one that hashes each file once (`--redo`), and one that hashes it for each stage.
"""

import time
from pathlib import Path

import numpy as np
import pytest

from gmrdata.stage import store
from gmrdata.stage.progress import answers
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.records import Config

pytestmark = pytest.mark.bench
N_SEQUENCES, N_FRAMES, FRAME_BYTES = 8, 150, 250_000
STAGES = ("people", "masks_by", "masks", "sfm")
LEAST_RATIO = 3.0


def write_frames(root: Path) -> list[Path]:
    """Folders of files that hold noise."""
    rng = np.random.default_rng(0)
    folders = [root / f"sequence_{number}" / "frames" for number in range(N_SEQUENCES)]
    for folder in folders:
        folder.mkdir(parents=True)
        for row in range(N_FRAMES):
            (folder / f"{row:05d}.jpg").write_bytes(rng.bytes(FRAME_BYTES))
    return folders


def seconds_of(folders: list[Path], run: Run, *, once: bool = True) -> float:
    """Wall time of all stages in a new process [s]; not `once`: each stage forgets as well."""
    store._HASHED.clear()
    start_s = time.perf_counter()
    for folder in folders:
        for name in STAGES:
            if not once:
                store._HASHED.clear()
            out_dir = folder.with_name(name)
            run_stage(name, out_dir, Config(), {"images": folder}, lambda _: None, run=run)
    return time.perf_counter() - start_s


def test_a_rerun_reads_no_frame_again(tmp_path: Path) -> None:
    folders = write_frames(tmp_path)
    time.sleep(2 * store.FRESH_NS / 1e9)
    seconds_of(folders, DEFAULT_RUN)
    known_s, once_s, each_s = [
        min(seconds_of(folders, run, once=once) for _ in range(3))
        for run, once in ((DEFAULT_RUN, True), (Run(redo=True), True), (Run(redo=True), False))
    ]
    answers.print(
        f"known {known_s:.2f} s, hashed once {once_s:.2f} s, hashed by each stage {each_s:.2f} s: "
        f"{each_s / known_s:.1f} times as long"
    )
    assert each_s / known_s >= LEAST_RATIO
