"""Verbs for work in shards: merge; and the end of a share."""

from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path

from tyro.conf import Positional

from gmrdata.stage.progress import console
from gmrdata.stage.shards import COMMAND_FILE, SHARDS_FOLDER, CommandRecord, OthersLeft
from gmrdata.values.errors import BadRecord, MissingInput

SHARD_FLAG, OUT_FLAG = "--shard", "--out"
SHARED_VERBS = ("motions", "render", "threedpw", "floor", "tables")


def end_of_share(left: OthersLeft, arguments: Sequence[str]) -> None:
    """Say what other shards have left, and keep the command for `gmrdata merge`."""
    record = CommandRecord(arguments=tuple(arguments), folder=str(Path.cwd()))
    if left.folder.is_dir():  # who finished meanwhile took it away
        record.write(left.folder / COMMAND_FILE)
    console.print(str(left), markup=False, soft_wrap=True)


def merge(out: Positional[Path]) -> None:
    """Write manifest, pages and verdicts of a folder whose shards have all ended.

    The shard that ends last does so by itself. This is for the case that it was killed while it
    did, and says which shares are left.

    Args:
        out: Output folder of the shards.
    """
    from gmrdata.cli import main

    records = sorted(out.glob(f"**/{SHARDS_FOLDER}/*/{COMMAND_FILE}"))
    if not records:
        raise MissingInput(f"{out}: nothing is left to merge: its last shard ended, or none began")
    record = CommandRecord.read(records[0])
    arguments = merging(records[0], record, out)
    with chdir(record.folder):
        main(arguments)


def merging(path: Path, record: CommandRecord, out: Path) -> list[str]:
    """The command of a shard, as the share 0 of as many: it works on nothing.

    BadRecord where it is not a command of shards, or writes another folder than `out`.
    """
    typed = [part for argument in record.arguments for part in argument.split("=", 1)]
    flags = [part for part in typed[:-1] if part in (SHARD_FLAG, OUT_FLAG)]
    values = {flag: typed[typed.index(flag) + 1] for flag in flags}
    fits = typed[:1] and typed[0] in SHARED_VERBS and {SHARD_FLAG, OUT_FLAG} == values.keys()
    if not fits or Path(record.folder, values[OUT_FLAG]).resolve() != out.resolve():
        said = " ".join(record.arguments)
        raise BadRecord(f"{path}: {said}: not a command of shards of {out}")
    at = typed.index(SHARD_FLAG) + 1
    return [*typed[:at], f"0/{typed[at].partition('/')[2]}", *typed[at + 1 :]]
