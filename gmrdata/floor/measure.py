"""A regenerated twin set against its truth."""

from collections.abc import Sequence
from pathlib import Path

from gmrdata.body.file import read_body
from gmrdata.body.keep import BODY_FILE
from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadBodyFile
from gmrdata.evaluate.floor_record import Floor
from gmrdata.evaluate.sequence_error import FPS_HZ, sequence_row
from gmrdata.floor.groups import by_class, group
from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import load_entry, read_manifest
from gmrdata.manifest.recipe import without_machine_paths
from gmrdata.masks.sources import masks_seconds
from gmrdata.progress import track
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.store import STAGE_FILE, read_json, stage_seconds
from gmrdata.threedpw.twin_truth import TwinTruth


def measure(
    twins: TwinTruth, regenerated_dir: Path, recipe: ThreedpwRecipe, *, seed: int | None = None
) -> Floor:
    """Figures of each sequence that `regenerate_set` has a verdict on, of each class, and of all.

    Args:
        twins: The truth.
        regenerated_dir: What `regenerate_set` made of the twins.
        recipe: Its recipe.
        seed: What the twins were drawn by.

    Raises:
        MissingInput: a sequence has no truth.
        BadBodyFile: a sequence's body is not among the recipe's.
    """
    paths = SetPaths(regenerated_dir.resolve())
    bodies = [read_body(paths.body_dir(n) / BODY_FILE) for n in range(len(recipe.bodies))]
    clips = _clips(paths.manifest)
    rows = []
    for verdict in track(read_json(paths.verdicts), "measuring"):
        name = verdict["sequence"]
        truth = twins.people(name)
        row = sequence_row(
            name,
            twins.classes[name],
            clips.get(name, []),
            truth,
            accepted=verdict["accepted"],
            seconds=_seconds(paths, name),
            body=_body_of(truth[0], bodies),
            class_measured=verdict["class"],
            scale=verdict["scale"],
            scale_sigma=verdict["scale_sigma"],
        )
        rows.append(row | {"reasons": verdict["reasons"]})
    return Floor(
        format="gmrdata-floor/1",
        fps_hz=FPS_HZ,
        seed=seed,
        recipe=without_machine_paths(recipe.model_dump(mode="json", exclude={"workers"})),
        sequences=tuple(rows),
        classes=by_class(rows),
        overall=group(rows),
    )


def _clips(manifest_path: Path) -> dict[str, list[Clip]]:
    """Each sequence's people, valid only where the manifest keeps a frame."""
    if not manifest_path.is_file():  # no sequence could be read
        return {}
    manifest = read_manifest(manifest_path)
    assert isinstance(manifest, Manifest)
    clips: dict[str, list[Clip]] = {}
    for entry in manifest.clips:
        assert entry.source.sequence is not None
        clips.setdefault(entry.source.sequence, []).append(load_entry(manifest_path, entry))
    return clips


def _seconds(paths: SetPaths, name: str) -> float:
    """Wall time of the stages that were finished [s]."""
    folder = paths.sequence_dir(name)
    total = masks_seconds(folder / "masks") if _is_done(folder / "masks") else 0.0
    stages = [folder / "people", folder / "sfm", folder / "pseudo_gt"]
    return total + sum(stage_seconds(stage) for stage in stages if _is_done(stage))


def _is_done(stage_dir: Path) -> bool:
    return (stage_dir / STAGE_FILE).is_file()


def _body_of(clip: Clip, bodies: Sequence[BodyModel]) -> BodyModel:
    for body in bodies:
        if body.name == clip.motion.body and clip.motion.shape.shape == (body.n_shape,):
            return body
    raise BadBodyFile(
        f"{clip.id}: of body {clip.motion.body}, which is not among the recipe's "
        f"({', '.join(body.name for body in bodies)}); name it in the recipe's `bodies`"
    )
