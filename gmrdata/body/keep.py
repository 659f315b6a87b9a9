"""Keep the body that a data set uses beside its clips."""

from pathlib import Path

from gmrdata.body.file import save_body
from gmrdata.body.load import load_body
from gmrdata.config import Config
from gmrdata.store import run_stage

BODY_FILE = "body.npz"


class BodyConfig(Config):
    """Which body."""

    body: str
    """"anny", or the file name of a body model."""


def keep_body(spec: str, out_dir: Path, *, redo: bool = False) -> Path:
    """Stage: write a body to `out_dir/body.npz`.

    Args:
        spec: What `load_body` takes.
        out_dir: The stage's folder.
        redo: Replace another body.

    Returns:
        Path of the file.
    """
    is_file = Path(spec).is_file()

    def work(partial_dir: Path) -> None:
        save_body(partial_dir / BODY_FILE, load_body(spec))

    config = BodyConfig(body=Path(spec).name)
    inputs = {"file": Path(spec)} if is_file else {}
    return run_stage("body", out_dir, config, inputs, work, redo=redo) / BODY_FILE
