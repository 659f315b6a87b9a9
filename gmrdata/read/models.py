"""The small free networks that make masks: where they come from, and where they are kept."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from gmrdata.read.download import DEFAULT_FETCH, FetchConfig, Wanted, fetch_files, folder_address
from gmrdata.stage.locks import locked
from gmrdata.values.errors import BadDetector, FetchFailed, MissingInput
from gmrdata.values.files import sha256_of_file
from gmrdata.values.limits import MIB, MOST_NETWORK_BYTES

REMEDY = "`gmrdata fetch models` gets it"


@dataclass(frozen=True)
class Model:
    """A network's file as its authors published it."""

    name: str
    url: str
    sha256: str


YOLOX_NANO = Model(
    "yolox_nano.onnx",
    "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx",
    "695e750a5d5754bb5a8d5325643b59282191a7e7a564e435a415fd3c578eab14",
)
"""A detector on COCO's 80 classes (Apache-2.0)."""
POSE_LANDMARKS = Model(
    "pose_landmark_heavy.tflite",
    "https://storage.googleapis.com/mediapipe-assets/pose_landmark_heavy.tflite?generation=1661875897944151",
    "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
)
"""BlazePose GHUM heavy, a person's landmarks and outline (Apache-2.0)."""
QUICK_LANDMARKS = Model(
    "pose_landmark_lite.tflite",
    "https://storage.googleapis.com/mediapipe-assets/pose_landmark_lite.tflite?generation=1661875901231143",
    "f17bfbecadb61c3be1baa8b8d851cc6619c870a87167b32848ad20db306b9d61",
)
"""BlazePose GHUM lite, a quarter of the time, for outlines alone (Apache-2.0)."""
MODELS = (YOLOX_NANO, POSE_LANDMARKS, QUICK_LANDMARKS)


def cache_dir() -> Path:
    """Where files that can be fetched again are: $XDG_CACHE_HOME/gmrdata, or ~/.cache/gmrdata."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "gmrdata"


def models_dir() -> Path:
    """Where networks are looked for, and fetched to."""
    return cache_dir() / "models"


def find_model(model: Model, given: Path | None = None) -> Path:
    """A network's file: the one that is given, or else the fetched one, which is as published."""
    path = require_model(given or models_dir() / model.name)
    if given is None and sha256_of_file(path) != model.sha256:
        raise BadDetector(f"{path}: not the published file; {REMEDY} anew with --redo")
    return path


def require_model(path: Path) -> Path:
    """A network's file; MissingInput with the command that gets it if it is not there, BadDetector
    if it is larger than any that we run."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such model file; {REMEDY}")
    if (size_bytes := path.stat().st_size) > MOST_NETWORK_BYTES:
        most = f"{MOST_NETWORK_BYTES // MIB} MiB are the most"
        raise BadDetector(f"{path}: has {size_bytes // MIB} MiB, and {most}; {REMEDY}")
    return path


def fetch_models(
    out_dir: str | Path | None = None,
    config: FetchConfig = DEFAULT_FETCH,
    rng: np.random.Generator | None = None,
    *,
    redo: bool = False,
    sleep: Callable[[float], None] = time.sleep,
) -> list[Path]:
    """Get the networks whose published files are not there, and check each against its SHA-256.

    Without `out_dir` they go to the cache folder in which every job looks for them.  With `redo` a
    file of another content is fetched again.  BadRecipe: the address is not one of
    the web.  FetchFailed: some were not fetched, or not as published; the others are there.
    """
    out_dir = models_dir() if out_dir is None else Path(out_dir)
    rng = np.random.default_rng() if rng is None else rng
    wanted = wanted_models(out_dir, config)
    with locked(out_dir / "fetch"):
        problems = fetch_files(wanted, config, rng, sleep, redo)
    if problems:
        raise FetchFailed("\n".join(problems.values()))
    return [file.path for file in wanted]


def wanted_models(out_dir: Path, config: FetchConfig) -> list[Wanted]:
    """The files of `fetch_models`."""
    base = None if config.base_url is None else folder_address(config.base_url)
    files = []
    for model in MODELS:
        url = model.url if base is None else f"{base}/{model.name}"
        accept = partial(_accept, model, url)
        files.append(Wanted(model.name, out_dir / model.name, url, model.sha256, accept))
    return files


def _accept(model: Model, url: str, part: Path) -> None:
    if (sha256 := sha256_of_file(part)) != model.sha256:
        what = f"its SHA-256 is {sha256}, that of the published file {model.sha256}"
        raise FetchFailed(f"{url}: not the published file: {what}")
