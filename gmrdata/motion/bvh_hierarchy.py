"""The first half of a BVH file: joints, offsets and channels."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gmrdata.errors import BadMotionFile
from gmrdata.motion.text_numbers import parse_floats

_CHANNEL = re.compile(r"^([XYZ])(position|rotation)$", re.IGNORECASE)


@dataclass
class Hierarchy:
    """The skeleton while it is being read."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    tips: list[list[float]] = field(default_factory=list)
    channels: list[list[tuple[str, str]]] = field(default_factory=list)
    """Per joint the (axis "X", kind "position" or "rotation") of each column."""
    open_blocks: list[int | None] = field(default_factory=list)
    """Joints whose braces are open; None stands for an End Site."""
    announced: int | None = None
    brace_due: bool = False
    offset_due: bool = False


def read_hierarchy(lines: list[str], path: Path) -> Hierarchy:
    """Read everything above MOTION.

    Raises:
        BadMotionFile: braces, joints, offsets or channels are not as the format has them.
    """
    tree = Hierarchy()
    for line_number, line in enumerate(lines, 1):
        for statement in re.findall(r"[{}]|[^{}]+", line):
            if statement.strip():
                _read_statement(tree, statement.strip(), path, line_number)
    if tree.open_blocks or tree.brace_due:
        raise BadMotionFile(f"{path}:{len(lines)}: a brace of the hierarchy is not closed")
    if not tree.names:
        raise BadMotionFile(f"{path}: the hierarchy has no ROOT")
    if not any(tree.channels):
        raise BadMotionFile(f"{path}: the joints have no channels, so there is no motion to read")
    return tree


def _read_statement(tree: Hierarchy, statement: str, path: Path, line_number: int) -> None:
    """One statement or brace of the hierarchy."""
    keyword, _, rest = statement.partition(" ")
    keyword, _, tabbed = keyword.partition("\t")
    rest = f"{tabbed} {rest}".strip()
    here = tree.open_blocks[-1] if tree.open_blocks else None
    if tree.brace_due != (keyword == "{"):
        raise BadMotionFile(
            f"{path}:{line_number}: '{{' and joints do not alternate; broken hierarchy"
        )
    if keyword == "{":
        tree.open_blocks.append(tree.announced)
        tree.brace_due, tree.offset_due = False, True
    elif keyword == "}" and tree.open_blocks and not tree.offset_due:
        tree.open_blocks.pop()
    elif keyword.upper() in ("ROOT", "JOINT") and rest:
        _announce_joint(tree, keyword.upper(), rest, path, line_number)
    elif keyword.upper() == "END" and here is not None:
        tree.announced, tree.brace_due = None, True
    elif keyword.upper() == "OFFSET" and tree.offset_due:
        _read_offset(tree, parse_floats(rest.split(), path, line_number), path, line_number)
    elif keyword.upper() == "CHANNELS" and here is not None and not tree.channels[here]:
        tree.channels[here] = _read_channel_names(rest.split(), path, line_number)
    elif not (keyword == "HIERARCHY" and not tree.names):
        raise BadMotionFile(
            f"{path}:{line_number}: {statement[:40]!r} is not expected here; broken hierarchy"
        )


def _announce_joint(tree: Hierarchy, keyword: str, name: str, path: Path, line_number: int) -> None:
    here = tree.open_blocks[-1] if tree.open_blocks else None
    if (keyword == "ROOT") != (not tree.names) or (keyword == "JOINT" and here is None):
        raise BadMotionFile(
            f"{path}:{line_number}: {keyword} {name[:40]} is not inside the one ROOT; broken "
            "hierarchy"
        )
    if name in tree.names:
        raise BadMotionFile(f"{path}:{line_number}: a second joint of the name {name[:40]}")
    tree.announced, tree.brace_due = len(tree.names), True
    tree.names.append(name)
    tree.parents.append(-1 if here is None else here)
    tree.offsets.append([0.0] * 3)
    tree.tips.append([np.nan] * 3)
    tree.channels.append([])


def _read_offset(tree: Hierarchy, offset: list[float], path: Path, line_number: int) -> None:
    if len(offset) != 3:
        raise BadMotionFile(f"{path}:{line_number}: an OFFSET has 3 numbers, not {len(offset)}")
    tree.offset_due = False
    here = tree.open_blocks[-1]
    if here is not None:
        tree.offsets[here] = offset
        return
    bone = tree.open_blocks[-2]
    if bone is not None:
        tree.tips[bone] = offset


def _read_channel_names(words: list[str], path: Path, line_number: int) -> list[tuple[str, str]]:
    matches = [_CHANNEL.match(word) for word in words[1:]]
    channels = [(m.group(1).upper(), m.group(2).lower()) for m in matches if m]
    if not words or words[0] != str(len(matches)) or len(channels) != len(matches):
        raise BadMotionFile(
            f"{path}:{line_number}: CHANNELS needs its count and as many names like Xposition, "
            "Zrotation"
        )
    if len(set(channels)) != len(channels):
        raise BadMotionFile(f"{path}:{line_number}: a channel is listed twice")
    return channels
