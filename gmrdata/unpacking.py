"""The bytes of a file that may be compressed as joblib.dump does it: its first bytes tell."""

import bz2
import gzip
import io
import lzma
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any

from gmrdata.errors import BrokenPickle

MAX_UNPACKED_BYTES = 4 << 30
"""A file that unpacks to more is refused before it fills the memory."""
_CHUNK_BYTES = 1 << 20

_OPENERS: dict[bytes, Callable[[IO[bytes]], Any]] = {
    b"\x1f\x8b": lambda stream: gzip.GzipFile(fileobj=stream),
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ\x00": lzma.LZMAFile,
    b"\x5d\x00": partial(lzma.LZMAFile, format=lzma.FORMAT_ALONE),
}
"""First bytes of each compression; zlib's are below."""
_ZLIB_FIRST = b"\x78"
"""No pickle begins so: there is no such opcode."""


def unpacked_bytes(path: Path) -> bytes:
    """Read a whole file, unpacking zlib, gzip, bz2, xz and lzma.

    Raises:
        BrokenPickle: it is truncated, or unpacks to more than `MAX_UNPACKED_BYTES`.
    """
    data = path.read_bytes()
    if data.startswith(_ZLIB_FIRST):
        return _unpacked(path, _zlib_chunks(data))
    for first, opener in _OPENERS.items():
        if data.startswith(first):
            return _unpacked(path, _stream_chunks(opener(io.BytesIO(data))))
    return data


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


def _stream_chunks(stream: IO[bytes]) -> Iterator[bytes]:
    while chunk := stream.read(_CHUNK_BYTES):
        yield chunk


def _unpacked(path: Path, chunks: Iterable[bytes]) -> bytes:
    found, size_bytes = [], 0
    try:
        for chunk in chunks:
            found.append(chunk)
            size_bytes += len(chunk)
            if size_bytes > MAX_UNPACKED_BYTES:
                raise BrokenPickle(
                    f"{path}: unpacks to more than {MAX_UNPACKED_BYTES} bytes; no motion needs that"
                )
    except (zlib.error, lzma.LZMAError, EOFError, OSError) as error:
        raise BrokenPickle(
            f"{path}: truncated or not a pickle ({type(error).__name__}: {error}); get it again"
        ) from None
    return b"".join(found)
