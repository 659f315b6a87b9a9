"""The lifter that travels with the package, its file, and how it reads a track."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.people.lifter import (
    N_FEATURES,
    RATE_HZ,
    WEIGHTS_FILE,
    WINDOW,
    Lifter,
    LifterConfig,
    lift,
    load_lifter,
    save_lifter,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.motion import Motion
from tests.people.exact import aligned_mm, seen_exactly, some_of

SMALL = LifterConfig(hidden=16, blocks=1)


def test_the_shipped_weights_are_small() -> None:
    assert WEIGHTS_FILE.stat().st_size <= 5_000_000


def test_exact_landmarks_give_about_the_pose(walk: Motion, anny: BodyModel) -> None:
    """It expects the network's errors, so it is no better than some centimetres without them."""
    found = lift(seen_exactly(walk, anny))
    assert aligned_mm(walk, anny, found.rotmats) < MOST_MM
    np.testing.assert_allclose(np.linalg.det(found.rotmats), 1, atol=1e-4)
    assert 0.6 < found.leg_m.mean() < 1.05


MOST_MM = 70.0


def test_left_is_left(walk: Motion, anny: BodyModel) -> None:
    """The mirrored walk, seen as somebody who walks the other way, is not the walk."""
    seen = seen_exactly(walk, anny)
    found = lift(seen)
    cosines = np.einsum("tij,tij->t", found.rotmats[:, 0], walk.root_rotmats)
    angles_deg = np.rad2deg(np.arccos(((cosines - 1) / 2).clip(-1, 1)))
    assert np.median(angles_deg) < 25


def test_a_part_of_a_track_has_the_same_poses_away_from_its_ends(
    walk: Motion, anny: BodyModel
) -> None:
    seen = seen_exactly(walk, anny)
    whole, part = lift(seen), lift(some_of(seen, slice(2, None)))
    far = int(WINDOW / RATE_HZ * walk.fps_hz / 2) + 2
    np.testing.assert_allclose(part.rotmats[far:-1], whole.rotmats[far + 2 : -1], atol=1e-5)


def test_a_single_frame_has_a_pose(walk: Motion, anny: BodyModel) -> None:
    found = lift(some_of(seen_exactly(walk, anny), slice(4, 5)))
    assert found.rotmats.shape == (1, 24, 3, 3) and np.isfinite(found.rotmats).all()


def test_what_is_before_a_long_gap_does_not_matter(walk: Motion, anny: BodyModel) -> None:
    seen = seen_exactly(walk, anny)
    late = replace(seen, times_s=seen.times_s + np.where(np.arange(walk.n_frames) >= 10, 5.0, 0))
    other = replace(
        late, rays=np.where(np.arange(walk.n_frames)[:, None, None] < 10, 0.3, late.rays)
    )
    np.testing.assert_allclose(lift(late).rotmats[12:], lift(other).rotmats[12:], atol=1e-6)


def test_weights_come_back(tmp_path: Path) -> None:
    torch.manual_seed(0)
    lifter = Lifter(SMALL).eval()
    save_lifter(tmp_path / "my.safetensors", lifter, SMALL)
    again = load_lifter(tmp_path / "my.safetensors")
    windows = torch.randn(2, WINDOW, N_FEATURES)
    for one, two in zip(lifter(windows), again(windows), strict=True):
        np.testing.assert_allclose(one.detach(), two.detach(), atol=2e-2)


@pytest.mark.parametrize("content", [b"", b"<html>404</html>" * 9])
def test_a_broken_file_is_told(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "my.safetensors"
    path.write_bytes(content)
    with pytest.raises(BadCheckpoint, match=r"my\.safetensors: not a lifter"):
        load_lifter(path)


def test_other_weights_are_told(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    save_file({"layer": torch.zeros(2)}, tmp_path / "my.safetensors")
    with pytest.raises(BadCheckpoint, match=r"my\.safetensors: not a lifter"):
        load_lifter(tmp_path / "my.safetensors")
