"""What can be scored: a trained network, clips of gmrdata's own, or results of other systems."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.gmr.config import Which, weights_dir
from gmrdata.gmr.runs import ClipFile, LazyClips, UsableClip, usable_files
from gmrdata.manifest.current import ClipEntry
from gmrdata.manifest.listing import read_listing
from gmrdata.manifest.read import listed_path
from gmrdata.read.bodies import load_bodies
from gmrdata.read.frames import number_in_name
from gmrdata.read.systems import phalp
from gmrdata.score import Deviation, ProtocolName, SeenAs
from gmrdata.score.predictions import (
    Pairing,
    PredictedClip,
    clip_beside_truth,
    file_clip,
    known_rows,
    network_clip,
    rows_between,
    whole_steps,
)
from gmrdata.score.protocols import protocol_as
from gmrdata.score.records import Protocol, ScoredFiles, ScoredNetwork, ScoredResults
from gmrdata.score.result_files import ClipFolder, ClipName, ResultSet
from gmrdata.score.results import (
    MatchedClip,
    RowsOfVideo,
    frames_of_rows,
    has_rows,
    matched_clip,
    people_of_clips,
    timed_clip,
)
from gmrdata.values import limits
from gmrdata.values.body import BodyModel, body_of
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.motion import whole_ratio
from gmrdata.values.people import EstimatedPeople, EstimatedPerson
from gmrdata.values.records import Config

MOST_FRAMES_OFF = 2  # that programs leave out or count twice at the end of a video


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
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)

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
class PredictorSource:
    """Something that is scored by itself, still on disk."""

    name: str
    inputs: Mapping[str, Path]  # its files, by their part
    open: Callable[[], Predictor]
    run_dir: Path | None = None  # of a network
    lacking: Mapping[str, str] = field(default_factory=dict)  # why clips have none, by id


def network_source(run_dir: Path, config: ScoreConfig) -> PredictorSource:
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

    return PredictorSource(run_dir.resolve().name, {"run": weights_dir(run_dir)}, opened, run_dir)


def clips_source(one: ClipFolder, config: ScoreConfig, beside: "ResultSets") -> PredictorSource:
    """`<clip id>.npz` for each clip, as `file_clip` reads them, on the frames of those beside."""
    files = {clip.id: one.folder / f"{clip.id}.npz" for clip in beside.names}
    lacking = {id: f"no prediction {it.name}" for id, it in files.items() if not it.is_file()}
    _require_all(one.folder, lacking, config)

    def opened() -> Predictor:
        model = ScoredFiles(kind="files", predictions=one.name)
        shared = beside.shared_rows if config.missing == "drop" else None
        predict = partial(file_clip, one.folder, how=config.pairing(), shared=shared)
        return Predictor(one.name, model, config.fps_hz, predict)

    inputs = {"predictions": one.folder}
    if config.missing == "drop":
        inputs |= {key: path for key, path in beside.inputs().items() if path != one.folder}
    return PredictorSource(one.name, inputs, opened, lacking=lacking)


def _require_all(path: Path, lacking: Mapping[str, str], config: ScoreConfig) -> None:
    """Refuse clips without a prediction before any is scored, unless they shall be dropped."""
    if lacking and config.missing == "error":
        id, reason = next(iter(lacking.items()))
        more = f", and {len(lacking) - 1} more lack one" if len(lacking) > 1 else ""
        remedy = "Give all, or pass --missing drop to leave those clips out"
        raise BadMotionFile(f"{path}: {reason}, for clip {id}{more}. {remedy}")


UNREAD: Mapping[str, Sequence[str]] = {
    "a network": ("fps_hz", "missing", "person", "camera", "first_image"),
    "clips of gmrdata": ("which", "person", "camera", "first_image"),
    "results of other systems": ("which",),
}
"""By what is scored, the settings that say nothing of it."""


def check_read(config: ScoreConfig, what: str) -> None:
    """Refuse settings that say nothing of what is scored: one is a mistake, not a default."""
    for name in UNREAD[what]:
        if getattr(config, name) != getattr(ScoreConfig(), name):
            raise BadRecipe(f"--{name.replace('_', '-')}: not for {what}. Leave it out")


def clip_names(manifest_path: Path) -> tuple[list[ClipName], list[ClipName]]:
    """The clips that can be scored, and those that can't; people of these count among those of a
    sequence."""
    _, left_out, manifest = usable_files(manifest_path)
    people: dict[str, set[str]] = {}
    for entry in manifest.clips:
        people.setdefault(entry.source.sequence, set()).add(entry.source.person or "")
    names = [
        ClipName(entry.id, source.sequence, source.person or "", len(people[source.sequence]))
        for entry in manifest.clips
        for source in (entry.source,)
    ]
    scored = [name for name in names if name.id not in left_out]
    return scored, [name for name in names if name.id in left_out]


def check_people(
    config: ScoreConfig, names: Sequence[ClipName], sets: Sequence[ResultSet | ClipFolder]
) -> None:
    """Refuse a --person for a clip or a set that is not there."""
    ids = [clip.id for clip in names]
    known = {"", *ids, *(f"{one.name}/{id}" for one in sets for id in ids)}
    if unknown := sorted(config.person.keys() - known):
        of_sets = ", ".join(one.name for one in sets)
        raise BadRecipe(
            f"--person {unknown[0]}={config.person[unknown[0]]}: no such clip, or set and clip. "
            f"Sets are {of_sets}; clips are {', '.join(ids[:20])}"
        )


@dataclass(frozen=True)
class ResultSets:
    """All sets of results that are scored on a manifest's clips."""

    path: Path  # that they were found in
    sets: Sequence[ResultSet]
    names: Sequence[ClipName]  # of the clips
    manifest_path: Path
    body_path: Path | None  # of the predictions
    config: ScoreConfig
    clip_folders: Sequence[Path] = ()  # of clips of gmrdata's own, which are scored beside

    def source(self, one: ResultSet) -> PredictorSource:
        """One of them.

        With `missing` "drop" all are scored on the frames that each of them has.
        """
        people = people_of_clips(one, self.names, self.config.person)
        lacking = {
            clip.id: f"nobody is left for it in {one.results[clip.id].files[0].name}"
            if clip.id in one.results
            else f"no result of {one.name}"
            for clip in self.names
            if clip.id not in people
        }
        _require_all(self.path, lacking, self.config)
        inputs = self.inputs() if self.config.missing == "drop" else _result_files([one])
        return PredictorSource(one.name, inputs, lambda: self._opened(one, people), lacking=lacking)

    def inputs(self) -> dict[str, Path]:
        """The files of all that are scored, by their part."""
        folders = {f"clips_{n}": folder for n, folder in enumerate(self.clip_folders)}
        return _result_files(self.sets) | folders

    def shared_rows(self, true: Clip) -> np.ndarray:
        """(T,) bool: rows of a clip in which all who predict it do so.

        Beside a prediction at a k-th of the clip's rate, they are whole steps of that.
        """
        frames, step = self._frames(true), 1
        shared = np.ones(len(frames), dtype=bool)
        for people in self._people:
            person = people.get(true.id)
            if person is not None and not person.has_own_rate:
                shared &= has_rows(person, true, frames, self.config.camera)
        for valid, fps_hz in self._timed(true):
            its_step = whole_ratio(true.motion.fps_hz, fps_hz) or 1
            shared &= rows_between(valid, its_step, len(frames))
            step = math.lcm(step, its_step)
        return shared if step == 1 else whole_steps(shared & true.valid, step)

    def _timed(self, true: Clip) -> Iterator[tuple[np.ndarray, float]]:
        """`valid` (N,) and the rate [Hz] of each prediction of a clip that has its own rate."""
        for one, people in zip(self.sets, self._people, strict=True):
            person = people.get(true.id)
            if person is not None and person.has_own_rate:
                n_rows, fps_hz = len(person.frame_numbers), one.results[true.id].fps_hz
                yield np.ones(n_rows, dtype=bool), fps_hz or true.motion.fps_hz
        for folder in self.clip_folders:
            if (path := folder / f"{true.id}.npz").is_file():
                clip = load_clip(path)
                yield known_rows(path, clip, true), clip.motion.fps_hz

    @cached_property
    def _people(self) -> list[dict[str, EstimatedPerson]]:
        return [people_of_clips(one, self.names, self.config.person) for one in self.sets]

    @cached_property
    def _files(self) -> dict[str, ClipFile]:
        return {file.entry.id: file for file in usable_files(self.manifest_path)[0]}

    def _images(self, true: Clip) -> list[int]:
        return _image_numbers(self._files[true.id].entry, self.manifest_path)

    def _frames(self, true: Clip) -> np.ndarray:
        return frames_of_rows(true, self._images(true), self.config.first_image)

    def _opened(self, one: ResultSet, people: Mapping[str, EstimatedPerson]) -> Predictor:
        config, bodies = self.config, load_bodies(self.body_path)
        clips = LazyClips([file for id, file in self._files.items() if id in people])
        matched = {clip.id: self._matched(one, people[clip.id], clip, bodies) for clip in clips}
        model = ScoredResults(
            kind="results",
            predictions=self.path.resolve().name,
            system=one.system,
            camera=config.camera if one.system in ("vibe", "phalp") else None,
            clips={id: match.matched for id, match in matched.items()},
        )
        return Predictor(
            one.name, model, config.fps_hz, lambda clip: _predicted(one, matched, config, clip)
        )

    def _matched(
        self, one: ResultSet, person: EstimatedPerson, true: Clip, bodies: Sequence[BodyModel]
    ) -> MatchedClip:
        """A clip's prediction, on the frames that all results of it have where some may lack."""
        result, body = one.results[true.id], _body_of(person, true, bodies)
        shared = self.shared_rows(true) if self.config.missing == "drop" else None
        if result.system == "amass":
            return timed_clip(result, person, true, body, shared)
        if self.config.first_image is None:
            _require_same_video(result, true, len(set(self._images(true))))
        rows = RowsOfVideo(self._frames(true), shared)
        return matched_clip(result, person, true, body, self.config.camera, rows)


def _result_files(sets: Sequence[ResultSet]) -> dict[str, Path]:
    """The files of some sets, by the set and the clip that they are of: only their names say it."""
    return {
        f"result_{one.name}/{id}/{n}": file
        for one in sets
        for id, result in one.results.items()
        for n, file in enumerate(result.files)
    }


def _require_same_video(result: EstimatedPeople, true: Clip, n_images: int) -> None:
    """Refuse a result of more or fewer frames than the clip has images, where both are known; one
    that doesn't tell has at least those in which it saw somebody."""
    if phalp.ends_early(result, n_images):
        return
    shown = max((int(one.frame_numbers[-1]) + 1 for one in result.people), default=0)
    n_frames = result.n_frames or max(shown, n_images)
    if n_images and abs(n_frames - n_images) > MOST_FRAMES_OFF:
        raise BadMotionFile(
            f"{result.files[0]}: of a video of {n_frames} frames, and clip {true.id} has "
            f"{n_images} images. Give a result of these images, or say with --first-image which "
            "one is frame 0"
        )


def _body_of(person: EstimatedPerson, clip: Clip, bodies: Sequence[BodyModel]) -> BodyModel:
    """The body that a result's shape is of; else the clip's own; else the first."""
    named = (body for body in bodies if body.name == person.betas_body)
    return next(named, None) or body_of(clip.motion, bodies) or bodies[0]


def _image_numbers(entry: ClipEntry, manifest_path: Path) -> list[int]:
    """Numbers of the images that the manifest lists for a clip; none without a listing."""
    if entry.images is None:
        return []
    listing = listed_path(manifest_path, entry, "images.listing", entry.images.listing.path)
    if not listing.is_file():
        return []
    numbers = (number_in_name(one.path) for one in read_listing(listing))
    return [number for number in numbers if number is not None]


def _predicted(
    results: ResultSet, matched: Mapping[str, MatchedClip], config: ScoreConfig, one: UsableClip
) -> PredictedClip | str:
    result, its_clip = results.results[one.clip.id], matched[one.clip.id].clip
    predicted = clip_beside_truth(result.files[0], its_clip, one, config.pairing())
    world = result.people[0].in_world
    if isinstance(predicted, str) or (world is not None and world.has_camera_path):
        return predicted
    # A person seen in both frames tells where the camera looks, but not where it is.
    return replace(predicted, camera_paths_m=None)
