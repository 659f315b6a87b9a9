"""What can be scored: a trained network, clips of gmrdata's own, or results of other systems."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import Field

from gmrdata.gmr.config import Which
from gmrdata.gmr.runs import UsableClip
from gmrdata.score import Deviation, ProtocolName, SeenAs
from gmrdata.score.predictions import Pairing, PredictedClip, file_clip, network_clip
from gmrdata.score.protocols import protocol_as
from gmrdata.score.records import Protocol, ScoredFiles, ScoredNetwork, ScoredResults
from gmrdata.values import limits
from gmrdata.values.errors import BadRecipe
from gmrdata.values.records import Config


class ScoreConfig(Config):
    """The recipe of a score."""

    which: Which = "latest"
    """Which weights of a network are scored; predictions from files have none."""
    all_phases: bool = False
    """Whether a clip of a higher frame rate is scored in all its phases, or in the first; the paper
    doesn't say."""
    protocol: ProtocolName | None = None
    """What is measured beside OME, TME, VME and the vertex error over time."""
    original: tuple[Deviation | Literal["all"], ...] = ()
    """In what a protocol follows its released code where it doesn't by itself."""
    fps_hz: float = Field(default=10.0, gt=0)
    """Rate of OME, TME and VME of predictions from files [Hz]; a network is scored at its own."""
    missing: Literal["error", "drop"] = "error"
    """Whether valid frames without a prediction are an error, or dropped and counted."""
    person: Mapping[str, str] = Field(default_factory=dict)
    """Which person of another system's result is a clip's, by `<set>/<clip id>`, `<clip id>` or ""
    for all."""
    camera: SeenAs = "ignored"
    """How such a motion in the camera's frame becomes one in the world."""
    first_image: int | None = Field(default=None, ge=0)
    """Number of the image that is such a system's frame 0; None for the first of the images that
    the manifest lists, else 0."""
    resamples: int = Field(default=2000, ge=100, le=limits.MOST_DRAWS)
    """How often clips are drawn for a bootstrap interval."""
    seed: int = Field(default=0, ge=0)

    def its_protocol(self) -> Protocol | None:
        """The protocol as it is asked for; BadRecipe where it has no such deviation."""
        if self.protocol is None:
            if self.original:
                raise BadRecipe(f"--original {' '.join(self.original)}: give --protocol too")
            return None
        return protocol_as(self.protocol, self.original)

    def pairing(self) -> Pairing:
        protocol = self.its_protocol()
        return Pairing(
            self.fps_hz,
            protocol_fps_hz=protocol.fps_hz if protocol else None,
            smoothing_frames=protocol.smoothing_frames if protocol else 0.0,
            all_phases=self.all_phases,
            drop_missing=self.missing == "drop",
        )


@dataclass(frozen=True, eq=False)
class Predictor:
    """Something that predicts clips, opened."""

    name: str
    model: ScoredNetwork | ScoredFiles | ScoredResults
    fps_hz: float  # rate of OME, TME and VME [Hz]
    predict: Callable[[UsableClip], PredictedClip | str]  # or the reason why there is none


@dataclass(frozen=True, eq=False)
class Source:
    """Something that is scored by itself, still on disk."""

    name: str
    inputs: Mapping[str, Path]  # its files, by their part
    open: Callable[[], Predictor]


def network_source(run_dir: Path, config: ScoreConfig) -> Source:
    """A trained network.

    Its input is each clip's own local pose and shape, so VME is of the motion alone.  Each run of
    valid frames is a sequence of its own.
    """

    def opened() -> Predictor:
        from gmrdata.gmr.predict import load_gmr

        gmr = load_gmr(run_dir, config.which)
        network = gmr.model.config.model_dump(mode="json")
        model = ScoredNetwork(
            kind="network", run=gmr.name, step=gmr.step, which=config.which, network=network
        )
        predict = partial(network_clip, gmr, how=config.pairing())
        return Predictor(gmr.name, model, gmr.fps_hz, predict)

    return Source(run_dir.name, {"run": run_dir}, opened)


def clips_source(name: str, folder: Path, config: ScoreConfig) -> Source:
    """`<clip id>.npz` for each clip, as `file_clip` reads them."""

    def opened() -> Predictor:
        model = ScoredFiles(kind="files", predictions=name)
        predict = partial(file_clip, folder, how=config.pairing())
        return Predictor(name, model, config.fps_hz, predict)

    return Source(name, {"predictions": folder}, opened)
