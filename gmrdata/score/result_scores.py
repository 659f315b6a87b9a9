"""Results of other systems as something to score: which person of them each clip is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gmrdata.gmr.runs import UsableClip, usable_clips, usable_files
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.listing import read_listing
from gmrdata.read.bodies import load_bodies
from gmrdata.read.frames import number_in_name
from gmrdata.score.predictions import PredictedClip, clip_beside_truth
from gmrdata.score.predictors import Predictor, ScoreConfig, Source
from gmrdata.score.records import ScoredResults
from gmrdata.score.result_files import ClipFiles, ClipName, ResultSet
from gmrdata.score.results import (
    MatchedClip,
    RowsOfVideo,
    frames_of_rows,
    has_rows,
    matched_clip,
    people_of_clips,
    timed_clip,
)
from gmrdata.values.body import BodyModel, body_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.files import resolve_inside
from gmrdata.values.people import EstimatedPerson


def clip_names(manifest_path: Path) -> list[ClipName]:
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


def check_people(
    config: ScoreConfig, names: Sequence[ClipName], sets: Sequence[ResultSet | ClipFiles]
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

    def source(self, one: ResultSet) -> Source:
        """One of them.

        With `missing` "drop" all are scored on the frames that each of them has.
        """
        beside = self.sets if self.config.missing == "drop" else [one]
        people = {
            other.name: people_of_clips(other, self.names, self.config.person) for other in beside
        }
        files = dict.fromkeys(file for other in beside for file in other.files)
        inputs = {f"result_{n}": file for n, file in enumerate(files)}
        return Source(one.name, inputs, lambda: self._opened(one, people))

    def _opened(
        self, one: ResultSet, people: Mapping[str, Mapping[str, EstimatedPerson]]
    ) -> Predictor:
        usable, config = usable_clips(self.manifest_path), self.config
        entries = {entry.id: entry for entry in usable.manifest.clips}
        bodies = load_bodies("anny" if self.body_path is None else str(self.body_path))
        matched = {
            clip.clip.id: self._matched(one, people, clip, entries[clip.clip.id], bodies)
            for clip in usable.clips
            if clip.clip.id in people[one.name]
        }
        model = ScoredResults(
            kind="results",
            predictions=self.path.resolve().name,
            system=one.system,
            camera=config.camera if one.system in ("vibe", "phalp") else None,
            clips={id: found.matched for id, found in matched.items()},
        )
        return Predictor(
            one.name, model, config.fps_hz, lambda clip: _predicted(one, matched, config, clip)
        )

    def _matched(
        self,
        one: ResultSet,
        people: Mapping[str, Mapping[str, EstimatedPerson]],
        clip: UsableClip,
        entry: ClipEntry,
        bodies: Sequence[BodyModel],
    ) -> MatchedClip:
        """A clip's prediction, on the frames that all results of it have where some may lack."""
        id, true, seen_as = clip.clip.id, clip.clip, self.config.camera
        result, person = one.results[id], people[one.name][id]
        body = _body_of(person, true, bodies)
        if result.system == "amass":
            return timed_clip(result, person, true, body)
        images = _image_numbers(entry, self.manifest_path)
        frames = frames_of_rows(true, images, self.config.first_image)
        common = np.ones(len(frames), dtype=bool)
        for of_set in people.values():
            if id in of_set and not of_set[id].has_own_rate:
                common &= has_rows(of_set[id], true, frames, seen_as)
        rows = RowsOfVideo(frames, common)
        return matched_clip(result, person, true, body, seen_as, rows)


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
    found: ResultSet, matched: Mapping[str, MatchedClip], config: ScoreConfig, one: UsableClip
) -> PredictedClip | str:
    if one.clip.id not in matched:
        reason = f"no result of {found.name}"
        if one.clip.id in found.results:
            reason = f"nobody is left for it in {found.results[one.clip.id].files[0].name}"
        if config.missing == "drop":
            return reason
        raise BadMotionFile(
            f"clip {one.clip.id}: {reason}. Give one, or pass --missing drop to leave it out"
        )
    result = found.results[one.clip.id]
    its_clip = matched[one.clip.id].clip
    predicted = clip_beside_truth(result.files[0], its_clip, one, config.pairing())
    world = result.people[0].in_world
    if isinstance(predicted, str) or (world is not None and world.has_camera_path):
        return predicted
    # A person seen in both frames tells where the camera looks, but not where it is.
    return replace(predicted, camera_paths_m=None)
