"""Files as joblib.dump writes them, made without joblib, which is not a dependency.

By joblib's source (numpy_pickle.py, versions 0.10 to 1.5): the pickle of the value, in which each
array is an object `NumpyArrayWrapper`, whose frame ends with it, and right after it the array's
bytes.  From 1.2 on a byte before them says how many bytes of padding follow, so that they begin at
a multiple of 16.
"""

import io
import pickle  # noqa: TID251  The tests write the pickles that are to be read.
import sys
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np

ALIGNMENT = 16


class NumpyArrayWrapper:
    """Stands for joblib's class of this name."""

    def __init__(self, array: np.ndarray, aligned: bool) -> None:
        f_order = array.flags.f_contiguous and not array.flags.c_contiguous
        self.subclass = type(array)
        self.shape = array.shape
        self.order = "F" if f_order else "C"
        self.dtype = array.dtype
        self.allow_mmap = True
        if aligned:
            self.numpy_array_alignment_bytes = ALIGNMENT


NumpyArrayWrapper.__module__ = "joblib.numpy_pickle"


class _Pickler(pickle._Pickler):
    """Python's own, whose inner parts its types don't list."""

    def __init__(self, stream: io.BytesIO, protocol: int, aligned: bool) -> None:
        super().__init__(stream, protocol)
        self.stream, self.aligned = stream, aligned

    def save(self, obj: Any, save_persistent_id: bool = True) -> None:
        if type(obj) is not np.ndarray:
            super().save(obj, save_persistent_id)  # type: ignore[misc]
            return
        super().save(NumpyArrayWrapper(obj, self.aligned))  # type: ignore[misc]
        if self.proto >= 4:  # type: ignore[attr-defined]
            self.framer.commit_frame(force=True)  # type: ignore[attr-defined]
        if obj.dtype.hasobject:
            pickle.dump(obj, self.stream, protocol=2)
            return
        if self.aligned:
            padding = ALIGNMENT - (self.stream.tell() + 1) % ALIGNMENT
            self.stream.write(bytes([padding]) + b"\xff" * padding)
        f_order = obj.flags.f_contiguous and not obj.flags.c_contiguous
        self.stream.write(obj.tobytes("F" if f_order else "C"))


def joblib_bytes(value: Any, protocol: int = 4, *, aligned: bool = True) -> bytes:
    """What joblib.dump would write for a value, uncompressed."""
    module = ModuleType("joblib.numpy_pickle")
    module.NumpyArrayWrapper = NumpyArrayWrapper  # type: ignore[attr-defined]
    stream = io.BytesIO()
    with mock.patch.dict(sys.modules, {"joblib": ModuleType("joblib"), module.__name__: module}):
        _Pickler(stream, protocol, aligned).dump(value)
    return stream.getvalue()
