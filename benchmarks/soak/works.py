"""A verb with its arguments, run as processes of its own, and the files that it leaves."""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from film.set_kills import contents

from gmrdata.cli.shards import COMMAND_FILE

UNLIKE = {".shown", COMMAND_FILE}
"""What hangs on times: a mark of what the pages of 3DPW show, and which share ended last."""


@dataclass(frozen=True)
class Work:
    """One command of gmrdata, but for its output folder."""

    name: str
    command: tuple[str, ...]
    out: Path = Path()
    shards: int = 1
    """Processes that share the work, with --shard."""
    on_hosts: bool = False
    """Whether it takes --scheduler, and can be met by a cut cable."""

    def into(self, out: Path) -> "Work":
        """The same to another folder."""
        return replace(self, out=out)

    def start(self) -> list[subprocess.Popen[bytes]]:
        """All of its processes; what they say is appended to `<out>.log`."""
        self.out.parent.mkdir(parents=True, exist_ok=True)
        line = self.line()
        each = [["--shard", f"{n + 1}/{self.shards}"] if self.shards > 1 else []
                for n in range(self.shards)]  # fmt: skip
        with self.log.open("ab") as log:
            return [
                subprocess.Popen([*line, *more], stdout=log, stderr=log, start_new_session=True)
                for more in each
            ]

    def line(self) -> list[str]:
        """The whole command, without --shard."""
        return [sys.executable, "-m", "gmrdata", *self.command, "--out", str(self.out)]

    @property
    def log(self) -> Path:
        """What the processes said."""
        return self.out.with_name(f"{self.out.name}.log")

    def said(self) -> str:
        return self.log.read_text()

    def clear(self) -> None:
        shutil.rmtree(self.out, ignore_errors=True)
        self.log.unlink(missing_ok=True)


def contents_of(out: Path) -> Mapping[str, str]:
    """SHA-256 of each file that repeats."""
    return {path: sha for path, sha in contents(out).items() if Path(path).name not in UNLIKE}
