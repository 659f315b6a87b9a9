"""A body's picture: reading its coordinates and its pixels."""

from pathlib import Path

import numpy as np

from gmrdata.read.body_file import read_plain_npz
from gmrdata.read.frames import decoded
from gmrdata.values.errors import BadBodyFile, BadFrames, MissingInput


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
    if ft.shape != faces.shape or vt.ndim != 2 or vt.shape[1] != 2 or ft.dtype.kind not in "iu":
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
    found: dict[tuple[int, ...], list[int]] = {}
    for (a, b, c), (p, q, r) in corners:
        found |= {(a, b, c): [p, q, r], (b, c, a): [q, r, p], (c, a, b): [r, p, q]}
    try:
        ft = np.array([found[tuple(face)] for face in faces.tolist()])
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
