"""Batches in shards: the verb merge, and the end of a share."""

from collections.abc import Iterator, Sequence
from contextlib import chdir, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from gmrdata.cli.answers import fail
from gmrdata.stage.jobs import OthersLeft
from gmrdata.stage.progress import remark
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.records import Record

COMMAND_FILE = ".shards.json"
SHARD_FLAG, OUT_FLAG, DRY_RUN = "--shard", "--out", "--dry-run"
SHARED_VERBS = ("motions", "render", "video", "threedpw", "floor", "tables", "run")
GONE = ("--print-slurm", "--print-kubernetes")


class CommandRecord(Record):
    """`.shards.json` in the output folder of shards: what was typed, for `gmrdata merge`."""

    format: Literal["gmrdata-command/1"] = "gmrdata-command/1"
    arguments: tuple[str, ...]
    folder: str
    """The working folder, in which relative paths hold."""


@contextmanager
def share(arguments: Sequence[str]) -> Iterator[None]:
    """Keep the command of a share that ended for `gmrdata merge`.

    Ends with 0 where this share is made and others are left; with 1 where some of it failed.
    """
    typed = _parted(arguments)
    if gone := [flag for flag in GONE if flag in typed]:
        fail(f"{gone[0]} is gone: docs/scale.md, Slurm and Kubernetes, has such a script", code=2)
    out, looks = _values(typed).get(OUT_FLAG), DRY_RUN in typed
    if looks and SHARD_FLAG in typed:
        remark(f"{DRY_RUN} is of the whole batch, whatever {SHARD_FLAG} says")
    left = None
    try:
        yield
    except OthersLeft as others:
        left = others
    if out is not None and SHARD_FLAG in typed and not looks:
        record = CommandRecord(arguments=tuple(typed), folder=str(Path.cwd()))
        record.write(Path.cwd() / out / COMMAND_FILE)
    if left is not None:
        say = fail if left.failed else remark
        say(str(left))


def _parted(arguments: Sequence[str]) -> list[str]:
    """Arguments with flags and values apart, and hyphens in flags: --a_b=c as --a-b c.

    A value like -y stays with its flag: alone it would be taken for one.
    """
    parts = []
    for argument in arguments:
        if not argument.startswith("--"):
            parts.append(argument)
            continue
        flag, equals, value = argument.partition("=")
        flag = flag.replace("_", "-")
        joined = not equals or value.startswith("-")
        parts += [f"{flag}{equals}{value}"] if joined else [flag, value]
    return parts


def _values(typed: Sequence[str]) -> dict[str, str]:
    """The values of --shard and --out, as far as they are there; the last one of each counts."""
    return {flag: value for flag, value in pairwise(typed) if flag in (SHARD_FLAG, OUT_FLAG)}


def merge(out: Positional[Path]) -> None:
    """Write manifest, pages and verdicts of a folder whose shards have all ended.

    A shard that finds everything made does so by itself. Clips that failed are named; where some
    were not tried yet, nothing is written, and they are named with their shards.

    Args:
        out: Output folder of the shards.
    """
    from gmrdata.cli import main

    path = out / COMMAND_FILE
    if not path.is_file():
        raise MissingInput(f"{out}: nothing to merge: no shard ended here. Run them first")
    record = CommandRecord.read(path)
    arguments = merging(path, record, out)
    with chdir(record.folder):
        main(arguments)


def merging(path: Path, record: CommandRecord, out: Path) -> list[str]:
    """The command of a shard, as the share 0 of as many: it works on nothing.

    BadRecord where it is no command of shards of `out`, or its working folder is not here.
    """
    typed = list(record.arguments)
    values = _values(typed)
    fits = typed[:1] and typed[0] in SHARED_VERBS and len(values) == 2
    folder = Path(record.folder)
    if not fits or not folder.is_dir() or (folder / values[OUT_FLAG]).resolve() != out.resolve():
        what = f"{' '.join(typed)}: not a command of shards of {out} in {folder}"
        remedy = f"Give the command of the shards again, with --out {out} --shard 0/N"
        raise BadRecord(f"{path}: {what}. {remedy}")
    at = len(typed) - typed[::-1].index(SHARD_FLAG)  # of the value behind the last one
    return [*typed[:at], f"0/{typed[at].partition('/')[2]}", *typed[at + 1 :]]
