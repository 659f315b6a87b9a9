"""One run of the camera stage by the code of a given tree: `python older.py TREE FRAMES K.npy OUT`.

Writes seconds and processor seconds to stdout.  A tree of before the folders were named by the
method has the stage elsewhere.
"""

import importlib
import inspect
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np


def _own_modules_only(tree: Path) -> None:
    """Let Python find no gmrdata but the tree's.

    An editable install's finder gives what a tree lacks from another one, without a word: a version
    without `gmrdata/cameras` was once timed with the stage of the newest.
    """
    sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in repr(finder)]
    sys.path.insert(0, str(tree))


def main(tree: Path, images_dir: Path, intrinsics: Path, out_dir: Path) -> None:
    _own_modules_only(tree)
    names = ("gmrdata.cameras.reconstruct", "gmrdata.cameras.recipe")
    if (tree / "gmrdata" / "sfm").is_dir():
        names = ("gmrdata.sfm.reconstruct", "gmrdata.sfm.config")
    stage, recipe = map(importlib.import_module, names)
    images, lens = _given(stage, images_dir, np.load(intrinsics))
    started, processor = time.perf_counter(), time.process_time()
    stage.reconstruct(images, None, lens, out_dir, recipe.SfmConfig())
    seconds, processor_s = time.perf_counter() - started, time.process_time() - processor
    _require_own(tree)
    spent = {"seconds": seconds, "processor_s": processor_s}
    sys.stdout.write(json.dumps(spent) + "\n")


def _given(stage: Any, images_dir: Path, intrinsics_px: np.ndarray) -> tuple[Any, Any]:
    """Images and lens as the tree's stage takes them: older ones a folder and a matrix."""
    if "frames" not in inspect.signature(stage.reconstruct).parameters:
        return images_dir, intrinsics_px
    frames = importlib.import_module("gmrdata.read.frames").read_frames(images_dir)
    lens = importlib.import_module("gmrdata.values.camera").Lens
    return frames, lens.of_matrix(intrinsics_px, frames.size_px)


def _require_own(tree: Path) -> None:
    found = [module for name, module in sys.modules.items() if name.split(".")[0] == "gmrdata"]
    files = [Path(path) for module in found if (path := getattr(module, "__file__", None))]
    if strange := [path for path in files if not path.is_relative_to(tree)]:
        raise SystemExit(f"{strange[0]} is not of {tree}")


if __name__ == "__main__":
    main(*(Path(given).resolve() for given in sys.argv[1:]))
