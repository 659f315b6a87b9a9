"""Wall and processor time of whole processes."""

import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from gmrdata.film.blender_environment import blender_command, blender_variables

REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Spent:
    """What a process took, from its start to its end."""

    wall_s: float
    cpu_s: float
    said: str
    """Its standard output."""


ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # of numpy


def run_python(*words: str | Path) -> Spent:
    """Run a Python process with the repository's packages, and numpy with one thread."""
    packages = os.pathsep.join([str(REPOSITORY), str(REPOSITORY / "benchmarks")])
    return _run([sys.executable, *map(str, words)], os.environ | {"PYTHONPATH": packages})


def run_in_blender(script: Path, *words: str | Path) -> Spent:
    """Run a script in Blender's environment, and numpy with one thread."""
    return _run(blender_command(script, *words), blender_variables())


def _run(words: list[str], environment: dict[str, str]) -> Spent:
    before, start_s = _children_cpu_s(), time.perf_counter()
    done = subprocess.run(
        words,
        env=environment | ONE_THREAD,
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    wall_s = time.perf_counter() - start_s
    if done.returncode:
        raise RuntimeError(f"{words} ended with {done.returncode}:\n{done.stderr[-3000:]}")
    return Spent(wall_s, _children_cpu_s() - before, done.stdout)


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
