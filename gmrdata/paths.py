"""Relative paths that stay inside their folder."""

import re
from pathlib import Path, PurePosixPath

_DRIVE = re.compile(r"^[A-Za-z]:")


def safe_relative(text: str) -> str:
    """Return `text` if it is a plain relative path with forward slashes.

    Raises:
        ValueError: the path is absolute, climbs with `..`, or is written in a way that another
            system would read differently (backslashes, drive letters, control characters, `a//b`).
    """
    if not text:
        raise ValueError("path is empty")
    if text.startswith("/") or _DRIVE.match(text):
        raise ValueError(f"path {text!r} is absolute; write it relative to the manifest's folder")
    if "\\" in text or any(ord(letter) < 32 or ord(letter) == 127 for letter in text):
        raise ValueError(f"path {text!r} has a backslash or control character; use forward slashes")
    if ".." in text.split("/"):
        raise ValueError(f"path {text!r} climbs out with '..'; keep files below the manifest")
    if text == ".":
        raise ValueError("path '.' is the manifest's folder itself; name a file or folder below it")
    if PurePosixPath(text).as_posix() != text:
        raise ValueError(f"path {text!r} is not in its short form {PurePosixPath(text).as_posix()}")
    return text


def resolve_inside(root: Path, relative: str) -> Path:
    """The real path of `root / relative`, with every link on the way followed.

    Args:
        root: The folder that nothing may leave.
        relative: A path that `safe_relative` accepts.

    Raises:
        ValueError: the path, or a link anywhere along it, leads out of `root`.
    """
    real_root = root.resolve()
    try:
        target = (real_root / safe_relative(relative)).resolve()
    except (OSError, RuntimeError) as error:  # links that point at each other
        raise ValueError(f"path {relative!r} can't be followed ({error})") from None
    if not target.is_relative_to(real_root):
        raise ValueError(
            f"path {relative!r} is or passes a link out of the manifest's folder; "
            "copy the file in place of the link"
        )
    return target
