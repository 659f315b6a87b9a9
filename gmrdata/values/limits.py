"""Limits: how much memory and time a file that others made may take (docs/security.md).

A reader makes a `Budget` of its file, and takes from it what the file asks for before it is made.
What a file may ask for grows with its size, so that a small file can't fill the memory, up to a
ceiling; what every small file may ask for is free of that.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from gmrdata.values.errors import BadRecipe

MIB = 1 << 20

FREE_BYTES, BYTES_PER_BYTE, MOST_BYTES = 256 * MIB, 64, 4096 * MIB
"""Bytes that a file unpacks to: free, for each byte of the file, and at most."""
FREE_NUMBERS, NUMBERS_PER_BYTE, MOST_NUMBERS = 32 * MIB, 8, 512 * MIB
"""Numbers in its arrays and lists, each counted as often as it is referred to; 8 bytes in use."""
FREE_NODES, NODES_PER_BYTE, MOST_NODES = 2_000_000, 1, 20_000_000
"""Steps of a pickle."""
MOST_MEMBERS = 10_000  # files in an archive
MOST_KEY_PARTS = 32  # of a tuple that is a key: what is hashed is small and flat
MOST_ODD_KEYS = 20_000  # tuples and the like, whose hashes a file can make equal, as no text's
LARGEST_INTEGER = 1 << 60  # that is no odd key; above it Python's hashes repeat
LZMA_BYTES = 256 * MIB  # of memory that a compressed file may tell its reader to set aside

MOST_TEXT_BYTES = 1024 * MIB  # of a motion file in text
FREE_LINES, BYTES_PER_LINE = 1_000_000, 12  # free, and else this many bytes for each
MOST_JOINTS = 1000  # of a skeleton
MOST_PIXELS = 200_000_000  # of an image
MOST_DIGITS = 9  # of the number of an image or a track
MOST_VIDEO_FRAMES, MOST_VIDEO_PIXELS = 200_000, 10**12
"""Of a video: frames that are taken, and the pixels of all of them."""
LOWEST_FPS_HZ, HIGHEST_FPS_HZ = 0.05, 2000.0  # of a video that a camera took

MOST_NETWORK_BYTES = 512 * MIB  # of a network's file
MOST_INPUT_SIDE_PX = 4096  # of the pictures that a network wants
MOST_NETWORK_NUMBERS = 256 * MIB  # in one array that a network makes

BLENDER_GIB, BLENDER_GIB_NAME = 8.0, "GMRDATA_BLENDER_GIB"
"""Memory that Blender's process may have, and what in the environment says another."""
BLENDER_FRAME_S, BLENDER_RAY_S, BLENDER_FRAME_NAME = 600.0, 1e-4, "GMRDATA_BLENDER_FRAME_S"
"""How long a frame may take, with the start for the first: free, for each ray of it, and what in
the environment says another time for the whole.  A ray takes 1 to 10 µs of one slow core."""

MOST_RECIPE_BYTES = 16 * MIB  # 100,000 clips
MOST_JOINT_MAP_BYTES = MIB
# What a recipe, or a checkpoint's record, may say; configs name them as their fields' limits.
MOST_CLIPS = 100_000
MOST_FRAMES = 1_000_000  # of a clip or window
LONGEST_S = 86_400.0  # of a clip, and of most other times
LARGEST_SIDE_PX = 16_384  # of a rendered image
MOST_WORKERS = 1024  # processes, or threads of one
LARGEST_SEED = 2**63 - 1
MOST_DRAWS = 1_000_000  # of a bootstrap
MOST_LAYERS, MOST_UNITS = 64, 65_536  # of a network
MOST_NETWORKS = 64  # that predict together
MOST_WEIGHTS = 2_000_000_000  # of a network's layers; the paper's has 0.26 billion
MOST_BATCH = 65_536  # windows in a step
MOST_BATCH_FRAMES = 4_000_000  # in all windows of a step
MOST_STEPS = 1_000_000_000
MOST_MANIFEST_BYTES = 64 * MIB
DEEPEST_YAML = 32
MOST_YAML_DIGITS = 100  # of a whole number


class OverBudget(ValueError):
    """A file asks for more than its budget; the text does not name the file."""

    remedy = "get it from its maker"


class OverCeiling(OverBudget):
    """A file asks for more than any file may: it may well be what it should be."""

    remedy = "cut it into parts, or make it of a part of the video"


def blender_bytes() -> int:
    """Memory that Blender's process may have, no more than this machine has."""
    asked = int(_from_environment(BLENDER_GIB_NAME, BLENDER_GIB) * 1024 * MIB)
    return min(asked, machine_bytes() or asked)


def machine_bytes() -> int | None:
    """Memory of this machine; None where the system has no such call (Windows)."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def allowed_cores() -> int:
    """Cores that this process may use; all of the machine where the system does not say (macOS)."""
    if hasattr(os, "sched_getaffinity"):  # of the machine's, those of a cpuset or taskset
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def blender_frame_s(n_rays: int) -> float:
    """How long Blender may take for a frame of so many rays [s]."""
    return _from_environment(BLENDER_FRAME_NAME, BLENDER_FRAME_S + BLENDER_RAY_S * n_rays)


def _from_environment(name: str, default: float) -> float:
    said = os.environ.get(name)
    try:
        value = default if said is None else float(said)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise BadRecipe(f"{name}={said}: in the environment; give a positive number, or unset it")
    return value


@dataclass
class Budget:
    """What a file may still ask for."""

    size_bytes: int  # of the file as it is
    bytes_left: int
    numbers_left: int
    nodes_left: int
    odd_keys_left: int = MOST_ODD_KEYS

    @classmethod
    def of(cls, path: Path) -> Self:
        return cls.of_size(path.stat().st_size)

    @classmethod
    def of_size(cls, size_bytes: int) -> Self:
        return cls(
            size_bytes,
            bytes_left=min(MOST_BYTES, max(FREE_BYTES, BYTES_PER_BYTE * size_bytes)),
            numbers_left=min(MOST_NUMBERS, max(FREE_NUMBERS, NUMBERS_PER_BYTE * size_bytes)),
            nodes_left=min(MOST_NODES, max(FREE_NODES, NODES_PER_BYTE * size_bytes)),
        )

    @classmethod
    def ceiling(cls) -> Self:
        """That of a file of our own, which may be small beside what it holds, as masks are."""
        return cls.of_size(MOST_BYTES)

    def take_bytes(self, count: int) -> None:
        self.bytes_left -= count
        if self.bytes_left < 0:
            raise self._over("unpacks to more bytes", BYTES_PER_BYTE, MOST_BYTES)

    def take_numbers(self, count: int) -> None:
        self.numbers_left -= count
        if self.numbers_left < 0:
            raise self._over("holds more numbers", NUMBERS_PER_BYTE, MOST_NUMBERS)

    def too_many_nodes(self) -> OverBudget:
        return self._over("takes more steps to read", NODES_PER_BYTE, MOST_NODES)

    def check_members(self, count: int) -> None:
        if count > MOST_MEMBERS:
            raise OverBudget(f"holds {count} files; {MOST_MEMBERS} are the most")

    def check_key(self, key: Any) -> None:
        """Refuse what must not be hashed: deep or wide tuples crash or stall the interpreter, and
        many keys of one hash take for ever."""
        if isinstance(key, str | bytes | float | None) or (
            isinstance(key, int) and abs(key) < LARGEST_INTEGER
        ):
            return
        if isinstance(key, tuple):
            _require_flat(key)
        self.odd_keys_left -= 1
        if self.odd_keys_left < 0:
            raise OverBudget(f"has more than {MOST_ODD_KEYS} keys that are no texts or numbers")

    def _over(self, what: str, per_byte: int, most: int) -> OverBudget:
        if per_byte * self.size_bytes >= most:
            return OverCeiling(f"{what} than any file may (docs/security.md)")
        return OverBudget(f"{what} than a file of {self.size_bytes} bytes has any use for")


def _require_flat(key: tuple[Any, ...]) -> None:
    parts = list(key[:MOST_KEY_PARTS])
    for part in parts:  # grows while it is gone through
        parts += part[:MOST_KEY_PARTS] if isinstance(part, tuple) else ()
        if len(parts) >= MOST_KEY_PARTS:
            raise OverBudget(f"has a key of {MOST_KEY_PARTS} parts or more")
