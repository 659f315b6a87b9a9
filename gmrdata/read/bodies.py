"""Bodies by name, file or folder: the default one, gmrdata's own files, SMPL's models."""

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.body_file import BODY_FORMAT, check_body, read_body, read_plain_npz, save_body
from gmrdata.read.safe_pickle import load_plain
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import file_state, run_stage
from gmrdata.values.body import HANDS, N_JOINTS, PARENTS, BodyModel, of_equal_size
from gmrdata.values.errors import BadBodyFile, BrokenPickle, MissingInput
from gmrdata.values.files import files_inside, npz_format, visible
from gmrdata.values.records import Config

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
_WORD = re.compile(r"(?:^|[^a-z])(neutral|female|male)(?:[^a-z]|$)")
_LETTER = re.compile(r"(?:^|[^a-z])([nfm])(?:[^a-z]|$)")
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


def _without_fingers(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """SMPL+H's arrays on the 24-joint tree; fingers are straight against the first index joint."""
    weights, pose_dirs_m, tree = (arrays[k] for k in ("weights", "posedirs", "kintree_table"))
    n_vertices = len(weights)
    if weights.ndim != 2:
        raise BadBodyFile(f"{path}: weights has {weights.ndim} dimensions; get the file again")
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
        content = read_plain_npz(path) if path.suffix.lower() == ".npz" else load_plain(path)
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
    said = _found_gender(path)
    if said is None:
        like = f"neutral, female or male, like SMPL_NEUTRAL{path.suffix}"
        why = "the file does not say, and one gender's shape means nothing on another"
        raise BadBodyFile(f"{path}: name the file so that it says {like}: {why}")
    return _GENDER_NAMES.get(said, said)


def _found_gender(path: Path) -> str | None:
    """What the file's name says, else its folder's."""
    stem, folder = path.stem.lower(), path.absolute().parent.name.lower()
    match = _WORD.search(stem) or _LETTER.search(stem) or _WORD.search(folder)
    return None if match is None else match[1]


BODY_FILE = "body.npz"
ANNY_FILE = Path(__file__).with_name("anny.npz")
"""The default body, under CC0; benchmarks/training/default_body.py made it."""


def load_body(body: Path | str | None) -> BodyModel:
    """Load a body by name or path; errors are MissingInput, BadBodyFile and UnsafePickle.

    "anny", and None, are the default body, `ANNY_FILE`.  A path is of SMPL's model as `.npz` or
    `.pkl`, or of an `.npz` of gmrdata's own.
    """
    path = _given(body)
    if path is None:
        return read_body(ANNY_FILE)
    if path.is_dir():
        what = "a folder of bodies, and here one body stands for everybody. Name one of its files"
        raise BadBodyFile(f"{path}: {what}")
    if not path.is_file():
        what = "no such body file. Give 'anny' for the free default body, or the path of your own"
        remedy = "SMPL is free for research after registering at https://smpl.is.tue.mpg.de"
        raise MissingInput(f"{path}: {what} SMPL model; {remedy} and accepting its licence")
    if npz_format(path) == BODY_FORMAT:
        return read_body(path)
    if path.suffix.lower() in (".npz", ".pkl"):
        return read_smpl(path)
    raise BadBodyFile(f"{path}: a body is 'anny', or a file ending in .npz or .pkl")


def load_body_once(body: Path | str) -> BodyModel:
    """The same, read once in a process for as long as the file stays as it is."""
    path = _given(body)
    return _as_it_is(body, file_state(path) if path is not None and path.is_file() else None)


@lru_cache(maxsize=8)
def _as_it_is(body: Path | str, state: object) -> BodyModel:
    return load_body(body)


def _given(body: Path | str | None) -> Path | None:
    """The file or folder that a body's path names; None for the default body."""
    return None if body is None or str(body) == "anny" else Path(body).expanduser()


_IN_FOLDER = ("*", "*/*", "*/*/*")
"""Where a folder's models lie: in it, as SMPL's releases have them, as `female/model.npz`."""


def body_files(folder: Path) -> list[Path]:
    """The bodies' files in a folder and the two levels below: all that is gmrdata's own body, or
    says a gender in its name or its folder's.  Links that lead out of the folder are left out."""
    paths = (path for pattern in _IN_FOLDER for path in visible(folder.glob(pattern)))
    files = files_inside(
        folder, (path for path in paths if path.suffix.lower() in (".npz", ".pkl"))
    )
    return [path for path in files if _found_gender(path) or npz_format(path) == BODY_FORMAT]


def load_bodies(body: Path | str | None) -> tuple[BodyModel, ...]:
    """The body that `load_body` takes, or those of a folder, by name; errors as there.

    They get as many shape coefficients as the one with most.  MissingInput: a folder without any.
    BadBodyFile: two files are of one body.
    """
    folder = _given(body)
    if folder is None or not folder.is_dir():
        return (load_body(folder),)
    by_name = _named_files(folder)
    return of_equal_size([one for _, one in (by_name[name] for name in sorted(by_name))])


def body_inputs(body: Path | str | None, role: str = "body") -> dict[str, Path]:
    """The files of `load_bodies`, as a stage's inputs; none for the default body."""
    path = _given(body)
    if path is None or not path.is_dir():
        return {} if path is None else {role: path}
    return {f"{role}_{number}": file for number, file in enumerate(body_files(path))}


def body_file(body: str, name: str) -> Path:
    """The file of the body of that name, of those that `load_bodies` takes."""
    folder = _given(body)
    if folder is None or not folder.is_dir():
        return folder or ANNY_FILE
    by_name = _named_files(folder)
    if name not in by_name:
        raise BadBodyFile(f"{folder}: holds {', '.join(by_name)}, but not {name}. Put it there")
    return by_name[name][0]


def _named_files(folder: Path) -> dict[str, tuple[Path, BodyModel]]:
    """A folder's bodies and their files, by the bodies' names."""
    by_name: dict[str, tuple[Path, BodyModel]] = {}
    for path in body_files(folder):
        one = load_body(path)
        if one.name in by_name:
            both = f"{by_name[one.name][0]} and {path}"
            what = f"holds two files of the body {one.name}: {both}"
            raise BadBodyFile(f"{folder}: {what}. Leave one there")
        by_name[one.name] = path, one
    if not by_name:
        like = "like SMPL_FEMALE.npz, basicmodel_f_lbs_10_207_0_v1.1.0.pkl or female/model.npz"
        raise MissingInput(f"{folder}: holds no SMPL models, which are named {like}")
    return by_name


class BodyConfig(Config):
    body: str
    """"anny", or the file name of a body model."""


def keep_body(body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Stage: write a body to `out_dir/body.npz`, beside the clips that use it; gives its path."""

    def work(partial_dir: Path) -> None:
        save_body(partial_dir / BODY_FILE, load_body(body))

    config, path = BodyConfig(body=Path(body).name), _given(body)
    inputs = {"file": path} if path is not None and path.is_file() else {}
    return run_stage("body", out_dir, config, inputs, work, run=run) / BODY_FILE


def keep_bodies(body: str, out_dir: Path, *, run: Run = DEFAULT_RUN) -> dict[str, Path]:
    """Keep each body of a folder, or a single one, in `out_dir/<name>`; the files by name."""
    folder = _given(body)
    if folder is None or not folder.is_dir():
        named = {load_body(body).name: body}
    else:
        named = {name: str(path) for name, (path, _) in sorted(_named_files(folder).items())}
    return {name: keep_body(one, out_dir / name, run=run) for name, one in named.items()}
