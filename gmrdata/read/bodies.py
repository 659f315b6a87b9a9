"""Bodies by name, file or folder: gmrdata's compact .npz of float32 arrays, SMPL's, the default."""

import os
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.stage.claims import claimed
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.bodies import of_equal_size
from gmrdata.values.body import N_JOINTS, N_LOCAL, PHENOTYPES, BodyModel
from gmrdata.values.errors import BadBodyFile, BadMotionFile, MissingInput
from gmrdata.values.files import read_npz, write_npz
from gmrdata.values.records import Config

FORMAT = "gmrdata-body/1"
BODY_FILE = "body.npz"
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


def load_body(body: str) -> BodyModel:
    """Load a body by name or path; errors are MissingInput, BadBodyFile and UnsafePickle.

    "anny" is the default body, which is made once per machine (about a minute, with progress) and
    kept in the user's cache folder.  A path is of SMPL's model as `.npz` or `.pkl`, or of an `.npz`
    of gmrdata's own.
    """
    if body == "anny":
        made = anny_file()
        try:
            return read_body(made)
        except BadBodyFile as error:
            raise BadBodyFile(f"{error}. Delete {made}, and it is made again") from None
    path = Path(body).expanduser()
    if path.is_dir():
        what = "a folder of bodies, and here one body stands for everybody. Name one of its files"
        raise BadBodyFile(f"{path}: {what}")
    if not path.is_file():
        what = "no such body file. Give 'anny' for the free default body, or the path of your own"
        remedy = "SMPL is free for research after registering at https://smpl.is.tue.mpg.de"
        raise MissingInput(f"{path}: {what} SMPL model; {remedy} and accepting its licence")
    if path.suffix == ".npz" and str(read_plain_npz(path).get("format")) == FORMAT:
        return read_body(path)
    if path.suffix in (".npz", ".pkl"):
        from gmrdata.read.smpl import read_smpl

        return read_smpl(path)
    raise BadBodyFile(f"{path}: a body is 'anny', or a file ending in .npz or .pkl")


_IN_FOLDER = ("*", "*/*", "*/*/*")
"""Where a folder's models lie: in it, as SMPL's releases have them, as `female/model.npz`."""


def body_files(folder: Path) -> list[Path]:
    """The bodies' files in a folder and the two levels below: all that is gmrdata's own body, or
    says a gender in its name or its folder's.  Links that lead out of the folder are left out."""
    from gmrdata.read.smpl import says_gender

    found = {path for pattern in _IN_FOLDER for path in folder.glob(pattern)}
    inside = (path for path in found if path.resolve().is_relative_to(folder.resolve()))
    files = (path for path in inside if path.suffix in (".npz", ".pkl") and path.is_file())
    return sorted(path for path in files if says_gender(path) or _is_own(path))


def load_bodies(body: str) -> tuple[BodyModel, ...]:
    """The body that `load_body` takes, or those of a folder, by name; errors as there.

    They get as many shape coefficients as the one with most.  MissingInput: a folder without any.
    BadBodyFile: two files are of one body.
    """
    folder = Path(body).expanduser()
    if body == "anny" or not folder.is_dir():
        return (load_body(body),)
    found = _named_files(folder)
    return of_equal_size([one for _, one in (found[name] for name in sorted(found))])


def body_inputs(path: Path | None, role: str = "body") -> dict[str, Path]:
    """The files of `load_bodies`, as a stage's inputs; none for the default body."""
    if path is None or not path.is_dir():
        return {} if path is None else {role: path}
    return {f"{role}_{number}": file for number, file in enumerate(body_files(path))}


def body_file(body: str, name: str) -> Path:
    """The file of the body of that name, of those that `load_bodies` takes."""
    folder = Path(body).expanduser()
    if body == "anny" or not folder.is_dir():
        return anny_file() if body == "anny" else Path(body)
    found = _named_files(folder)
    if name not in found:
        raise BadBodyFile(f"{folder}: holds {', '.join(found)}, but not {name}. Put it there")
    return found[name][0]


def _named_files(folder: Path) -> dict[str, tuple[Path, BodyModel]]:
    """A folder's bodies and their files, by the bodies' names."""
    found: dict[str, tuple[Path, BodyModel]] = {}
    for path in body_files(folder):
        one = load_body(str(path))
        if one.name in found:
            both = f"{found[one.name][0]} and {path}"
            what = f"holds two files of the body {one.name}: {both}"
            raise BadBodyFile(f"{folder}: {what}. Leave one there")
        found[one.name] = path, one
    if not found:
        like = "like SMPL_FEMALE.npz, basicmodel_f_lbs_10_207_0_v1.1.0.pkl or female/model.npz"
        raise MissingInput(f"{folder}: holds no SMPL models, which are named {like}")
    return found


def _is_own(path: Path) -> bool:
    """Whether a file is one of `save_body`."""
    if path.suffix != ".npz":
        return False
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return "format" in arrays and str(arrays["format"]) == FORMAT
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def anny_file() -> Path:
    """The default body's file in the user's cache; made now, by one process, if it is not there."""
    from gmrdata.read.anny import build_anny, file_name

    path = cache_dir() / file_name()
    if path.is_file():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with claimed(path.with_suffix(".claim")):
        if not path.is_file():
            save_body(path, build_anny(path.with_suffix(".partial")))
    return path


def cache_dir() -> Path:
    """Where files that can be made again are kept: $XDG_CACHE_HOME/gmrdata, or ~/.cache/gmrdata."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "gmrdata"


class BodyConfig(Config):
    body: str
    """"anny", or the file name of a body model."""


def keep_body(body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Stage: write a body to `out_dir/body.npz`, beside the clips that use it; gives its path."""

    def work(partial_dir: Path) -> None:
        save_body(partial_dir / BODY_FILE, load_body(body))

    config = BodyConfig(body=Path(body).name)
    inputs = {"file": Path(body)} if Path(body).is_file() else {}
    return run_stage("body", out_dir, config, inputs, work, run=run) / BODY_FILE


def keep_bodies(body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> dict[str, Path]:
    """Keep each body of a folder, or a single one, in `out_dir/<name>`; the files by name."""
    folder = Path(body).expanduser()
    if body == "anny" or not folder.is_dir():
        named = {load_body(body).name: body}
    else:
        named = {name: str(path) for name, (path, _) in sorted(_named_files(folder).items())}
    return {name: keep_body(one, out_dir / name, run=run) for name, one in named.items()}
