"""Loading a body by name or by file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.bodies import (
    ANNY_FILE,
    body_file,
    body_files,
    body_inputs,
    keep_bodies,
    keep_body,
    load_bodies,
    load_body,
)
from gmrdata.read.body_file import save_body
from gmrdata.read.models import cache_dir
from gmrdata.values.errors import BadBodyFile, MissingInput, StaleOutput
from tests.smpl_models import save_smpl


def test_our_own_file_is_known_by_its_content(small_body, tmp_path):
    save_body(tmp_path / "x.npz", small_body)
    assert load_body(str(tmp_path / "x.npz")).name == "small"


def test_missing_file_says_where_smpl_comes_from(tmp_path):
    with pytest.raises(MissingInput, match=r"SMPL_MALE\.pkl.*'anny'.*smpl\.is\.tue\.mpg\.de"):
        load_body(str(tmp_path / "SMPL_MALE.pkl"))


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "body.obj").write_text("v 0 0 0\n")
    with pytest.raises(BadBodyFile, match=r"body\.obj.*\.npz or \.pkl"):
        load_body(str(tmp_path / "body.obj"))


def test_a_folder_holds_bodies_of_each_gender(small_body, tmp_path):
    folder = tmp_path / "smpl"
    save_smpl(folder / "SMPL_NEUTRAL.npz", small_body, "neutral")
    few = replace(
        small_body,
        shape_dirs_m=small_body.shape_dirs_m[..., :6],
        joint_shape_dirs_m=small_body.joint_shape_dirs_m[..., :6],
    )
    save_smpl(folder / "male" / "model.npz", few, "male")
    save_body(folder / "own" / "deep" / "x.npz", replace(small_body, name="mine"))
    np.savez(folder / "smpl_mean_params.npz", pose=np.zeros(144))
    save_smpl(tmp_path / "outside" / "SMPL_FEMALE.npz", small_body, "female")
    (folder / "SMPL_FEMALE.npz").symlink_to(tmp_path / "outside" / "SMPL_FEMALE.npz")
    (folder / "SMPL_MALE.npz").symlink_to(folder / "SMPL_MALE.npz")
    names = [str(path.relative_to(folder)) for path in body_files(folder)]
    assert names == ["SMPL_NEUTRAL.npz", "male/model.npz", "own/deep/x.npz"]
    bodies = load_bodies(str(folder))
    assert [body.name for body in bodies] == ["mine", "smpl-male", "smpl-neutral"]
    assert {body.n_shape for body in bodies} == {10}
    betas = np.arange(10) / 10
    expected_m = few.rest_vertices_m(betas[:6])
    np.testing.assert_allclose(bodies[1].rest_vertices_m(betas), expected_m, atol=1e-6)
    kept = keep_bodies(str(folder), tmp_path / "kept")
    assert {name: path.parent.name for name, path in kept.items()} == {
        body.name: body.name for body in bodies
    }
    assert load_body(str(kept["smpl-male"])).n_shape == 6
    assert [body.name for body in load_bodies(str(tmp_path / "kept"))] == list(kept)
    assert [body.name for body in load_bodies(str(kept["mine"]))] == ["mine"]


def test_a_home_folder_by_its_sign_is_the_same_path(small_body, tmp_path, monkeypatch):
    """Of `--body=~/x.npz`, which no shell spells out, a stage noted no file, and kept the old one
    when it changed."""
    monkeypatch.setenv("HOME", str(tmp_path))
    path = tmp_path / "smpl" / "x.npz"
    save_body(path, replace(small_body, name="first"))
    assert load_body(str(keep_body("~/smpl/x.npz", tmp_path / "kept"))).name == "first"
    assert keep_body(str(path), tmp_path / "kept") == tmp_path / "kept" / "body.npz"
    save_body(path, replace(small_body, name="second"))
    with pytest.raises(StaleOutput, match="file"):
        keep_body("~/smpl/x.npz", tmp_path / "kept")
    assert body_file("~/smpl/x.npz", "second") == body_file("~/smpl", "second") == path
    assert body_inputs(Path("~/smpl/x.npz")) == {"body": path}
    assert body_inputs(Path("~/smpl")) == {"body_0": path}


@pytest.mark.parametrize("body", [None, "anny", Path("anny")])
def test_the_default_body_by_any_of_its_names(body, anny):
    """A path of that name, as `--predictions-body anny` gives, was called no body file."""
    (found,) = load_bodies(body)
    assert found.name == load_body(body).name == anny.name and body_inputs(body) == {}
    assert body is None or body_file(body, "anny") == ANNY_FILE


def test_folders_that_leave_it_open_are_refused(small_body, tmp_path):
    save_smpl(tmp_path / "SMPL_MALE.npz", small_body, "male")
    save_smpl(tmp_path / "male" / "model.npz", small_body, "male")
    with pytest.raises(BadBodyFile, match="two files of the body smpl-male: .*SMPL_MALE.*model"):
        load_bodies(str(tmp_path))
    with pytest.raises(BadBodyFile, match="a folder of bodies.*Name one of its files"):
        load_body(str(tmp_path))
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match=r"holds no SMPL models.*female/model\.npz"):
        load_bodies(str(tmp_path / "empty"))


def test_cache_folder_follows_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_dir() == tmp_path / ".cache" / "gmrdata"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    assert cache_dir() == tmp_path / "elsewhere" / "gmrdata"
