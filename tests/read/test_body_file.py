"""The compact file of a body."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.body_file import BODY_FORMAT, check_body, read_body, save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadBodyFile, MissingInput


def with_pose_dirs(body: BodyModel) -> BodyModel:
    shape = (len(body.template_m), 3, 207)
    return dataclasses.replace(body, pose_dirs_m=np.random.default_rng(0).normal(size=shape))


@pytest.mark.parametrize("posed", [False, True])
def test_a_body_comes_back_to_single_precision(small_body, tmp_path, posed):
    body = with_pose_dirs(small_body) if posed else small_body
    save_body(tmp_path / "body.npz", body)
    found = read_body(tmp_path / "body.npz")
    for field in dataclasses.fields(BodyModel):
        written, read = getattr(body, field.name), getattr(found, field.name)
        if isinstance(written, np.ndarray) and written.dtype.kind == "f":
            assert read.dtype == np.float64
            np.testing.assert_array_equal(read, written.astype(np.float32))
        elif isinstance(written, np.ndarray):
            np.testing.assert_array_equal(read, written)
        else:
            assert read == written
    assert [p.name for p in tmp_path.iterdir()] == ["body.npz"]


def test_the_same_body_gives_the_same_bytes(small_body, tmp_path):
    for name in ("a.npz", "b.npz"):
        save_body(tmp_path / name, small_body)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_every_missing_array_is_named(small_body, tmp_path):
    save_body(tmp_path / "body.npz", with_pose_dirs(small_body))
    with np.load(tmp_path / "body.npz") as archive:
        arrays = dict(archive)
    for key in arrays:
        np.savez(tmp_path / "less.npz", **{k: v for k, v in arrays.items() if k != key})
        if key == "pose_dirs_m":
            assert read_body(tmp_path / "less.npz").pose_dirs_m is None
            continue
        with pytest.raises(
            BadBodyFile, match=rf"less\.npz.*{'format' if key == 'format' else key}"
        ):
            read_body(tmp_path / "less.npz")


def test_truncated_files_are_refused(small_body, tmp_path):
    path = tmp_path / "body.npz"
    save_body(path, small_body)
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 997), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(BadBodyFile, match=r"body\.npz"):
            read_body(path)


def test_pickled_objects_and_missing_files_are_refused(tmp_path):
    path = tmp_path / "body.npz"
    np.savez(path, format=np.array([BODY_FORMAT], dtype=object))
    with pytest.raises(BadBodyFile, match=r"body\.npz"):
        read_body(path)
    with pytest.raises(MissingInput, match=r"none\.npz"):
        read_body(tmp_path / "none.npz")


@pytest.mark.parametrize("name", ["../evil", "/tmp/evil", "..", "", ".hidden", np.array(3.0)])
def test_a_name_that_is_no_folders_is_refused(small_body, tmp_path, name):
    """`keep_bodies` wrote to such a folder, wherever it was."""
    save_body(tmp_path / "body.npz", small_body)
    arrays = dict(np.load(tmp_path / "body.npz"))
    np.savez(tmp_path / "body.npz", **arrays | {"name": np.array(name)})
    with pytest.raises(BadBodyFile, match=r"body\.npz: name is .*, which can't be a folder's"):
        read_body(tmp_path / "body.npz")


def test_what_is_no_text_and_no_row_of_vertices_is_refused(small_body):
    for change, said in (
        ({"licence": np.array(3.0)}, "licence is an array"),
        ({"faces": small_body.faces.astype(float)}, "faces must name vertices"),
    ):
        with pytest.raises(BadBodyFile, match=rf"here\.npz: {said}"):
            check_body(Path("here.npz"), dataclasses.replace(small_body, **change))


def test_arrays_that_do_not_fit_are_named(small_body):
    infinite = small_body.template_m.copy()
    infinite[7, 1] = np.inf
    changes: dict[str, np.ndarray] = {
        "template_m": infinite,
        "shape_dirs_m": small_body.shape_dirs_m[1:],
        "joints_template_m": small_body.joints_template_m[:23],
        "joint_shape_dirs_m": small_body.joint_shape_dirs_m[..., :9],
        "skin_weights": small_body.skin_weights * 1.01,
        "faces": small_body.faces + 1,
        "pose_dirs_m": np.zeros((len(small_body.template_m), 3, 206)),
    }
    for name, array in changes.items():
        with pytest.raises(BadBodyFile, match=rf"here\.npz: {name}"):
            check_body(Path("here.npz"), dataclasses.replace(small_body, **{name: array}))
        with pytest.raises(BadBodyFile, match=rf"here\.npz: {name} has 0 dimensions"):
            check_body(Path("here.npz"), dataclasses.replace(small_body, **{name: np.array(1.0)}))
