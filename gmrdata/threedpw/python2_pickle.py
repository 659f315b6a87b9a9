"""Pickles as Python 2 wrote them, which is how 3DPW's files are: protocol 2, byte strings, arrays.

Made opcode by opcode (Python's `pickletools` describes them) and not by the pickle module: the
bytes then hold nothing but containers, strings and arrays by construction, do not depend on the
versions of Python and numpy, and need `encoding="latin1"` to be read, as the real files do.
"""

import struct
from typing import Any

import numpy as np

_ARRAY_TYPES = {"f8": "<", "f4": "<", "i8": "<", "u2": "<", "u1": "|", "b1": "|"}
"""Byte order of each element type that is written."""
_LARGEST_LENGTH = (1 << 31) - 1
_NO_FIELDS = b"NNN" + b"J\xff\xff\xff\xff" * 2 + b"K\x00"


def python2_pickle(value: Any) -> bytes:
    """Pickle nested dictionaries, lists, strings, integers and plain arrays.

    Args:
        value: The value.  Strings must be Latin-1; arrays of float64, float32, int64, uint16, uint8
            or bool.

    Raises:
        ValueError: something else is in it.
    """
    return b"\x80\x02" + _value(value) + b"."


def _value(value: Any) -> bytes:
    match value:
        case np.ndarray():
            return _array(value)
        case str():
            return _string(value.encode("latin1"))
        case bool():
            return b"\x88" if value else b"\x89"
        case int():
            return _integer(value)
        case list():
            return b"](" + b"".join(map(_value, value)) + b"e"
        case dict():
            items = (_value(key) + _value(item) for key, item in value.items())
            return b"}(" + b"".join(items) + b"u"
    raise ValueError(f"a {type(value).__name__} is no plain data")


def _array(array: np.ndarray) -> bytes:
    """`numpy.core.multiarray._reconstruct` with the array's state, as numpy 1 asked for it."""
    code = array.dtype.str[1:]
    if code not in _ARRAY_TYPES:
        raise ValueError(f"an array of dtype {array.dtype} is not written")
    order = _ARRAY_TYPES[code]
    contiguous = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder(order))
    empty = b"cnumpy\nndarray\n(K\x00t" + _string(b"b") + b"\x87R"
    dtype = b"cnumpy\ndtype\n" + _string(code.encode()) + b"K\x00K\x01\x87R"
    dtype += b"(K\x03" + _string(order.encode()) + _NO_FIELDS + b"tb"
    shape = b"(" + b"".join(map(_integer, array.shape)) + b"t"
    state = b"(K\x01" + shape + dtype + b"\x89" + _string(contiguous.tobytes()) + b"t"
    return b"cnumpy.core.multiarray\n_reconstruct\n" + empty + state + b"b"


def _string(data: bytes) -> bytes:
    """A str of Python 2: bytes, whatever they mean."""
    if len(data) < 256:
        return b"U" + bytes([len(data)]) + data
    if len(data) > _LARGEST_LENGTH:
        raise ValueError(f"{len(data)} bytes are more than protocol 2 can hold in one string")
    return b"T" + struct.pack("<i", len(data)) + data


def _integer(value: int) -> bytes:
    if not -(1 << 31) <= value < 1 << 31:
        raise ValueError(f"the integer {value} is not written")
    return b"K" + bytes([value]) if 0 <= value < 256 else b"J" + struct.pack("<i", value)
