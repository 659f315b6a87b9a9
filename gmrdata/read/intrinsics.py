"""Calibrations that others wrote, and the focal length that a camera notes in its pictures.

Calibrations are read by `gmrdata.read.lens_files`; of pictures EXIF, of videos what a phone says of
its lens.
"""

import struct
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.frames import read_exif
from gmrdata.read.lens_files import OtherModel, parse_lens
from gmrdata.read.safe_pickle import BROKEN
from gmrdata.values.camera import ASSUMED, Lens, Origin
from gmrdata.values.errors import BadIntrinsics, MissingInput

MOST_BYTES = 1 << 24  # a calibration is a few lines, or those of each frame
FILM_DIAGONAL_MM = 43.267  # of 24 x 36 mm
MOST_SHIFT_PX = 1.0  # at the corner, by a radial term that is not needed, or left out
MOST_TANGENTIAL = 0.006
"""The same by tangential terms, which are left out, over the picture's longer side: 0.003 to 0.006
of Human3.6M's cameras, whose pictures they move by 0.6 to 1.1 px in the mean."""
SHORTEST, LONGEST = 0.1, 100.0  # focal lengths of cameras, over the picture's longer side
LARGEST_RATIO = 2.5  # of a focal length across and down: anamorphic lenses have 2
OTHER_SIZE, OTHER_SIZE_TOLERANCE = 0.08, 0.03
"""A principal point that is off the middle by as much, along both sides by the same share, is the
middle of a larger or a smaller picture; one so near to that of the picture on its side, of that."""
SHAPE_TOLERANCE = 0.01  # of the sides' ratio, between a calibration's picture and the frames


GIVEN_SIGMA, EXIF_SIGMA, VIDEO_SIGMA = 0.01, 0.05, 0.12
"""Standard errors, as shares: of a calibration, of whole millimetres of 35 mm film, and of those
for a video, which a phone crops to steady it."""


def read_intrinsics(path: Path, size_px: tuple[int, int]) -> Lens:
    """A camera's calibration, for frames of this size (width, height).

    Raises:
        MissingInput: there is no such file.
        BadIntrinsics: it is of no known format, of another picture, or of a lens that two radial
            terms do not describe.
    """
    if path.is_dir():
        inside = [path / name for name in ("cameras.bin", "cameras.txt")]
        path = next((file for file in inside if file.is_file()), path)
    if not path.is_file():
        raise MissingInput(f"{path}: no such file of intrinsics")
    if path.stat().st_size > MOST_BYTES:
        raise BadIntrinsics(f"{path}: larger than a calibration can be; give another file")
    try:
        pinhole, terms = parse_lens(path, size_px)
    except OtherModel as error:
        remedy = "undistort the frames to a pinhole, and give that one's"
        raise BadIntrinsics(f"{path}: can't be read as intrinsics ({error}); {remedy}") from None
    except (*BROKEN, ArithmeticError) as error:
        formats = "COLMAP's cameras.txt or .bin, OpenCV's or ROS's YAML, or 3x3 numbers"
        said = error.args[0] if isinstance(error, KeyError) and error.args else error
        what = f"can't be read as intrinsics ({said})"
        raise BadIntrinsics(f"{path}: {what}; give {formats}") from None
    _require_of_frames(path, pinhole, terms, size_px)
    radial = _two_terms(path, pinhole, terms)
    lens = replace(pinhole.at_size(size_px), focal_from=Origin("given", GIVEN_SIGMA))
    # A matrix alone says nothing of distortion.
    return replace(lens, radial=radial) if terms else replace(lens, radial_from=ASSUMED)


def _require_of_frames(
    path: Path, pinhole: Lens, terms: tuple[float, ...], size_px: tuple[int, int]
) -> None:
    """Refuse what can't be the lens of frames of this size."""
    focal_px, (width, height) = pinhole.focal_px, pinhole.size_px
    if not np.isfinite([*focal_px, *pinhole.centre_px, *terms]).all() or min(focal_px) <= 0:
        raise BadIntrinsics(f"{path}: a focal length of {focal_px} px; calibrate again")
    if max(focal_px) > LARGEST_RATIO * min(focal_px):
        remedy = "write decimal points, not commas, or calibrate again"
        raise BadIntrinsics(f"{path}: focal lengths of {focal_px} px; {remedy}")
    if min(width, height) <= 0:
        raise BadIntrinsics(f"{path}: a picture of {pinhole.size_px} px; calibrate again")
    if not SHORTEST < max(focal_px) / max(width, height) < LONGEST:
        what = f"a focal length of {focal_px[0]:g} px for {width}x{height} px"
        raise BadIntrinsics(f"{path}: {what}; give it in pixels of these frames")
    require_shape(path, pinhole, size_px)
    if not (0 < pinhole.centre_px[0] < width and 0 < pinhole.centre_px[1] < height):
        what = f"principal point {pinhole.centre_px} px is outside of the picture"
        raise BadIntrinsics(f"{path}: {what}; give the intrinsics of these frames")
    across, down = np.divide(pinhole.centre_px, pinhole.size_px) * 2
    turned = np.divide(pinhole.centre_px, (height, width)) * 2
    is_turned = max(abs(turned - 1)) < OTHER_SIZE < max(abs(across - 1), abs(down - 1))
    is_other = abs(across - 1) > OTHER_SIZE and abs(across - down) < OTHER_SIZE_TOLERANCE * across
    if is_turned or is_other:
        other = "x".join(f"{2 * one:.0f}" for one in pinhole.centre_px)
        what = f"principal point {pinhole.centre_px} px is the middle of a picture of {other} px"
        raise BadIntrinsics(f"{path}: {what}; give the intrinsics of these frames")


def require_shape(path: Path, lens: Lens, size_px: tuple[int, int]) -> None:
    """BadIntrinsics where a file's lens is of a picture of another shape than the frames."""
    scale = np.divide(size_px, lens.size_px)
    if abs(np.log(scale[0] / scale[1])) > SHAPE_TOLERANCE:
        what = "a picture of {}x{} px, the frames have {}x{} px".format(*lens.size_px, *size_px)
        raise BadIntrinsics(f"{path}: for {what}; give the intrinsics of these frames")


def _two_terms(path: Path, pinhole: Lens, terms: tuple[float, ...]) -> tuple[float, float]:
    """k1 and k2 that show the picture as all terms do (OpenCV: k1, k2, p1, p2, k3), k1 alone where
    that is enough; refuses a lens that they do not describe."""
    k1, k2, p1, p2, k3 = (*terms, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r, focal_px = np.linspace(0, pinhole.corner_radius, 50), max(pinhole.focal_px)
    beyond = k2 * r**5 + k3 * r**7
    radial, left = (k1, 0.0), focal_px * beyond
    if np.abs(left).max() > MOST_SHIFT_PX:
        powers = np.stack([r**3, r**5], axis=1)
        more = np.linalg.lstsq(powers, beyond, rcond=None)[0]
        radial, left = (k1 + more[0], more[1]), focal_px * (beyond - powers @ more)
    tangential_px = 3 * (abs(p1) + abs(p2)) * r[-1] ** 2 * focal_px
    most_px = MOST_TANGENTIAL * max(pinhole.size_px)
    if np.abs(left).max() > MOST_SHIFT_PX or tangential_px > max(MOST_SHIFT_PX, most_px):
        shift_px = np.abs(left).max() + tangential_px
        what = f"terms of distortion beyond k1 and k2 move the corner by {shift_px:.1f} px"
        remedy = "calibrate with two radial terms (COLMAP: RADIAL), or undistort the frames"
        raise BadIntrinsics(f"{path}: {what}; {remedy}")
    return float(radial[0]), float(radial[1])


def exif_lens(image: Path, size_px: tuple[int, int]) -> Lens | None:
    """The lens by a picture's EXIF (CIPA DC-008: 0xA405, or 0x920A with the focal plane's
    resolution), for frames of this size; None where it has none that can be."""
    said: dict[int, Any] = {}
    with suppress(SyntaxError, ValueError, OSError, LookupError, TypeError, struct.error):
        said = read_exif(image).get_ifd(0x8769)
    # A ratio over 0 is NaN, which is no more than 0 either.
    values = {tag: float(value) for tag, value in said.items() if isinstance(value, Real)}
    if (film_mm := values.get(0xA405, 0.0)) > 0:
        return _noted(_of_film_px(film_mm, size_px), size_px, EXIF_SIGMA)
    focal_mm, per_unit = values.get(0x920A, 0.0), values.get(0xA20E, 0.0)
    unit_mm = {2.0: 25.4, 3.0: 10.0, 4.0: 1.0}.get(values.get(0xA210, 2.0), 0.0)
    # A picture that a program set upright is longer down than across.
    taken_px = max(values.get(0xA002, 0.0), values.get(0xA003, 0.0))
    if not all(value > 0 for value in (focal_mm, per_unit, unit_mm, taken_px)):
        return None
    focal_px = focal_mm * per_unit / unit_mm * max(size_px) / taken_px
    return _noted(focal_px, size_px, EXIF_SIGMA)


def _noted(focal_px: float, size_px: tuple[int, int], sigma: float) -> Lens | None:
    """A focal length that a camera notes; None where no camera has it."""
    if not SHORTEST < focal_px / max(size_px) < LONGEST:
        return None
    return Lens.centred(focal_px, size_px, Origin("metadata", sigma))


def _of_film_px(film_mm: float, size_px: tuple[int, int]) -> float:
    """A focal length on 35 mm film, in pixels of a picture of this size."""
    return film_mm / FILM_DIAGONAL_MM * float(np.hypot(*size_px))


FILM_KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def video_lens(video: Path, size_px: tuple[int, int]) -> Lens | None:
    """The lens that a phone notes in a video, for frames of this size; None without."""
    import av

    from gmrdata.read.video import opened

    said: dict[str, str] = {}
    with suppress(av.FFmpegError, OSError), opened(video) as file:
        for metadata in (file.metadata, *(stream.metadata for stream in file.streams)):
            said |= dict(metadata)
    with suppress(ValueError):
        return _noted(_of_film_px(float(said.get(FILM_KEY, "")), size_px), size_px, VIDEO_SIGMA)
    return None
