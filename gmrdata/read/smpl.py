"""SMPL's official model files, which users get under their own licence, as a BodyModel."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.bodies import check_body, read_plain_npz
from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.body import N_JOINTS, PARENTS, BodyModel
from gmrdata.values.errors import BadBodyFile, BrokenPickle

N_SHAPE = 10
"""Shape coefficients that are kept of a model's 10 or 300; 3DPW has 10, and they come by size."""
LICENCE = "SMPL model licence (smpl.is.tue.mpg.de): non-commercial research; not to be passed on"
_KEYS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
_GENDER = re.compile(r"(?:^|[^a-z])(neutral|female|male|[nfm])(?:[^a-z]|$)")
_GENDER_NAMES = {"n": "neutral", "f": "female", "m": "male"}


def read_smpl(path: Path) -> BodyModel:
    """Read SMPL's model (Loper et al. 2015): a `.pkl`, with or without chumpy, or an `.npz` of it.

    The gender stands in the file's name only: "SMPL_NEUTRAL.pkl", "basicModel_f_lbs_10_207_0.pkl".
    The joint regressor is linear (eq. 10) and applied here, to the template and each direction.
    """
    arrays = _read_arrays(path)
    n_joints = arrays["weights"].shape[-1:]
    if n_joints != (N_JOINTS,):
        what = f"has {n_joints} joints, SMPL has {N_JOINTS}; SMPL-H, SMPL-X and MANO are other"
        raise BadBodyFile(f"{path}: {what} models")
    template_m, shape_dirs_m = arrays["v_template"], arrays["shapedirs"][..., :N_SHAPE]
    regressor = arrays["J_regressor"]
    if regressor.shape != (N_JOINTS, len(template_m)) or shape_dirs_m.ndim != 3:
        shapes = f"J_regressor {regressor.shape}, shapedirs {shape_dirs_m.shape} and v_template"
        what = f"{shapes} {template_m.shape} do not fit together"
        raise BadBodyFile(f"{path}: {what}; get the file again")
    body = BodyModel(
        name=f"smpl-{_gender(path)}",
        template_m=template_m,
        shape_dirs_m=shape_dirs_m,
        joints_template_m=regressor @ template_m,
        joint_shape_dirs_m=np.einsum("jv,vcs->jcs", regressor, shape_dirs_m),
        skin_weights=arrays["weights"],
        faces=arrays["f"].astype(np.int64),
        pose_dirs_m=arrays["posedirs"],
        licence=LICENCE,
    )
    check_body(path, body)
    tree = arrays["kintree_table"]
    # The root's parent is -1 stored as an unsigned number.
    if tree.shape != (2, N_JOINTS) or tuple(tree[0, 1:].astype(int)) != PARENTS[1:]:
        raise BadBodyFile(f"{path}: kintree_table is not SMPL's tree; get the file again")
    return body


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
    found = _GENDER.search(path.stem.lower())
    if found is None:
        like = f"neutral, female or male, like SMPL_NEUTRAL{path.suffix}"
        why = "the file does not say, and one gender's shape means nothing on another"
        raise BadBodyFile(f"{path}: name the file so that it says {like}: {why}")
    return _GENDER_NAMES.get(found[1], found[1])
