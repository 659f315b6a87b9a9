"""Twins made, regenerated, and measured against their truth: `floor.json`."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import load_entry, read_manifest
from gmrdata.manifest.write import without_machine_paths
from gmrdata.people.sources import masks_seconds
from gmrdata.read.bodies import BODY_FILE
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import track
from gmrdata.stage.recipes import read_recipe
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import stage_seconds
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import Verdicts, regenerate_set
from gmrdata.twins.floor_record import Floor, FloorGroup, PersonErrors, SequenceErrors
from gmrdata.twins.pseudo_gt_error import FPS_HZ, RecoveredSequence, sequence_errors
from gmrdata.twins.twin_set import TwinRecipe, TwinTruth, make_twins, read_truth
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadBodyFile, NothingMade, StageFailed
from gmrdata.values.files import STAGE_FILE

TWINS_FOLDER, REGENERATED_FOLDER, FLOOR_FILE = "twins", "regenerated", "floor.json"


class MadeFloor(NamedTuple):
    """`floor.json`, and what could not be rendered or read; the others are measured."""

    path: Path
    failed: StageFailed | None


def measure_floor(
    twins_dir: str | Path,
    out_dir: str | Path,
    recipe: ThreedpwRecipe | str | Path = "threedpw",
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Regenerate rendered twins of 3DPW and measure them against their truth; gives `floor.json`.

    StageFailed, once the others are measured, where some sequences failed.
    """
    loaded = read_recipe(recipe, ThreedpwRecipe)
    made = floor_of_twins(Path(twins_dir), loaded, Path(out_dir), run=run)
    if made.failed is not None:
        raise made.failed
    return made.path


def sampled_floor(
    sampled: TwinRecipe,
    motions_dir: Path,
    recipe: ThreedpwRecipe,
    out_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> MadeFloor:
    """Render twins to `out_dir/twins`, then as `floor_of_twins`; NothingMade without any twin."""
    twins_dir = out_dir / TWINS_FOLDER
    failed = _what_failed(lambda: make_twins(sampled, twins_dir, motions_dir=motions_dir, run=run))
    made = floor_of_twins(twins_dir, recipe, out_dir, seed=sampled.set.seed, run=run)
    return made._replace(failed=failed or made.failed)


def floor_of_twins(
    twins_dir: Path,
    recipe: ThreedpwRecipe,
    out_dir: Path,
    *,
    seed: int | None = None,
    run: Run = DEFAULT_RUN,
) -> MadeFloor:
    """Regenerate twins to `out_dir/regenerated` and measure them; a run that was stopped goes on.
    In `out_dir/floor.json` sequences that failed are listed as rejected.  Where all did,
    NothingMade is raised, and an earlier one stays."""
    twins = read_truth(twins_dir)
    names = recipe.sequences or tuple(sorted(twins.classes))
    for name in names:
        twins.people(name)
    recipe = recipe.model_copy(update={"sequences": names})
    regenerated_dir = out_dir / REGENERATED_FOLDER
    failed = _what_failed(lambda: regenerate_set(recipe, twins.root, regenerated_dir, run=run))
    floor = measure(twins, regenerated_dir, recipe, seed=seed)
    floor.write(out_dir / FLOOR_FILE)
    return MadeFloor(out_dir / FLOOR_FILE, failed)


def _what_failed(make: Callable[[], Path]) -> StageFailed | None:
    """Why a part of a set could not be made; NothingMade is raised where nothing could."""
    try:
        make()
    except NothingMade:
        raise
    except StageFailed as error:
        return error
    return None


def measure(
    twins: TwinTruth, regenerated_dir: Path, recipe: ThreedpwRecipe, *, seed: int | None = None
) -> Floor:
    """Figures of each twin that `regenerate_set` gave a verdict, of each class, and of all."""
    paths = SetPaths(regenerated_dir.resolve())
    bodies = [read_body(paths.body_dir(n) / BODY_FILE) for n in range(len(recipe.bodies))]
    # An earlier run's manifest may still hold those that failed now.
    failed = {path.stem for path in paths.failures_dir.glob("*.txt")}
    clips = {name: of for name, of in _clips(paths.manifest).items() if name not in failed}
    sequences = []
    for verdict in track(Verdicts.read(paths.verdicts).sequences, "measuring"):
        name = verdict.sequence
        if name not in twins.classes:  # of an earlier run, and gone since
            continue
        truth = twins.people(name)
        recovered = RecoveredSequence(
            id=name,
            class_true=twins.classes[name],
            accepted=verdict.accepted,
            seconds=_seconds(paths.sequence_dir(name)),
            class_measured=verdict.camera_motion,
            scale=verdict.scale,
            scale_sigma=verdict.scale_sigma,
            reasons=verdict.reasons,
        )
        body = _body_of(truth[0], bodies)
        sequences.append(sequence_errors(recovered, clips.get(name, []), truth, body))
    return Floor(
        fps_hz=FPS_HZ,
        seed=seed,
        recipe=without_machine_paths(recipe.model_dump(mode="json", exclude={"workers"})),
        sequences=tuple(sequences),
        classes=by_class(sequences),
        overall=group(sequences),
    )


def by_class(sequences: Sequence[SequenceErrors]) -> dict[str, FloorGroup]:
    """A group for each true class, in alphabetical order."""
    names = sorted({one.class_true for one in sequences})
    return {name: group([one for one in sequences if one.class_true == name]) for name in names}


def group(sequences: Sequence[SequenceErrors]) -> FloorGroup:
    """Figures of at least one sequence."""
    accepted = [one for one in sequences if one.accepted]
    people = [person for one in accepted for person in one.people]
    scale_errors = [e for one in accepted if (e := one.scale_error_percent) is not None]
    seen = sum(one.frames * len(one.people) for one in sequences)
    kept = sum(person.kept_frames for one in sequences for person in one.people)
    return FloorGroup(
        sequences=len(sequences),
        accepted=len(accepted),
        class_right=sum(one.class_measured == one.class_true for one in sequences),
        n_motions=sum(person.n_motions for person in people),
        **{key: _over_motions(people, key) for key in ("ome_deg", "tme_mm", "vme_mm")},
        camera_rotation_deg=_mean(one.camera_rotation_deg for one in accepted),
        camera_path_mm=_mean(one.camera_path_mm for one in accepted),
        abs_scale_error_percent=_mean(abs(error) for error in scale_errors),
        scale_stated=len(scale_errors),
        scale_within_2sigma=sum(one.scale_within_2sigma is True for one in accepted),
        kept_share=kept / seen,
        seconds_per_frame=sum(one.seconds for one in sequences)
        / sum(one.frames for one in sequences),
    )


def _over_motions(people: Sequence[PersonErrors], key: str) -> float | None:
    """Mean over all motions of all people, from each one's mean."""
    known = [(e, one.n_motions) for one in people if (e := getattr(one, key)) is not None]
    n_motions = sum(n for _, n in known)
    return sum(error * n for error, n in known) / n_motions if n_motions else None


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


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


def _seconds(folder: Path) -> float:
    """Wall time of the stages of a sequence that were finished [s]."""
    masks, *stages = (folder / name for name in ("masks", "people", "sfm", "lines", "pseudo_gt"))
    total = masks_seconds(masks) if (masks / STAGE_FILE).is_file() else 0.0
    return total + sum(stage_seconds(one) for one in stages if (one / STAGE_FILE).is_file())


def _body_of(clip: Clip, bodies: Sequence[BodyModel]) -> BodyModel:
    for body in bodies:
        if body.name == clip.motion.body and clip.motion.shape.shape == (body.n_shape,):
            return body
    names = ", ".join(body.name for body in bodies)
    known = f"which is not among the recipe's ({names}); name it in the recipe's `bodies`"
    raise BadBodyFile(f"{clip.id}: of body {clip.motion.body}, {known}")
