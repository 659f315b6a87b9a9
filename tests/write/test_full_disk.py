"""Files that can't be written whole, as on a full disk: an error names each, and none passes."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
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
