"""Changed files: bytes, lines and numbers of a text, values and keys of data, parts of archives."""

import io
import json
import pickle  # noqa: TID251  Only to write.
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import yaml

from gmrdata.read import pickle_records
from gmrdata.read.safe_pickle import Interpreter
from gmrdata.values.limits import Budget
from tests.joblib_layout import joblib_bytes

Mutation = Callable[[bytes, np.random.Generator], bytes]

ODD_NUMBERS = (0, -1, 1, 2**31, 2**63, 10**30, 1e308, -1e308, 1e-320, float("nan"), float("inf"))
ODD_TEXTS = (
    "", " ", "$x$", "\ud800", "\0", "../../../etc/passwd", "/etc/passwd", "/dev/zero", "a" * 5000,
    "nan", "1e999", "٣", "\u202e", "data:,", "1_000", "0x10", "{{x}}", "<b>",
)  # fmt: skip
ODD_WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"1e-320",
    b"99999999",
    b"9" * 400,
    b"",
    b"{",
    b"}",
)


def changed_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes flipped, cut off, doubled, left out, made zero, or a length made large."""
    if not data:
        return bytes(rng.integers(0, 256, 20, dtype=np.uint8))
    start, stop = sorted(int(at) for at in rng.integers(0, len(data) + 1, 2))
    found = bytearray(data)
    match rng.integers(0, 7):
        case 0:
            for at in rng.integers(0, len(data), rng.integers(1, 9)):
                found[at] ^= 1 << int(rng.integers(0, 8))
        case 1:
            del found[start:]
        case 2:
            found[stop:stop] = found[start:stop]
        case 3:
            del found[start:stop]
        case 4:
            found[start : min(stop, start + 64)] = bytes(min(stop - start, 64))
        case 5:
            value = int(rng.choice([0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**30]))
            found[start : start + 4] = struct.pack(str(rng.choice(["<I", ">I"])), value)
        case _:
            # The first bytes are those that say what is in the file.
            found[int(rng.integers(0, min(len(data), 256)))] = int(rng.integers(0, 256))
    return bytes(found)


def changed_text(data: bytes, rng: np.random.Generator) -> bytes:
    """Lines doubled, left out or exchanged, and words or numbers replaced."""
    lines = data.split(b"\n")
    at, other = (int(n) for n in rng.integers(0, len(lines), 2))
    match rng.integers(0, 6):
        case 0:
            lines.insert(at, lines[other])
        case 1:
            del lines[at]
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case 3:
            lines[at:at] = lines[min(at, other) : max(at, other)] * int(rng.integers(1, 4))
        case _:
            words = re.split(rb"(\s+)", lines[at])
            words[int(rng.integers(0, len(words)))] = ODD_WORDS[int(rng.integers(len(ODD_WORDS)))]
            lines[at] = b"".join(words)
    return b"\n".join(lines)


def changed_value(value: Any, rng: np.random.Generator) -> Any:
    """A value of dicts, lists, texts, numbers and arrays with one of its parts changed."""
    if rng.random() < 0.15 or not isinstance(value, dict | list | tuple) or not value:
        return _changed_leaf(value, rng)
    if isinstance(value, dict):
        keys = list(value)
        key = keys[int(rng.integers(0, len(keys)))]
        match rng.integers(0, 8):
            case 0:
                return {name: value[name] for name in keys if name != key}
            case 1:
                odd = ODD_TEXTS[int(rng.integers(len(ODD_TEXTS)))]
                return {odd if name == key else name: value[name] for name in keys}
            case _:
                return {**value, key: changed_value(value[key], rng)}
    items, at = list(value), int(rng.integers(0, len(value)))
    match rng.integers(0, 6):
        case 0:
            del items[at]
        case 1:
            items.insert(at, items[at])
        case _:
            items[at] = changed_value(items[at], rng)
    return items if isinstance(value, list) else tuple(items)


def _changed_leaf(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, np.ndarray) and rng.random() < 0.8:
        return _changed_array(value, rng)
    others: tuple[Any, ...] = (
        None, True, [], {}, [[]], {"a": 1}, [value], {"a": value}, _deep(60),
        *ODD_NUMBERS, *ODD_TEXTS,
    )  # fmt: skip
    return others[int(rng.integers(0, len(others)))]


def _changed_array(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Of another shape, length or type, or with odd numbers."""
    match rng.integers(0, 9):
        case 0:
            return array[: len(array) // 2] if array.ndim else array[None]
        case 1:
            return array[:0] if array.ndim else np.array([])
        case 2:
            return np.asarray(array.T)
        case 3:
            return array[None]
        case 4:
            return array.ravel()
        case 5:
            kind = str(rng.choice(["f2", "f4", "i1", "u8", "c8", "?", "U3", "S2", ">f8", "M8[s]"]))
            try:
                return array.astype(kind)
            except (ValueError, TypeError, OverflowError):
                return np.zeros(array.shape, np.int8)
        case 6 if array.ndim:
            return np.concatenate([array, array])
        case _:
            if array.dtype.kind not in "fiu" or not array.size:
                return np.zeros((0, 3))
            odd = array.astype(np.float64) if array.dtype.kind == "f" else array.copy()
            number = ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]
            with np.errstate(all="ignore"):
                flat = odd.reshape(-1)
                one = np.array(number if odd.dtype.kind == "f" else -1).astype(odd.dtype)
                flat[int(rng.integers(0, odd.size)) :: int(rng.integers(1, 50))] = one
            return odd


def _deep(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


def changed_json(data: bytes, rng: np.random.Generator) -> bytes:
    return json.dumps(changed_value(json.loads(data), rng)).encode("utf-8", "surrogatepass")


def changed_yaml(data: bytes, rng: np.random.Generator) -> bytes:
    changed = changed_value(yaml.safe_load(data), rng)
    return yaml.safe_dump(changed, sort_keys=False).encode("utf-8", "surrogatepass")


def changed_npz(data: bytes, rng: np.random.Generator) -> bytes:
    with np.load(io.BytesIO(data)) as arrays:
        changed = changed_value(dict(arrays), rng)
    stream = io.BytesIO()
    if not isinstance(changed, dict):
        np.savez(stream, np.asarray(changed, dtype=object), allow_pickle=True)
    else:
        named = {str(k).replace("\0", ""): _plain(v) for k, v in changed.items()}
        np.savez(stream, **named)  # type: ignore[arg-type]
    return stream.getvalue()


def _plain(value: Any) -> np.ndarray:
    try:
        return np.asarray(value)
    except ValueError:
        return np.asarray(str(value))


def _unpickled(stream: io.BytesIO) -> Any:
    """By the readers' interpreter: Python's own runs and dies of what was changed before."""
    budget = Budget.of_size(len(stream.getvalue()))
    return pickle_records.plain(Interpreter(stream, budget).load(), budget)


def changed_pickle(data: bytes, rng: np.random.Generator) -> bytes:
    """A plain pickle, or joblib's form."""
    changed = changed_value(_unpickled(io.BytesIO(data)), rng)
    joblib = rng.random() < 0.3
    return joblib_bytes(changed) if joblib else pickle.dumps(changed, int(rng.integers(2, 5)))


def changed_packed(data: bytes, rng: np.random.Generator) -> bytes:
    """A file in zlib's form whose inside is changed."""
    return zlib.compress(changed_bytes(zlib.decompress(data), rng), 1)


def changed_torch(data: bytes, rng: np.random.Generator) -> bytes:
    content = torch.load(io.BytesIO(data), weights_only=True)
    as_arrays = {key: _arrays(value) for key, value in content.items()}
    stream = io.BytesIO()
    torch.save(_tensors(changed_value(as_arrays, rng)), stream)
    return stream.getvalue()


def _arrays(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _arrays(inner) for key, inner in value.items()}
    return value.numpy() if isinstance(value, torch.Tensor) else value


def _tensors(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _tensors(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in "fib" and value.dtype.isnative:
        return torch.from_numpy(np.ascontiguousarray(value))
    return None if isinstance(value, np.ndarray) else value


def changed_object(data: bytes, rng: np.random.Generator) -> bytes:
    """A .npy of an object."""
    stream = io.BytesIO(data)
    np.lib.format.read_magic(stream)
    np.lib.format.read_array_header_1_0(stream)
    changed = np.empty((), dtype=object)
    changed[()] = changed_value(_unpickled(stream).item(), rng)
    stream = io.BytesIO()
    np.save(stream, changed, allow_pickle=True)
    return stream.getvalue()


def changed_member(data: bytes, rng: np.random.Generator) -> bytes:
    """A zip archive in which the bytes of one file are changed; its checksums fit."""
    stream, source = io.BytesIO(), zipfile.ZipFile(io.BytesIO(data))
    names = source.namelist()
    chosen = int(rng.integers(0, len(names)))
    with zipfile.ZipFile(stream, "w") as archive:
        for number, name in enumerate(names):
            content = source.read(name)
            archive.writestr(name, changed_bytes(content, rng) if number == chosen else content)
    return stream.getvalue()


def changed_png(data: bytes, rng: np.random.Generator) -> bytes:
    """A PNG whose header says something else, with the checksum that fits."""
    found = bytearray(data)
    sizes = [0, 1, 2, 3, 255, 30000, 2**31 - 1, 2**32 - 1]
    if rng.random() < 0.5:
        at = 16 + 4 * int(rng.integers(0, 2))
        found[at : at + 4] = struct.pack(">I", sizes[int(rng.integers(len(sizes)))])
    else:
        found[24 + int(rng.integers(0, 5))] = int(rng.integers(0, 17))
    found[29:33] = struct.pack(">I", zlib.crc32(bytes(found[12:29])))
    return bytes(found)


def changed_glb(data: bytes, rng: np.random.Generator) -> bytes:
    """A .glb whose JSON is changed, with the lengths that fit."""
    (length,) = struct.unpack_from("<I", data, 12)
    text = changed_json(data[20 : 20 + length], rng)
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


TEXT = (changed_text, changed_text, changed_bytes)
JSON = (changed_json, changed_json, changed_json, changed_bytes, changed_text)
YAML = (changed_yaml, changed_yaml, changed_text, changed_bytes)
NPZ = (changed_npz, changed_npz, changed_member, changed_bytes)
OBJECT = (changed_object, changed_object, changed_bytes)
PICKLE = (changed_pickle, changed_pickle, changed_bytes)
"""Mutations by kind of file."""
