"""Shards: one batch of jobs shared by processes that see the same folder and nothing else.

Each process is one shard of N and works on its share.  Marks in `shards/` beside the results say
who works and who is done.  Who is done takes over the shares of those that died.  The process that
finds everything made or failed goes on with the batch, to the manifest and the pages; the others
end before, with `OthersLeft`.
"""

import hashlib
import heapq
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from gmrdata.stage.claims import Claim, ClaimRecord, held, is_dead, owner, try_claim
from gmrdata.values.errors import BadRecipe, BadRecord, ClaimLost, MissingInput, StageFailed
from gmrdata.values.files import host_word
from gmrdata.values.records import Record

SHARDS_FOLDER = "shards"
LOOK_S = 0.2  # between two looks at a claim of another machine


@dataclass(frozen=True)
class Shard:
    """Share `index` of `count`, counted from 1; 0 works on none and only merges."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Of a text like 2/4; BadRecipe where it is none."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        shard = cls(int(found[1]), int(found[2])) if found else cls(1, 0)
        if shard.index > shard.count or shard.count < 1:
            raise BadRecipe(f"--shard {text}: give it as 2/4, the second of four")
        return shard


class OthersLeft(Exception):
    """This shard is done, and others are not: no error, but no result of the whole batch yet."""

    def __init__(self, message: str, folder: Path, *, merging: bool = False) -> None:
        super().__init__(message)
        self.folder = folder  # of the marks
        self.merging = merging  # share 0, which was asked for the whole


class DoneRecord(Record):
    """`<shard>.done`: a shard's share is made, or failed with a reason."""

    format: Literal["gmrdata-shard/1"] = "gmrdata-shard/1"
    jobs_sha256: str
    """Of all ids and weights and the number of shards: marks of other shares don't count."""


COMMAND_FILE = "command.json"


class CommandRecord(Record):
    """`command.json` among the marks: what was typed, so that `gmrdata merge` knows the batch."""

    format: Literal["gmrdata-command/1"] = "gmrdata-command/1"
    arguments: tuple[str, ...]
    folder: str
    """The working folder, in which relative paths hold."""


class Marks:
    """The marks of a batch, as one of its shards sees and sets them."""

    def __init__(self, folder: Path, shard: Shard, weights: Mapping[str, float]) -> None:
        self.folder, self._shard = folder, shard
        self._shares = shares(weights, shard.count)
        listed = "\n".join([str(shard.count), *(f"{weights[id]!r} {id}" for id in sorted(weights))])
        self._done = DoneRecord(jobs_sha256=hashlib.sha256(listed.encode()).hexdigest())

    @contextmanager
    def working(self) -> Iterator[Iterator[list[str]]]:
        """Ids of jobs to work on: the own share, then the shares of dead shards.

        StageFailed where another living process has this shard.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        if self._shard.index == 0:
            yield iter(())
            return
        path = self._claim(self._shard.index)
        claim = settled(path)
        if claim is None:
            has = owner(path)
            who = "" if has is None else f" (process {has.pid} on {has.machine})"
            raise StageFailed(
                f"shard {self._shard.index}/{self._shard.count} is worked on by another "
                f"process{who}. Give each process a shard of its own"
            )
        with held(claim):
            yield self._to_do(claim)

    def _to_do(self, claim: Claim) -> Iterator[list[str]]:
        index = self._shard.index
        # What an earlier run of this shard ended with, and why its jobs failed, is past.
        self._mark(index).unlink(missing_ok=True)
        yield self._shares[index]
        self._mark_done(index, claim)
        adopted = True
        while adopted:
            adopted = False
            paths = {index: self._claim(index) for index in self._others()}
            for index, claim in left_by_the_dead(paths):
                with held(claim):
                    # Else it ended in this moment, or gave up, and who begins again does it.
                    if claim.taken_over and not self.is_done(index):
                        adopted = True
                        yield self._shares[index]
                        self._mark_done(index, claim)

    def _others(self) -> list[int]:
        """Those that are not done, from the next one on: several who are done begin with different
        ones."""
        own, count = self._shard.index, self._shard.count
        others = ((own - 1 + step) % count + 1 for step in range(1, count))
        return [index for index in others if not self.is_done(index)]

    def ended(self) -> set[str]:
        """Ids of the jobs whose shard is done: those that are not made have failed."""
        done = filter(self.is_done, self._shares)
        return {id for index in done for id in self._shares[index]}

    def is_done(self, index: int) -> bool:
        try:
            return DoneRecord.read(self._mark(index)) == self._done
        except (MissingInput, BadRecord, FileNotFoundError):
            return False

    def said(self, left: Iterable[str]) -> str:
        """What is left, shard by shard, for whoever waits for the whole."""
        left, lines = set(left), []
        for index, share in self._shares.items():
            if count := len(left.intersection(share)):
                lines.append(
                    f"  shard {index}/{self._shard.count}: {count} left, {self._state(index)}"
                )
        return "\n".join(lines)

    def _state(self, index: int) -> str:
        if has := owner(self._claim(index)):
            return f"process {has.pid} on {has.machine}"
        if self.is_done(index):
            return "made with other settings or inputs, or gone since. Run this shard again"
        return "not begun, or ended by an error. Run this shard"

    def remove(self) -> None:
        """Take the marks away, the folder too when no other batch has some."""
        shutil.rmtree(self.folder, ignore_errors=True)
        with suppress(OSError):
            self.folder.parent.rmdir()

    def _mark_done(self, index: int, claim: Claim) -> None:
        """Unless another process took the share over: it makes the mark then.

        Or it saw that everything is made and took all marks away, maybe while this one was written.
        """
        with suppress(ClaimLost, FileNotFoundError):
            claim.require()
            self._done.write(self._mark(index))

    def _claim(self, index: int) -> Path:
        return self.folder / f".{index}-of-{self._shard.count}.claim"

    def _mark(self, index: int) -> Path:
        return self.folder / f"{index}-of-{self._shard.count}.done"


def settled(path: Path) -> Claim | None:
    """A claim if its owner is dead or nobody has it, None if he lives.

    Of another machine's owner this takes until he shows that he lives, or was silent too long.
    """
    first = owner(path)
    while (claim := try_claim(path)) is None:
        found = owner(path)
        if first is None or found is None or found.token != first.token:
            first = found
        elif _lives(path, found, first):
            return None
        time.sleep(LOOK_S)
    return claim


def left_by_the_dead(paths: Mapping[int, Path]) -> Iterator[tuple[int, Claim]]:
    """Claims of dead owners, one by one; not beating yet.

    All are watched at once, so that a hundred owners on other machines take no longer than one.
    Claims that nobody has are left alone: who begins late does his share himself.
    """
    first = {index: found for index, path in paths.items() if (found := owner(path))}
    while first:
        for index, path in paths.items():
            if index not in first:
                continue
            found = owner(path)
            if found is None or _lives(path, found, first[index]):
                del first[index]
            elif claim := try_claim(path):
                del first[index]
                yield index, claim
        if first:
            time.sleep(LOOK_S)


def _lives(path: Path, found: ClaimRecord, first: ClaimRecord) -> bool:
    """Whether an owner was seen to live since the first look."""
    if found.host == host_word():
        return not is_dead(path, found)
    return (found.token, found.beats) != (first.token, first.beats)


def shares(weights: Mapping[str, float], count: int) -> dict[int, list[str]]:
    """Ids of each shard from 1 to count, whose weights are about the same.

    The heaviest job goes first, to the shard that has least by then; a hash of the ids orders those
    of the same weight.  So it hangs on ids and weights alone, not on their order.
    """
    found: dict[int, list[str]] = {index: [] for index in range(1, count + 1)}
    loads = [(0.0, index) for index in found]

    def rank(id: str) -> tuple[float, str]:
        return -weights[id], hashlib.sha256(id.encode()).hexdigest()

    for id in sorted(weights, key=rank):
        load, index = heapq.heappop(loads)
        found[index].append(id)
        heapq.heappush(loads, (load + weights[id], index))
    return found


def marks_folder(failures_dir: Path, description: str) -> Path:
    """Where the marks of a batch lie, beside its reasons of failure."""
    slug = re.sub(r"[^a-z0-9]+", "-", description.lower())
    return failures_dir.parent / SHARDS_FOLDER / slug
