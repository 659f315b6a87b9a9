"""A verb with its arguments, run as processes of its own, and the files that it leaves."""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from film.set_kills import contents

UNLIKE = {"metrics.jsonl", ".shown"}
"""What hangs on times: a training's log, and a page's mark of the records that it shows."""


@dataclass(frozen=True)
class Work:
    """One command of gmrdata, but for its output folder."""

    name: str
    command: tuple[str, ...]
    out: Path = Path()
    shards: int = 1
    """Processes that share the work, with --shard."""

    def into(self, out: Path) -> "Work":
        """The same to another folder."""
        return replace(self, out=out)

    def start(self) -> list[subprocess.Popen[bytes]]:
        """All of its processes; what they say is appended to `<out>.log`."""
        self.out.parent.mkdir(parents=True, exist_ok=True)
        line = [sys.executable, "-m", "gmrdata", *self.command, "--out", str(self.out)]
        each = [["--shard", f"{n + 1}/{self.shards}"] if self.shards > 1 else []
                for n in range(self.shards)]  # fmt: skip
        with self._log.open("ab") as log:
            return [
                subprocess.Popen([*line, *more], stdout=log, stderr=log, start_new_session=True)
                for more in each
            ]

    @property
    def _log(self) -> Path:
        return self.out.with_name(f"{self.out.name}.log")

    def said(self) -> str:
        return self._log.read_text()

    def clear(self) -> None:
        shutil.rmtree(self.out, ignore_errors=True)
        self._log.unlink(missing_ok=True)


def contents_of(out: Path) -> Mapping[str, str]:
    """SHA-256 of each file that repeats."""
    return {path: sha for path, sha in contents(out).items() if Path(path).name not in UNLIKE}
