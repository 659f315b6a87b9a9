"""Training: one loop, from manifests to a run folder.

    run/checkpoints/...   the latest checkpoint and the best weights (gmrdata.gmr.checkpoint)
    run/metrics.jsonl     one line per logged step: step, loss, its terms; and held-out scores
    run/tensorboard/...   the same as event files, if the recipe asks for them
    run/stage.json        recipe with the seed, hashes of the manifests and the body, versions,
                          number of processes, machine

A run that was killed, at any moment and however, goes on when it is started again, and ends with
the weights that it would have had: each step's windows and dropout depend on (seed, step) alone.
Started by `torchrun`, several processes train one network (gmrdata.gmr.steps).
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

from gmrdata.gmr.config import TrainConfig
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.files import as_paths
from gmrdata.values.records import Config


class GmrRecipe(Config):
    """Train a network on manifests and score it on others; paths start at the recipe's folder."""

    recipe: Literal["gmr"]
    training: tuple[Path, ...] = ()  # those of the command line if left out
    scored: tuple[Path, ...] = ()
    body: Path | None = None  # body model of the clips; the default body if left out
    train: TrainConfig = TrainConfig()


def train(
    manifest_paths: str | Path | Iterable[str | Path],
    run_dir: Path | str,
    config: TrainConfig | None = None,
    *,
    body_path: Path | str | None = None,
    held_out_paths: str | Path | Iterable[str | Path] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Train a network on the clips of manifests; resumes a killed run.

    Args:
        body_path: Body of the clips, or a folder of bodies, as `load_bodies` takes it; None for the
            default body.
        held_out_paths: Manifests to score every `eval_every` steps; they don't change the training.

    Raises:
        BadManifest: no clips to train on, or of another body than the given ones.
        BadRecipe: weights that are not one per manifest, or a held-out subject without a clip.
        BadMotionFile: a clip holds NaN, or has a lower frame rate than the windows.
        TrainingDiverged: the loss became infinite or NaN; the last good checkpoint is kept.
        BadCheckpoint: the unfinished run's checkpoint is broken.
        StageFailed: a GPU is asked for, and there is none.
        StaleOutput: the folder was made with another recipe.
    """
    from gmrdata.gmr.loop import fit_manifests
    from gmrdata.gmr.steps import ALONE, in_all_processes, join_processes
    from gmrdata.read.bodies import body_inputs

    config, run_dir = config or TrainConfig(), Path(run_dir)
    manifests, held_out = as_paths(manifest_paths), as_paths(held_out_paths)
    inputs = {f"manifest_{i}": path for i, path in enumerate(manifests)}
    inputs |= {f"held_out_{i}": path for i, path in enumerate(held_out)}
    inputs |= body_inputs(body_path)
    processes = ALONE if run.only_look else join_processes(config.device)

    def work(partial_dir: Path) -> dict[str, Any]:
        split = fit_manifests(manifests, partial_dir, config, body_path, held_out, processes)
        made_by = {"processes": processes.count} | machine(config.device)
        return {"clips": len(split.training), "left_out": split.left_out} | made_by

    def stage(work: Callable[[Path], dict[str, Any]]) -> Path:
        return run_stage(
            "gmr-train", run_dir, config, inputs, Resumable(work, costly=True), run=run
        )

    in_all_processes(stage, work, processes)
    return run_dir


def machine(device: str) -> dict[str, str]:
    """The processor and the GPU that a run was made on, for its record."""
    import platform

    import torch

    capability = torch.backends.cpu.get_cpu_capability()
    gpu = {"gpu": torch.cuda.get_device_name()} if device == "cuda" else {}
    return {"machine": platform.machine(), "cpu_capability": capability} | gpu
