"""Files that can't be written whole, as on a full disk: an error names each, and none passes."""

import pickle  # noqa: TID251  A take goes to another process.
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.write.cameras import ColmapPoints, write_colmap
from gmrdata.write.glb import write_glb
from gmrdata.write.take import Take
from gmrdata.write.usd import write_usd
from tests.write.takes import N_FRAMES


@contextmanager
def small_files() -> Iterator[None]:
    """No file may be longer than some thousand bytes."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def colmap(path: Path, take: Take) -> None:
    """With points enough for a long file."""
    assert take.camera is not None
    rows = np.flatnonzero(take.camera.has_camera).repeat(100)
    points = ColmapPoints(
        np.ones((len(rows), 3)), rows, np.arange(len(rows)), np.ones((len(rows), 2))
    )
    write_colmap(path, take.camera, [f"{row}.jpg" for row in range(N_FRAMES)], points)


def glb(path: Path, take: Take) -> None:
    write_glb(path, take.people[0].motion, take.people[0].body)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.usdc", write_usd),
        ("a.glb", glb),
        ("model", colmap),
    ],
)
def test_what_does_not_fit_is_an_error(name, write, take, tmp_path):
    """COLMAP's own writer ended as if all was well, and left a model that was cut off."""
    with small_files(), pytest.raises(OSError) as caught:
        write(tmp_path / name, take)
    assert caught.value.strerror
    assert not (tmp_path / name).is_file()


def test_a_recording_that_does_not_fit_is_an_error(take, tmp_path):
    """Rerun's own end waited without end, or ended as if all was well.  It is longer than a pipe
    holds, and is written in another process, whose waiting would have an end."""
    code = """
import pickle, sys
from pathlib import Path
from gmrdata.write.recording import write_recording
from tests.write.test_full_disk import small_files
with small_files():
    write_recording(Path(sys.argv[1]), [pickle.load(sys.stdin.buffer)])
"""
    long = replace(take, points_m=np.random.default_rng(0).normal(size=(200_000, 3)))
    command = [sys.executable, "-c", code, str(tmp_path / "a.rrd")]
    done = subprocess.run(command, input=pickle.dumps(long), capture_output=True, timeout=60)
    assert b"OSError: [Errno 27] File too large" in done.stderr
    assert not list(tmp_path.iterdir())
