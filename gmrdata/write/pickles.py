"""Plain data as a pickle, for data sets and programs that keep their files so.

Pickles are made opcode by opcode (Python's `pickletools` describes them) and not by the pickle
module: the bytes then hold nothing but containers, strings, numbers and arrays by construction, and
do not depend on the versions of Python and numpy.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

_ARRAY_TYPES = ("f8", "f4", "i8", "u2", "u1", "b1")
"""Element types that are written."""
_NO_FIELDS = b"NNN" + b"J\xff\xff\xff\xff" * 2 + b"K\x00"


@dataclass(frozen=True)
class _Strings:
    """How a version of Python writes its strings."""

    text: Callable[[str], bytes]
    data: Callable[[bytes], bytes]


def python2_pickle(value: Any) -> bytes:
    """Pickle nested dicts, lists, Latin-1 strings, integers, and arrays of `_ARRAY_TYPES`.

    As Python 2 did it: protocol 2 and byte strings, which need `encoding="latin1"` to be read.
    """
    return b"\x80\x02" + _value(value, _PYTHON_2) + b"."


def python3_pickle(value: Any) -> bytes:
    """The same in protocol 4, with any text, which `pickle.load` reads without an encoding."""
    return b"\x80\x04" + _value(value, _PYTHON_3) + b"."


def _value(value: Any, strings: _Strings) -> bytes:
    match value:
        case np.ndarray():
            return _array(value, strings)
        case str():
            return strings.text(value)
        case bool():
            return b"\x88" if value else b"\x89"
        case int():
            return _integer(value)
        case list():
            return b"](" + b"".join(_value(item, strings) for item in value) + b"e"
        case dict():
            items = (_value(one, strings) for item in value.items() for one in item)
            return b"}(" + b"".join(items) + b"u"
    raise ValueError(f"a {type(value).__name__} is no plain data")


def _array(array: np.ndarray, strings: _Strings) -> bytes:
    """`numpy.core.multiarray._reconstruct` with the array's state, as numpy 1 asked for it."""
    code = array.dtype.str[1:]
    if code not in _ARRAY_TYPES:
        raise ValueError(f"an array of dtype {array.dtype} is not written")
    order: Literal["<", "|"] = "<" if array.dtype.itemsize > 1 else "|"
    contiguous = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder(order))
    empty = b"cnumpy\nndarray\n(K\x00t" + strings.data(b"b") + b"\x87R"
    dtype = b"cnumpy\ndtype\n" + strings.text(code) + b"K\x00K\x01\x87R"
    dtype += b"(K\x03" + strings.text(order) + _NO_FIELDS + b"tb"
    shape = b"(" + b"".join(map(_integer, array.shape)) + b"t"
    state = b"(K\x01" + shape + dtype + b"\x89" + strings.data(contiguous.tobytes()) + b"t"
    return b"cnumpy.core.multiarray\n_reconstruct\n" + empty + state + b"b"


def _integer(value: int) -> bytes:
    if not -(1 << 31) <= value < 1 << 31:
        raise ValueError(f"the integer {value} is not written")
    return b"K" + bytes([value]) if 0 <= value < 256 else b"J" + struct.pack("<i", value)


def _byte_string(data: bytes) -> bytes:
    """A str of Python 2: bytes, whatever they mean."""
    if len(data) >= 1 << 31:
        raise ValueError(f"{len(data)} bytes are more than protocol 2 can hold in one string")
    head = b"U" + bytes([len(data)]) if len(data) < 256 else b"T" + struct.pack("<i", len(data))
    return head + data


def _unicode(text: str) -> bytes:
    data = text.encode()
    return b"X" + struct.pack("<I", len(data)) + data


_PYTHON_2 = _Strings(text=lambda text: _byte_string(text.encode("latin1")), data=_byte_string)
_PYTHON_3 = _Strings(text=_unicode, data=lambda data: b"\x8e" + struct.pack("<Q", len(data)) + data)
