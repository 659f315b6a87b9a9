"""Loading a body by name or by file."""

import os
from pathlib import Path

from gmrdata.body.file import FORMAT, read_body, read_plain_npz, save_body
from gmrdata.body.model import BodyModel
from gmrdata.errors import BadBodyFile, MissingInput
from gmrdata.store import locked

SMPL_SOURCE = (
    "SMPL is free for research after registering at https://smpl.is.tue.mpg.de "
    "and accepting its licence"
)


def load_body(spec: str) -> BodyModel:
    """Load a body.

    Args:
        spec: "anny" for the default body, which is made once per machine (about a minute, with
            progress) and kept in the user's cache folder; or the path of SMPL's model as `.npz` or
            `.pkl`; or the path of an `.npz` of gmrdata's own.

    Raises:
        MissingInput: there is no such file.
        BadBodyFile: the file is broken, or holds something else than a body of 24 joints.
        UnsafePickle: the pickle wants to import something that is not plain data.
    """
    if spec == "anny":
        made = anny_file()
        try:
            return read_body(made)
        except BadBodyFile as error:
            raise BadBodyFile(f"{error}. Delete {made}, and it is made again") from None
    path = Path(spec).expanduser()
    if not path.is_file():
        raise MissingInput(
            f"{path}: no such body file. Give 'anny' for the free default body, or the path of "
            f"your own SMPL model; {SMPL_SOURCE}"
        )
    if path.suffix == ".npz" and str(read_plain_npz(path).get("format")) == FORMAT:
        return read_body(path)
    if path.suffix in (".npz", ".pkl"):
        from gmrdata.body.smpl import read_smpl

        return read_smpl(path)
    raise BadBodyFile(f"{path}: a body is 'anny', or a file ending in .npz or .pkl")


def anny_file() -> Path:
    """The default body's file in the user's cache folder, made now if it is not there.

    Two processes that ask at once make it once.
    """
    from gmrdata.body.anny_body import build_anny, file_name

    path = cache_dir() / file_name()
    if path.is_file():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path.with_suffix(".lock")):
        if not path.is_file():
            save_body(path, build_anny(path.with_suffix(".partial")))
    return path


def cache_dir() -> Path:
    """Where files that can be made again are kept: $XDG_CACHE_HOME/gmrdata, or ~/.cache/gmrdata."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "gmrdata"
