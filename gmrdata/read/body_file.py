"""gmrdata's own file of a body, a compact .npz of float32 arrays; and a body's picture."""

import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.frames import decoded
from gmrdata.values.body import N_JOINTS, N_LOCAL, PHENOTYPES, BodyModel
from gmrdata.values.errors import BadBodyFile, BadFrames, BadMotionFile, MissingInput
from gmrdata.values.files import read_npz, write_npz

BODY_FORMAT = "gmrdata-body/1"
_OPTIONAL = ("pose_dirs_m", "adult_shapes", "adult_phenotypes")


def save_body(path: str | Path, body: BodyModel) -> None:
    """Write a body as float32 and int32 arrays; the same body gives the same bytes."""
    arrays = {"format": np.array(BODY_FORMAT)}
    for field in fields(BodyModel):
        value = getattr(body, field.name)
        if isinstance(value, str):
            arrays[field.name] = np.array(value)
        elif value is not None:
            arrays[field.name] = value.astype(np.int32 if field.name == "faces" else np.float32)
    write_npz(Path(path), arrays, compressed=True)


def read_body(path: Path) -> BodyModel:
    """Read a body that `save_body` wrote; arrays come back as float64 and int64."""
    arrays = read_plain_npz(path)
    if str(arrays.get("format")) != BODY_FORMAT:
        what = f"not a body file of gmrdata (its format is not {BODY_FORMAT!r})"
        raise BadBodyFile(f"{path}: {what}")
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
        return read_npz(path, plain_alone=True)
    except BadMotionFile as error:
        raise BadBodyFile(str(error)) from None


_NAME = re.compile(r"\w[\w .+-]{0,99}")
"""What a body may be called: a folder's name, in which a stage keeps it."""
_SHAPES: dict[str, tuple[str | int, ...]] = {
    "template_m": ("vertices", 3),
    "shape_dirs_m": ("vertices", 3, "coefficients"),
    "joints_template_m": (N_JOINTS, 3),
    "joint_shape_dirs_m": (N_JOINTS, 3, "coefficients"),
    "skin_weights": ("vertices", N_JOINTS),
    "faces": ("faces", 3),
    "pose_dirs_m": ("vertices", 3, 9 * N_LOCAL),
    "adult_shapes": ("adults", "coefficients"),
    "adult_phenotypes": ("adults", len(PHENOTYPES)),
}
"""Of a body's arrays; a size that has a name is the same in all of them."""


def check_body(path: Path, body: BodyModel) -> None:
    """Refuse a body whose arrays do not fit together, or whose name could be no folder's."""
    if not isinstance(body.name, str) or not _NAME.fullmatch(body.name):
        raise BadBodyFile(f"{path}: name is {body.name!r:.40}, which can't be a folder's")
    if not isinstance(body.licence, str):
        raise BadBodyFile(f"{path}: licence is an array, not a text")
    sizes: dict[str, int] = {}
    for name in _SHAPES:
        if getattr(body, name) is not None:
            _check_array(path, name, getattr(body, name), sizes)
    if (body.adult_shapes is None) != (body.adult_phenotypes is None):
        raise BadBodyFile(f"{path}: adult_shapes and adult_phenotypes belong together")
    last, are_rows = sizes["vertices"] - 1, body.faces.dtype.kind in "iu" and len(body.faces) > 0
    if not are_rows or body.faces.min() < 0 or body.faces.max() > last:
        raise BadBodyFile(f"{path}: faces must name vertices 0 to {last}")
    if np.abs(body.skin_weights.sum(axis=1) - 1).max() > 1e-4 or body.skin_weights.min() < -1e-4:
        raise BadBodyFile(f"{path}: skin_weights of each vertex must be shares that sum to 1")


def _check_array(path: Path, name: str, array: np.ndarray | str, sizes: dict[str, int]) -> None:
    """Refuse an array of another shape, and note those sizes that are known by now."""
    wanted = _SHAPES[name]
    if isinstance(array, str):
        raise BadBodyFile(f"{path}: {name} is a text, not an array of numbers")
    if array.ndim != len(wanted):
        raise BadBodyFile(f"{path}: {name} has {array.ndim} dimensions, expected {len(wanted)}")
    shape = tuple(
        sizes.setdefault(size, length) if isinstance(size, str) else size
        for size, length in zip(wanted, array.shape, strict=True)
    )
    if array.shape != shape:
        raise BadBodyFile(f"{path}: {name} has the shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise BadBodyFile(f"{path}: {name} holds values that are not finite")


def _in_memory(path: Path, name: str, array: np.ndarray | None) -> Any:
    if array is None or array.dtype.kind == "U":
        return None if array is None else str(array)
    if array.dtype.kind not in "biuf":
        raise BadBodyFile(f"{path}: {name} is of {array.dtype}, which are no numbers")
    return array.astype(np.int64 if array.dtype.kind in "iu" else np.float64)


def read_uv(path: Path, faces: np.ndarray) -> np.ndarray:
    """Picture coordinates (F, 3, 2) of the corners of a body's faces; (0, 0) is the lower left.

    The file is a Wavefront .obj of the body's triangles in any order, whose `f` lines name texture
    coordinates (`v/vt`); or an .npz with `vt` (N, 2) and `ft` (F, 3), in the order of the body's
    faces, as SMPL-X's model files have them.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file of texture coordinates")
    if path.suffix.lower() == ".npz":
        return _uv_of_npz(path, faces)
    if path.suffix.lower() == ".obj":
        return _uv_of_obj(path, faces)
    raise BadBodyFile(f"{path}: texture coordinates come from an .obj, or an .npz with vt and ft")


def read_picture(path: Path) -> np.ndarray:
    """(H, W, 3) sRGB values from 0 to 1, row 0 at the top."""
    import cv2

    if not path.is_file():
        raise MissingInput(f"{path}: no such texture")
    fault = "not a picture; give a .png or .jpg as the texture"
    try:
        pixels = decoded(path, cv2.IMREAD_COLOR, fault)
    except BadFrames as error:
        raise BadBodyFile(str(error)) from None
    return np.asarray(pixels[..., ::-1], dtype=np.float32) / 255


def _uv_of_npz(path: Path, faces: np.ndarray) -> np.ndarray:
    arrays = read_plain_npz(path)
    missing = " and no ".join(key for key in ("vt", "ft") if key not in arrays)
    if missing:
        raise BadBodyFile(f"{path}: has no {missing}; give an .obj with texture coordinates")
    vt, ft = np.asarray(arrays["vt"]), np.asarray(arrays["ft"])
    fits = ft.shape == faces.shape and vt.shape[1:] == (2,)
    if not fits or ft.dtype.kind not in "iu" or vt.dtype.kind not in "fiu":
        what = f"vt {vt.shape} and ft {ft.shape}, but the body has {len(faces)} faces"
        raise BadBodyFile(f"{path}: {what}; give the coordinates of this very body")
    return _look_up(path, vt, ft)


def _uv_of_obj(path: Path, faces: np.ndarray) -> np.ndarray:
    vt, corners = _read_obj(path)
    remedy = "give the .obj of this very body"
    if len(corners) != len(faces):
        what = f"has {len(corners)} triangles, but the body has {len(faces)}"
        raise BadBodyFile(f"{path}: {what}; {remedy}")
    # A face's corners may start anywhere, so each is found by all three of its beginnings.
    ft_of: dict[tuple[int, ...], list[int]] = {}
    for (a, b, c), (p, q, r) in corners:
        ft_of |= {(a, b, c): [p, q, r], (b, c, a): [q, r, p], (c, a, b): [r, p, q]}
    try:
        ft = np.array([ft_of[tuple(face)] for face in faces.tolist()])
    except KeyError as unknown:
        what = f"has no triangle of the body's vertices {unknown.args[0]} (counted from 0)"
        raise BadBodyFile(f"{path}: {what}; {remedy}") from None
    return _look_up(path, vt, ft)


def _read_obj(path: Path) -> tuple[np.ndarray, list[tuple[list[int], list[int]]]]:
    """Texture coordinates (N, 2), and each triangle's vertices and coordinates, counted from 0."""
    vt: list[list[float]] = []
    corners: list[tuple[list[int], list[int]]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines()):
        words = line.split()
        try:
            if words[:1] == ["vt"]:
                vt.append([float(word) for word in words[1:3]])
                if len(vt[-1]) != 2:
                    raise ValueError
            elif words[:1] == ["f"]:
                pairs = [[int(part) - 1 for part in word.split("/")[:2]] for word in words[1:]]
                if len(pairs) != 3 or any(len(p) != 2 or min(p) < 0 for p in pairs):
                    raise ValueError
                corners.append(([p[0] for p in pairs], [p[1] for p in pairs]))
        except ValueError:
            what = "neither `vt u v` nor a triangle `f v/vt v/vt v/vt`"
            raise BadBodyFile(f"{path}, line {number + 1}: {what}") from None
    return np.array(vt, dtype=np.float64).reshape(-1, 2), corners


def _look_up(path: Path, vt: np.ndarray, ft: np.ndarray) -> np.ndarray:
    if len(ft) and (ft.min() < 0 or ft.max() >= len(vt)):
        what = f"its faces name {ft.max() + 1} texture coordinates, and it has {len(vt)}"
        raise BadBodyFile(f"{path}: {what}")
    uv = np.asarray(vt[ft], dtype=np.float64)
    if not np.isfinite(uv).all():
        raise BadBodyFile(f"{path}: texture coordinates that are not finite")
    return uv
