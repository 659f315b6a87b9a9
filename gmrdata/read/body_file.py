"""gmrdata's own file of a body: a compact .npz of float32 arrays."""

import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.values.body import N_JOINTS, N_LOCAL, PHENOTYPES, BodyModel
from gmrdata.values.errors import BadBodyFile, BadMotionFile
from gmrdata.values.files import read_npz, write_npz

FORMAT = "gmrdata-body/1"
_OPTIONAL = ("pose_dirs_m", "adult_shapes", "adult_phenotypes")


def save_body(path: Path, body: BodyModel) -> None:
    """Write a body as float32 and int32 arrays; the same body gives the same bytes."""
    arrays = {"format": np.array(FORMAT)}
    for field in fields(BodyModel):
        value = getattr(body, field.name)
        if isinstance(value, str):
            arrays[field.name] = np.array(value)
        elif value is not None:
            arrays[field.name] = value.astype(np.int32 if field.name == "faces" else np.float32)
    write_npz(path, arrays, compressed=True)


def read_body(path: Path) -> BodyModel:
    """Read a body that `save_body` wrote; arrays come back as float64 and int64."""
    arrays = read_plain_npz(path)
    if str(arrays.get("format")) != FORMAT:
        raise BadBodyFile(f"{path}: not a body file of gmrdata (its format is not {FORMAT!r})")
    names = [field.name for field in fields(BodyModel)]
    missing = [name for name in names if name not in arrays and name not in _OPTIONAL]
    if missing:
        raise BadBodyFile(f"{path}: the array {missing[0]} is missing")
    body = BodyModel(**{name: _in_memory(path, name, arrays.get(name)) for name in names})
    check_body(path, body)
    return body


def read_plain_npz(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a body's .npz, without unpickling anything."""
    try:
        return read_npz(path)
    except BadMotionFile as error:
        raise BadBodyFile(str(error)) from None


_DIMENSIONS = {
    "template_m": 2, "shape_dirs_m": 3, "joints_template_m": 2, "joint_shape_dirs_m": 3,
    "skin_weights": 2, "faces": 2, "pose_dirs_m": 3, "adult_shapes": 2, "adult_phenotypes": 2,
}  # fmt: skip


def check_body(path: Path, body: BodyModel) -> None:
    """Refuse a body whose arrays do not fit together."""
    _check_dimensions(path, body)
    n_vertices, n_shape = len(body.template_m), body.shape_dirs_m.shape[-1]
    n_adults = 0 if body.adult_shapes is None else len(body.adult_shapes)
    expected = {
        "template_m": (n_vertices, 3),
        "shape_dirs_m": (n_vertices, 3, n_shape),
        "joints_template_m": (N_JOINTS, 3),
        "joint_shape_dirs_m": (N_JOINTS, 3, n_shape),
        "skin_weights": (n_vertices, N_JOINTS),
        "faces": (len(body.faces), 3),
        "pose_dirs_m": (n_vertices, 3, 9 * N_LOCAL),
        "adult_shapes": (n_adults, n_shape),
        "adult_phenotypes": (n_adults, len(PHENOTYPES)),
    }
    for name, shape in expected.items():
        array = getattr(body, name)
        if array is None:
            continue
        if array.shape != shape:
            raise BadBodyFile(f"{path}: {name} has the shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise BadBodyFile(f"{path}: {name} holds values that are not finite")
    if (body.adult_shapes is None) != (body.adult_phenotypes is None):
        raise BadBodyFile(f"{path}: adult_shapes and adult_phenotypes belong together")
    if len(body.faces) == 0 or body.faces.min() < 0 or body.faces.max() >= n_vertices:
        raise BadBodyFile(f"{path}: faces must name vertices 0 to {n_vertices - 1}")
    if np.abs(body.skin_weights.sum(axis=1) - 1).max() > 1e-4 or body.skin_weights.min() < -1e-4:
        raise BadBodyFile(f"{path}: skin_weights of each vertex must be shares that sum to 1")


def _check_dimensions(path: Path, body: BodyModel) -> None:
    for name, n_dims in _DIMENSIONS.items():
        value = getattr(body, name)
        if isinstance(value, str):
            raise BadBodyFile(f"{path}: {name} is a text, not an array of numbers")
        if value is not None and value.ndim != n_dims:
            raise BadBodyFile(f"{path}: {name} has {value.ndim} dimensions, expected {n_dims}")


def _in_memory(path: Path, name: str, array: np.ndarray | None) -> Any:
    if array is None or array.dtype.kind == "U":
        return None if array is None else str(array)
    if array.dtype.kind not in "biuf":
        raise BadBodyFile(f"{path}: {name} is of {array.dtype}, which are no numbers")
    return array.astype(np.int64 if array.dtype.kind in "iu" else np.float64)


def is_own_body(path: Path) -> bool:
    """Whether a file is one of `save_body`."""
    if path.suffix != ".npz":
        return False
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return "format" in arrays and str(arrays["format"]) == FORMAT
    except (OSError, EOFError, ValueError, zipfile.BadZipFile):
        return False
