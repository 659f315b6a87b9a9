"""Score other systems' results as they write them, each set by itself, and compare the sets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.gmr.runs import UsableClip, usable_clips, usable_files
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.listing import read_listing
from gmrdata.read.frames import number_in_name
from gmrdata.score.compare import CompareConfig, compare
from gmrdata.score.predictions import PredictedClip, clip_beside_truth
from gmrdata.score.records import MatchedResult, ScoredResults
from gmrdata.score.result_files import (
    COMPARISON,
    ClipFiles,
    ClipName,
    ResultSet,
    find_result_sets,
)
from gmrdata.score.results import (
    MatchedClip,
    SeenAs,
    frames_of_rows,
    has_rows,
    matched_clip,
    people_of_clips,
    timed_clip,
)
from gmrdata.score.score import (
    Predictor,
    ScoreConfig,
    bodies_for,
    score_predictions,
    write_scores,
)
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.bodies import body_of
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.estimated import EstimatedPerson
from gmrdata.values.files import resolve_inside


class ResultsConfig(ScoreConfig):
    """The recipe of scores of other systems' results."""

    person: Mapping[str, str] = Field(default_factory=dict)
    """Which person of a result is a clip's, by `<set>/<clip id>`, `<clip id>` or "" for all."""
    camera: SeenAs = "ignored"
    """How a motion in the camera's frame becomes one in the world."""
    first_image: int | None = Field(default=None, ge=0)
    """Number of the image that is frame 0; None for the first of the images that the manifest
    lists, else 0."""


@dataclass(frozen=True)
class ScoredSets:
    """What was scored."""

    scores: tuple[Path, ...]  # the `scores.json` of each set
    comparison: Path | None  # `comparison.json` of several sets; None for one


@dataclass(frozen=True)
class _Given:
    """What the scores of all sets have in common."""

    manifest_path: Path
    body_path: Path | None
    predictions_body_path: Path | None
    floor_path: Path | None
    joint_regressor_path: Path | None
    run: Run

    def inputs(self) -> dict[str, Path | None]:
        return {
            "manifest": self.manifest_path,
            "body": self.body_path,
            "floor": self.floor_path,
            "predictions_body": self.predictions_body_path,
            "joint_regressor": self.joint_regressor_path,
        }


def score_results(
    path: Path,
    manifest_path: Path,
    body_path: Path | None,
    out_dir: Path,
    config: ResultsConfig | None = None,
    *,
    predictions_body_path: Path | None = None,
    floor_path: Path | None = None,
    joint_regressor_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> ScoredSets:
    """Score what other systems predicted for a manifest's clips, and clips of gmrdata's own.

    One set of results is scored in `out_dir`; several are in `out_dir/<set>` each, and compared
    with the first in `out_dir/comparison`.  With `missing` "drop" all sets are scored on the frames
    that each of them has.  What is not said here is as for `score_predictions`.

    Args:
        path: A result, or a folder of results, as `result_files` finds them.

    MissingInput where there is no result.  BadMotionFile where a clip or frame has none and may not
    be dropped, where a result has several people and none was named, or none of a clip's frames.
    """
    config = config or ResultsConfig()
    given = _Given(
        manifest_path, body_path, predictions_body_path, floor_path, joint_regressor_path, run
    )
    names = _clip_names(manifest_path)
    sets = find_result_sets(path, names)
    _check_people(config, names, sets)
    scores = []
    for one in sets:
        folder = out_dir if len(sets) == 1 else out_dir / one.name
        if isinstance(one, ClipFiles):
            scores.append(_score_clip_files(one, given, folder, config))
        else:
            others = [other for other in sets if isinstance(other, ResultSet)]
            scores.append(_score_set(path, one, others, names, given, folder, config))
    if len(sets) == 1:
        return ScoredSets(tuple(scores), None)
    compared = CompareConfig(names=tuple(one.name for one in sets), seed=config.seed)
    comparison = compare(scores, out_dir / COMPARISON, compared, run=run)
    return ScoredSets(tuple(scores), comparison)


def _clip_names(manifest_path: Path) -> list[ClipName]:
    """The clips that can be scored; people of rejected clips count among those of a sequence."""
    files, _, manifest = usable_files(manifest_path)
    people: dict[str, set[str]] = {}
    for entry in manifest.clips:
        people.setdefault(entry.source.sequence, set()).add(entry.source.person or "")
    return [
        ClipName(entry.id, source.sequence, source.person or "", len(people[source.sequence]))
        for entry in (file.entry for file in files)
        for source in (entry.source,)
    ]


def _check_people(
    config: ResultsConfig, names: Sequence[ClipName], sets: Sequence[ResultSet | ClipFiles]
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


def _score_clip_files(
    files: ClipFiles, given: _Given, out_dir: Path, config: ResultsConfig
) -> Path:
    plain = {name: getattr(config, name) for name in ScoreConfig.model_fields}
    return score_predictions(
        files.folder,
        given.manifest_path,
        given.body_path,
        out_dir,
        ScoreConfig.model_validate(plain),
        predictions_body_path=given.predictions_body_path,
        floor_path=given.floor_path,
        joint_regressor_path=given.joint_regressor_path,
        run=given.run,
    )


def _score_set(
    path: Path,
    found: ResultSet,
    sets: Sequence[ResultSet],
    names: Sequence[ClipName],
    given: _Given,
    out_dir: Path,
    config: ResultsConfig,
) -> Path:
    beside = sets if config.missing == "drop" else [found]
    people = {one.name: people_of_clips(one, names, config.person) for one in beside}

    def predictor() -> Predictor:
        usable = usable_clips(given.manifest_path)
        entries = {entry.id: entry for entry in usable.manifest.clips}
        bodies = bodies_for(given.body_path, given.predictions_body_path)
        matched = {
            one.clip.id: _matched(
                found, people, one, entries[one.clip.id], bodies.of_predictions, given, config
            )
            for one in usable.clips
            if one.clip.id in people[found.name]
        }
        predict = partial(_predicted, found, matched, config)
        records = {id: one.matched for id, one in matched.items()}
        return found.name, _model(path, found, records, config), predict, config.fps_hz

    files = [file for one in beside for file in one.files]
    inputs = given.inputs() | {f"result_{n}": file for n, file in enumerate(dict.fromkeys(files))}
    return write_scores(out_dir, given.manifest_path, predictor, inputs, config, given.run)


def _model(
    path: Path, found: ResultSet, matched: Mapping[str, MatchedResult], config: ResultsConfig
) -> ScoredResults:
    return ScoredResults(
        kind="results",
        predictions=path.resolve().name,
        system=found.system,
        camera=config.camera if found.system in ("vibe", "phalp") else None,
        clips=dict(matched),
    )


def _matched(
    found: ResultSet,
    people: Mapping[str, Mapping[str, EstimatedPerson]],
    one: UsableClip,
    entry: ClipEntry,
    bodies: Sequence[BodyModel],
    given: _Given,
    config: ResultsConfig,
) -> MatchedClip:
    """A clip's prediction, on the frames that all results of the clip have where some may lack."""
    id, result = one.clip.id, found.results[one.clip.id]
    person = people[found.name][id]
    body = _body_of(person, one.clip, bodies)
    if result.system == "amass":
        return timed_clip(result, person, one.clip, body)
    images = _image_numbers(entry, given.manifest_path)
    frames = frames_of_rows(one.clip, images, config.first_image)
    common = np.ones(len(frames), dtype=bool)
    for of_set in people.values():
        if id in of_set and not of_set[id].has_own_rate:
            common &= has_rows(of_set[id], one.clip, frames, config.camera)
    return matched_clip(result, person, one.clip, frames, body, config.camera, common)


def _body_of(person: EstimatedPerson, clip: Clip, bodies: Sequence[BodyModel]) -> BodyModel:
    """The body that a result's shape is of; else the clip's own; else the first."""
    named = (body for body in bodies if body.name == person.betas_body)
    return next(named, None) or body_of(clip.motion, bodies) or bodies[0]


def _image_numbers(entry: ClipEntry, manifest_path: Path) -> list[int]:
    """Numbers of the images that the manifest lists for a clip; none without a listing."""
    if entry.images is None:
        return []
    listing = resolve_inside(manifest_path.parent, entry.images.listing.path)
    if not listing.is_file():
        return []
    found = (number_in_name(one.path) for one in read_listing(listing))
    return [number for number in found if number is not None]


def _predicted(
    found: ResultSet, matched: Mapping[str, MatchedClip], config: ResultsConfig, one: UsableClip
) -> PredictedClip | str:
    drop, protocol = config.missing == "drop", config.its_protocol()
    if one.clip.id not in matched:
        reason = f"no result of {found.name}"
        if one.clip.id in found.results:
            reason = f"nobody is left for it in {found.results[one.clip.id].files[0].name}"
        if drop:
            return reason
        raise BadMotionFile(
            f"clip {one.clip.id}: {reason}. Give one, or pass --missing drop to leave it out"
        )
    result = found.results[one.clip.id]
    predicted = clip_beside_truth(
        result.files[0],
        matched[one.clip.id].clip,
        one,
        config.fps_hz,
        protocol_fps_hz=protocol.fps_hz if protocol else None,
        smoothing_frames=protocol.smoothing_frames if protocol else 0.0,
        all_phases=config.all_phases,
        drop_missing=drop,
    )
    world = result.people[0].in_world
    if isinstance(predicted, str) or (world is not None and world.has_camera_path):
        return predicted
    # A person seen in both frames tells where the camera looks, but not where it is.
    return replace(predicted, camera_paths_m=None)
