"""What a folder holds."""

from pathlib import Path


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every file by its path within a folder, but for a stage's record, which holds times."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "stage.json"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
