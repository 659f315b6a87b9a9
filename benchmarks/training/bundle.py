"""Make a folder of weights alone of trained runs, like the one that the package brings."""

from collections.abc import Sequence
from pathlib import Path

from safetensors.torch import save_file

from gmrdata.gmr.checkpoint import read_model, read_state, trained_checkpoint, writable
from gmrdata.gmr.config import BUNDLE_FILE
from gmrdata.gmr.predict import Bundle
from gmrdata.values.errors import BadCheckpoint


def write_bundle(run_dirs: Sequence[Path], name: str, out_dir: Path) -> Path:
    """Keep the last weights of trained runs of one recipe, for use alone.

    BadCheckpoint where the runs are of different networks or frame rates.
    """
    folders = [trained_checkpoint(run_dir) for run_dir in run_dirs]
    states = [read_state(folder) for folder in folders]
    first = states[0]
    for run_dir, state in zip(run_dirs, states, strict=True):
        if (state.model, state.fps_hz, state.body) != (first.model, first.fps_hz, first.body):
            raise BadCheckpoint(
                f"{run_dir}: of another network than {run_dirs[0]}. Give runs of one recipe"
            )
    out_dir.mkdir(parents=True, exist_ok=True)
    for i, folder in enumerate(folders):
        weights = writable(read_model(folder).state_dict())
        halves = {key: value.half() for key, value in weights.items()}
        save_file(halves, out_dir / f"network_{i}.safetensors")
    Bundle(
        name=name,
        model=first.model,
        fps_hz=first.fps_hz,
        body=first.body,
        step=first.step,
        networks=len(folders),
    ).write(out_dir / BUNDLE_FILE)
    return out_dir
