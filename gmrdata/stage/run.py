"""How a command runs its stages.  Nothing here decides a result, so no recipe holds it."""

from dataclasses import dataclass

from gmrdata.stage.shards import Shard
from gmrdata.values.errors import BadRecipe


@dataclass(frozen=True)
class Run:
    """Passed on as it is from a command to its stages."""

    redo: bool = False  # throw away and make anew what another recipe or other inputs made
    workers: int | None = None  # local worker processes; as many as the recipe says when None
    scheduler: str | None = None
    """Address of a running Dask scheduler (tcp://host:port); local processes when None."""
    shard: Shard | None = None
    """Which share of a batch this process works on; all of it when None."""
    only_look: bool = False
    """Make nothing: a stage that has work to do raises `gmrdata.stage.store.NotMade`."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise BadRecipe(f"--workers {self.workers}: at least one process has to do the work")


DEFAULT_RUN = Run()  # keep what is made; the recipe's number of local workers
