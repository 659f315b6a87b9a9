"""The files of a reconstruction: each key is needed, and older versions are refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.cameras.files import (
    _CAMERA_SHAPES,
    CAMERAS_FILE,
    POINTS_FILE,
    QUALITY_FILE,
    Agreement,
    Distortion,
    ModelRecord,
    SfmCameras,
    Smoothing,
    SmoothPlace,
    SmoothTurn,
    WeakestStep,
    load_cameras,
    load_points,
    load_quality,
    save_cameras,
    save_points,
)
from gmrdata.cameras.match.tracks import Tracks
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadRecord
from tests.reconstructions import good_quality
from tests.record_keys import assert_each_key_is_needed

QUALITY = good_quality(
    5,
    models=(ModelRecord(5, True, "the largest"),),
    smoothing=Smoothing(SmoothTurn(0.05, 0.004, 0.03, 0.5), SmoothPlace(8e-4, 6e-5, 6e-4, 0.5)),
    focal_factor=1.01,
    focal_sigma=0.02,
    weakest_step=WeakestStep(2, 4, 0.0003, 0.04, 1.2),
    second_share=1.0,
    agreement=Agreement(3, 0.05, 0.004),
    radial_k1=0.013,
    radial_k1_sigma=0.009,
    lens=Distortion(0.042, -0.05, 0.06),
)
CAMERAS = SfmCameras(
    CameraPath(np.eye(3), 4, 3, np.tile(np.eye(4), (5, 1, 1)), np.ones(5, dtype=bool)),
    "full",
    np.arange(5),
    np.arange(5) == 1,
)


def without_array(path: Path, key: str) -> None:
    arrays = dict(np.load(path))
    np.savez(path, **{name: array for name, array in arrays.items() if name != key})


def test_figures_come_back(tmp_path):
    QUALITY.write(tmp_path / QUALITY_FILE)
    assert load_quality(tmp_path) == QUALITY


def test_what_is_said_of_the_lens():
    focal, k1, taken_out = QUALITY.lens_in_words
    assert focal[1] == "1.01 ± 0.02" and k1[1] == "0.013 ± 0.009"
    assert taken_out[1] == "k1 0.042, k2 -0.05"
    assert QUALITY.model_copy(update={"lens": None}).lens_in_words == [focal, k1]


def test_each_figure_is_needed_and_named(tmp_path):
    assert_each_key_is_needed(QUALITY, tmp_path / QUALITY_FILE)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"reprojection_px": 55.0}, "unknown key `reprojection_px`"),
        ({"evidence": QUALITY.model_dump(mode="json")["evidence"] | {"x": 1}}, "`evidence.x`"),
        ({"mean_reprojection_px": float("nan")}, "`mean_reprojection_px` is wrong"),
        ({"mean_reprojection_px": None}, "`mean_reprojection_px` is wrong"),
        ({"registered_share": None}, "`registered_share` is wrong"),
        ({"inliers_per_frame": [200] * 4}, "4 inliers_per_frame, but 5 frames"),
        ({"focal_sigma": None}, "focal_factor and focal_sigma"),
        ({"radial_k1": None}, "radial_k1 and radial_k1_sigma"),
        ({"geometry": "bent"}, "`geometry` is wrong"),
    ],
)
def test_figures_that_cannot_be(tmp_path, changes, said):
    text = json.dumps(QUALITY.model_dump(mode="json") | changes)
    (tmp_path / QUALITY_FILE).write_text(text)
    with pytest.raises(BadRecord, match=said):
        load_quality(tmp_path)


def test_cameras_come_back(tmp_path):
    save_cameras(tmp_path / CAMERAS_FILE, CAMERAS)
    found = load_cameras(tmp_path)
    assert found.geometry == "full" and (found.path.width_px, found.path.height_px) == (4, 3)
    assert np.array_equal(found.path.world_from_cam, CAMERAS.path.world_from_cam)
    assert np.array_equal(found.image_numbers, CAMERAS.image_numbers)
    assert np.array_equal(found.interpolated, CAMERAS.interpolated)


@pytest.mark.parametrize("key", ["format", *_CAMERA_SHAPES])
def test_each_array_of_the_cameras_is_needed_and_named(tmp_path, key):
    save_cameras(tmp_path / CAMERAS_FILE, CAMERAS)
    without_array(tmp_path / CAMERAS_FILE, key)
    with pytest.raises(BadRecord, match=rf"cameras\.npz: has no .*{key}.*--redo"):
        load_cameras(tmp_path)


@pytest.mark.parametrize("key", ["format", "xyz", "track_lengths"])
def test_each_array_of_the_points_is_needed_and_named(tmp_path, key):
    save_points(tmp_path / POINTS_FILE, np.ones((2, 3)), np.array([3, 4]))
    assert np.array_equal(load_points(tmp_path), np.ones((2, 3)))
    without_array(tmp_path / POINTS_FILE, key)
    with pytest.raises(BadRecord, match=rf"points\.npz: has no .*{key}.*--redo"):
        load_points(tmp_path)


def test_arrays_that_do_not_fit_are_named(tmp_path):
    save_points(tmp_path / POINTS_FILE, np.ones((2, 3)), np.array([3, 4, 5]))
    with pytest.raises(BadRecord, match=r"'track_lengths' has shape \(3,\)"):
        load_points(tmp_path)
    save_cameras(tmp_path / CAMERAS_FILE, CAMERAS)
    arrays = dict(np.load(tmp_path / CAMERAS_FILE))
    np.savez(tmp_path / CAMERAS_FILE, **(arrays | {"geometry": "bent"}))
    with pytest.raises(BadRecord, match="unknown geometry 'bent'"):
        load_cameras(tmp_path)


@pytest.mark.parametrize(("row", "point"), [(2, 0), (-1, 0), (0, 3), (0, -1)])
def test_tracks_fit_frames_and_points_that_are_there(row, point):
    """Numbers below 0 stood for the last ones."""
    good = Tracks(np.zeros(1, int), np.zeros(1, int), np.zeros((1, 2)), np.ones(2, bool), ("", ""))
    assert good.fits(2, 3) and not good.fits(3, 3)
    assert not replace(good, rows=np.array([row]), points=np.array([point])).fits(2, 3)
