"""What a pickle of plain data may call, as inert records, and turning those into arrays."""

import io
import math
import re
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from gmrdata.values.errors import UnsafePickle
from gmrdata.values.files import require_texts
from gmrdata.values.limits import Budget, OverBudget

JOBLIB_ARRAY = "joblib array"
"""Kind of record whose array's bytes stand in the file right after it; see `array_that_follows`."""
TORCH_STORAGE = "torch storage"
"""Kind of record whose bytes are a file of torch's own, in its form from before version 1.6."""
_CALLS = {
    "numpy.dtype": "dtype",
    **{f"numpy.{core}.multiarray._reconstruct": "array" for core in ("core", "_core")},
    **{f"numpy.{core}.multiarray.scalar": "scalar" for core in ("core", "_core")},
    **{f"numpy.{core}.numeric._frombuffer": "buffer" for core in ("core", "_core")},
    **{f"scipy.sparse.{module}.csc_matrix": "csc" for module in ("csc", "_csc")},
    **{f"scipy.sparse.{module}.csr_matrix": "csr" for module in ("csr", "_csr")},
    "chumpy.ch.Ch": "chumpy.ch.Ch",
    "chumpy.reordering.Select": "chumpy.reordering.Select",
    "_codecs.encode": "encode",
    "copy_reg._reconstructor": "object",
    "copyreg._reconstructor": "object",
    **{f"{module}.bytes": "bytes" for module in ("__builtin__", "builtins")},
    **{f"{module}.set": "set" for module in ("__builtin__", "builtins")},
    "collections.defaultdict": "dict",
    **{f"pathlib.{kind}Path": "path" for kind in ("Posix", "Windows", "PurePosix", "PureWindows")},
    **{f"pathlib._local.{kind}Path": "path" for kind in ("Posix", "Windows")},  # Python 3.13
    "collections.OrderedDict": "ordered",
    "joblib.numpy_pickle.NumpyArrayWrapper": JOBLIB_ARRAY,
}
"""Kind of record for each name that may be called, as Python 2 and 3, old and new numpy say it."""
_TORCH_CALLS = {
    "torch._utils._rebuild_tensor_v2": "tensor",
    "torch._utils._rebuild_parameter": "parameter",
    "torch.storage._load_from_bytes": TORCH_STORAGE,
    "torch.Size": "size",
}
STORAGE_DTYPES = {
    "torch.DoubleStorage": "<f8",
    "torch.FloatStorage": "<f4",
    "torch.HalfStorage": "<f2",
    "torch.LongStorage": "<i8",
    "torch.IntStorage": "<i4",
    "torch.ShortStorage": "<i2",
    "torch.CharStorage": "i1",
    "torch.ByteStorage": "u1",
    "torch.BoolStorage": "?",
}
"""numpy's type of the numbers of each of torch's storages."""
_BFLOAT16 = "torch.BFloat16Storage"  # the upper half of a float32, which numpy doesn't have
_TORCH_IMPORTS = frozenset(_TORCH_CALLS) | frozenset(STORAGE_DTYPES) | {_BFLOAT16}
_FACTORIES = frozenset({"collections.defaultdict"}) | {
    f"{module}.{name}"
    for module in ("__builtin__", "builtins")
    for name in ("dict", "list", "set", "int", "long", "float", "str", "unicode")
}
"""What a defaultdict may be made with."""
_ONLY_NAMED = _FACTORIES | {"numpy.ndarray", "__builtin__.object", "builtins.object"}
ADMITTED_IMPORTS = frozenset(_CALLS) | _ONLY_NAMED | _TORCH_IMPORTS
"""Every name that a pickle may import; some only as an argument of a call."""
_MOST_AXES = 32  # numpy's
_DTYPE_CODE = re.compile(r"b1|[iu][1248]|f[248]|c(8|16)|[SU]\d{1,6}|O8?")
_PLAIN = (bool, int, float, complex, str, bytes, bytearray, np.ndarray, type(None))
"""What is itself already; an array is so when it was read as joblib writes it."""


@dataclass(eq=False)
class Call:
    """A call that the pickle asked for; nothing was called."""

    kind: str
    arguments: tuple[Any, ...]
    state: Any = None  # what the pickle wanted to set on the result


def record_of_call(name: str, arguments: tuple[Any, ...], budget: Budget) -> Any:
    """The record of a call, or its value where that is a plain one.

    `name` is in full, one of `ADMITTED_IMPORTS`; imported names are strings in the arguments too.
    """
    kind = _CALLS.get(name) or _TORCH_CALLS.get(name)
    match kind, arguments:
        case "object", (str() as made, "__builtin__.object" | "builtins.object", None):
            return record_of_call(made, (), budget)
        case "set", (list() as members,):
            return set_of(members, budget)
        case "path", parts if all(isinstance(part, str) for part in parts):
            budget.take_bytes(sum(map(len, parts)))
            return "/".join(parts).replace("//", "/")
        case "ordered", (list() as items,):  # as Python 2 wrote it; an item is [key, value]
            for key, _ in items:
                budget.check_key(key)
            return dict(items)
    value = _plain_value(kind, arguments)
    value = _record(str(kind), arguments) if value is None else value
    if value is None:
        raise UnsafePickle(f"wants to call {name!r} with {_summary(arguments)}")
    return value


def _plain_value(kind: str | None, arguments: tuple[Any, ...]) -> Any:
    """The value of a call that makes a plain one, else None."""
    match kind, arguments:
        case "encode", (str() as text, "latin1" | "latin-1"):
            return text.encode("latin1")
        case "bytes", ():
            return b""
        case ("dict", () | (None,)) | ("ordered", ()):
            return {}  # torch keeps tensors and a tensor's hooks in the latter
        case "dict", (str() as factory,) if factory in _FACTORIES:
            return {}
        case "size", (tuple() as sizes,):
            return sizes
    return None


def _record(kind: str, arguments: tuple[Any, ...]) -> Call | None:
    """The record of a call that makes an array or a part of one, else None."""
    match kind, arguments:
        case "torch storage", (bytes(),):
            return Call(TORCH_STORAGE, arguments)
        case "parameter", (Call("tensor") as tensor, bool(), {}):
            return tensor
        case "tensor", (np.ndarray(), int(), tuple(), tuple(), bool(), {}, *_):
            return Call("tensor", arguments[:4])
        case "dtype", (str() as code, *_) if _DTYPE_CODE.fullmatch(code):
            return Call("dtype", (code,))
        case "scalar", (Call("dtype", (str() as code,)), bytes() | str()) if code[0] != "O":
            return Call("scalar", arguments)
        case "buffer", (bytes() | bytearray(), Call(kind="dtype"), tuple(), "C" | "F"):
            return Call("buffer", arguments)
        case ("array", ("numpy.ndarray", _, _)) | (
            "csc" | "csr" | "chumpy.ch.Ch" | "chumpy.reordering.Select" | "joblib array",
            (),
        ):
            return Call(kind, ())
    return None


def set_of(members: list[Any], budget: Budget) -> set[Any]:
    for member in members:
        budget.check_key(member)
    return set(members)


def array_that_follows(
    state: Any, subclass: str | None, stream: IO[bytes], budget: Budget, *, unread: bool
) -> np.ndarray | None:
    """The array of a joblib `NumpyArrayWrapper`, whose bytes stand in the file right after it.

    joblib.dump writes each array so (joblib/numpy_pickle.py, version 0.10 and later): the wrapper
    with shape, order and dtype, then the bytes in that order.  Since 1.2 one byte stands before
    them that says how many bytes of padding follow it.

    `state` are the wrapper's attributes, and `subclass` names the class that the array shall have.
    None where the array is left unread: then the stream is put behind it.
    """
    keys = ("shape", "order", "dtype")
    match [state.get(key) for key in keys] if isinstance(state, dict) else []:
        case [tuple() as shape, "C" | "F" as order, Call("dtype") as recorded]:
            dtype = _dtype(recorded)
        case _:
            raise ValueError("a joblib array lacks its shape, order or dtype")
    if subclass != "numpy.ndarray" or dtype.hasobject:
        raise UnsafePickle(f"holds a joblib array of {subclass!r} of {dtype}, not of numbers")
    if state.get("numpy_array_alignment_bytes") is not None:
        stream.read(stream.read(1)[0])
    n_bytes = _size(shape) * dtype.itemsize
    if unread:
        stream.seek(n_bytes, io.SEEK_CUR)
        return None
    return _array(stream.read(n_bytes), dtype, shape, order, _Done(budget))


class _Done(dict[int, Any]):
    """What was made of each part so far, by the part's id."""

    def __init__(self, budget: Budget) -> None:
        super().__init__()
        self.budget = budget


def plain(value: Any, budget: Budget) -> Any:
    """Replace the records in nested containers by arrays.  Shared parts stay shared, but count each
    time: numpy and the readers copy them."""
    made = _plain(value, _Done(budget))
    budget.take_numbers(_numbers_in(made, {}))
    return made


def _numbers_in(value: Any, known: dict[int, int | None]) -> int:
    """Numbers in nested containers, each as often as it is referred to."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return value.size
    if isinstance(value, str | bytes | bytearray):
        return 1 + len(value) // 8
    if hasattr(value, "toarray"):  # sparse, and perhaps made dense
        return math.prod(value.shape)
    if not isinstance(value, list | tuple | set | frozenset | dict | np.ndarray):
        return 1
    if id(value) not in known:
        known[id(value)] = None
        parts = (
            [*value, *value.values()]
            if isinstance(value, dict)
            else list(value.flat if isinstance(value, np.ndarray) else value)
        )
        # An array of texts has the longest one's room for each of them.
        texts = [len(part) for part in parts if isinstance(part, str | bytes)]
        text = len(texts) * max(texts, default=0)
        known[id(value)] = text + 1 + sum(_numbers_in(part, known) for part in parts)
    count = known[id(value)]
    if count is None:
        raise OverBudget("holds a list or dictionary that is in itself")
    return count


def _array_of(value: Any, done: _Done) -> np.ndarray:
    """`np.asarray` of a part, which numpy writes out in full."""
    made = _plain(value, done)
    done.budget.take_numbers(_numbers_in(made, {}))
    return np.asarray(made)


def _plain(value: Any, done: _Done) -> Any:
    if isinstance(value, _PLAIN):
        return value
    if id(value) in done:
        return done[id(value)]
    if isinstance(value, list):
        items: list[Any] = []
        done[id(value)] = items
        items.extend(_plain(item, done) for item in value)
    elif isinstance(value, dict):
        table: dict[Any, Any] = {}
        done[id(value)] = table
        table.update({_plain(key, done): _plain(item, done) for key, item in value.items()})
    elif isinstance(value, tuple | set | frozenset):
        done[id(value)] = type(value)(_plain(item, done) for item in value)
    elif isinstance(value, Call):
        done[id(value)] = _evaluate(value, done)
    else:
        name = getattr(value, "name", type(value).__name__)
        raise UnsafePickle(f"holds {name!r} itself, which is not data")
    return done[id(value)]


def _evaluate(record: Call, done: _Done) -> Any:
    match record.kind, record.arguments, record.state:
        case "array", _, (1, tuple() as shape, Call("dtype") as dtype, int() as fortran, raw):
            return _array(raw, _dtype(dtype), shape, "F" if fortran else "C", done)
        case "scalar", (dtype, raw), None:
            return _array(raw, _dtype(dtype), (), "C", done)[()]
        case "buffer", (raw, dtype, shape, order), None:
            return _array(raw, _dtype(dtype), shape, order, done)
        case "dtype", _, _:
            return _dtype(record)
        case "tensor", (storage, offset, size, stride), None:
            done.budget.take_numbers(_size(size))  # a step of 0 could ask for any amount of memory
            return _strided(storage, offset, size, stride)
        case "csc" | "csr", _, dict() as state:
            return _sparse(record.kind, {key: _plain(item, done) for key, item in state.items()})
        case "chumpy.ch.Ch", _, {"x": x}:
            return _array_of(x, done)
        case "chumpy.reordering.Select", _, {"a": a, "idxs": idxs, **rest}:
            chosen = _array_of(a, done).ravel()[_array_of(idxs, done)]
            shape = _plain(rest.get("preferred_shape", chosen.shape), done)
            return chosen.reshape(shape)
    raise ValueError(f"the parts of a {record.kind} do not fit together")


def _dtype(record: Call) -> np.dtype:
    dtype = np.dtype(record.arguments[0])
    match record.state:
        case None:
            return dtype
        case (3, "<" | ">" | "|" | "=" as order, None, None, None, _, _, _):
            return dtype.newbyteorder(order)
    raise UnsafePickle(f"holds an array of a dtype that is not plain: {_summary((record.state,))}")


def _size(shape: tuple[Any, ...]) -> int:
    if len(shape) > _MOST_AXES or not all(isinstance(n, int) and 0 <= n < 2**62 for n in shape):
        raise ValueError("an array cannot have such a shape")
    return math.prod(shape)


def _array(
    raw: Any, dtype: np.dtype, shape: tuple[Any, ...], order: Any, done: _Done
) -> np.ndarray:
    size = _size(shape)
    if dtype.hasobject:
        if not isinstance(raw, list) or len(raw) != size:
            raise ValueError(f"an array of shape {shape} lacks its list of objects")
        objects = np.empty(size, dtype=object)
        for n, item in enumerate(raw):
            objects[n] = _plain(item, done)
        return objects.reshape(shape)
    data = raw.encode("latin1") if isinstance(raw, str) else raw
    if not isinstance(data, bytes | bytearray) or len(data) != size * dtype.itemsize:
        raise ValueError(f"an array of shape {shape} and dtype {dtype} lacks its bytes")
    if size == 0:
        return np.zeros(shape, dtype)
    if dtype.itemsize == 0:
        raise ValueError(f"an array of shape {shape} has numbers of no bytes")
    array = np.frombuffer(data, dtype).reshape(shape, order=order).copy(order="K")
    if dtype.kind == "U":
        require_texts("an array", array)
    return array


def storage_of(name: str, raw: bytes) -> np.ndarray:
    """The numbers (n,) of a storage of torch, from their bytes; `name` is its imported name."""
    if name == _BFLOAT16:
        return (np.frombuffer(raw, "<u2").astype("<u4") << 16).view("<f4")
    return np.frombuffer(raw, STORAGE_DTYPES[name])


def _strided(
    storage: np.ndarray, offset: int, size: tuple[Any, ...], stride: tuple[Any, ...]
) -> np.ndarray:
    """The numbers of one tensor, which steps through its storage (n,) by `stride`."""
    if not _size(size):
        return np.zeros(size, storage.dtype)
    _size(stride)  # whole numbers, none below 0
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if not 0 <= offset <= last < len(storage):
        raise ValueError(f"a tensor of shape {size} reaches beyond its {len(storage)} numbers")
    rows = np.full((), offset)
    for n, step in zip(size, stride, strict=True):
        rows = rows[..., None] + step * np.arange(n)
    return np.asarray(storage[rows])


def _sparse(kind: str, state: dict[str, Any]) -> Any:
    from scipy import sparse

    shape = state["_shape"] if "_shape" in state else state["shape"]
    make = sparse.csc_matrix if kind == "csc" else sparse.csr_matrix
    matrix = make((state["data"], state["indices"], state["indptr"]), shape=shape)
    # Without this an index outside the shape would make scipy write outside its memory.
    matrix.check_format(full_check=True)
    return matrix


def _summary(arguments: tuple[Any, ...]) -> str:
    text = ", ".join(
        repr(a)[:200] if isinstance(a, str | int) else type(a).__name__ for a in arguments
    )
    return f"({text[:200]})"
