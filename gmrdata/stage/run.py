"""How a command runs its stages.  Nothing here decides a result, so no recipe holds it."""

import hashlib
import re
from dataclasses import dataclass
from typing import Self

from gmrdata.values.errors import BadRecipe
from gmrdata.values.limits import MOST_WORKERS


@dataclass(frozen=True)
class Shard:
    """Share `index` of `count`, counted from 1; 0 works on none and only merges."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Of a text like 2/4; BadRecipe where it is none."""
        match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        shard = cls(int(match[1]), int(match[2])) if match else cls(1, 0)
        if shard.index > shard.count or shard.count < 1:
            raise BadRecipe(f"--shard {text}: give it as 2/4, the second of four")
        return shard

    def of(self, id: str) -> int:
        """Which share a job is in, by a hash of its id: the same whatever else is in the batch."""
        digest = hashlib.sha256(id.encode(errors="surrogateescape")).digest()
        return int.from_bytes(digest[:8], "big") % self.count + 1


@dataclass(frozen=True)
class Run:
    """Passed on as it is from a command to its stages."""

    redo: bool = False  # throw away and make anew what another recipe or other inputs made
    anew: bool = False
    """The same for what a page shows, which nobody asked to keep; hashes that an earlier process
    remembered are believed."""
    workers: int | None = None  # local worker processes; as many as the recipe says when None
    scheduler: str | None = None
    """Address of a running Dask scheduler (tcp://host:port); local processes when None."""
    shard: Shard | str | None = None
    """Which share of a batch this process works on, or a text like 2/4; all of it when None."""
    only_look: bool = False
    """Make nothing: a stage that has work to do raises `gmrdata.stage.store.NotMade`."""

    @property
    def replaces(self) -> bool:
        """Whether what another recipe or other inputs made is thrown away."""
        return self.redo or self.anew

    @property
    def share(self) -> Shard | None:
        """The shard, whichever way it was given."""
        return Shard.parse(self.shard) if isinstance(self.shard, str) else self.shard

    def __post_init__(self) -> None:
        _ = self.share  # refused here, not in the midst of the work
        if self.workers is not None and self.workers < 1:
            raise BadRecipe(f"--workers {self.workers}: at least one process has to do the work")
        if self.workers is not None and self.workers > MOST_WORKERS:
            raise BadRecipe(f"--workers {self.workers}: give {MOST_WORKERS} or fewer")


DEFAULT_RUN = Run()  # keep what is made; the recipe's number of local workers
