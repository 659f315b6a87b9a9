"""Model files of SMPL and SMPL+H, which users get under their own licence, as a BodyModel."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.body_file import check_body, read_plain_npz
from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.body import HANDS, N_JOINTS, PARENTS, BodyModel
from gmrdata.values.errors import BadBodyFile, BrokenPickle

N_SHAPE = 16
"""Most shape coefficients that are kept of a model's 10, 16 or 300: as many as AMASS has."""
SMPLH_JOINTS = 52
_KEPT = (*range(22), *HANDS[3 * SMPLH_JOINTS])
"""SMPL+H's joints that are those of the 24-joint tree; the first index joints are the hands."""
_FINGERS = 15
LICENCE = "SMPL model licence (smpl.is.tue.mpg.de): non-commercial research; not to be passed on"
SMPLH_LICENCE = (
    "SMPL+H model licence (mano.is.tue.mpg.de): non-commercial research; not to be passed on"
)
_KEYS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
_GENDER = re.compile(r"(?:^|[^a-z])(neutral|female|male|[nfm])(?:[^a-z]|$)")
_IN_FOLDER = re.compile(r"(?:^|[^a-z])(neutral|female|male)(?:[^a-z]|$)")
_GENDER_NAMES = {"n": "neutral", "f": "female", "m": "male"}


def read_smpl(path: Path) -> BodyModel:
    """Read SMPL's model (Loper et al. 2015): a `.pkl`, with or without chumpy, or an `.npz` of it.

    The gender stands in the file's name only, "SMPL_NEUTRAL.pkl", "basicModel_f_lbs_10_207_0.pkl",
    or in that of its folder, "female/model.npz".  The joint regressor is linear (eq. 10) and
    applied here, to the template and each direction.

    SMPL+H (Romero et al. 2017), whose shapes AMASS has, is the same body with fingers.  Here a
    hand is one piece, as in SMPL: its vertices go with the first index joint.
    """
    arrays = _read_arrays(path)
    n_joints = arrays["weights"].shape[-1:]
    if n_joints not in ((N_JOINTS,), (SMPLH_JOINTS,)):
        what = f"has {n_joints} joints, SMPL has {N_JOINTS} and SMPL+H {SMPLH_JOINTS}"
        raise BadBodyFile(f"{path}: {what}; SMPL-X and MANO are other models")
    template_m, shape_dirs_m = arrays["v_template"], arrays["shapedirs"]
    fits = (
        template_m.ndim == 2 and shape_dirs_m.ndim == 3
        and shape_dirs_m.shape[:2] == template_m.shape
    )  # fmt: skip
    if not fits or arrays["J_regressor"].shape != (*n_joints, len(template_m)):
        shapes = f"J_regressor {arrays['J_regressor'].shape}, shapedirs {shape_dirs_m.shape} and"
        what = f"{shapes} v_template {template_m.shape} do not fit together"
        raise BadBodyFile(f"{path}: {what}; get the file again")
    shape_dirs_m = shape_dirs_m[..., :N_SHAPE]
    if has_fingers := n_joints == (SMPLH_JOINTS,):
        arrays = _without_fingers(path, arrays)
    regressor = arrays["J_regressor"]
    body = BodyModel(
        name=f"smpl-{_gender(path)}",
        template_m=template_m,
        shape_dirs_m=shape_dirs_m,
        joints_template_m=regressor @ template_m,
        joint_shape_dirs_m=np.einsum("jv,vcs->jcs", regressor, shape_dirs_m),
        skin_weights=arrays["weights"],
        faces=arrays["f"].astype(np.int64),
        pose_dirs_m=arrays["posedirs"],
        licence=SMPLH_LICENCE if has_fingers else LICENCE,
    )
    check_body(path, body)
    tree = arrays["kintree_table"]
    # The root's parent is -1 stored as an unsigned number.
    if tree.shape != (2, N_JOINTS) or tuple(tree[0, 1:].astype(int)) != PARENTS[1:]:
        raise BadBodyFile(f"{path}: kintree_table is not SMPL's tree; get the file again")
    return body


def says_gender(path: Path) -> bool:
    """Whether the name of a model's file, or of its folder, says a gender."""
    return _found_gender(path) is not None


def _without_fingers(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """SMPL+H's arrays on the 24-joint tree; fingers are straight against the first index joint."""
    weights, pose_dirs_m, tree = (arrays[k] for k in ("weights", "posedirs", "kintree_table"))
    n_vertices = len(weights)
    if pose_dirs_m.shape != (n_vertices, 3, 9 * (SMPLH_JOINTS - 1)):
        raise BadBodyFile(f"{path}: posedirs is {pose_dirs_m.shape}; get the file again")
    if tree.shape != (2, SMPLH_JOINTS):
        raise BadBodyFile(f"{path}: kintree_table is not SMPL+H's tree; get the file again")
    hands = weights[:, 22:].reshape(n_vertices, 2, _FINGERS).sum(axis=2)
    by_joint = pose_dirs_m.reshape(n_vertices, 3, SMPLH_JOINTS - 1, 9)
    kept = list(_KEPT)
    return arrays | {
        "weights": np.concatenate([weights[:, :22], hands], axis=1),
        "posedirs": by_joint[:, :, [joint - 1 for joint in kept[1:]]].reshape(n_vertices, 3, -1),
        "J_regressor": arrays["J_regressor"][kept],
        "kintree_table": tree[:, kept],
    }


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        content = read_plain_npz(path) if path.suffix == ".npz" else load_plain(path)
    except BrokenPickle as error:
        raise BadBodyFile(str(error)) from None
    missing = [key for key in _KEYS if not isinstance(content, dict) or key not in content]
    if missing:
        what = f"not SMPL's model, it lacks {', '.join(missing)}"
        raise BadBodyFile(f"{path}: {what}; get the model from https://smpl.is.tue.mpg.de")
    return {key: _dense(path, key, content[key]) for key in _KEYS}


def _dense(path: Path, key: str, value: Any) -> np.ndarray:
    """A file's array as float64, sparse ones as dense ones."""
    # A sparse array may claim any size; the largest real one is SMPL's regressor, 24 x 6890.
    if hasattr(value, "toarray") and max(value.shape) < 100_000:
        value = value.toarray()
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise BadBodyFile(f"{path}: {key} is not an array of numbers; get the file again")
    return value.astype(np.float64)


def _gender(path: Path) -> str:
    found = _found_gender(path)
    if found is None:
        like = f"neutral, female or male, like SMPL_NEUTRAL{path.suffix}"
        why = "the file does not say, and one gender's shape means nothing on another"
        raise BadBodyFile(f"{path}: name the file so that it says {like}: {why}")
    return _GENDER_NAMES.get(found, found)


def _found_gender(path: Path) -> str | None:
    """What the file's name says, else its folder's."""
    found = _GENDER.search(path.stem.lower())
    found = found or _IN_FOLDER.search(path.absolute().parent.name.lower())
    return None if found is None else found[1]
