"""Bodies by name, file or folder: the default one, gmrdata's own files, SMPL's models."""

from pathlib import Path

from gmrdata.read.body_file import is_own_body, read_body, save_body
from gmrdata.read.smpl import read_smpl, says_gender
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel, of_equal_size
from gmrdata.values.errors import BadBodyFile, MissingInput
from gmrdata.values.records import Config

BODY_FILE = "body.npz"
ANNY_FILE = Path(__file__).with_name("anny.npz")
"""The default body, under CC0; benchmarks/training/default_body.py made it."""


def load_body(body: Path | str | None) -> BodyModel:
    """Load a body by name or path; errors are MissingInput, BadBodyFile and UnsafePickle.

    "anny", and None, are the default body, `ANNY_FILE`.  A path is of SMPL's model as `.npz` or
    `.pkl`, or of an `.npz` of gmrdata's own.
    """
    if body in ("anny", None):
        return read_body(ANNY_FILE)
    path = Path(body).expanduser()
    if path.is_dir():
        what = "a folder of bodies, and here one body stands for everybody. Name one of its files"
        raise BadBodyFile(f"{path}: {what}")
    if not path.is_file():
        what = "no such body file. Give 'anny' for the free default body, or the path of your own"
        remedy = "SMPL is free for research after registering at https://smpl.is.tue.mpg.de"
        raise MissingInput(f"{path}: {what} SMPL model; {remedy} and accepting its licence")
    if is_own_body(path):
        return read_body(path)
    if path.suffix in (".npz", ".pkl"):
        return read_smpl(path)
    raise BadBodyFile(f"{path}: a body is 'anny', or a file ending in .npz or .pkl")


_IN_FOLDER = ("*", "*/*", "*/*/*")
"""Where a folder's models lie: in it, as SMPL's releases have them, as `female/model.npz`."""


def body_files(folder: Path) -> list[Path]:
    """The bodies' files in a folder and the two levels below: all that is gmrdata's own body, or
    says a gender in its name or its folder's.  Links that lead out of the folder are left out."""
    found = {path for pattern in _IN_FOLDER for path in folder.glob(pattern)}
    inside = (path for path in found if path.resolve().is_relative_to(folder.resolve()))
    files = (path for path in inside if path.suffix in (".npz", ".pkl") and path.is_file())
    return sorted(path for path in files if says_gender(path) or is_own_body(path))


def load_bodies(body: Path | str | None) -> tuple[BodyModel, ...]:
    """The body that `load_body` takes, or those of a folder, by name; errors as there.

    They get as many shape coefficients as the one with most.  MissingInput: a folder without any.
    BadBodyFile: two files are of one body.
    """
    if body is None or not (folder := Path(body).expanduser()).is_dir() or body == "anny":
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
        return ANNY_FILE if body == "anny" else Path(body)
    found = _named_files(folder)
    if name not in found:
        raise BadBodyFile(f"{folder}: holds {', '.join(found)}, but not {name}. Put it there")
    return found[name][0]


def _named_files(folder: Path) -> dict[str, tuple[Path, BodyModel]]:
    """A folder's bodies and their files, by the bodies' names."""
    found: dict[str, tuple[Path, BodyModel]] = {}
    for path in body_files(folder):
        one = load_body(path)
        if one.name in found:
            both = f"{found[one.name][0]} and {path}"
            what = f"holds two files of the body {one.name}: {both}"
            raise BadBodyFile(f"{folder}: {what}. Leave one there")
        found[one.name] = path, one
    if not found:
        like = "like SMPL_FEMALE.npz, basicmodel_f_lbs_10_207_0_v1.1.0.pkl or female/model.npz"
        raise MissingInput(f"{folder}: holds no SMPL models, which are named {like}")
    return found


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
