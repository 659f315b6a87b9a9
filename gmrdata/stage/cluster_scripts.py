"""Scripts that run a command's shards on a cluster: a Slurm array, a Kubernetes indexed job."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import yaml

from gmrdata.values.errors import BadRecipe

MARGIN = 2.0  # times what was estimated: nodes are slower than this machine, clips differ
LEAST_MINUTES, LEAST_MIB = 10, 1024


@dataclass(frozen=True)
class Array:
    """What was asked for: a script for so many shards."""

    system: Literal["slurm", "kubernetes"]
    shards: int

    def __post_init__(self) -> None:
        if self.shards < 1:
            raise BadRecipe(f"--print-{self.system} {self.shards}: at least one shard")


@dataclass(frozen=True)
class Need:
    """What all shards need together, as far as it was measured."""

    cpu_s: float | None  # processor time of the whole batch [s]
    memory_mib: float | None  # of one process with its children [MiB]


def array_script(array: Array, command: Sequence[str], folder: Path, need: Need) -> str:
    """The script; `command` is `gmrdata` with its arguments, but for `--shard`.

    Args:
        folder: Working folder of the shards; it and the output lie on the shared disk.
    """
    minutes, mib = _minutes(array.shards, need), _mib(need)
    said = "measured here by the dry run, twice as much for safety"
    if need.cpu_s is None or need.memory_mib is None:
        said = "a guess: this verb's dry run measures neither, so change them"
    if array.system == "slurm":
        return _slurm(array.shards, command, folder, minutes, mib, said)
    return _kubernetes(array.shards, command, folder, minutes, mib, said)


def _minutes(shards: int, need: Need) -> int:
    if need.cpu_s is None:
        return 24 * 60
    return max(LEAST_MINUTES, round(MARGIN * need.cpu_s / shards / 60.0 + 0.5))


def _mib(need: Need) -> int:
    return 8192 if need.memory_mib is None else max(LEAST_MIB, round(MARGIN * need.memory_mib))


def _slurm(
    shards: int, command: Sequence[str], folder: Path, minutes: int, mib: int, said: str
) -> str:
    time = f"{minutes // 60:02d}:{minutes % 60:02d}:00"
    return "\n".join(
        [
            "#!/bin/bash",
            f"#SBATCH --job-name=gmrdata-{command[1]}",
            f"#SBATCH --array=1-{shards}",
            "#SBATCH --cpus-per-task=1",
            f"#SBATCH --mem={mib}M",
            f"#SBATCH --time={time}",
            "#SBATCH --requeue",
            f"# Memory and time are {said}.",
            "# A task that was cut off goes on where it was; submit again for what is left.",
            "set -e",
            "export OMP_NUM_THREADS=${SLURM_CPUS_PER_TASK:-1}",
            f"cd {shlex.quote(str(folder))}",
            f'exec {shlex.join(command)} --shard "$SLURM_ARRAY_TASK_ID/{shards}"',
            "",
        ]
    )


def _kubernetes(
    shards: int, command: Sequence[str], folder: Path, minutes: int, mib: int, said: str
) -> str:
    shard = f"--shard $((JOB_COMPLETION_INDEX + 1))/{shards}"
    container = {
        "name": "gmrdata",
        "image": "IMAGE",
        "workingDir": str(folder),
        "command": ["sh", "-c", f"exec {shlex.join(command)} {shard}"],
        "env": [{"name": "OMP_NUM_THREADS", "value": "1"}],
        "resources": {
            "requests": {"cpu": "1", "memory": f"{mib}Mi"},
            "limits": {"memory": f"{mib}Mi"},
        },
        "volumeMounts": [{"name": "data", "mountPath": str(folder)}],
    }
    volume = {"name": "data", "persistentVolumeClaim": {"claimName": "CLAIM"}}
    job = {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": f"gmrdata-{command[1]}"},
        "spec": {
            "completions": shards,
            "parallelism": shards,
            "completionMode": "Indexed",
            "backoffLimit": 4 * shards,
            "activeDeadlineSeconds": 60 * minutes,
            "template": {
                "spec": {
                    "restartPolicy": "OnFailure",
                    "containers": [container],
                    "volumes": [volume],
                }
            },
        },
    }
    head = (
        f"# Memory and time are {said}.\n"
        "# Put your image with gmrdata for IMAGE, and the claim of the shared disk for CLAIM.\n"
    )
    return head + yaml.safe_dump(job, sort_keys=False)
