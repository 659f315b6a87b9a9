"""The clip file: what is saved is loaded, and what is broken is refused.  Runs of texts."""

import io
import zipfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmrdata.values import limits
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import (
    _CAMERA_SHAPES,
    _SHAPES,
    Clip,
    load_clip,
    rows_of_numbers,
    save_clip,
    text_runs,
    texts_of,
)
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from tests.damage import Calls
from tests.motions import random_motion


def a_clip(n_frames: int = 5, seed: int = 0, with_camera: bool = True, far_m: float = 1.0) -> Clip:
    rng = np.random.default_rng(seed)
    motion = random_motion(
        rng,
        n_frames,
        shape=rng.normal(size=11),
        fps_hz=29.97,
        gender="female",
        frame="camera" if seed % 2 else "world",
        source="made up: Ünïcode, seed 0",
    )
    motion = replace(motion, pelvis_m=far_m * motion.pelvis_m)
    camera = None
    if with_camera:
        world_from_cam = np.tile(np.eye(4), (n_frames, 1, 1))
        world_from_cam[:, :3, 3] = rng.normal(size=(n_frames, 3))
        world_from_cam[0] = np.nan
        has_camera = np.arange(n_frames) > 0
        camera = CameraPath(intrinsics_from_fov(60, 640, 360), 640, 360, world_from_cam, has_camera)
    return Clip(f"clip_{seed}", motion, rng.random(n_frames) > 0.5, np.arange(n_frames), camera)


@settings(max_examples=25)
@given(
    n_frames=st.integers(1, 9),
    seed=st.integers(0, 2**32 - 1),
    with_camera=st.booleans(),
    far_m=st.sampled_from([0.0, 1.0, 1000.0]),
)
def test_round_trip(n_frames, seed, with_camera, far_m, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "round_trip.npz"
    clip = a_clip(n_frames, seed, with_camera, far_m)
    rest_pelvis_m = np.random.default_rng(seed).normal(size=3)
    save_clip(path, clip, rest_pelvis_m)
    found = load_clip(path)
    np.testing.assert_allclose(found.motion.pelvis_m, clip.motion.pelvis_m, rtol=0, atol=1e-12)
    for field in ("local_rotmats", "root_rotmats"):
        saved, loaded = getattr(clip.motion, field), getattr(found.motion, field)
        np.testing.assert_allclose(loaded, saved, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.motion.shape, clip.motion.shape)
    for field in ("fps_hz", "body", "gender", "frame", "source"):
        assert getattr(found.motion, field) == getattr(clip.motion, field)
    assert found.id == clip.id
    np.testing.assert_array_equal(found.valid, clip.valid)
    np.testing.assert_array_equal(found.image_numbers, clip.image_numbers)
    assert (found.camera is None) == (clip.camera is None)
    if clip.camera is not None and found.camera is not None:
        for field in ("intrinsics_px", "world_from_cam", "has_camera", "width_px", "height_px"):
            np.testing.assert_array_equal(getattr(found.camera, field), getattr(clip.camera, field))


def test_trans_is_smpls_and_not_the_pelvis(tmp_path):
    """A reader of AMASS files that adds J0 gets the pelvis; one that doesn't gets `transl`."""
    clip, rest_pelvis_m = a_clip(), np.array([0.01, -0.2, 0.03])
    save_clip(tmp_path / "c.npz", clip, rest_pelvis_m)
    with np.load(tmp_path / "c.npz", allow_pickle=False) as archive:
        np.testing.assert_allclose(
            archive["trans"], clip.motion.pelvis_m - rest_pelvis_m, rtol=0, atol=1e-15
        )
        np.testing.assert_array_equal(archive["rest_pelvis_m"], rest_pelvis_m)
        assert archive["poses"].shape == (5, 72)
        assert float(archive["mocap_framerate"]) == 29.97
        assert str(archive["gender"]) == "female"


def test_same_clip_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_clip(tmp_path / f"{name}.npz", a_clip(), np.zeros(3))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}  # no time inside


def test_rows_without_a_motion_stay_unknown(tmp_path):
    """Pseudo ground truth has no root where it has no camera; scipy refuses NaN matrices."""
    clip = a_clip()
    root_rotmats, pelvis_m = clip.motion.root_rotmats.copy(), clip.motion.pelvis_m.copy()
    root_rotmats[1], pelvis_m[1] = np.nan, np.nan
    motion = replace(clip.motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    save_clip(tmp_path / "c.npz", replace(clip, motion=motion), np.ones(3))
    found = load_clip(tmp_path / "c.npz").motion
    assert np.isnan(found.root_rotmats[1]).all()
    assert np.isnan(found.pelvis_m[1]).all()
    np.testing.assert_allclose(found.local_rotmats, motion.local_rotmats, atol=1e-12)
    known = [0, 2, 3, 4]
    np.testing.assert_allclose(found.root_rotmats[known], root_rotmats[known], atol=1e-12)


def damaged(tmp_path: Path, **changed: object) -> Path:
    path = tmp_path / "damaged.npz"
    save_clip(path, a_clip(), np.zeros(3))
    with np.load(path) as archive:
        arrays = dict(archive) | changed
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("poses", np.zeros((5, 66))),
        ("poses", np.zeros((4, 72))),
        ("poses", np.zeros((5, 72), dtype="U1")),
        ("poses", np.array(1.0)),
        ("trans", np.zeros((1, 3))),  # would broadcast without a word
        ("rest_pelvis_m", np.zeros((5, 3))),
        ("rest_pelvis_m", np.array([0.0, np.nan, 0.0])),
        ("betas", np.zeros((1, 10))),
        ("valid", np.zeros(5)),
        ("valid", np.zeros(4, dtype=bool)),
        ("image_numbers", np.arange(5.0)),
        ("mocap_framerate", np.array([10.0, 10.0])),
        ("mocap_framerate", np.array(0.0)),
        ("mocap_framerate", np.array(np.nan)),
        ("frame", np.array("moon")),
        ("id", np.array(3)),
        ("world_from_cam", np.zeros((5, 3, 4))),
        ("camera_size_px", np.array([640])),
        ("has_camera", None),
        ("trans", None),
    ],
)
def test_arrays_that_do_not_fit(tmp_path, key, value):
    path = damaged(tmp_path, **{key: value})
    with pytest.raises(BadMotionFile, match=r"damaged\.npz: .*"):
        load_clip(path)


@pytest.mark.parametrize("key", [*_SHAPES, *_CAMERA_SHAPES])
def test_each_array_is_needed_and_named(tmp_path, key):
    said = "has no `format`.*--redo" if key == "format" else f"has no array '{key}'"
    with pytest.raises(BadMotionFile, match=rf"damaged\.npz: {said}"):
        load_clip(damaged(tmp_path, **{key: None}))


def test_a_clip_of_another_format_or_with_more_in_it(tmp_path):
    with pytest.raises(BadMotionFile, match=r"`format` is 'gmrdata-clip/9', not 'gmrdata-clip/1'"):
        load_clip(damaged(tmp_path, format=np.array("gmrdata-clip/9")))
    with pytest.raises(BadMotionFile, match="has an unknown array 'confidence'"):
        load_clip(damaged(tmp_path, confidence=np.ones(5)))


def test_rows_are_found_by_the_number_of_their_image():
    numbers, wanted = np.array([4, -1, 5, 9]), np.array([9, 4, -1, 7, 5])
    assert rows_of_numbers(numbers, wanted).tolist() == [3, 0, -1, -1, 2]
    assert rows_of_numbers(numbers, np.zeros(0, int)).dtype.kind == "i"


def test_no_frames(tmp_path):
    with pytest.raises(BadMotionFile, match="no frames"):
        save_clip(tmp_path / "c.npz", a_clip(0, with_camera=False), np.zeros(3))


def test_saving_what_does_not_fit_writes_nothing(tmp_path):
    clip = replace(a_clip(), valid=np.ones(4, dtype=bool))
    with pytest.raises(BadMotionFile, match="'valid' has shape"):
        save_clip(tmp_path / "c.npz", clip, np.zeros(3))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (lambda motion: {"root_rotmats": -motion.root_rotmats}, "joint 0 in row 0 is no rotation"),
        (lambda motion: {"local_rotmats": 2 * motion.local_rotmats}, "joint 1 in row 0 is no rot"),
        (lambda motion: {"local_rotmats": motion.rotmats}, r"\(5, 24, 3, 3\), and not"),
        (lambda motion: {"local_rotmats": motion.local_rotmats[1:]}, r"\(4, 23, .*, and not \(5"),
    ],
)
def test_a_motion_that_is_none_is_not_saved(tmp_path, changed, why):
    """Reflections and enlarged matrices, as of a left-handed world, were saved as other turns."""
    clip = a_clip()
    clip = replace(clip, motion=replace(clip.motion, **changed(clip.motion)))
    with pytest.raises(BadMotionFile, match=why):
        save_clip(tmp_path / "c.npz", clip, np.zeros(3))
    assert list(tmp_path.iterdir()) == []


def test_missing_file(tmp_path):
    with pytest.raises(MissingInput, match=r"nothing\.npz"):
        load_clip(tmp_path / "nothing.npz")


def test_every_truncation_is_refused(tmp_path):
    path = tmp_path / "c.npz"
    save_clip(path, a_clip(2), np.zeros(3))
    content = path.read_bytes()
    for size in [*range(0, len(content), 211), len(content) - 1]:
        path.write_bytes(content[:size])
        with pytest.raises(BadMotionFile, match="not a readable"):
            read_npz(path)


def test_pickled_objects_are_not_opened(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = damaged(tmp_path, betas=np.array([Calls(Path("trap_was_sprung").touch)], dtype=object))
    with pytest.raises(BadMotionFile, match="not a readable .npz of plain arrays"):
        load_clip(path)
    assert not (tmp_path / "trap_was_sprung").exists()


def _of_one_array() -> bytes:
    single = io.BytesIO()
    np.save(single, np.zeros(3))
    return single.getvalue()


def _of_damaged_data() -> bytes:
    """zlib's error is neither an OSError nor a ValueError."""
    whole = io.BytesIO()
    np.savez_compressed(whole, a=np.random.default_rng(0).normal(size=1000).round(1))
    return whole.getvalue()[:60] + bytes(60) + whole.getvalue()[120:]


def _that_claims_more_than_any_memory() -> bytes:
    header, whole = io.BytesIO(), io.BytesIO()
    claim = {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)}
    np.lib.format.write_array_header_1_0(header, claim)
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr("a.npy", header.getvalue())
    return whole.getvalue()


@pytest.mark.parametrize(
    "content",
    [b"", b"text", b"PK\x03\x04" + bytes(100), _of_one_array(), _of_damaged_data(),
     _that_claims_more_than_any_memory()],
)  # fmt: skip
def test_what_is_no_readable_npz(content, tmp_path):
    (tmp_path / "c.npz").write_bytes(content)
    with pytest.raises(BadMotionFile, match="not a readable"):
        read_npz(tmp_path / "c.npz")


@pytest.mark.parametrize("code", [0xD800, 0x110000, 0xFFFFFFFF])
def test_texts_of_no_letters(code, tmp_path):
    """Python's own texts can't hold these: to look at one ends in a SystemError."""
    letters = np.array("abc")
    for name, dtype in (("little", "<u4"), ("big", ">u4")):
        codes = np.array([97, code, 99], dtype)
        path = tmp_path / f"{name}.npz"
        np.savez(path, gender=codes.view(dtype.replace("u4", "U3"))[0], other=letters)
        with pytest.raises(BadMotionFile, match="'gender' is a text of no letters"):
            read_npz(path)
        np.savez(path, gender=letters.astype(dtype.replace("u4", "U3")), empty=np.array([""]))
        assert str(read_npz(path)["gender"]) == "abc"


def test_npz_bomb_is_refused_unopened(tmp_path, monkeypatch):
    path = tmp_path / "c.npz"
    np.savez_compressed(path, a=np.zeros(200_000))
    monkeypatch.setattr(limits, "FREE_BYTES", 1_000_000)
    with pytest.raises(BadMotionFile, match="unpacks to more bytes"):
        read_npz(path)


@given(st.lists(st.sampled_from(["", "a", "b"]), max_size=30))
def test_runs_tile_the_rows_and_give_the_texts_back(texts):
    runs = text_runs(texts)
    assert [start for start, _, _ in runs] == [0, *[stop for _, stop, _ in runs]][: len(runs)]
    assert all(a[2] != b[2] for a, b in pairwise(runs))
    assert texts_of(runs, len(texts)) == texts
    assert texts_of((run for run in runs if run[2]), len(texts)) == texts
