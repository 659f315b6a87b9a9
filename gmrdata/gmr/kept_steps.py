"""The folder of a kept step, whole or absent, and a pointer to the latest.

`<run>/checkpoints/step_00001000/` holds files of weights and `state.json`; the file `latest` beside
it holds the folder's name.
"""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors.torch import save_file
from torch import Tensor

from gmrdata.errors import BadCheckpoint, BadRecord, MissingInput
from gmrdata.store import read_json, write_json, write_text

STATE_FILE = "state.json"


def checkpoint_dir(run_dir: Path, step: int) -> Path:
    """Where the checkpoint of a step lies."""
    return run_dir / "checkpoints" / f"step_{step:08d}"


def latest_checkpoint(run_dir: Path) -> Path | None:
    """The checkpoint that the pointer names, or None where there is none yet.

    Raises:
        BadCheckpoint: the pointer names a folder that is not there.
    """
    pointer = run_dir / "checkpoints" / "latest"
    if not pointer.is_file():
        return None
    folder = pointer.parent / pointer.read_text(encoding="utf-8").strip()
    if folder == pointer.parent or not folder.is_dir():
        raise BadCheckpoint(f"{pointer}: names {folder.name!r}, which is not there. Train again")
    return folder


def write_step(
    run_dir: Path, step: int, tensors: Mapping[str, dict[str, Tensor]], state: dict[str, Any]
) -> Path:
    """Write a step's files, point `latest` to them, and drop older ones.

    A process that is killed at any moment leaves the former folder or this one.

    Args:
        run_dir: The run's folder.
        step: Steps done.
        tensors: Tensors on the CPU that share no memory, by name, for each file.
        state: JSON values for `state.json`, to which the step is added.
    """
    folder = checkpoint_dir(run_dir, step)
    temporary = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    for name, values in tensors.items():
        save_file(values, temporary / name)
    write_json(temporary / STATE_FILE, state | {"step": step})
    for file in temporary.iterdir():
        _fsync(file)
    shutil.rmtree(folder, ignore_errors=True)
    temporary.rename(folder)
    _fsync(folder.parent)
    write_text(folder.with_name("latest"), folder.name + "\n")
    for other in folder.parent.glob("*step_*"):
        if other != folder:
            shutil.rmtree(other)
    return folder


def read_step_state(folder: Path, file_format: str) -> dict[str, Any]:
    """A kept step's `state.json`.

    Raises:
        BadCheckpoint: it is missing, not JSON, or of another format.
    """
    path = folder / STATE_FILE
    try:
        state = read_json(path)
    except (MissingInput, BadRecord) as error:
        raise BadCheckpoint(f"{path}: unreadable ({error}). Train again") from None
    if not isinstance(state, dict) or state.get("format") != file_format or "step" not in state:
        raise BadCheckpoint(
            f"{path}: not a checkpoint of {file_format}. Give a run made by gmrdata"
        )
    return state


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
