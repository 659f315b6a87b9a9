"""Render a set of clips to a manifest."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from gmrdata.film.character import CHARACTER_FILE, load_character, residual_figures
from gmrdata.film.render import optional_outputs
from gmrdata.film.render_jobs import try_render_clips
from gmrdata.film.render_outputs import IN_FRAME, clearance_figures, whole_person_share
from gmrdata.film.set_plan import SyntheticRecipe, render_config
from gmrdata.film.set_takes import Selection, Take, plan_takes, select
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality
from gmrdata.manifest.entry import clip_entry, created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.cmu import fetch_command
from gmrdata.motion.library import file_source, gait_source, licence_of
from gmrdata.read.bodies import keep_body, read_body
from gmrdata.stage.jobs import raise_failures, record_failures, worker_pool
from gmrdata.stage.progress import console
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import MissingInput
from gmrdata.values.files import remove_orphans, write_text


def _how_to_get(missing: Sequence[str], motions_dir: Path | None) -> str:
    command = fetch_command(missing, motions_dir)
    return "" if command is None else f". To get what is missing:\n  {command}"


def render_set(
    recipe: SyntheticRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Render every clip whose motion is there, and list them in `out_dir/synthetic.yaml`.

    Beside the manifest stands `warnings.txt` where a clip deserves one.  A clip that can't be
    planned or rendered leaves its reason in `failed/<id>.txt` and the others go on; a manifest
    without some of its clips has "incomplete" in its version.

    Returns:
        Path of the manifest.

    Raises:
        MissingInput: not one clip of the recipe can be rendered.
        StageFailed: some clips failed; the others are done and the manifest lists them.
    """
    selection = select(recipe, motions_dir)
    require_takes(recipe, selection, motions_dir)
    out_dir = out_dir.resolve()
    failures_dir = out_dir / "failed"
    for folder in (out_dir, failures_dir, *out_dir.glob("listings/**/")):
        remove_orphans(folder)
    body_path = keep_body(recipe.body, out_dir / "body", run=run)
    reasons = _render(recipe, selection, out_dir, body_path, failures_dir, run)
    done = [take for take in selection.takes if take.id not in reasons]
    manifest_path = out_dir / "synthetic.yaml"
    if done:
        _list(recipe, done, out_dir, read_body(body_path), bool(reasons), run)
    raise_failures("synthetic set", reasons, len(selection.takes), failures_dir)
    return manifest_path


def require_takes(recipe: SyntheticRecipe, selection: Selection, motions_dir: Path | None) -> None:
    """Say which motions are missing.

    Raises:
        MissingInput: not one clip of the recipe has its motion.
    """
    if not selection.takes:
        raise MissingInput(
            f"recipe {recipe.name}: none of its trials found. Give their folder with --motions"
            + _how_to_get(selection.missing, motions_dir)
        )
    if selection.missing:
        console.print(
            f"no motion file for {', '.join(selection.missing)}: left out"
            + _how_to_get(selection.missing, motions_dir),
            markup=False,
            soft_wrap=True,
        )


def render_dir(out_dir: Path, clip_id: str) -> Path:
    """Stage folder of a rendered clip."""
    return out_dir / "render" / clip_id


def _render(
    recipe: SyntheticRecipe,
    selection: Selection,
    out_dir: Path,
    body_path: Path,
    failures_dir: Path,
    run: Run,
) -> Mapping[str, str]:
    """Plan and render; gives the reason of each clip that failed, by id."""
    planned = plan_takes(recipe, selection, body_path, out_dir / "plan", run=run)
    record_failures(failures_dir, planned.reasons, ())
    if not planned.paths:
        return planned.reasons
    with worker_pool(run, recipe.workers) as client:
        outcome = try_render_clips(
            planned.paths,
            body_path,
            out_dir / "render",
            {take.id: render_config(recipe, take.clip) for take in selection.takes},
            client,
            failures_dir,
            layouts=layouts_of(selection.takes, planned.paths),
            run=run,
        )
    return {**planned.reasons, **outcome.reasons}


def layouts_of(takes: Sequence[Take], paths: Mapping[str, Path]) -> dict[str, list[Path]]:
    """By id of a clip or its twin: the planned paths of both, which share one place (Table 6)."""
    sharing: dict[str, list[Path]] = {}
    for take in takes:
        if take.id in paths:
            sharing.setdefault(take.clip.id, []).append(paths[take.id])
    together = {take.id: sharing.get(take.clip.id, []) for take in takes}
    return {id: shared for id, shared in together.items() if len(shared) > 1}


def _list(
    recipe: SyntheticRecipe,
    takes: Sequence[Take],
    out_dir: Path,
    body: BodyModel,
    incomplete: bool,
    run: Run,
) -> None:
    """Write the manifest and the warnings of what was rendered."""
    entries = [_entry(out_dir, take, body, recipe) for take in takes]
    write_manifest(
        out_dir / "synthetic.yaml",
        name=recipe.name,
        version=_incomplete(recipe.version) if incomplete else recipe.version,
        kind="synthetic",
        description="Rendered clips with exact cameras and exact world motions.",
        licence=f"clips as stated by each; body: {body.licence}",
        clips=entries,
        created_by=created_by(
            recipe.model_dump(mode="json", exclude={"workers"}), {"render": recipe.seed}
        ),
        redo=run.redo or incomplete,
    )
    warnings = frame_warnings(entries, recipe.min_in_frame_share)
    for line in warnings.values():
        console.print(f"warning: {line}", style="yellow", markup=False)
    if warnings:
        write_text(out_dir / "warnings.txt", "".join(f"{line}\n" for line in warnings.values()))
    else:
        (out_dir / "warnings.txt").unlink(missing_ok=True)


def _incomplete(version: str) -> str:
    return f"{version}{'.' if '-' in version else '-'}incomplete"


def frame_warnings(entries: Sequence[ClipEntry], min_share: float) -> dict[str, str]:
    """One line for each clip that has the person out of frame too often, by id."""
    shares = {entry.id: (entry.quality or Quality()).figures[IN_FRAME] for entry in entries}
    return {
        id: f"clip {id}: the whole person is in {share:.0%} of the frames, less than "
        f"{min_share:.0%}; give its camera more distance_m, or leave distance_m out"
        for id, share in shares.items()
        if share < min_share
    }


def _entry(out_dir: Path, take: Take, body: BodyModel, recipe: SyntheticRecipe) -> ClipEntry:
    folder = render_dir(out_dir, take.id)
    clip = take.clip
    source = file_source(clip.trial) if clip.trial else gait_source(clip.gait or "")
    config = render_config(recipe, clip)
    licence = licence_of(source)
    if config.character is None:
        figures = {IN_FRAME: whole_person_share(load_clip(folder / "clip.npz"), body)}
    else:
        record = load_character(folder / CHARACTER_FILE)
        figures = {IN_FRAME: float(record.in_frame.mean())} | residual_figures(record)
        licence = f"{licence}; character: {config.character.licence}"
    return clip_entry(
        out_dir,
        id=take.id,
        clip_path=folder / "clip.npz",
        images_dir=folder / "frames",
        masks_dir=folder / "masks",
        **optional_outputs(folder, config),
        camera_motion=take.camera_motion,
        licence=licence,
        source=source,
        quality=Quality(geometry="exact", figures={**figures, **clearance_figures(folder)}),
        recipe=stage_recipe(folder),
    )
