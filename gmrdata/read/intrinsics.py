"""Calibrations that others wrote, and the focal length that a camera notes in its pictures.

Read are COLMAP's cameras.txt and cameras.bin, OpenCV's and ROS's YAML, a matrix of 3x3 numbers,
record3d's `metadata` and transforms.json of NeRF programs; of pictures EXIF, of videos what a phone
says of its lens.
"""

import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmrdata.read.frames import read_exif
from gmrdata.values import plain_yaml
from gmrdata.values.errors import BadIntrinsics, MissingInput
from gmrdata.values.files import parse_json

MOST_BYTES = 1 << 20  # a calibration is a few lines
FILM_DIAGONAL_MM = 43.267  # of 24 x 36 mm
OPENCV_CENTRE_PX = 0.5  # OpenCV counts from the middle of the first pixel
MOST_SHIFT_PX = 1.0  # at the corner, by what one radial term can't say
SHAPE_TOLERANCE = 0.01  # of the sides' ratio, between a calibration's picture and the frames


@dataclass(frozen=True)
class Calibration:
    """A lens as one file has it, in the pixels of the frames."""

    focal_px: tuple[float, float]
    """Along x and y."""
    centre_px: tuple[float, float]
    """Principal point; (0, 0) is the outer corner of the first pixel."""
    radial_k1: float
    """A point at r, in units of the focal length, is seen at r + k1 r^3; 0 for a pinhole."""


class _Found(NamedTuple):
    """What a file says, in its own pixels."""

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    terms: tuple[float, ...] = ()  # k1, k2, p1, p2, k3 as OpenCV has them
    size_px: tuple[float, float] | None = None  # of its picture, None where it does not say


def read_intrinsics(path: Path, size_px: tuple[int, int]) -> Calibration:
    """A camera's calibration, for frames of this size (width, height).

    Raises:
        MissingInput: there is no such file.
        BadIntrinsics: it is of no known format, of another picture, or of a lens that one radial
            term does not describe.
    """
    if path.is_dir():
        inside = [path / name for name in ("cameras.bin", "cameras.txt")]
        path = next((file for file in inside if file.is_file()), path)
    if not path.is_file():
        raise MissingInput(f"{path}: no such file of intrinsics")
    if path.stat().st_size > MOST_BYTES:
        raise BadIntrinsics(f"{path}: larger than a calibration can be; give another file")
    try:
        found = _parse(path)
    except (ValueError, KeyError, TypeError, IndexError, struct.error, OverflowError) as error:
        formats = "COLMAP's cameras.txt or .bin, OpenCV's YAML, 3x3 numbers, record3d's metadata"
        what = f"can't be read as intrinsics ({error})"
        raise BadIntrinsics(f"{path}: {what}; give {formats}") from None
    return _for_frames(path, found, size_px)


def _for_frames(path: Path, found: _Found, size_px: tuple[int, int]) -> Calibration:
    """What a file says in the frames' pixels; refused where it can't be of them."""
    numbers = np.array([*found.focal_px, *found.centre_px, *found.terms])
    if not np.isfinite(numbers).all() or min(found.focal_px) <= 0:
        raise BadIntrinsics(f"{path}: a focal length of {found.focal_px} px; calibrate again")
    own = found.size_px or (float(size_px[0]), float(size_px[1]))
    if min(own) <= 0 or not np.isfinite(own).all():
        raise BadIntrinsics(f"{path}: a picture of {own} px; calibrate again")
    scale = np.divide(size_px, own)
    if abs(np.log(scale[0] / scale[1])) > SHAPE_TOLERANCE:
        what = f"for a picture of {own[0]:g}x{own[1]:g} px, the frames have {size_px[0]}x"
        raise BadIntrinsics(f"{path}: {what}{size_px[1]} px; give the intrinsics of these frames")
    if not (0 < found.centre_px[0] < own[0] and 0 < found.centre_px[1] < own[1]):
        what = f"principal point {found.centre_px} px is outside of the picture"
        raise BadIntrinsics(f"{path}: {what}; give the intrinsics of these frames")
    _require_one_term(path, found, own)
    fx, fy, cx, cy = (numbers[:4] * np.tile(scale, 2)).tolist()
    return Calibration((fx, fy), (cx, cy), found.terms[0] if found.terms else 0.0)


def _require_one_term(path: Path, found: _Found, size_px: tuple[float, float]) -> None:
    """Refuse a lens whose further terms move the corner."""
    _, k2, p1, p2, k3 = (*found.terms, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    corner = np.divide(np.maximum(found.centre_px, np.subtract(size_px, found.centre_px)),
                       found.focal_px)  # fmt: skip
    r2 = float(corner @ corner)
    radial = abs(k2 * r2**2 + k3 * r2**3) * np.sqrt(r2)
    shift_px = (radial + 3 * (abs(p1) + abs(p2)) * r2) * max(found.focal_px)
    if shift_px > MOST_SHIFT_PX:
        what = f"terms of distortion beyond k1 move the corner by {shift_px:.1f} px"
        remedy = "calibrate with one radial term (COLMAP: SIMPLE_RADIAL), or undistort the frames"
        raise BadIntrinsics(f"{path}: {what}; {remedy}")


def _parse(path: Path) -> _Found:
    content = path.read_bytes()
    if path.suffix == ".bin":
        return _colmap_binary(content)
    text = content.decode("utf-8")
    if text.startswith("%YAML") or "opencv-matrix" in text:
        return _opencv(text)
    if text.lstrip().startswith("{"):
        return _json(parse_json(text))
    if path.suffix in (".yaml", ".yml"):
        return _ros(plain_yaml.parse(text)[0])
    lines = [line.split() for line in text.splitlines() if line.strip()[:1] not in ("", "#")]
    if any(len(words) > 4 and words[1] in COLMAP_TERMS for words in lines):
        return _one_of([_colmap_line(words) for words in lines])
    matrix = np.array([line for words in lines for line in words], dtype=np.float64).reshape(3, 3)
    return _of_matrix(matrix)


def _of_matrix(matrix: np.ndarray, terms: tuple[float, ...] = (), offset_px: float = 0.0) -> _Found:
    fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    if not np.allclose(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], atol=1e-6):
        raise ValueError("no matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return _Found((fx, fy), (cx + offset_px, cy + offset_px), terms)


COLMAP_TERMS = {
    "SIMPLE_PINHOLE": (0, "f"), "PINHOLE": (1, "ff"), "SIMPLE_RADIAL": (2, "f"),
    "RADIAL": (3, "f"), "OPENCV": (4, "ff"),
}  # fmt: skip
"""Number of each camera model that is a pinhole with distortion, and its focal lengths.
https://colmap.github.io/cameras.html"""
COLMAP_PARAMETERS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8}


def _colmap_camera(model: str, size_px: tuple[float, float], params: tuple[float, ...]) -> _Found:
    number, focals = COLMAP_TERMS[model]
    if len(params) != COLMAP_PARAMETERS[number]:
        raise ValueError(f"{model} with {len(params)} parameters")
    n = len(focals)
    return _Found((params[0], params[n - 1]), (params[n], params[n + 1]), params[n + 2 :], size_px)


def _colmap_line(words: list[str]) -> _Found:
    """CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]."""
    if words[1] not in COLMAP_TERMS:
        raise ValueError(f"camera model {words[1]}; known are {', '.join(COLMAP_TERMS)}")
    width, height, *params = map(float, words[2:])
    return _colmap_camera(words[1], (width, height), tuple(params))


def _colmap_binary(content: bytes) -> _Found:
    """uint64 count; of each camera uint32 id, int32 model, uint64 width, height, doubles."""
    names = {number: name for name, (number, _) in COLMAP_TERMS.items()}
    (count,), at, found = struct.unpack_from("<Q", content), 8, []
    for _ in range(min(count, len(content))):
        _, model, width, height = struct.unpack_from("<IiQQ", content, at)
        if model not in names:
            raise ValueError(f"camera model {model}; known are {', '.join(COLMAP_TERMS)}")
        params = struct.unpack_from(f"<{COLMAP_PARAMETERS[model]}d", content, at + 24)
        at += 24 + 8 * len(params)
        found.append(_colmap_camera(names[model], (width, height), params))
    return _one_of(found)


def _one_of(cameras: list[_Found]) -> _Found:
    if len(set(cameras)) != 1:
        raise ValueError(f"{len(cameras)} cameras; keep the one of these frames")
    return cameras[0]


def _opencv(text: str) -> _Found:
    """cv2.FileStorage, as OpenCV's and Kalibr's calibration programs write it."""
    import cv2

    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        nodes = {name: storage.getNode(name) for name in (*MATRIX_KEYS, *TERMS_KEYS)}
        matrices = {k: node.mat() for k, node in nodes.items() if node.isMap()}
        sizes = [storage.getNode(name).real() for name in ("image_width", "image_height")]
        storage.release()
    except (cv2.error, SystemError) as error:
        raise ValueError(f"OpenCV: {error}") from None
    return _of_named(matrices, (sizes[0], sizes[1]) if min(sizes) > 0 else None)


MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "intrinsic_matrix", "K", "M1")
TERMS_KEYS = ("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist", "D", "D1")


def _of_named(
    matrices: Mapping[str, np.ndarray | None], size_px: tuple[float, float] | None
) -> _Found:
    """K and k1, k2, p1, p2, k3 under one of their usual names, by OpenCV's count of pixels."""
    found = next((matrices[key] for key in MATRIX_KEYS if matrices.get(key) is not None), None)
    if found is None:
        raise KeyError(f"none of {', '.join(MATRIX_KEYS)}")
    terms = next((matrices[key] for key in TERMS_KEYS if matrices.get(key) is not None), None)
    flat = () if terms is None else tuple(np.asarray(terms, dtype=np.float64).ravel().tolist())
    if len(flat) > 5 and any(flat[5:]):
        raise ValueError(f"{len(flat)} terms of distortion")
    matrix = np.asarray(found, dtype=np.float64).reshape(3, 3)
    return _of_matrix(matrix, flat[:5], OPENCV_CENTRE_PX)._replace(size_px=size_px)


def _ros(value: Mapping[str, Any]) -> _Found:
    """ROS's camera_info: matrices with rows, cols and data."""
    matrices = {
        key: np.array(entry["data"], dtype=np.float64)
        for key, entry in value.items()
        if isinstance(entry, dict) and "data" in entry
    }
    sizes = value.get("image_width"), value.get("image_height")
    size_px = None if None in sizes else (float(sizes[0] or 0), float(sizes[1] or 0))
    return _of_named(matrices, size_px)


def _json(value: Mapping[str, Any]) -> _Found:
    """record3d's metadata (K by columns, w, h) or transforms.json (fl_x, cx, w, k1, ...)."""
    size_px = (float(value["w"]), float(value["h"]))
    if "K" in value:
        matrix = np.array(value["K"], dtype=np.float64).reshape(3, 3).T
        return _of_matrix(matrix)._replace(size_px=size_px)
    fx = float(value["fl_x"])
    names = ("k1", "k2", "p1", "p2", "k3")
    terms = tuple(float(value.get(name, 0.0)) for name in names)
    focal_px = (fx, float(value.get("fl_y", fx)))
    return _Found(focal_px, (float(value["cx"]), float(value["cy"])), terms, size_px)


def exif_focal_px(image: Path, size_px: tuple[int, int]) -> float | None:
    """Focal length by a picture's EXIF (CIPA DC-008: 0xA405, or 0x920A with the focal plane's
    resolution), for frames of this size [px]; None where it has none that can be."""
    said: dict[int, Any] = {}
    with suppress(SyntaxError, ValueError, OSError, LookupError, TypeError, struct.error):
        said = read_exif(image).get_ifd(0x8769)
    # A ratio over 0 is NaN, which is no more than 0 either.
    values = {tag: float(value) for tag, value in said.items() if isinstance(value, Real)}
    if (film_mm := values.get(0xA405, 0.0)) > 0:
        return _possible(film_mm / FILM_DIAGONAL_MM * float(np.hypot(*size_px)), size_px)
    focal_mm, per_unit = values.get(0x920A, 0.0), values.get(0xA20E, 0.0)
    unit_mm = {2.0: 25.4, 3.0: 10.0, 4.0: 1.0}.get(values.get(0xA210, 2.0), 0.0)
    taken_px = values.get(0xA002, 0.0)
    if not all(value > 0 for value in (focal_mm, per_unit, unit_mm, taken_px)):
        return None
    return _possible(focal_mm * per_unit / unit_mm * max(size_px) / taken_px, size_px)


def _possible(focal_px: float, size_px: tuple[int, int]) -> float | None:
    return focal_px if 0.1 < focal_px / max(size_px) < 100 else None


FILM_KEYS = ("com.apple.quicktime.camera.focal_length.35mm_equivalent",)


def video_focal_px(video: Path, size_px: tuple[int, int]) -> float | None:
    """Focal length that a phone notes in a video, for frames of this size [px]; None without."""
    import av

    said: dict[str, str] = {}
    with suppress(av.FFmpegError, OSError), av.open(str(video), metadata_errors="replace") as file:
        for metadata in (file.metadata, *(stream.metadata for stream in file.streams)):
            said |= dict(metadata)
    for key in FILM_KEYS:
        with suppress(ValueError):
            film_mm = float(said.get(key, ""))
            return _possible(film_mm / FILM_DIAGONAL_MM * float(np.hypot(*size_px)), size_px)
    return None
