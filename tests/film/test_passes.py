"""Depth, normals and flow through their files."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmrdata.film.render_outputs import (
    read_depth,
    read_flow,
    read_instances,
    read_normals,
    write_depth,
    write_flow,
    write_instances,
    write_normals,
)
from gmrdata.values.errors import BadFrames

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_what_is_written_is_read(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("passes") / "00000.png"
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.05, 65.5, (5, 7))
    write_depth(path, depth_m)
    assert np.abs(read_depth(path) - depth_m).max() <= 0.0005 + 1e-9
    normals = rng.normal(size=(5, 7, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    write_normals(path, normals)
    assert np.abs(read_normals(path) - normals).max() <= 1 / 65535 + 1e-9
    flow_px = rng.uniform(-511, 511, (5, 7, 2))
    write_flow(path, flow_px)
    assert np.abs(read_flow(path) - flow_px).max() <= 1 / 128 + 1e-9
    instances = rng.integers(0, 256, (5, 7))
    write_instances(path, instances)
    assert read_instances(path).dtype == np.uint8
    np.testing.assert_array_equal(read_instances(path), instances)


def test_pixels_without_a_value(tmp_path: Path) -> None:
    path = tmp_path / "00000.png"
    write_depth(path, np.array([[1.0, np.inf, np.nan, 65.6, 1000.0]]))
    np.testing.assert_array_equal(read_depth(path), [[1.0, np.inf, np.inf, np.inf, np.inf]])
    write_normals(path, np.array([[[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]]))
    np.testing.assert_allclose(read_normals(path)[0], [[0, 0, -1], [0, 0, 0]], atol=1e-4)
    write_flow(path, np.array([[[1.5, -2.25], [np.nan, np.nan], [0.0, 513.0]]]))
    nan = np.nan
    np.testing.assert_array_equal(read_flow(path)[0], [[1.5, -2.25], [nan, nan], [nan, nan]])


def test_the_stored_numbers_are_those_that_the_format_names(tmp_path: Path) -> None:
    path = tmp_path / "00000.png"
    write_depth(path, np.array([[2.0004]]))
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[2000]]
    write_normals(path, np.array([[[1.0, 0.0, -1.0]]]))
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[[0, 32768, 65535]]]
    write_flow(path, np.array([[[1.0, -2.0]]]))  # KITTI: u, v, valid in red, green, blue
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).tolist() == [[[1, 32640, 32832]]]


def test_other_images_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "00000.png"
    with pytest.raises(BadFrames, match="00000.png: missing"):
        read_depth(path)
    cv2.imwrite(str(path), np.zeros((3, 3), np.uint8))
    with pytest.raises(BadFrames, match="16-bit"):
        read_depth(path)
    cv2.imwrite(str(path), np.zeros((3, 3), np.uint16))
    for read in (read_flow, read_normals):
        with pytest.raises(BadFrames, match="16-bit"):
            read(path)
    for wrong in (path, tmp_path / "absent.png"):
        with pytest.raises(BadFrames, match="8-bit"):
            read_instances(wrong)
