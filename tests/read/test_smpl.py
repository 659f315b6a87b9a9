"""SMPL's files, on a random model in SMPL's format: the real one may not be passed on."""

import pickle  # noqa: TID251  The tests write SMPL's pickle.
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.spatial.transform import Rotation

from gmrdata.read.bodies import load_body, read_smpl
from gmrdata.read.body_file import read_body, save_body
from gmrdata.values.body import PARENTS
from gmrdata.values.errors import BadBodyFile, UnsafePickle
from gmrdata.values.skinning_torch import place, posed_vertices
from tests.smpl_models import smpl_arrays
from tests.torch_joints import posed_joints

N_VERTICES = 6890


@pytest.fixture(scope="module")
def official() -> dict[str, Any]:
    """Arrays with the keys, shapes and dtypes of SMPL's `.pkl`."""
    rng = np.random.default_rng(0)
    skin = np.zeros((N_VERTICES, 24))
    for vertex in range(N_VERTICES):
        skin[vertex, rng.choice(24, 4, replace=False)] = rng.dirichlet(np.ones(4))
    regressor = sparse.lil_matrix((24, N_VERTICES))
    for joint in range(24):
        regressor[joint, rng.choice(N_VERTICES, 30, replace=False)] = rng.dirichlet(np.ones(30))
    parents = np.array(PARENTS)
    parents[0] = 2**32 - 1
    return {
        "v_template": rng.normal(size=(N_VERTICES, 3)),
        "shapedirs": 0.1 * rng.normal(size=(N_VERTICES, 3, 18)),
        "posedirs": 0.1 * rng.normal(size=(N_VERTICES, 3, 207)),
        "J_regressor": regressor.tocsc(),
        "weights": skin,
        "kintree_table": np.stack([parents, np.arange(24)]).astype(np.uint32),
        "f": rng.integers(0, N_VERTICES, (13776, 3)).astype(np.uint32),
        "bs_style": "lbs",
        "bs_type": "lrotmin",
    }


def write_pickle(path: Path, arrays: dict[str, Any], protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(arrays, protocol))
    return path


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    dense = {k: v.toarray() if sparse.issparse(v) else v for k, v in arrays.items()}
    np.savez(path, **dense)
    return path


def smpl_vertices_by_the_paper(
    model: dict[str, Any], betas: np.ndarray, pose: np.ndarray, trans: np.ndarray, vertices: range
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints by Loper et al. 2015, eqs. 2-10, one vertex at a time.

    Args:
        model: SMPL's arrays.
        betas: (16,).
        pose: (24, 3) axis-angle, root first.
        trans: (3,).
        vertices: Which vertices to pose.
    """
    shaped = model["v_template"] + sum(
        beta * model["shapedirs"][:, :, n] for n, beta in enumerate(betas)
    )
    rest_joints = model["J_regressor"].toarray() @ shaped
    rotations = [Rotation.from_rotvec(axis_angle).as_matrix() for axis_angle in pose]
    world = []
    for k in range(24):
        parent = int(model["kintree_table"][0, k]) if k else None
        local = np.eye(4)
        local[:3, :3] = rotations[k]
        local[:3, 3] = rest_joints[k] - (rest_joints[parent] if parent is not None else 0)
        world.append(local if parent is None else world[parent] @ local)
    removed = []
    for k in range(24):
        to_rest = np.eye(4)
        to_rest[:3, 3] = -rest_joints[k]
        removed.append(world[k] @ to_rest)
    feature = np.concatenate([(rotations[k] - np.eye(3)).ravel() for k in range(1, 24)])
    posed = []
    for i in vertices:
        rest = shaped[i] + sum(feature[n] * model["posedirs"][i, :, n] for n in range(207))
        point = np.zeros(4)
        for k in range(24):
            point += model["weights"][i, k] * (removed[k] @ np.append(rest, 1.0))
        posed.append(point[:3] + trans)
    return np.array(posed), np.array([g[:3, 3] for g in world]) + trans


def test_forward_is_the_published_one(official, tmp_path):
    body = read_smpl(write_pickle(tmp_path / "SMPL_NEUTRAL.pkl", official))
    rng = np.random.default_rng(1)
    for _ in range(2):
        betas, trans = rng.normal(size=16), rng.normal(size=3)
        pose = rng.normal(size=(24, 3))
        some = range(0, N_VERTICES, 97)
        vertices_m, joints_m = smpl_vertices_by_the_paper(official, betas, pose, trans, some)
        rotmats = torch.as_tensor(Rotation.from_rotvec(pose).as_matrix())
        # pelvis = trans + J0: SMPL turns about the rest pelvis, then shifts.
        pelvis_m = torch.as_tensor(trans + body.rest_pelvis_m(betas))
        shape = torch.as_tensor(betas)
        found_m = place(rotmats[0], pelvis_m, posed_vertices(body, shape, rotmats[1:]))
        found_joints_m = place(rotmats[0], pelvis_m, posed_joints(body, shape, rotmats[1:])[0])
        np.testing.assert_allclose(found_m[list(some)], vertices_m, atol=1e-11)
        np.testing.assert_allclose(found_joints_m, joints_m, atol=1e-11)


def assert_equal_bodies(one: Any, other: Any) -> None:
    for name in ("template_m", "shape_dirs_m", "joints_template_m", "joint_shape_dirs_m",
                 "skin_weights", "faces", "pose_dirs_m"):  # fmt: skip
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
def test_pickle_and_npz_load_equal(official, tmp_path, protocol):
    if protocol == 0:  # text: keep the file small
        official = official | {"posedirs": np.zeros((N_VERTICES, 3, 207), dtype=np.float16)}
    pickled = load_body(str(write_pickle(tmp_path / "SMPL_FEMALE.pkl", official, protocol)))
    zipped = load_body(str(write_npz(tmp_path / "SMPL_FEMALE.npz", official)))
    assert pickled.name == zipped.name == "smpl-female"
    assert pickled.n_shape == 16
    assert pickled.shape_dirs_m.shape == (N_VERTICES, 3, 16)
    assert "smpl.is.tue.mpg.de" in pickled.licence
    assert_equal_bodies(pickled, zipped)


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("female/model", "smpl-female"),
        ("male/model", "smpl-male"),
        ("neutral/model", "smpl-neutral"),
        ("SMPL_NEUTRAL", "smpl-neutral"),
        ("SMPL_MALE", "smpl-male"),
        ("basicModel_f_lbs_10_207_0_v1.0.0", "smpl-female"),
        ("basicmodel_m_lbs_10_207_0_v1.1.0", "smpl-male"),
        ("basicModel_neutral_lbs_10_207_0_v1.0.0", "smpl-neutral"),
        ("smpl_f32_male", "smpl-male"),
        ("male/scan_m_female", "smpl-female"),
    ],
)
def test_gender_stands_in_the_name_of_file_or_folder(official, tmp_path, file, name):
    path = tmp_path / f"{file}.npz"
    path.parent.mkdir(exist_ok=True)
    assert load_body(str(write_npz(path, few_vertices(official)))).name == name
    with pytest.raises(BadBodyFile, match="neutral, female or male"):
        load_body(str(path.rename(tmp_path / "model.npz")))


def few_vertices(model: dict[str, Any]) -> dict[str, Any]:
    """200 vertices of SMPL's arrays, which fit together as the whole does."""
    regressor = np.random.default_rng(3).dirichlet(np.ones(200), 24)
    by_vertex = {
        key: model[key][:200] for key in ("v_template", "shapedirs", "posedirs", "weights")
    }
    return model | by_vertex | {"J_regressor": regressor, "f": model["f"] % 200}


def with_fingers(model: dict[str, Any]) -> dict[str, Any]:
    """SMPL's arrays in SMPL+H's layout: a hand's share is divided among its 15 joints."""
    rng, kept, n_vertices = np.random.default_rng(4), [*range(22), 22, 37], len(model["weights"])
    weights = np.zeros((n_vertices, 52))
    weights[:, :22] = model["weights"][:, :22]
    for hand in range(2):
        shares = rng.dirichlet(np.ones(15), n_vertices)
        weights[:, 22 + 15 * hand : 37 + 15 * hand] = shares * model["weights"][:, [22 + hand]]
    pose_dirs = rng.normal(size=(n_vertices, 3, 51, 9))
    pose_dirs[:, :, [joint - 1 for joint in kept[1:]]] = model["posedirs"].reshape(-1, 3, 23, 9)
    regressor = rng.dirichlet(np.ones(n_vertices), 52)
    regressor[kept] = model["J_regressor"]
    fingers = [[20 + hand, *range(23 + 15 * hand, 37 + 15 * hand)] for hand in range(2)]
    tree = np.array([2**32 - 1, *PARENTS[1:22], *fingers[0], *fingers[1]])
    changed = {"weights": weights, "J_regressor": regressor}
    changed["posedirs"] = pose_dirs.reshape(n_vertices, 3, -1)
    return model | changed | {"kintree_table": np.stack([tree, np.arange(52)])}


def test_smplh_is_the_same_body_with_hands_of_one_piece(official, tmp_path):
    model = few_vertices(official)
    smpl = load_body(str(write_npz(tmp_path / "SMPL_FEMALE.npz", model)))
    (tmp_path / "female").mkdir()
    found = load_body(str(write_npz(tmp_path / "female" / "model.npz", with_fingers(model))))
    assert found.name == "smpl-female" and "mano.is.tue.mpg.de" in found.licence
    assert_equal_bodies(replace(found, skin_weights=smpl.skin_weights), smpl)
    np.testing.assert_allclose(found.skin_weights, smpl.skin_weights, atol=1e-12)


@pytest.mark.parametrize("suffix", ["pkl", "npz"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": None}, "lacks weights"),
        ({"weights": np.full((N_VERTICES, 55), 1 / 55)}, "SMPL-X"),
        ({"weights": np.full((N_VERTICES, 52), 1 / 52)}, "do not fit together"),
        (
            {
                "weights": np.full(52, 1 / 52),
                "J_regressor": np.zeros((52, N_VERTICES)),
                "posedirs": np.zeros((52, 3, 459)),
            },
            "weights has 1 dimensions",
        ),
        ({"f": np.zeros((5, 4), dtype=np.uint32)}, "faces has the shape"),
        ({"f": np.full((5, 3), N_VERTICES, dtype=np.uint32)}, "faces must name vertices"),
        ({"posedirs": np.zeros((N_VERTICES, 3, 9))}, "pose_dirs_m has the shape"),
        *(
            ({"shapedirs": np.zeros(shape)}, "do not fit together")
            for shape in [(2 * N_VERTICES, 3, 10), (N_VERTICES, 10), (N_VERTICES, 2, 10), ()]
        ),
        ({"J_regressor": sparse.csc_matrix((17, N_VERTICES))}, "do not fit together"),
        ({"v_template": np.full((N_VERTICES, 3), np.nan)}, "not finite"),
        ({"v_template": np.full((N_VERTICES, 3), "x")}, "not an array of numbers"),
        ({"kintree_table": np.zeros((2, 24), dtype=np.uint32)}, "not SMPL's tree"),
    ],
)
def test_another_file_is_refused_by_name(official, tmp_path, suffix, change, message):
    small = official | {"posedirs": np.zeros((N_VERTICES, 3, 207), dtype=np.float16)} | change
    arrays = {key: value for key, value in small.items() if value is not None}
    path = tmp_path / f"SMPL_MALE.{suffix}"
    write_pickle(path, arrays) if suffix == "pkl" else write_npz(path, arrays)
    with pytest.raises(BadBodyFile, match=message) as caught:
        load_body(str(path))
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\x80\x02", b"not a model", pickle.dumps([1, 2], 2)])
@pytest.mark.parametrize("suffix", ["pkl", "npz"])
def test_broken_file_is_refused_by_name(tmp_path, suffix, content):
    path = tmp_path / f"SMPL_MALE.{suffix}"
    path.write_bytes(content)
    with pytest.raises(BadBodyFile, match=r"SMPL_MALE\."):
        load_body(str(path))


def test_huge_sparse_regressor_is_refused(official, tmp_path):
    """A few bytes may claim a matrix that fills the memory once it is dense."""
    huge = sparse.csr_matrix((24, 2**31 - 1))
    path = write_pickle(tmp_path / "SMPL_MALE.pkl", official | {"J_regressor": huge})
    with pytest.raises(BadBodyFile, match="J_regressor|holds more numbers than a file of"):
        load_body(str(path))


def test_hostile_pickle_is_refused_by_name(tmp_path):
    path = tmp_path / "SMPL_MALE.pkl"
    path.write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(UnsafePickle, match=r"SMPL_MALE\.pkl: wants to import 'os\.system'"):
        load_body(str(path))


@pytest.mark.parametrize("key", ["v_template", "f", "weights", "J_regressor", "kintree_table"])
def test_a_number_in_place_of_an_array(key, small_body, tmp_path):
    path = write_npz(tmp_path / "SMPL_MALE.npz", smpl_arrays(small_body, 1.0, 10) | {key: 2.0})
    with pytest.raises(BadBodyFile, match=r"SMPL_MALE\.npz: "):
        read_smpl(path)


@pytest.mark.parametrize(
    ("key", "changed", "said"),
    [
        *(
            ("template_m", partial(np.zeros_like, dtype=dtype), "is of .*, which are no numbers")
            for dtype in ("S8", "c16", "M8[s]")
        ),
        *(
            (key, lambda _: np.array("x"), "is a text")
            for key in ("template_m", "shape_dirs_m", "faces")
        ),
    ],
)
def test_an_array_of_no_numbers_and_a_text(key, changed, said, small_body, tmp_path):
    save_body(tmp_path / "a.npz", small_body)
    arrays = dict(np.load(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", **arrays | {key: changed(arrays[key])})
    with pytest.raises(BadBodyFile, match=rf"b\.npz: {key} {said}"):
        read_body(tmp_path / "b.npz")
