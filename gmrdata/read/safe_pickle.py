"""Reading pickles of plain data (SMPL, 3DPW, estimators' outputs) without running them.

A pickle is a program that may import and call.  Here an import only yields an inert `Import`, and
a call only a record of what was to be called; records become arrays after the program has ended.
So whatever a file holds, none of its imports is made and none of its calls is run.

joblib.dump's files are read as well: pickles, compressed or not, in which the bytes of each array
stand outside of the program (`pickle_records.array_that_follows`).  joblib itself is not needed.

numpy.save's files of objects are a pickle behind numpy's header.  Torch's tensors in any pickle
are a call on a storage, whose bytes are a file of torch.save's older form; both become arrays.

Memory and time are bounded by the file's `Budget`: what it unpacks to, the steps of its program,
the numbers in what it makes, and what may be a key.
"""

import bz2
import gzip
import io
import lzma
import pickle  # noqa: TID251  Only its interpreter is used, with every import and call taken out.
import reprlib
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any, ClassVar

import numpy as np

from gmrdata.read import pickle_records
from gmrdata.values.errors import BrokenPickle, GmrdataError, UnsafePickle
from gmrdata.values.files import require_file
from gmrdata.values.limits import LZMA_BYTES, Budget, OverBudget

_CHUNK_BYTES = 1 << 20
_OPENERS: dict[bytes, Callable[[IO[bytes]], Any]] = {
    b"\x1f\x8b": lambda stream: gzip.GzipFile(fileobj=stream),
    b"BZh": bz2.BZ2File,
}
"""First bytes of each compression; those of zlib and lzma are below."""
_ZLIB_FIRST = b"\x78"  # no pickle begins so: there is no such opcode
_LZMA_FIRST = (b"\xfd7zXZ\x00", b"\x5d\x00")


def _unpacked(data: bytes, budget: Budget) -> bytes:
    """Unpack zlib, gzip, bz2, xz and lzma."""
    opener = next((o for first, o in _OPENERS.items() if data.startswith(first)), None)
    if data.startswith(_ZLIB_FIRST):
        chunks = _zlib_chunks(data)
    elif data.startswith(_LZMA_FIRST):
        chunks = _lzma_chunks(data)
    elif opener is not None:
        chunks = iter(partial(opener(io.BytesIO(data)).read, _CHUNK_BYTES), b"")
    else:
        return data
    content = bytearray()
    for chunk in chunks:
        budget.take_bytes(len(chunk))
        content += chunk
    return bytes(content)


def _zlib_chunks(data: bytes) -> Iterator[bytes]:
    unpacker = zlib.decompressobj()
    for start in range(0, len(data), _CHUNK_BYTES):
        rest = data[start : start + _CHUNK_BYTES]
        while rest and not unpacker.eof:
            yield unpacker.decompress(rest, _CHUNK_BYTES)
            rest = unpacker.unconsumed_tail
    yield unpacker.flush()
    if not unpacker.eof:
        raise EOFError("the compressed data ends in its middle")


def _lzma_chunks(data: bytes) -> Iterator[bytes]:
    while data:
        # Its header says how much memory the unpacker sets aside.
        unpacker = lzma.LZMADecompressor(memlimit=LZMA_BYTES)
        yield unpacker.decompress(data, _CHUNK_BYTES)
        while not unpacker.eof:
            if unpacker.needs_input:
                raise EOFError("the compressed data ends in its middle")
            yield unpacker.decompress(b"", _CHUNK_BYTES)
        data = unpacker.unused_data.lstrip(b"\0")


BROKEN = (
    pickle.UnpicklingError, EOFError, ValueError, KeyError, IndexError, TypeError, AttributeError,
    OverflowError, MemoryError, AssertionError, struct.error, zlib.error,
    lzma.LZMAError, OSError, SyntaxError, TokenError, zipfile.BadZipFile,
    RuntimeError,  # an encrypted or strangely compressed member of an archive
)  # fmt: skip
"""What parsers and what looks through their values raise for a file that is another's, or cut."""


def load_plain(path: Path, without: frozenset[str] = frozenset()) -> Any:
    """Read a pickle or joblib file of plain data, as it is or compressed, as in `_OPENERS`.

    Gives nested dicts, lists, tuples, sets, strings, bytes, numbers, None and numpy arrays.  Python
    2's strings are read as Latin-1, sparse matrices as `scipy.sparse.csc_matrix` or `csr_matrix`,
    chumpy's arrays and torch's tensors as numpy's.  Anything else is an UnsafePickle that names it.
    Keys of dicts in `without` are left out: their arrays are neither made nor counted.
    """
    require_file(path)
    budget = Budget.of(path)
    with explained(path, "a pickle"):
        stream = io.BytesIO(_unpacked(path.read_bytes(), budget))
        return pickle_records.plain(Interpreter(stream, budget, without).load(), budget)


def load_object_npy(path: Path) -> Any:
    """Read the one object that numpy.save wrote to a .npy, with torch's tensors as arrays.

    Gives what `load_plain` does, and raises what it does.
    """
    require_file(path)
    stream, budget = io.BytesIO(path.read_bytes()), Budget.of(path)
    with explained(path, "a .npy of an object"):
        version = min(np.lib.format.read_magic(stream)[0], 2)
        shape, _, dtype = getattr(np.lib.format, f"read_array_header_{version}_0")(stream)
        if shape != () or dtype != np.dtype(object):
            raise ValueError(f"holds an array of dtype {dtype} and shape {shape}")
        unpickled = Interpreter(stream, budget).load()
        return pickle_records.plain(unpickled, budget).item()


@contextmanager
def explained(path: Path, kind: str, broken: type[GmrdataError] = BrokenPickle) -> Iterator[None]:
    """Let what a broken or unsafe file raises name the file and the remedy."""
    try:
        yield
    except UnsafePickle as error:
        remedy = "Do not trust this file; get it from its maker"
        raise UnsafePickle(f"{path}: {error}. {remedy}") from None
    except OverBudget as error:
        raise broken(f"{path}: {error}; {error.remedy}") from None
    except BROKEN as error:
        what = f"truncated or not {kind} ({type(error).__name__}: {error})"
        raise broken(f"{path}: {what[:300]}; get it again") from None


_short = reprlib.Repr()
"""A text of what a file holds; a full one may be larger than the memory."""


@dataclass(frozen=True)
class Import:
    """What the pickle wanted to import: a name, and nothing behind it."""

    name: str


_Unframer: Any = vars(pickle)["_Unframer"]  # of its interpreter, as `_Unpickler` is
_Stop: Any = vars(pickle)["_Stop"]
_OWN_STEPS: dict[int, Callable[[Any], None]] = dict(pickle._Unpickler.dispatch)


class Interpreter(pickle._Unpickler):
    """Python's own pickle interpreter, with every opcode that could reach an object replaced.

    The pure Python one, since the C one cannot be kept from setting attributes and allocates what
    a file's length fields say.
    """

    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = dict(_OWN_STEPS)
    stack: list[Any]
    memo: dict[int, Any]
    _file_read: Callable[[int], bytes]
    _file_readline: Callable[[], bytes]
    pop_mark: Callable[[], list[Any]]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]
    readline: Callable[[], bytes]

    def __init__(
        self, stream: io.BytesIO, budget: Budget, without: frozenset[str] = frozenset()
    ) -> None:
        self._stream, self.budget, self._without = stream, budget, without
        super().__init__(stream, encoding="latin1")

    def load(self) -> Any:
        """Python's own loop, with each step counted."""
        self._unframer = _Unframer(self._file_read, self._file_readline)
        self.read, self.readline = self._unframer.read, self._unframer.readline
        self.readinto = self._unframer.readinto
        self.metastack: list[Any] = []
        self.stack = []
        self.append = self.stack.append
        self.proto = 0
        budget = self.budget
        try:
            while key := self.read(1):
                budget.nodes_left -= 1
                if budget.nodes_left < 0:
                    raise budget.too_many_nodes()
                self.dispatch[key[0]](self)
        except _Stop as stop:
            return stop.value
        raise EOFError("the program does not end")

    def find_class(self, module: str, name: str) -> Any:
        full_name = f"{module}.{name}"
        if full_name not in pickle_records.ADMITTED_IMPORTS:
            raise UnsafePickle(f"wants to import {full_name!r}")
        return Import(full_name)

    def persistent_load(self, pid: Any) -> Any:
        raise UnsafePickle(f"wants the outside object {_short.repr(pid)}")

    def get_extension(self, code: int) -> None:
        raise UnsafePickle(f"wants to import number {code} of the extension registry")

    def _call(self) -> None:
        arguments = self.stack.pop()
        made = _record(self.stack[-1], arguments, self.budget)
        if isinstance(made, pickle_records.Call) and made.kind == pickle_records.TORCH_STORAGE:
            made = _storage(made.arguments[0], self.budget)
        self.stack[-1] = made

    def _call_with_keywords(self) -> None:
        keywords = self.stack.pop()
        if keywords:
            raise UnsafePickle(f"wants to call with the keywords {_short.repr(keywords)}")
        self._call()

    def _old_instance(self) -> None:
        module, name = (self.readline()[:-1].decode("ascii") for _ in range(2))
        raise UnsafePickle(f"wants to make an object of the old class {f'{module}.{name}'!r}")

    def _old_object(self) -> None:
        raise UnsafePickle("wants to make an object the way only old classes are made")

    def _set_state(self) -> None:
        state = self.stack.pop()
        made = self.stack[-1]
        if not isinstance(made, pickle_records.Call) or made.state is not None:
            raise UnsafePickle(f"wants to set attributes of a {type(made).__name__}")
        made.state = state
        if made.kind == pickle_records.JOBLIB_ARRAY:
            subclass = state.get("subclass") if isinstance(state, dict) else None
            named = subclass.name if isinstance(subclass, Import) else None
            # The bytes stand behind this opcode, which is where a frame has ended.
            key = self.stack[-2] if len(self.stack) > 1 else None
            unread = isinstance(key, str) and key in self._without
            self.stack[-1] = pickle_records.array_that_follows(
                state, named, self._stream, self.budget, unread=unread
            )

    def _bytearray(self) -> None:
        (length,) = struct.unpack("<Q", self.read(8))
        # Python's own allocates the length first, which a broken file may claim to be anything.
        self.append(bytearray(self.read(length)))

    def _text(self, opcode: bytes) -> None:
        _OWN_STEPS[opcode[0]](self)
        try:  # a hundred times as fast as a look at each letter: Python 2's arrays are such texts
            self.stack[-1].encode()
        except UnicodeEncodeError:
            raise ValueError("a text has half of a surrogate pair") from None

    def _set_item(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._fill_dict([key, value])

    def _set_items(self) -> None:
        self._fill_dict(self.pop_mark())

    def _dict(self) -> None:
        items = self.pop_mark()
        self.append({})
        self._fill_dict(items)

    def _fill_dict(self, items: list[Any]) -> None:
        made = self.stack[-1]
        if not isinstance(made, dict):
            raise UnsafePickle(f"wants to set keys of a {type(made).__name__}")
        for key in items[::2]:
            self.budget.check_key(key)
        made.update(zip(items[::2], items[1::2], strict=True))
        for key in self._without:
            made.pop(key, None)

    def _add_items(self) -> None:
        members = self.pop_mark()
        made = self.stack[-1]
        if not isinstance(made, set):
            raise UnsafePickle(f"wants to add members to a {type(made).__name__}")
        made |= pickle_records.set_of(members, self.budget)

    def _frozenset(self) -> None:
        members = self.pop_mark()
        self.append(frozenset(pickle_records.set_of(members, self.budget)))

    def _remember(self) -> None:
        number = int(self.readline()[:-1])
        # Python's own takes any number, and those of one hash take for ever to look up.
        if not 0 <= number < len(self.memo) + 2**31:
            raise ValueError("remembers under a number that no writer gives")
        self.memo[number] = self.stack[-1]

    def _out_of_band(self) -> None:
        raise UnsafePickle("wants a buffer from outside the file")


def _record(called: Any, arguments: Any, budget: Budget) -> Any:
    if not isinstance(called, Import) or not isinstance(arguments, tuple):
        raise UnsafePickle(f"wants to call a {type(called).__name__}")
    names = [a.name if isinstance(a, Import) else a for a in arguments]
    return pickle_records.record_of_call(called.name, tuple(names), budget)


_REPLACED: dict[bytes, Callable[[Interpreter], None]] = {
    pickle.REDUCE: Interpreter._call,
    pickle.NEWOBJ: Interpreter._call,
    pickle.NEWOBJ_EX: Interpreter._call_with_keywords,
    pickle.OBJ: Interpreter._old_object,
    pickle.INST: Interpreter._old_instance,
    pickle.BUILD: Interpreter._set_state,
    pickle.BYTEARRAY8: Interpreter._bytearray,
    pickle.SETITEM: Interpreter._set_item,
    pickle.SETITEMS: Interpreter._set_items,
    pickle.DICT: Interpreter._dict,
    pickle.ADDITEMS: Interpreter._add_items,
    pickle.FROZENSET: Interpreter._frozenset,
    pickle.PUT: Interpreter._remember,
    pickle.NEXT_BUFFER: Interpreter._out_of_band,
    pickle.READONLY_BUFFER: Interpreter._out_of_band,
}
_TEXTS = (pickle.UNICODE, pickle.BINUNICODE, pickle.SHORT_BINUNICODE, pickle.BINUNICODE8)
_REPLACED |= {opcode: partial(Interpreter._text, opcode=opcode) for opcode in _TEXTS}
Interpreter.dispatch |= {opcode[0]: method for opcode, method in _REPLACED.items()}


class _StorageInterpreter(Interpreter):
    """Reads what a storage's own file says of it: its imported name, and how many numbers."""

    def persistent_load(self, pid: Any) -> Any:
        match pid:
            case ("storage", Import(name), str(), str(), int() as n, *_):
                return name, n
        return super().persistent_load(pid)


_TORCH_MAGIC = 0x1950A86A20F9469CFC6C
_TORCH_PROTOCOL = 1001


def _storage(data: bytes, budget: Budget) -> np.ndarray:
    """The numbers (n,) of a storage that torch wrote in its form from before version 1.6.

    Five pickles (a magic number, the form's number, the machine, the storage, the list of its one
    key), then how many numbers there are, as 8 bytes, and the numbers (torch/serialization.py).
    """
    stream = io.BytesIO(data)
    magic, protocol, machine = (Interpreter(stream, budget).load() for _ in range(3))
    known = (magic, protocol) == (_TORCH_MAGIC, _TORCH_PROTOCOL) and isinstance(machine, dict)
    if not known or machine.get("little_endian") is not True:
        raise ValueError("a tensor is not in the form that torch writes")
    name, n_numbers = _StorageInterpreter(stream, budget).load()
    Interpreter(stream, budget).load()
    (n_said,) = struct.unpack("<q", stream.read(8))
    numbers = pickle_records.storage_of(name, stream.read())
    if not n_said == n_numbers == len(numbers):
        raise ValueError(f"a tensor of {n_numbers} numbers lacks its bytes")
    return numbers
