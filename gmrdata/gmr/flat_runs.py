"""Runs of training frames laid end to end: in memory, or in files that are mapped into it.

A frame takes 464 bytes with quaternions, so AMASS's 1.4 million frames at 10 fps take 650 MB.  From
a mapped file only those parts are read that are drawn, and processes on one machine share them.
Local rotation matrices, which would take twice as much, are computed from the network's input where
a batch is made.
"""

import io
import shutil
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.gmr.config import Representation
from gmrdata.stage.locks import locked
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import NUMPY_ERRORS, partial_of
from gmrdata.values.records import Record

PACK_FILE = "pack.json"


class PackRecord(Record):
    """What decides the content of a set's files: of the network's input."""

    format: Literal["gmrdata-pack/2"] = "gmrdata-pack/2"
    input: Representation
    fps_hz: float


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """Frames that follow each other: a whole run, or a window of it."""

    poses: np.ndarray  # (n, D) network input without extra inputs
    root_rotmats: np.ndarray  # (n, 3, 3) frame_from_root
    pelvis_m: np.ndarray  # (n, 3) [m]
    shape: np.ndarray  # (S,)
    part: int = 0  # which of several manifests it comes from; parts come one after the other
    body: int = 0  # which of several bodies the person has
    mirrored: bool = False  # left and right exchanged: in the root's motion, not yet in `poses`


@dataclass(frozen=True, eq=False)
class FlatRuns:
    """N frames of R runs; run i has the frames `ends[i - 1]` to `ends[i]`."""

    poses: np.ndarray  # (N, D) float32 network input
    root_rotmats: np.ndarray
    """(N, 3, 3) float64 frame_from_root: differences of neighbouring frames are taken of it."""
    pelvis_m: np.ndarray
    """(N, 3) float64 [m], likewise: 300 m from the origin float32 would be 0.03 mm off."""
    shapes: np.ndarray  # (R, S) float32
    parts: np.ndarray  # (R,) int64 which manifest each run comes from, ascending
    bodies: np.ndarray  # (R,) int64 which body each run's person has
    ends: np.ndarray  # (R,) int64 frames up to and including each run

    def rows(self, run: int) -> slice:
        return slice(int(self.ends[run - 1]) if run else 0, int(self.ends[run]))


_FRAME_ARRAYS = {"poses": np.float32, "root_rotmats": np.float64, "pelvis_m": np.float64}


def in_memory(runs: Iterable[TrainingRun]) -> FlatRuns:
    """Lay runs end to end in memory; there must be one at least."""
    kept = list(runs)
    frames = {
        name: np.concatenate([getattr(run, name) for run in kept]).astype(dtype, copy=False)
        for name, dtype in _FRAME_ARRAYS.items()
    }
    return FlatRuns(**frames, **_of_runs(kept, [len(run.poses) for run in kept]))


def in_files(runs: Iterable[TrainingRun], folder: Path, about: PackRecord) -> FlatRuns:
    """Lay runs end to end in one .npy per quantity, or find them there; mapped into memory.

    Processes that ask at once write once.  A folder that exists is complete; one of something else
    than `about` is made anew.  The runs are gone through once and not kept; there must be one at
    least.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        record = None
        with suppress(MissingInput, BadRecord):
            record = PackRecord.read(folder / PACK_FILE)
        if record != about:
            partial = partial_of(folder)
            for old in (partial, folder):
                shutil.rmtree(old, ignore_errors=True)
            partial.mkdir()
            _write(runs, partial)
            about.write(partial / PACK_FILE)
            partial.rename(folder)
    return _mapped(folder)


def _write(runs: Iterable[TrainingRun], folder: Path) -> None:
    none = np.zeros((0,))
    kept: list[TrainingRun] = []  # without their frames, which are many
    lengths: list[int] = []
    row_shapes: dict[str, tuple[int, ...]] = {}
    with ExitStack() as stack:
        streams = {
            name: stack.enter_context((folder / f"{name}.npy").open("wb")) for name in _FRAME_ARRAYS
        }
        for run in runs:
            for name, stream in streams.items():
                rows = np.ascontiguousarray(getattr(run, name), dtype=_FRAME_ARRAYS[name])
                if not kept:
                    row_shapes[name] = rows.shape[1:]
                    stream.write(_header(name, (0, *rows.shape[1:])))
                stream.write(rows.data)
            kept.append(replace(run, poses=none, root_rotmats=none, pelvis_m=none))
            lengths.append(len(run.poses))
        for name, stream in streams.items():
            stream.seek(0)
            stream.write(_header(name, (sum(lengths), *row_shapes[name])))
    for name, values in _of_runs(kept, lengths).items():
        np.save(folder / f"{name}.npy", values)


def _header(name: str, shape: tuple[int, ...]) -> bytes:
    """Header of a .npy: of the same length for any number of rows, since numpy leaves room."""
    header = io.BytesIO()
    descr = np.dtype(_FRAME_ARRAYS[name]).str
    about = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, about)
    return header.getvalue()


def _of_runs(runs: list[TrainingRun], lengths: list[int]) -> dict[str, np.ndarray]:
    return {
        "shapes": np.stack([run.shape for run in runs]).astype(np.float32),
        "parts": np.array([run.part for run in runs], np.int64),
        "bodies": np.array([run.body for run in runs], np.int64),
        "ends": np.cumsum(lengths, dtype=np.int64),
    }


def _mapped(folder: Path) -> FlatRuns:
    try:
        frames = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in _FRAME_ARRAYS}
        of_runs = ("shapes", "parts", "bodies", "ends")
        runs = {name: np.load(folder / f"{name}.npy") for name in of_runs}
        n_frames = int(runs["ends"][-1])
    except (*NUMPY_ERRORS, IndexError) as error:
        raise BadRecord(f"{folder}: broken ({error}). Remove it, and it is made again") from None
    of_frames, of_each = ({len(one) for one in some.values()} for some in (frames, runs))
    if of_frames != {n_frames} or len(of_each) > 1:
        raise BadRecord(f"{folder}: its arrays don't fit together. Remove it, and it is made again")
    return FlatRuns(**frames, **runs)
