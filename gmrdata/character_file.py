"""What can be said of a character's file before Blender opens it: its kind, and what it links to.

Layout of .glb and .gltf: the glTF 2.0 specification, sections 3 and 4.4 (binary glTF).
"""

import json
import struct
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from gmrdata.errors import BadCharacter, MissingInput

SUFFIXES = (".glb", ".gltf", ".fbx")
_GLB_HEADER = struct.Struct("<4sII")
_CHUNK_HEADER = struct.Struct("<I4s")
_FBX_STARTS = (b"Kaydara FBX Binary", b"; FBX")


def linked_files(path: Path) -> dict[str, Path]:
    """Files that a character's file names, buffers and pictures, by the name that it gives them.

    Args:
        path: A .glb, .gltf or .fbx file.

    Returns:
        Paths, all inside the file's folder.  None for FBX, whose pictures must be inside the file.

    Raises:
        MissingInput: the file, or one that it names, is not there.
        BadCharacter: it is cut off, not of its kind, or names files outside its folder.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadCharacter(
            f"{path}: a character is a .glb, .gltf or .fbx file; export it as one (.glb is best)"
        )
    if suffix == ".fbx":
        with path.open("rb") as file:
            if not file.read(64).startswith(_FBX_STARTS):
                raise BadCharacter(f"{path}: not an FBX file; export the character again")
        return {}
    names = {name: None for name in _uris(_gltf_of(path)) if not name.startswith("data:")}
    return {name: _inside(path, name) for name in names}


def _gltf_of(path: Path) -> Any:
    """The JSON part of a .glb or .gltf file."""
    data = path.read_bytes()
    if path.suffix.lower() == ".glb":
        data = _json_chunk(path, data)
    try:
        scene = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadCharacter(
            f"{path}: its JSON part can't be read ({error}); export it again"
        ) from None
    if not isinstance(scene, dict) or not isinstance(scene.get("asset"), dict):
        raise BadCharacter(f"{path}: not a glTF file; export the character again")
    return scene


def _json_chunk(path: Path, data: bytes) -> bytes:
    if len(data) < _GLB_HEADER.size + _CHUNK_HEADER.size or data[:4] != b"glTF":
        raise BadCharacter(f"{path}: not a binary glTF file; export the character again")
    _, version, length = _GLB_HEADER.unpack_from(data)
    if version != 2:
        raise BadCharacter(f"{path}: glTF {version}, and only glTF 2 is read; export it again")
    if length != len(data):
        raise BadCharacter(
            f"{path}: has {len(data)} bytes and says {length}, so it is cut off or damaged; "
            "copy or export it again"
        )
    chunk_length, kind = _CHUNK_HEADER.unpack_from(data, _GLB_HEADER.size)
    start = _GLB_HEADER.size + _CHUNK_HEADER.size
    if kind != b"JSON" or start + chunk_length > len(data):
        raise BadCharacter(f"{path}: has no JSON part; export the character again")
    return data[start : start + chunk_length]


def _uris(value: Any) -> Iterator[str]:
    """Every text under a key `uri`, at any depth."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key == "uri" and isinstance(item, str):
                yield item
            else:
                yield from _uris(item)
    elif isinstance(value, list):
        for item in value:
            yield from _uris(item)


def _inside(path: Path, name: str) -> Path:
    """The file that a URI names, links followed."""
    plain = unquote(name)
    outside = BadCharacter(
        f"{path}: names the file {name!r}, which is not in its folder; nothing was read from "
        "there. Put everything into one .glb"
    )
    bad_letters = any(ord(letter) < 32 for letter in plain) or "\\" in plain or ":" in plain
    if not plain or bad_letters or PurePosixPath(plain).is_absolute() or ".." in plain.split("/"):
        raise outside
    folder = path.resolve().parent
    try:
        target = (folder / plain).resolve()
    except (OSError, RuntimeError):  # links that point at each other
        raise outside from None
    if not target.is_relative_to(folder):
        raise outside
    if not target.is_file():
        raise MissingInput(f"{path}: names the file {name!r}, which is not there")
    return target
