"""One training in several processes, as `torchrun` starts them: one per GPU, or on CPUs.

    torchrun --nproc-per-node 4 -m gmrdata train manifest.yaml --out run

Each process takes its part of a step's windows; the gradients are averaged, so that all have the
same weights at all times.  The first process alone writes.  All must see the same run folder.
"""

import atexit
import os
from dataclasses import dataclass, fields
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import nn

from gmrdata.gmr.windows import Batch
from gmrdata.values.errors import StageFailed

PATIENCE = timedelta(hours=2)  # they wait for scores on held-out clips, which the first makes


@dataclass(frozen=True)
class Processes:
    """Which process this is, of how many."""

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:  # the one that writes
        return self.rank == 0


ALONE = Processes()


def check_device(device: str) -> None:
    if device == "cuda" and not torch.cuda.is_available():
        raise StageFailed("no GPU here that torch can use. Train with device: cpu")


def join_processes(device: str) -> Processes:
    """Join the others that `torchrun` started, until this process ends; `ALONE` without it."""
    check_device(device)
    if not dist.is_torchelastic_launched():
        return ALONE
    # Once per process: a second group would find the first one's addresses and wait for ever.
    if not dist.is_initialized():
        if device == "cuda":
            torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
        dist.init_process_group("nccl" if device == "cuda" else "gloo", timeout=PATIENCE)
        atexit.register(dist.destroy_process_group)
    return Processes(dist.get_rank(), dist.get_world_size())


def from_first(value: str | None, processes: Processes) -> str | None:
    """What the first process says; the others' own value is not looked at."""
    values = [value]
    if processes.count > 1:
        dist.broadcast_object_list(values, src=0)
    return values[0]


def averaging(model: nn.Module, processes: Processes) -> nn.Module:
    """The network, with gradients that are averaged over the processes as they are made."""
    if processes.count == 1:
        return model
    # Without device_ids, inputs stay where they are: the lengths must stay on the CPU.
    return nn.parallel.DistributedDataParallel(model, broadcast_buffers=False)


def averaged(values: torch.Tensor, processes: Processes) -> torch.Tensor:
    if processes.count > 1:
        dist.all_reduce(values)
        values = values / processes.count
    return values


def own_part(batch: Batch, processes: Processes) -> Batch:
    """This process's windows of a step's, of which each process has as many."""
    if processes.count == 1:
        return batch
    size = len(batch.poses) // processes.count
    rows = slice(processes.rank * size, (processes.rank + 1) * size)
    return Batch(*(getattr(batch, field.name)[rows] for field in fields(batch)))
