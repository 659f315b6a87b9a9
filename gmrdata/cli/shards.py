"""Work in shards: the verb merge, the end of a share, scripts for clusters."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import chdir, contextmanager, suppress
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from gmrdata.cli.answers import fail
from gmrdata.stage.cluster_scripts import Array, Need, array_script
from gmrdata.stage.finished import Batch, forget
from gmrdata.stage.progress import answers, console
from gmrdata.stage.shards import COMMAND_FILE, SHARDS_FOLDER, CommandRecord, OthersLeft, Shard
from gmrdata.values.errors import BadRecipe, BadRecord, MissingInput

SHARD_FLAG, OUT_FLAG = "--shard", "--out"
SHARED_VERBS = ("motions", "render", "video", "threedpw", "floor", "tables", "run")
NOT_MEASURED = Need(None, None)
NOT_ONCE = ("--redo", "--dry-run", "--preview", "--workers", "--scheduler", "--help", "-h")
"""With these a command does something else, or in processes whose inputs nobody here knows."""


@contextmanager
def once(arguments: Sequence[str]) -> Iterator[bool]:
    """Whether there is something to do.  A shard of a batch that is made says so and does nothing.

    Where the block ends well, all shards have: a record is left for the next time.
    """
    batch = shared_batch(arguments)
    if batch is None:
        yield True
    elif (found := batch.finished()) is not None:
        for line in (f"{batch.out_dir}: made, and no file of it or its inputs has changed since",
                     *found.remarks):  # fmt: skip
            console.print(line, markup=False, soft_wrap=True)
        answers.out(found.answers, end="", highlight=False)
        yield False
    else:
        began_ns = time.time_ns()
        forget()
        yield True
        batch.remember(began_ns)


def shared_batch(arguments: Sequence[str]) -> Batch | None:
    """The batch that a command is one shard of; None for other commands.

    BadRecipe for a share that is none.
    """
    typed = parted(arguments)
    values = _flag_values(typed)
    asked = {part for part in typed if part in NOT_ONCE or part.startswith("--print-")}
    if typed[:1] == [] or typed[0] not in SHARED_VERBS or len(values) < 2 or asked:
        return None
    Shard.parse(values[SHARD_FLAG])
    at = typed.index(SHARD_FLAG)
    return Batch((*typed[:at], *typed[at + 2 :]), Path.cwd() / values[OUT_FLAG])


def end_of_share(left: OthersLeft, arguments: Sequence[str]) -> None:
    """Say what other shards have left, and keep the command for `gmrdata merge`.

    That verb itself ends with 1 then: it was asked for the whole.
    """
    if left.merging:
        fail(str(left))
    record, path = CommandRecord(arguments=tuple(arguments), folder=str(Path.cwd())), left.folder
    if path.is_dir():
        with suppress(FileNotFoundError):  # taken away in this moment
            record.write(path / COMMAND_FILE)
        if not any(path.glob("*.done")):  # who finished meanwhile took all marks away
            (path / COMMAND_FILE).unlink(missing_ok=True)
            with suppress(OSError):
                path.rmdir()
                path.parent.rmdir()
    console.print(str(left), markup=False, soft_wrap=True)


def _array(print_slurm: int | None = None, print_kubernetes: int | None = None) -> Array | None:
    """Print a script for a cluster instead of working.

    Args:
        print_slurm: Print an sbatch script for so many shards.
        print_kubernetes: Print an indexed job for so many shards.
    """
    if print_slurm is not None:
        return Array("slurm", print_slurm)
    return None if print_kubernetes is None else Array("kubernetes", print_kubernetes)


ArrayFlags = Annotated[Array | None, OmitArgPrefixes, arg(constructor=_array)]
"""--print-slurm and --print-kubernetes, for verbs with --shard; give it no default."""


def print_script(array: Array, need: Need = NOT_MEASURED) -> None:
    """Print the command that was typed as a script for a cluster."""
    typed = parted(sys.argv[1:])
    if SHARD_FLAG in typed:
        raise BadRecipe(
            f"--print-{array.system}: the script gives each task its --shard; leave it out"
        )
    at = typed.index(f"--print-{array.system}")
    command = ["gmrdata", *typed[:at], *typed[at + 2 :]]
    answers.out(array_script(array, command, Path.cwd(), need), end="", highlight=False)


def parted(arguments: Sequence[str]) -> list[str]:
    """Arguments with flags and values apart, and hyphens in flags: --a_b=c as --a-b c."""
    found = []
    for argument in arguments:
        flag, *value = argument.split("=", 1) if argument.startswith("--") else (argument,)
        found += [flag.replace("_", "-") if argument.startswith("--") else flag, *value]
    return found


def _flag_values(typed: Sequence[str]) -> dict[str, str]:
    """The values of --shard and --out, as far as they are there."""
    flags = [part for part in typed[:-1] if part in (SHARD_FLAG, OUT_FLAG)]
    return {flag: typed[typed.index(flag) + 1] for flag in flags}


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
    typed = parted(record.arguments)
    values = _flag_values(typed)
    fits = typed[:1] and typed[0] in SHARED_VERBS and len(values) == 2
    if not fits or Path(record.folder, values[OUT_FLAG]).resolve() != out.resolve():
        said = " ".join(record.arguments)
        raise BadRecord(f"{path}: {said}: not a command of shards of {out}")
    at = typed.index(SHARD_FLAG) + 1
    return [*typed[:at], f"0/{typed[at].partition('/')[2]}", *typed[at + 1 :]]
