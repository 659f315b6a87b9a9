"""What a training run says of itself: `metrics.jsonl`, and TensorBoard's event files if wanted."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gmrdata.values.errors import MissingExtra
from gmrdata.values.files import write_text

Log = Callable[[Mapping[str, float]], None]
"""Takes a line: `step`, and numbers by name."""


@contextmanager
def run_log(run_dir: Path | None, done: int, tensorboard: bool) -> Iterator[Log]:
    """Go on with a run's log after some steps; what it has of later ones is cut off.

    Args:
        run_dir: The run folder; gets `metrics.jsonl`, and the folder `tensorboard`.  None for a
            process that is to say nothing.
        done: Steps done.
        tensorboard: Whether to write event files, which hold times of day.

    Raises:
        MissingExtra: tensorboard is wanted, and not installed.
    """
    if run_dir is None:
        yield lambda _: None
        return
    path = run_dir / "metrics.jsonl"
    _cut(path, done)
    writer = _event_writer(run_dir, done) if tensorboard else None

    def log(values: Mapping[str, float]) -> None:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(values) + "\n")
        if writer is not None:
            for name in values.keys() - {"step"}:
                writer.add_scalar(name, values[name], values["step"])

    try:
        yield log
    finally:
        if writer is not None:
            writer.close()


def _cut(path: Path, done: int) -> None:
    lines = path.read_text("utf-8").splitlines() if path.is_file() else []
    # The process may have been killed in the middle of a line, which then is beyond the checkpoint.
    kept = [line for line in lines if _line_step(line) <= done]
    write_text(path, "".join(line + "\n" for line in kept))


def _line_step(line: str) -> float:
    try:
        return float(json.loads(line)["step"])
    except (json.JSONDecodeError, KeyError, TypeError):
        return math.inf


def _event_writer(run_dir: Path, done: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise MissingExtra(
            f"{run_dir}: tensorboard: true, but tensorboard can't be imported ({error})."
            " Install gmrdata[tensorboard], or set it to false: metrics.jsonl has the same numbers"
        ) from None
    # The viewer drops what a killed process wrote of steps that are now done again.
    return SummaryWriter(str(run_dir / "tensorboard"), purge_step=done + 1)
