"""Which run a window is drawn from: by frames, or by manifest weights first."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmrdata.errors import BadManifest
from gmrdata.gmr.flat_runs import FlatRuns


@dataclass(frozen=True)
class Mix:
    """How clips in a row belong to manifests, and how often windows come from each."""

    sizes: tuple[int, ...]
    """Number of clips of each manifest, in order."""
    weights: tuple[float, ...] | None = None
    """Share of the windows from each manifest, up to a factor; None for its share of all frames."""
    names: tuple[str, ...] = ()
    """Names of the manifests, for messages."""

    def part_of_each(self) -> np.ndarray:
        """(sum of sizes,) which manifest each clip comes from."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)


def check_mix(runs: FlatRuns, mix: Mix) -> None:
    """Refuse a weight for a manifest that gives no window.

    Raises:
        BadManifest: there is one.
    """
    if mix.weights is None:
        return
    for part in set(range(len(mix.sizes))) - set(runs.parts.tolist()):
        name = mix.names[part] if mix.names else f"number {part}"
        raise BadManifest(
            f"manifest {name} has a weight, but no clip of it gives a window. Leave it out"
        )


def draw_run(runs: FlatRuns, weights: Sequence[float] | None, rng: np.random.Generator) -> int:
    """Draw a run by its share of the frames: of all, or of those of a manifest drawn by weight.

    Args:
        runs: The runs.
        weights: One per manifest, or None.
        rng: Advanced by one draw, or two.
    """
    start, stop = 0, int(runs.ends[-1])
    if weights is not None:
        upto = np.cumsum(weights)
        part = int(np.searchsorted(upto[:-1], rng.random() * upto[-1], side="right"))
        first, after = np.searchsorted(runs.parts, [part, part + 1])
        start = int(runs.ends[first - 1]) if first else 0
        stop = int(runs.ends[after - 1])
    frame = start + int(rng.integers(stop - start))
    return int(np.searchsorted(runs.ends, frame, side="right"))
