"""Lens files of other programs: a pinhole, and its terms of distortion.

A file becomes plain values, whatever wrote it, and these are read by the words that programs have
for the same things.  What names another model, or has numbers of a distortion that are not known
here, is refused by that name: k1 of a fisheye is none of a pinhole.
"""

import ast
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from gmrdata.read.safe_pickle import load_object_npy, load_plain
from gmrdata.values import plain_yaml
from gmrdata.values.camera import Lens
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import parse_json, read_npz

OPENCV_CENTRE_PX = 0.5  # OpenCV counts from the middle of the first pixel
SAME_FOCAL = 0.01  # as a share: pictures of one camera that focuses again

InFile = tuple[Lens, tuple[float, ...]]
"""What a file says: a pinhole in its own pixels, and k1, k2, p1, p2, k3 as OpenCV has them."""
Values = Mapping[str, Any]  # by names of letters and digits alone, in lower case


class OtherModel(ValueError):
    """A camera model that is no pinhole with the terms that are known here."""

    def __init__(self, name: str) -> None:
        super().__init__(f"camera model {name}, which is no pinhole with radial distortion")


def parse_lens(path: Path, frames_px: tuple[int, int]) -> InFile:
    """What a file says; of a picture as large as the frames where it says no size.

    ValueError, KeyError, TypeError, IndexError and struct.error of what can't be read.
    """
    content = path.read_bytes()
    if path.suffix == ".bin":
        return _colmap_binary(content)
    if content.startswith(BINARY) or path.suffix in (".p", ".pkl", ".pickle"):
        return _of_values(_binary_values(path, content), frames_px, from_middle=True)
    text = content.decode("utf-8-sig")
    if text.lstrip().startswith("<"):
        return _of_values(_xml_values(text), frames_px, from_middle=True)
    if text.lstrip().startswith("{"):
        return _of_values(_braced_values(text), frames_px, from_middle=False)
    lines = [line.split() for line in text.splitlines() if line.strip()[:1] not in ("", "#")]
    if lines and len(lines[0]) > 4 and lines[0][1].isupper():
        return _one_of([_colmap_camera(words[1], [*map(float, words[2:])]) for words in lines])
    if lines and lines[0][0].lower() in PLAIN_FIRST:
        raise ValueError(f"DSO's calibration ({lines[0][0]})")
    if (numbers := _listed_numbers(text)) is not None:
        return _one_of([_of_numbers(each, frames_px) for each in _by_picture(numbers, len(lines))])
    return _of_values(_yaml_values(text), frames_px, from_middle=True)


BINARY = (b"PK", b"\x93NUMPY", b"\x80", b"MATLAB")  # of numpy, Python's pickles and MATLAB
PLAIN_FIRST = ("fov", "kannalabrandt", "equidistant", "radtan", "pinhole")
"""Words with which DSO's calibrations begin."""

COLMAP_TERMS = {
    "SIMPLE_PINHOLE": (0, 1, 3), "PINHOLE": (1, 2, 4), "SIMPLE_RADIAL": (2, 1, 4),
    "RADIAL": (3, 1, 5), "OPENCV": (4, 2, 8), "FULL_OPENCV": (6, 2, 12),
}  # fmt: skip
"""Number of each camera model that is a pinhole with distortion, how many focal lengths it has, and
how many parameters.  https://colmap.github.io/cameras.html"""
COLMAP_OTHERS = {
    5: "OPENCV_FISHEYE", 7: "FOV", 8: "SIMPLE_RADIAL_FISHEYE", 9: "RADIAL_FISHEYE",
    10: "THIN_PRISM_FISHEYE", 11: "RAD_TAN_THIN_PRISM_FISHEYE", 12: "SIMPLE_DIVISION",
    13: "DIVISION", 14: "SIMPLE_FISHEYE", 15: "FISHEYE", 16: "EUCM", 17: "EQUIRECTANGULAR",
}  # fmt: skip


def _colmap_camera(model: str, numbers: Sequence[float]) -> InFile:
    """By MODEL, and WIDTH, HEIGHT, PARAMS[]."""
    if model not in COLMAP_TERMS:
        raise OtherModel(model)
    (_, n, n_params), (width, height, *params) = COLMAP_TERMS[model], numbers
    if len(params) != n_params:
        raise ValueError(f"{model} with {len(params)} parameters")
    focal_px, centre_px = (params[0], params[n - 1]), (params[n], params[n + 1])
    return Lens(focal_px, centre_px, _whole((width, height))), _known_terms(tuple(params[n + 2 :]))


def _whole(size_px: tuple[float, float]) -> tuple[int, int]:
    return round(size_px[0]), round(size_px[1])


def _colmap_binary(content: bytes) -> InFile:
    """uint64 count; of each camera uint32 id, int32 model, uint64 width, height, doubles."""
    names = {number: name for name, (number, _, _) in COLMAP_TERMS.items()}
    (count,), at, cameras = struct.unpack_from("<Q", content), 8, []
    for _ in range(min(count, len(content))):
        _, model, width, height = struct.unpack_from("<IiQQ", content, at)
        if model not in names:
            raise OtherModel(COLMAP_OTHERS.get(model, f"number {model}"))
        params = struct.unpack_from(f"<{COLMAP_TERMS[names[model]][2]}d", content, at + 24)
        at += 24 + 8 * len(params)
        cameras.append(_colmap_camera(names[model], (width, height, *params)))
    return _one_of(cameras)


def _one_of(cameras: list[InFile]) -> InFile:
    """The one camera of a file, also where each picture has its own that hardly differs."""
    if not cameras:
        raise ValueError("no camera")
    if len(set(cameras)) == 1:
        return cameras[0]
    if len({(lens.size_px, terms) for lens, terms in cameras}) == 1:
        numbers = np.array([(*lens.focal_px, *lens.centre_px) for lens, _ in cameras])
        middle = np.median(numbers, axis=0)
        if (np.abs(numbers - middle) <= SAME_FOCAL * middle[:2].max()).all():
            fx, fy, cx, cy = middle.tolist()
            return replace(cameras[0][0], focal_px=(fx, fy), centre_px=(cx, cy)), cameras[0][1]
    raise ValueError(f"{len(set(cameras))} cameras that differ; keep the one of these frames")


def _binary_values(path: Path, content: bytes) -> Any:
    """What Python saved."""
    if content.startswith(b"MATLAB"):
        raise ValueError("a file of MATLAB's; write its matrix as 3x3 numbers, for pixels from 0")
    try:
        if content.startswith(b"\x93NUMPY"):  # numpy.save writes a dict as an object
            is_object = b"'|O'" in content[:128]
            return load_object_npy(path) if is_object else np.load(path, allow_pickle=False)
        if content.startswith(b"PK"):
            return read_npz(path, plain_alone=True)
        return load_plain(path)
    except GmrdataError as error:
        raise ValueError(str(error).removeprefix(f"{path}: ")) from None


def _braced_values(text: str) -> Any:
    """JSON, or what Python prints of a dict."""
    try:
        return parse_json(text)
    except ValueError as error:
        with suppress(ValueError, SyntaxError, MemoryError, RecursionError):
            return ast.literal_eval(
                re.sub(r"\b(?:np\.|numpy\.)?array\(|\)|,\s*dtype=\w+", "", text)
            )
        raise error from None


def _yaml_values(text: str) -> Any:
    """YAML, as OpenCV writes it too, or lines `name = value`."""
    if "!!python" in text:
        raise ValueError("Python's own YAML of arrays; write them with .tolist()")
    if "[image]" in text:
        raise ValueError("ROS's .ini; give the .yaml that stands beside it")
    # ZED's .conf, and others: a camera for each [section], here by its name.
    text = re.sub(r"^\[(\w+)\]\s*$", r"\1:", text, flags=re.MULTILINE)
    if re.search(r"^\w+:\n\w+\s*=", text, flags=re.MULTILINE):
        text = re.sub(r"^(?=\w+\s*=)", "  ", text, flags=re.MULTILINE)
    plain = re.sub(r"^%YAML.*$|!!opencv-\S+", "", text.replace("\t", "  "), flags=re.MULTILINE)
    plain = re.sub(r"^(\s*[\w.]+)\s*=\s*", r"\1: ", plain, flags=re.MULTILINE)
    return plain_yaml.parse(plain)[0]


def _xml_values(text: str) -> Any:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("XML with a DOCTYPE")
    try:
        return _of_element(ElementTree.fromstring(text.strip()))
    except ElementTree.ParseError as error:
        raise ValueError(f"no XML: {error}") from None


def _of_element(element: ElementTree.Element) -> Any:
    """A text, or a mapping of children and attributes; the names without their spaces."""
    inside: dict[str, Any] = {_local(name): value for name, value in element.attrib.items()}
    for child in element:
        if child.get("class") == "initial" and element.find("*[@class='adjusted']") is not None:
            continue  # Metashape's lens, of which it made the other
        name, value = _local(child.tag), _of_element(child)
        # Several of a name are kept apart.
        inside[name if name not in inside else f"{name} {len(inside)}"] = value
    has_parts = len(element) > 0 or (inside and "type_id" not in inside)
    return inside if has_parts else element.text or ""


def _local(name: str) -> str:
    return name.rpartition("}")[2]


def _listed_numbers(text: str) -> list[float] | None:
    """The numbers of a text that has nothing else, but for brackets and one name."""
    if text.count("=") > 1:
        return None
    bare = re.sub(r"^\s*#.*$|^\s*\w+\s*=|[\[\](),;]", " ", text, flags=re.MULTILINE)
    with suppress(ValueError):
        return [float(word) for word in bare.split()]
    return None


def _by_picture(numbers: list[float], n_lines: int) -> list[list[float]]:
    """The numbers of each camera: a line of four or nine for each of several pictures, or a list of
    matrices; else all are one's."""
    each = len(numbers) // max(1, n_lines) if n_lines > 4 else 9
    if each not in (4, 9) or len(numbers) % each or len(numbers) < 2 * each:
        return [numbers]
    return [numbers[at : at + each] for at in range(0, len(numbers), each)]


def _of_numbers(numbers: list[float], frames_px: tuple[int, int]) -> InFile:
    """A matrix alone, of 3x3, 3x4 or 4x4; or fx, fy, cx, cy, and the terms if any."""
    if len(numbers) == 6 and min(numbers) > 1:  # ARKitScenes' .pincam: the size first, no terms
        return _of_numbers(numbers[2:], _whole((numbers[0], numbers[1])))
    if len(numbers) in (4, 8) or (len(numbers) == 9 and numbers[1] and numbers[3]):
        fx, fy, cx, cy, *terms = numbers
        return Lens((fx, fy), (cx, cy), frames_px), _known_terms(tuple(terms))
    return Lens.of_matrix(_matrix(numbers), frames_px), ()


def _matrix(numbers: Any) -> np.ndarray:
    """(3, 3), of what may be by columns, or a part of a projection."""
    flat = np.asarray(numbers, dtype=np.float64).ravel()
    if flat.size in (12, 16):
        wide = flat.reshape(-1, 4)
        if wide[:3, 3].any() or wide[3:].tolist() != [[0, 0, 0, 1]] * (len(wide) - 3):
            raise ValueError("a projection that also moves")
        flat = wide[:3, :3].ravel()
    matrix = flat.reshape(3, 3)
    return matrix.T if matrix[2, :2].any() and not matrix[:2, 2].any() else matrix


MATRICES = (
    "intrinsics", "cameramatrix", "intrinsicmatrix", "intrinsicmat", "k", "m1", "mtx", "matrix",
    "cameramtx", "kmatrix", "intrinsicsmatrix", "calibrationmatrix", "intrinsic",
    "cameraintrinsics", "cameraintrinsic", "intrinsicparameters",
)  # fmt: skip
"""OpenPose's `CameraMatrix` is where the camera stands, and stands before its `Intrinsics`."""
FOCALS_X = ("fx", "flx", "fu", "focallengthx", "focalx")
FOCALS_Y = ("fy", "fly", "fv", "focallengthy", "focaly")
FOCALS = ("focallength", "f", "focal", "focallengthpx")
CENTRES_X = ("cx", "ppx", "u0", "pu", "cu", "principalpointx")
CENTRES_Y = ("cy", "ppy", "v0", "pv", "cv", "principalpointy")
CENTRES = ("principalpoint", "c", "cc", "center", "centre")
WIDTHS = ("w", "width", "imagewidth", "imgwidth")
HEIGHTS = ("h", "height", "imageheight", "imgheight")
SIZES = ("resolution", "imagesize", "imgsize", "imageresolution", "size")
TERMS = re.compile(
    "d1?|kc|(lens)?dist(ortions?)?(ok[13]|coef(f|ficient)?s?|param(eter)?s|vector)?|coef(f|ficient)s"
)
TERM_NAMES = (
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy",
)  # fmt: skip
MODELS = (
    "cameramodel", "distortionmodel", "modeltype", "cameratype", "projectiontype", "lensmodel",
    "lenstype", "distortiontype", "projectionmodel", "intrinsicsmodel", "cammodel",
    "polymorphicname",
)  # fmt: skip
LOOSE_MODELS = ("model", "type", "projection", "camera", "lens")  # or the maker's name, or what not
FISHEYES = ("fisheye", "isfisheye", "fisheyemodel", "usefisheye", "isomnidirectional", "omnidir")
ALL_RADIAL = "(simple|pinhole)?radial(k?[13])?|brown3"
PINHOLES = re.compile(
    f"|none|null|{ALL_RADIAL}|(simple)?pinhole|pinholecamera(model)?|perspective(camera)?|frame|"
    "(full)?opencv[458]?|brown(conrady|3t2)?|plumbbob|rational(polynomial)?|standard|rectified|"
    "(pinhole)?(radtan8?|radialtangential)|nodistortion|undistorted"
)
BACKWARD = ("inversebrownconrady", "modifiedbrownconrady")  # RealSense's: only without terms
OTHER = re.compile(
    "fish|equi|kannala|^kb[0-9]|^mei$|omni|unified|ucm|^ds$|doublesphere|^fov$|atan|prism|division|"
    "spheric|panoram|cylind|ocam|scaramuzza|ftheta|stereographic|orthographic|mirror|catadiop|"
    "generic|equirect|3de|anamorphic|ptlens"
)
BEYOND = ("xi", "omega", "skew", "alphac", "p3", "p4", "b2", "tau", "polyparameters")
"""Numbers that no pinhole with those terms has, unless they are 0."""
PARTS = (
    "intrinsics", "intrinsic", "distortion", "distortionparameters", "projectionparameters",
    "mirrorparameters", "resolution", "calibration", "parameters", "params", "sensor",
    "cameraparams", "cameraparameters", "distortioncoefficients", "imagesize", "opencvstorage",
    "principalpoint", "focallength", "value",
)  # fmt: skip
"""Mappings that are parts of the camera in which they stand."""
DEEPEST = 8


def _name(key: object) -> str:
    """A key's letters and digits, without what OpenCV's programs put before a dot."""
    return re.sub(r"[^a-z0-9]", "", str(key).rpartition(".")[2].lower())


def _of_values(value: Any, frames_px: tuple[int, int], *, from_middle: bool) -> InFile:
    if isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
        value = {"cameras": value}
    if isinstance(value, Mapping):
        cameras = list(_cameras(_by_camera(value), {}, 0))
        if not cameras:
            own: dict[str, Any] = {}
            for one in (own, *_split(value, own)):
                _require_pinhole({_name(key): part for key, part in one.items()})
            names = ", ".join(map(str, list(value)[:8]))
            raise KeyError(f"no matrix and no focal length under a usual name, but {names}")
        return _one_of([_camera(one, frames_px, from_middle) for one in cameras])
    array = np.asarray(value, dtype=np.float64)
    each = _by_picture(array.ravel().tolist(), len(np.atleast_1d(array)))
    return _one_of([_of_numbers(numbers, frames_px) for numbers in each])


def _by_camera(value: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """Camera by camera what EasyMocap's `intri.yml` has as K_<name>, dist_<name> of all `names`."""
    names = value.get("names")
    if not names or not isinstance(names, list) or any(f"K_{one}" not in value for one in names):
        return value
    return {
        name: {key[: -len(end)]: one for key, one in value.items() if str(key).endswith(end)}
        for name, end in ((name, f"_{name}") for name in names)
    }


def _cameras(value: Mapping[Any, Any], around: Values, depth: int) -> Iterator[Values]:
    """The values of each camera that a mapping holds, with those that stand around it."""
    if depth > DEEPEST:
        raise ValueError("nested too deeply")
    said: dict[str, Any] = {}
    inside = list(_split(value, said))
    own = {**around, **said}
    within = [list(_cameras(one, own, depth + 1)) for one in inside]
    all_inside = [camera for cameras in within for camera in cameras]
    again = {name: one for name, one in said.items() if any(c[name] is not one for c in all_inside)}
    if _has_focal(said) and (_has_focal(again) or not (within and all(within))):
        for one, cameras in zip(inside, within, strict=True):
            if not cameras:  # what else it says may be of the lens
                _require_pinhole({_name(key): part for key, part in one.items()})
        yield own  # also for the frames that say nothing of their own, or something else
    yield from all_inside


def _split(value: Mapping[Any, Any], own: dict[str, Any]) -> Iterator[Mapping[Any, Any]]:
    """Put a mapping's own values into `own`; give the mappings in it that may be cameras."""
    for key, one in value.items():
        name = _name(key)
        terms = one.items() if isinstance(one, Mapping) and "fisheye" in name else ()
        if any(any(_numbers(term) or ()) for said, term in terms if TERMS.fullmatch(_name(said))):
            raise OtherModel(f"fisheye ({key})")  # Gyroflow's have no other word for it
        if isinstance(one, Mapping) and isinstance(one.get("data"), Mapping):
            yield from _split(one["data"], own)
        elif isinstance(one, Mapping) and "data" in one:
            _put(own, name, one["data"])
        elif isinstance(one, Mapping) and OF_DISTORTION.search(name):
            # Its model and its lists are no camera's: maplab's has a type of its own, unlike ours.
            yield from _split({_of_distortion(key, part): part for key, part in one.items()}, own)
        elif isinstance(one, Mapping) and name in PARTS:
            yield from _split(one, own)
        elif isinstance(one, Mapping):
            yield one
        elif isinstance(one, list) and one and all(isinstance(item, Mapping) for item in one):
            yield from one
        else:
            _put(own, name, one)


def _of_distortion(key: object, value: Any) -> str:
    """The name of what stands in a distortion, as it is called where it stands beside a camera."""
    own = OF_DISTORTION.search(_name(key)) or TERMS.fullmatch(_name(key)) or key == "data"
    return str(key) if own or not isinstance(value, str | list | Mapping) else f"distortion {key}"


def _put(own: dict[str, Any], name: str, value: Any) -> None:
    if name == "calibration" and len(listed := _numbers(value) or []) > 3 and listed[1]:
        own |= {"intrinsics": listed[:4], "distortioncoefficients": listed[4:]}  # MASt3R-SLAM's
    if name in own and name in (*MATRICES, *FOCALS_X) and str(own[name]) != str(value):
        raise ValueError(f"2 cameras: {name} stands twice; keep the one of these frames")
    own[name] = value


def _has_focal(values: Values) -> bool:
    names = (*MATRICES, *FOCALS_X, *FOCALS, "cameraanglex", "focallength35mm")
    return any(_numbers(values[name]) is not None for name in names if name in values)


def _numbers(value: Any) -> list[float] | None:
    """A number, a list of them, or a text of them; None of anything else."""
    if value is None:
        return None
    if isinstance(value, str):
        value = value.replace(",", " ").split()
    with suppress(ValueError, TypeError):
        return np.asarray(value, dtype=np.float64).ravel().tolist() or None
    return None


def _first(values: Values, names: tuple[str, ...], n: tuple[int, ...] = (1,)) -> list[float] | None:
    """The numbers under the first of several names that has so many."""
    lists = (_numbers(values.get(name)) or [] for name in names)
    return next((numbers for numbers in lists if len(numbers) in n), None)


def _camera(values: Values, frames_px: tuple[int, int], from_middle: bool) -> InFile:
    """A camera by its values."""
    _require_pinhole(values)
    values = _with_terms(values)
    if "m2" in values and str(values["m2"]) != str(values.get("m1")):
        raise ValueError("2 cameras: M1 and M2; keep the one of these frames")
    for name, what in (("focallength35mm", "RealityCapture's"), ("sensorwidth", "Meshroom's")):
        if name in values:
            raise ValueError(f"{what} lens in millimetres; export COLMAP's cameras.txt")
    is_matlab = "radialdistortion" in values and "pixelaspectratio" not in values  # Nerfies'
    size_px = _size(values, frames_px, by_rows=is_matlab or "intrinsicmat" in values)  # OpenCap's
    if "f" in values and ("projection" in values or values.get("type") == "frame"):
        lens = _metashape(values, size_px)
    elif "projectiontype" in values and (_first(values, FOCALS) or [9.0])[0] < MOST_SHARE:
        lens = _opensfm(values, size_px)
    else:
        lens = _pinhole(values, size_px)
        from_middle |= any(name in values for name in ("cameramatrix", "cameramtx", "mtx"))
        shift_px = -OPENCV_CENTRE_PX if is_matlab else OPENCV_CENTRE_PX if from_middle else 0.0
        cx, cy = lens.centre_px
        lens = replace(lens, centre_px=(cx + shift_px, cy + shift_px))
    return lens, _terms(values)


def _with_terms(values: Values) -> Values:
    """The same with the terms under usual names where `k` has them, and is no matrix: all of
    OpenCV's beside PROX's `camera_mtx`, the radial ones beside mmpose's and Human3.6M's `p`."""
    k, p = (_numbers(values.get(name)) for name in ("k", "p"))
    others = {name: value for name, value in values.items() if name not in ("k", "p")}
    is_matrix = k is not None and (len(k) in (9, 12, 16) or (len(k) == 4 and k[0] > MOST_SHARE))
    if k is None or is_matrix or not _has_focal(others):
        return values
    p = p if p is not None and len(p) == 2 else []  # else the matrix of a projection
    if not p and len(k) > 3:
        return others | {"coeffs": k}
    return others | {f"{n}{i}": x for n, xs in (("k", k), ("p", p)) for i, x in enumerate(xs, 1)}


def _require_pinhole(values: Values) -> None:
    """OtherModel for what names another one, or has a number of another one."""
    for name in (*MODELS, *LOOSE_MODELS):
        word = values.get(name)
        if not isinstance(word, str) or PINHOLES.fullmatch(_name(word)):
            continue
        if _name(word) in BACKWARD:
            is_other = any(_terms(values))
        else:
            is_other = name in MODELS or OTHER.search(_name(word)) is not None
        if is_other:
            raise OtherModel(word)
    for name in FISHEYES:
        if str(values.get(name, 0)).lower() not in ("0", "0.0", "false", "none", "no", ""):
            raise OtherModel(f"fisheye ({name})")
    for name in BEYOND:
        if any(_numbers(values.get(name)) or ()):
            raise OtherModel(f"with {name} of {values[name]}")


def _size(values: Values, frames_px: tuple[int, int], *, by_rows: bool) -> tuple[int, int]:
    width, height = _first(values, WIDTHS), _first(values, HEIGHTS)
    if width is not None and height is not None:
        return _whole((width[0], height[0]))
    if (both := _first(values, SIZES, (2, 3))) is None:
        return frames_px
    return _whole((both[1], both[0]) if by_rows else (both[0], both[1]))


def _pinhole(values: Values, size_px: tuple[int, int]) -> Lens:
    """By a matrix, else by numbers, else by how wide it sees; in the file's own count of pixels."""
    if (matrix := _first(values, MATRICES, (9, 12, 16))) is not None:
        return Lens.of_matrix(_matrix(matrix), size_px)
    if (four := _first(values, MATRICES, (4,))) is not None:
        return Lens((four[0], four[1]), (four[2], four[3]), size_px)
    focal = _first(values, FOCALS_X) or _first(values, FOCALS, (1, 2))
    if focal is None:
        if (wide_rad := _first(values, ("cameraanglex",))) is None:
            raise ValueError("no focal length")
        return Lens.centred(0.5 * size_px[0] / float(np.tan(wide_rad[0] / 2)), size_px)
    aspect = _first(values, ("pixelaspectratio",)) or [1.0]
    focal_y = _first(values, FOCALS_Y) or [aspect[0] * focal[-1]]
    x, y = (_first(values, names) or [] for names in (CENTRES_X, CENTRES_Y))
    centre = _first(values, CENTRES, (2,)) or [*x, *y]
    if len(centre) != 2:
        raise ValueError("no principal point")
    return Lens((focal[0], focal_y[-1]), (centre[0], centre[1]), size_px)


def _metashape(values: Values, size_px: tuple[int, int]) -> Lens:
    """Its principal point is counted from the picture's middle, and b1 is of the pixels' shape."""
    f, b1, cx, cy = ((_first(values, (name,)) or [0.0])[0] for name in ("f", "b1", "cx", "cy"))
    return Lens((f + b1, f), (size_px[0] / 2 + cx, size_px[1] / 2 + cy), size_px)


def _opensfm(values: Values, size_px: tuple[int, int]) -> Lens:
    """Its lengths are shares of the longer side."""
    side_px = max(size_px)
    focal_x = _first(values, ("focalx", *FOCALS)) or [0.0]
    focal_y = _first(values, ("focaly",)) or focal_x
    cx, cy = ((_first(values, (name,)) or [0.0])[0] for name in ("cx", "cy"))
    centre_px = size_px[0] / 2 + cx * side_px, size_px[1] / 2 + cy * side_px
    return Lens((focal_x[0] * side_px, focal_y[0] * side_px), centre_px, size_px)


def _terms(values: Values) -> tuple[float, ...]:
    """k1, k2, p1, p2, k3, or nothing; ValueError for others that are not 0."""
    numbers = {name: _numbers(values[name]) for name in values if OF_DISTORTION.search(name)}
    said = {name: one for name, one in numbers.items() if one is not None and any(one)}
    listed = _first(values, tuple(filter(TERMS.fullmatch, values)), tuple(range(1, 15)))
    if "radialdistortion" in said:
        k1, k2, k3 = (*said.pop("radialdistortion"), 0.0, 0.0)[:3]
        p1, p2 = (*said.pop("tangentialdistortion", [0.0, 0.0]), 0.0)[:2]
        listed = [k1, k2, p1, p2, k3]
    elif listed is None:
        is_said = any(numbers.get(name) for name in TERM_NAMES)
        if several := [name for name in TERM_NAMES if len(said.get(name, [0.0])) > 1]:
            raise ValueError(f"{len(said[several[0]])} numbers of {several[0]}: {COMMAS}")
        listed = [said.pop(name, [0.0])[0] for name in TERM_NAMES] if is_said else []
    elif len(listed) == 3 or any(
        re.fullmatch(ALL_RADIAL, _name(values.get(name, ""))) for name in MODELS
    ):
        k1, k2, k3 = (*listed, 0.0, 0.0)[:3]
        listed = [k1, k2, 0.0, 0.0, k3]
    if len(_numbers(values.get("distortionparams")) or ()) == 6:  # nerfstudio's k1 to k4, p1, p2
        listed = [*listed[:2], *listed[4:], *listed[2:4]]
    unknown = [n for n in said if len(said[n]) > 14 or not (n in TERM_NAMES or TERMS.fullmatch(n))]
    if unknown:
        raise ValueError(f"a distortion {unknown[0]} that is not known here")
    return _known_terms(tuple(listed))


OF_DISTORTION = re.compile(
    "(?<!un)dist(?!ance)|^radial|^tangential|^(cam|camera|lens)?[kps][0-9]+$|^tau[xy]$|^(d1?|kc)$|"
    "^coeff"
)
COMMAS = "write decimal points, not commas"
MOST_SHARE = 10.0  # that a focal length is of the longer side, where it is a share of it


def _known_terms(terms: tuple[float, ...]) -> tuple[float, ...]:
    if any(terms[5:]):
        names = [name for name, term in zip(TERM_NAMES[5:], terms[5:], strict=False) if term]
        raise OtherModel(f"with {', '.join(names) or 'more terms'} of a rational or prism model")
    return terms[:5]
