"""Exponential moving average of a network's weights (Polyak and Juditsky 1992, in its usual form).

The average of the last steps is less noisy than their last one.  It is a second network of the same
settings, which the checkpoint keeps beside the trained one: training goes on from the trained
weights, and the average is what is scored and used.
"""

import torch

from gmrdata.gmr.model import Gmr


def start_average(model: Gmr) -> Gmr:
    """A network with a copy of the weights, in evaluation mode, to put the average into."""
    average = Gmr(model.config).to(next(model.parameters()).device)
    average.load_state_dict(model.state_dict())
    return average.requires_grad_(False).eval()


def update_average(average: Gmr, model: Gmr, decay: float, step: int) -> None:
    """Take the weights of one more step into the average, in place.

    Args:
        average: What `start_average` gave.
        model: The trained network after this step.
        decay: Share of its former value that the average keeps.
        step: The step, counted from 0; early on the share is less (`decay_at`).
    """
    share = 1 - decay_at(decay, step)
    with torch.no_grad():
        for mean, value in zip(average.parameters(), model.parameters(), strict=True):
            mean.lerp_(value, share)


def decay_at(decay: float, step: int) -> float:
    """Share that the average keeps in a step, counted from 0: at most (1 + step) / (10 + step)."""
    return min(decay, (1 + step) / (10 + step))
