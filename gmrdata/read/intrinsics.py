"""Calibrations that others wrote, and the focal length that a camera notes in its pictures.

Read are COLMAP's cameras.txt and cameras.bin, OpenCV's and ROS's YAML, a matrix of 3x3 numbers,
record3d's `metadata` and transforms.json of NeRF programs; of pictures EXIF, of videos what a phone
says of its lens.
"""

import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.frames import read_exif
from gmrdata.values import plain_yaml
from gmrdata.values.camera import Lens, Origin
from gmrdata.values.errors import BadIntrinsics, MissingInput
from gmrdata.values.files import parse_json

MOST_BYTES = 1 << 20  # a calibration is a few lines
FILM_DIAGONAL_MM = 43.267  # of 24 x 36 mm
OPENCV_CENTRE_PX = 0.5  # OpenCV counts from the middle of the first pixel
MOST_SHIFT_PX = 1.0  # at the corner, by what one radial term can't say
SHAPE_TOLERANCE = 0.01  # of the sides' ratio, between a calibration's picture and the frames


GIVEN_SIGMA, EXIF_SIGMA, VIDEO_SIGMA = 0.01, 0.05, 0.12
"""Standard errors, as shares: of a calibration, of whole millimetres of 35 mm film, and of those
for a video, which a phone crops to steady it."""

InFile = tuple[Lens, tuple[float, ...]]
"""What a file says: a pinhole in its own pixels, and k1, k2, p1, p2, k3 as OpenCV has them."""


def read_intrinsics(path: Path, size_px: tuple[int, int]) -> Lens:
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
        pinhole, terms = _parse(path, size_px)
    except (ValueError, KeyError, TypeError, IndexError, struct.error, OverflowError) as error:
        formats = "COLMAP's cameras.txt or .bin, OpenCV's YAML, 3x3 numbers, record3d's metadata"
        what = f"can't be read as intrinsics ({error})"
        raise BadIntrinsics(f"{path}: {what}; give {formats}") from None
    _require_of_frames(path, pinhole, terms, size_px)
    _require_one_term(path, pinhole, terms)
    lens = replace(pinhole.at_size(size_px), radial=(terms[0] if terms else 0.0, 0.0))
    return replace(lens, focal_from=Origin("given", GIVEN_SIGMA))


def _require_of_frames(
    path: Path, pinhole: Lens, terms: tuple[float, ...], size_px: tuple[int, int]
) -> None:
    """Refuse what can't be the lens of frames of this size."""
    focal_px, (width, height) = pinhole.focal_px, pinhole.size_px
    if not np.isfinite([*focal_px, *pinhole.centre_px, *terms]).all() or min(focal_px) <= 0:
        raise BadIntrinsics(f"{path}: a focal length of {focal_px} px; calibrate again")
    if min(width, height) <= 0:
        raise BadIntrinsics(f"{path}: a picture of {pinhole.size_px} px; calibrate again")
    scale = np.divide(size_px, pinhole.size_px)
    if abs(np.log(scale[0] / scale[1])) > SHAPE_TOLERANCE:
        what = f"for a picture of {width}x{height} px, the frames have {size_px[0]}x"
        raise BadIntrinsics(f"{path}: {what}{size_px[1]} px; give the intrinsics of these frames")
    if not (0 < pinhole.centre_px[0] < width and 0 < pinhole.centre_px[1] < height):
        what = f"principal point {pinhole.centre_px} px is outside of the picture"
        raise BadIntrinsics(f"{path}: {what}; give the intrinsics of these frames")


def _require_one_term(path: Path, pinhole: Lens, terms: tuple[float, ...]) -> None:
    """Refuse a lens whose further terms move the corner."""
    _, k2, p1, p2, k3 = (*terms, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = pinhole.corner_radius**2
    radial = abs(k2 * r2**2 + k3 * r2**3) * np.sqrt(r2)
    shift_px = (radial + 3 * (abs(p1) + abs(p2)) * r2) * max(pinhole.focal_px)
    if shift_px > MOST_SHIFT_PX:
        what = f"terms of distortion beyond k1 move the corner by {shift_px:.1f} px"
        remedy = "calibrate with one radial term (COLMAP: SIMPLE_RADIAL), or undistort the frames"
        raise BadIntrinsics(f"{path}: {what}; {remedy}")


def _parse(path: Path, frames_px: tuple[int, int]) -> InFile:
    """What a file says; of a picture as large as the frames where it says no size."""
    content = path.read_bytes()
    if path.suffix == ".bin":
        return _colmap_binary(content)
    text = content.decode("utf-8")
    if text.startswith("%YAML") or "opencv-matrix" in text:
        return _opencv(text, frames_px)
    if text.lstrip().startswith("{"):
        return _json(parse_json(text))
    if path.suffix in (".yaml", ".yml"):
        return _ros(plain_yaml.parse(text)[0], frames_px)
    lines = [line.split() for line in text.splitlines() if line.strip()[:1] not in ("", "#")]
    if any(len(words) > 4 and words[1] in COLMAP_TERMS for words in lines):
        return _one_of([_colmap_line(words) for words in lines])
    matrix = np.array([line for words in lines for line in words], dtype=np.float64).reshape(3, 3)
    return Lens.of_matrix(matrix, frames_px), ()


COLMAP_TERMS = {
    "SIMPLE_PINHOLE": (0, "f"), "PINHOLE": (1, "ff"), "SIMPLE_RADIAL": (2, "f"),
    "RADIAL": (3, "f"), "OPENCV": (4, "ff"),
}  # fmt: skip
"""Number of each camera model that is a pinhole with distortion, and its focal lengths.
https://colmap.github.io/cameras.html"""
COLMAP_PARAMETERS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8}


def _colmap_camera(model: str, size_px: tuple[float, float], params: tuple[float, ...]) -> InFile:
    number, focals = COLMAP_TERMS[model]
    if len(params) != COLMAP_PARAMETERS[number]:
        raise ValueError(f"{model} with {len(params)} parameters")
    n = len(focals)
    focal_px, centre_px = (params[0], params[n - 1]), (params[n], params[n + 1])
    return Lens(focal_px, centre_px, _whole(size_px)), params[n + 2 :]


def _whole(size_px: tuple[float, float]) -> tuple[int, int]:
    return round(size_px[0]), round(size_px[1])


def _colmap_line(words: list[str]) -> InFile:
    """CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]."""
    if words[1] not in COLMAP_TERMS:
        raise ValueError(f"camera model {words[1]}; known are {', '.join(COLMAP_TERMS)}")
    width, height, *params = map(float, words[2:])
    return _colmap_camera(words[1], (width, height), tuple(params))


def _colmap_binary(content: bytes) -> InFile:
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


def _one_of(cameras: list[InFile]) -> InFile:
    if len(set(cameras)) != 1:
        raise ValueError(f"{len(cameras)} cameras; keep the one of these frames")
    return cameras[0]


def _opencv(text: str, frames_px: tuple[int, int]) -> InFile:
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
    return _of_named(matrices, _whole((sizes[0], sizes[1])) if min(sizes) > 0 else frames_px)


MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "intrinsic_matrix", "K", "M1")
TERMS_KEYS = ("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist", "D", "D1")


def _of_named(matrices: Mapping[str, np.ndarray | None], size_px: tuple[int, int]) -> InFile:
    """K and k1, k2, p1, p2, k3 under one of their usual names, by OpenCV's count of pixels."""
    found = next((matrices[key] for key in MATRIX_KEYS if matrices.get(key) is not None), None)
    if found is None:
        raise KeyError(f"none of {', '.join(MATRIX_KEYS)}")
    terms = next((matrices[key] for key in TERMS_KEYS if matrices.get(key) is not None), None)
    flat = () if terms is None else tuple(np.asarray(terms, dtype=np.float64).ravel().tolist())
    if len(flat) > 5 and any(flat[5:]):
        raise ValueError(f"{len(flat)} terms of distortion")
    pinhole = Lens.of_matrix(np.asarray(found, dtype=np.float64).reshape(3, 3), size_px)
    cx, cy = pinhole.centre_px
    return replace(pinhole, centre_px=(cx + OPENCV_CENTRE_PX, cy + OPENCV_CENTRE_PX)), flat[:5]


def _ros(value: Mapping[str, Any], frames_px: tuple[int, int]) -> InFile:
    """ROS's camera_info: matrices with rows, cols and data."""
    matrices = {
        key: np.array(entry["data"], dtype=np.float64)
        for key, entry in value.items()
        if isinstance(entry, dict) and "data" in entry
    }
    sizes = value.get("image_width"), value.get("image_height")
    said = frames_px if None in sizes else _whole((float(sizes[0] or 0), float(sizes[1] or 0)))
    return _of_named(matrices, said)


def _json(value: Mapping[str, Any]) -> InFile:
    """record3d's metadata (K by columns, w, h) or transforms.json (fl_x, cx, w, k1, ...)."""
    size_px = _whole((float(value["w"]), float(value["h"])))
    if "K" in value:
        matrix = np.array(value["K"], dtype=np.float64).reshape(3, 3).T
        return Lens.of_matrix(matrix, size_px), ()
    fx = float(value["fl_x"])
    names = ("k1", "k2", "p1", "p2", "k3")
    terms = tuple(float(value.get(name, 0.0)) for name in names)
    focal_px = (fx, float(value.get("fl_y", fx)))
    return Lens(focal_px, (float(value["cx"]), float(value["cy"])), size_px), terms


def exif_lens(image: Path, size_px: tuple[int, int]) -> Lens | None:
    """The lens by a picture's EXIF (CIPA DC-008: 0xA405, or 0x920A with the focal plane's
    resolution), for frames of this size; None where it has none that can be."""
    said: dict[int, Any] = {}
    with suppress(SyntaxError, ValueError, OSError, LookupError, TypeError, struct.error):
        said = read_exif(image).get_ifd(0x8769)
    # A ratio over 0 is NaN, which is no more than 0 either.
    values = {tag: float(value) for tag, value in said.items() if isinstance(value, Real)}
    if (film_mm := values.get(0xA405, 0.0)) > 0:
        return _noted(film_mm / FILM_DIAGONAL_MM * float(np.hypot(*size_px)), size_px, EXIF_SIGMA)
    focal_mm, per_unit = values.get(0x920A, 0.0), values.get(0xA20E, 0.0)
    unit_mm = {2.0: 25.4, 3.0: 10.0, 4.0: 1.0}.get(values.get(0xA210, 2.0), 0.0)
    taken_px = values.get(0xA002, 0.0)
    if not all(value > 0 for value in (focal_mm, per_unit, unit_mm, taken_px)):
        return None
    focal_px = focal_mm * per_unit / unit_mm * max(size_px) / taken_px
    return _noted(focal_px, size_px, EXIF_SIGMA)


def _noted(focal_px: float, size_px: tuple[int, int], sigma: float) -> Lens | None:
    """A focal length that a camera notes; None where no camera has it."""
    if not 0.1 < focal_px / max(size_px) < 100:
        return None
    return Lens.centred(focal_px, size_px, Origin("metadata", sigma))


FILM_KEYS = ("com.apple.quicktime.camera.focal_length.35mm_equivalent",)


def video_lens(video: Path, size_px: tuple[int, int]) -> Lens | None:
    """The lens that a phone notes in a video, for frames of this size; None without."""
    import av

    said: dict[str, str] = {}
    with suppress(av.FFmpegError, OSError), av.open(str(video), metadata_errors="replace") as file:
        for metadata in (file.metadata, *(stream.metadata for stream in file.streams)):
            said |= dict(metadata)
    for key in FILM_KEYS:
        with suppress(ValueError):
            film_mm = float(said.get(key, ""))
            focal_px = film_mm / FILM_DIAGONAL_MM * float(np.hypot(*size_px))
            return _noted(focal_px, size_px, VIDEO_SIGMA)
    return None
