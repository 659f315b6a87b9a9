"""Networks to be used, not trained on: a folder of weights alone, and the one in the package.

Such a folder is given wherever a run's folder is; `load_gmr` reads both.  It holds `bundle.json`
and a safetensors file for each network, in float16: rounding a weight by 0.05 % changes a motion by
far less than two trainings differ.  Several networks predict together (`MeanGmr`).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field
from safetensors.torch import save_file

from gmrdata.gmr.checkpoint import (
    REMEDY,
    read_model,
    read_network,
    read_state,
    trained_checkpoint,
    writable,
)
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import Gmr, MeanGmr
from gmrdata.values import limits
from gmrdata.values.errors import BadCheckpoint, BadRecord
from gmrdata.values.records import Record

BUNDLE_FILE = "bundle.json"
_PACKAGED = Path(__file__).with_name("weights")


class Bundle(Record):
    """`bundle.json`."""

    format: Literal["gmrdata-networks/1"] = "gmrdata-networks/1"
    name: str
    model: ModelConfig
    fps_hz: float = Field(gt=0)
    body: str
    step: int = Field(ge=0)
    networks: int = Field(ge=1, le=limits.MOST_NETWORKS)
    """How many; their files are `network_0.safetensors` and so on."""


def bundled_run() -> Path:
    """The folder of the GMR that the package brings; give it where a run's folder is asked for.

    `card.md` in it says what it was trained on, and how it scores.
    """
    return _PACKAGED


def read_bundle(folder: Path) -> tuple[Bundle, Gmr | MeanGmr]:
    """A folder's record and its network; BadCheckpoint where something is broken or missing."""
    try:
        bundle = Bundle.read(folder / BUNDLE_FILE)
    except BadRecord as error:
        raise BadCheckpoint(f"{error}. {REMEDY}") from None
    models = [read_network(folder, f"network_{i}", bundle.model) for i in range(bundle.networks)]
    return bundle, models[0] if len(models) == 1 else MeanGmr(models)


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
