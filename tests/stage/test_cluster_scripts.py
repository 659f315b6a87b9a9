"""Scripts for clusters: valid, and with the measured need in them."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gmrdata.stage.cluster_scripts import Array, Need, array_script
from gmrdata.values.errors import BadRecipe

COMMAND = ("gmrdata", "render", "my set.yaml", "--out", "out/set")
MEASURED = Need(cpu_s=7200.0, memory_mib=900.0)


def test_a_slurm_array_runs_each_shard_in_the_folder(tmp_path: Path) -> None:
    """The script is run here as Slurm runs a task of it, with gmrdata's place taken by echo."""
    folder = tmp_path / "with space"
    folder.mkdir()
    script = array_script(Array("slurm", 4), ("echo", *COMMAND[1:]), folder, MEASURED)
    assert "#SBATCH --array=1-4\n" in script
    assert "#SBATCH --mem=1800M\n" in script  # twice 900 MiB
    assert "#SBATCH --time=01:00:00\n" in script  # twice 2 h / 4
    done = subprocess.run(
        ["bash", "-c", script + "true"],
        env={"SLURM_ARRAY_TASK_ID": "3", "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "render my set.yaml --out out/set --shard 3/4\n"


def test_a_kubernetes_job_is_an_indexed_one(tmp_path: Path) -> None:
    job = yaml.safe_load(array_script(Array("kubernetes", 4), COMMAND, tmp_path, MEASURED))
    spec = job["spec"]
    assert (spec["completions"], spec["completionMode"]) == (4, "Indexed")
    container = spec["template"]["spec"]["containers"][0]
    assert container["resources"]["limits"]["memory"] == "1800Mi"
    shell, flag, line = container["command"]
    done = subprocess.run(
        [shell, flag, line.replace("exec gmrdata", "echo")],
        env={"JOB_COMPLETION_INDEX": "0", "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "render my set.yaml --out out/set --shard 1/4\n"


def test_what_was_not_measured_is_called_a_guess(tmp_path: Path) -> None:
    for system in ("slurm", "kubernetes"):
        script = array_script(Array(system, 2), COMMAND, tmp_path, Need(None, None))  # type: ignore[arg-type]
        assert "a guess: this verb's dry run measures neither" in script
    with pytest.raises(BadRecipe, match="--print-slurm 0: at least one shard"):
        Array("slurm", 0)


def test_the_command_line_prints_it_and_does_nothing(tmp_path: Path) -> None:
    arguments = ["motions", "walk.bvh", "--out=out", "--print-slurm", "8"]
    command = [sys.executable, "-m", "gmrdata", *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("#!/bin/bash\n#SBATCH --job-name=gmrdata-motions\n")
    wanted = 'exec gmrdata motions walk.bvh --out out --shard "$SLURM_ARRAY_TASK_ID/8"\n'
    assert done.stdout.endswith(wanted)
    assert list(tmp_path.iterdir()) == []
