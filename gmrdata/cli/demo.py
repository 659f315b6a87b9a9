"""The demo from end to end: every stage in order, each of them done once."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gmrdata.cli.demo_recipe import FPS_HZ, DemoClip, DemoPaths, DemoRecipe, MotionsConfig
from gmrdata.film.programmes import Film, film_motion, plan_clip
from gmrdata.film.render import RenderJob, optional_outputs, render_clip
from gmrdata.film.render_set import render_clips
from gmrdata.manifest.current import ClipEntry, Quality, Source
from gmrdata.manifest.write import (
    ClipAbout,
    ClipFiles,
    ManifestHead,
    clip_entry,
    made_by,
    stage_recipe,
    write_manifest,
)
from gmrdata.motion.files import FileReading, input_files, read_file, require_motion
from gmrdata.motion.gait import embedded_motions, make_gait
from gmrdata.motion.library import LibraryFile, gait_source, library_files, licence_of
from gmrdata.motion.resample import resample, resample_valid
from gmrdata.read.bodies import keep_body, load_body
from gmrdata.read.body_file import read_body
from gmrdata.read.source_motion import DEFAULT_READING
from gmrdata.solve.request import SequenceConfig
from gmrdata.solve.solve import solve_sequence
from gmrdata.stage.jobs import Job, run_jobs
from gmrdata.stage.progress import console, remark, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import NotMade, run_stage
from gmrdata.stage.workers import Pool, worker_pool
from gmrdata.values import plain_yaml
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, GmrdataError, MissingInput
from gmrdata.values.files import write_text
from gmrdata.values.people import PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.judge import load_record, quality_record

if TYPE_CHECKING:
    from gmrdata.score.score import Scored

DONE, TO_DO = "done", "to do"
SHORTEST_S = 1.2  # a trial shorter than this has too few motions at FPS_HZ to say anything
WIDEST_M = 7.0  # the scene's free ground; a trial that walks further than this doesn't fit
LEAST_TRAVEL_M = 0.5  # a trial that stays in place would make a dull picture


@dataclass(frozen=True)
class MotionFiles:
    """Motion files that a person gave: one for each clip to film, and the rest to train on."""

    filmed: tuple[LibraryFile, ...] = ()
    training: tuple[LibraryFile, ...] = ()


def run_demo(
    recipe: DemoRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    trials: tuple[str, ...] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Run every stage that isn't done, to the report, whose path it gives.

    The embedded gait is filmed where `motions_dir` is None, of its files else those named by
    `trials`, or the first that fit.
    """
    paths = DemoPaths(out_dir.resolve())
    _step(1, "body")
    keep_body(recipe.body, paths.body_dir, run=run)
    _step(2, "motions")
    files = choose_files(motions_dir, trials, recipe, load_body(paths.body))
    make_motions(paths, recipe, files, run=run)
    with worker_pool(run, recipe.workers) as pool:
        _step(3, "render")
        _render(paths, recipe, pool, run)
        _step(4, "masks, cameras, scale, world motion")
        _regenerate(paths, recipe, pool, run)
    _step(5, "manifests")
    write_manifests(paths, recipe, files)
    _step(6, "train GMR")
    _train(paths, recipe, run=run)
    _step(7, "score GMR")
    from gmrdata.pages.scores import write_scores_page

    for manifest in (paths.synthetic_manifest, paths.pseudo_gt_manifest):
        write_scores_page(*_score(paths, manifest, run=run).scores)
    _step(8, "report")
    write_text(paths.recipe, plain_yaml.dump(recipe.model_dump(mode="json")))
    from gmrdata.cli.demo_figures import show

    return show(paths, recipe)


def _train(paths: DemoPaths, recipe: DemoRecipe, *, run: Run) -> None:
    # Here, since it takes seconds to load, which the workers of the steps before do without.
    from gmrdata.gmr.train import train

    train([paths.training_manifest], paths.gmr_dir, recipe.gmr, body_path=paths.body, run=run)


def _score(paths: DemoPaths, manifest: Path, *, run: Run) -> "Scored":
    from gmrdata.score.score import score

    scores_dir = paths.scores_dir(manifest.stem)
    return score(paths.gmr_dir, manifest, scores_dir, body_path=paths.body, run=run)


def plan(
    recipe: DemoRecipe, out_dir: Path, motions_dir: Path | None, trials: tuple[str, ...], redo: bool
) -> list[tuple[str, str]]:
    """What a run would do: (stage, "done", "to do" or why it is refused), without doing it."""
    paths, look = DemoPaths(out_dir.resolve()), Run(anew=redo, only_look=True)
    files = choose_files(motions_dir, trials, recipe, load_body(recipe.body))
    states: dict[str, str] = {}

    def look_at(name: str, after: Iterable[str], make: Callable[..., object], *given: Any) -> None:
        """What a run finds of a stage, whose inputs are made `after` others."""
        states[name] = TO_DO
        if any(states[one] != DONE for one in after):
            return
        try:
            make(*given, run=look)
            states[name] = DONE
        except (NotMade, MissingInput):  # a manifest is written first
            pass
        except GmrdataError as error:
            states[name] = str(error)

    look_at("body", (), keep_body, recipe.body, paths.body_dir)
    look_at("motions", ("body",), make_motions, paths, recipe, files)
    for id, clip in ((clip.id, paths.clip(clip.id)) for clip in recipe.clips):
        filmed = clip.planned, paths.body, clip.render_dir, recipe.render
        look_at(f"render {id}", ("motions",), render_clip, *filmed)
        solved = f"masks, cameras, world motion {id}"
        look_at(solved, (f"render {id}",), regenerate, paths.root, id, recipe.sequence)
    look_at("train GMR", ("motions",), _train, paths, recipe)
    for manifest in (paths.synthetic_manifest, paths.pseudo_gt_manifest):
        look_at(f"score on {manifest.stem}", [*states], _score, paths, manifest)
    return list(states.items())


def _step(number: int, what: str) -> None:
    console.rule(f"[bold]{number}/8[/bold] {what}", align="left")


def choose_files(
    folder: Path | None, trials: tuple[str, ...], recipe: DemoRecipe, body: BodyModel
) -> MotionFiles:
    """Pick the files of a folder to film: `trials`, or the first that fit; of no folder none."""
    if folder is None:
        return MotionFiles()
    files = library_files((folder,))
    n_clips = len(recipe.clips)
    if trials:
        filmed = tuple(_named(trial, files, folder) for trial in trials)
    else:
        read = ((file, _readable(file, body)) for file in files)
        fitting = (file for file, reading in read if reading and _fits(reading, recipe.film))
        filmed = tuple(islice(fitting, n_clips))
    if len(filmed) != n_clips:
        counts = f"the recipe films {n_clips} motions, but {len(filmed)} of {len(files)} files were"
        least = f"at least {_shortest_s(recipe.film):g} s, {_slowest_hz(recipe.film):g} Hz"
        fit = f"found to fit: {least} and {LEAST_TRAVEL_M:g} m, at most {WIDEST_M:g} m"
        how = "named" if trials else fit
        raise MissingInput(f"{folder}: {counts} {how}. Name {n_clips} with --trials")
    remark("  filming " + ", ".join(file.id for file in filmed))
    others = tuple(file for file in files if file not in filmed)
    return MotionFiles(filmed, others[: recipe.training.max_files])


def _named(trial: str, files: Sequence[LibraryFile], folder: Path) -> LibraryFile:
    """The file of a clip's id, which tells namesakes apart, or of a name without suffix."""
    matches = [file for file in files if file.id == trial]
    if not (matches := matches or [file for file in files if file.path.stem == trial]):
        raise MissingInput(f"{folder}: no motion file named {trial} (.bvh, .amc or .npz)")
    if len(matches) > 1:
        ids = ", ".join(file.id for file in matches)
        raise BadRecipe(f"--trials {trial}: {folder} has several. Name one of {ids}")
    return matches[0]


def _readable(file: LibraryFile, body: BodyModel) -> FileReading | None:
    """The motion of a file that nobody asked for by name; None if it can't be read, and says so."""
    try:
        return read_file(file.path, body, DEFAULT_READING, ground=True)
    except GmrdataError as error:
        remark(f"left out: {error}")
        return None


def _fits(reading: FileReading, film: Film) -> bool:
    motion = reading.motion
    n_frames = min(motion.n_frames, round(film.duration_s * motion.fps_hz))
    if not reading.valid[:n_frames].all() or motion.fps_hz < _slowest_hz(film):
        return False
    extent_m = float(np.ptp(motion.pelvis_m[:n_frames, :2], axis=0).max())
    is_long = n_frames >= round(_shortest_s(film) * motion.fps_hz)
    return is_long and LEAST_TRAVEL_M <= extent_m <= WIDEST_M


def _shortest_s(film: Film) -> float:
    return min(SHORTEST_S, film.duration_s)


def _slowest_hz(film: Film) -> float:
    return film.fps_hz or FPS_HZ


def make_motions(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles, *, run: Run) -> Path:
    """Stage: the planned clips (motion and camera) and the training clips; gives its folder."""
    config = MotionsConfig(
        seed=recipe.seed,
        clips=recipe.clips,
        film=recipe.film,
        training=recipe.training,
        filmed=tuple(file.path.name for file in files.filmed),
    )

    def work(out_dir: Path) -> None:
        body = read_body(paths.body)
        for index, spec in enumerate(recipe.clips):
            rng = np.random.default_rng([config.seed, index])
            if files.filmed:
                path = files.filmed[index].path
                reading = read_file(path, body, DEFAULT_READING, ground=True)
                require_motion(reading, path, 0.0, config.film.duration_s)
                motion = reading.motion
                if motion.fps_hz < FPS_HZ:  # no report could be written of it
                    what = f"{motion.fps_hz:g} Hz, and errors are measured at {FPS_HZ:g}"
                    raise BadMotionFile(f"{path}: {what}. Film a motion of that rate or more")
            else:
                motion = make_gait(spec.gait, config.film.duration_s, 30.0, body, rng)
            filmed = film_motion(motion, config.film)
            clip = plan_clip(spec.id, filmed, spec.programme, config.film, rng)
            target = out_dir / paths.clip(spec.id).planned.relative_to(paths.motions_dir)
            save_clip(target, clip, body.rest_pelvis_m(filmed.shape))
        for clip in _training_clips(config, files, body):
            target = out_dir / paths.training_dir.name / f"{clip.id}.npz"
            save_clip(target, clip, body.rest_pelvis_m(clip.motion.shape))

    inputs = {"body": paths.body}
    for file in (*files.filmed, *files.training):
        inputs |= {f"file {file.id}{one.suffix}": one for one in _inputs(file)}
    return run_stage("motions", paths.motions_dir, config, inputs, work, run=run)


def _inputs(file: LibraryFile) -> tuple[Path, ...]:
    """A file and its skeleton; without one it is left out, or refused, when it is read."""
    try:
        return tuple(input_files(file.path).values())
    except MissingInput:
        return (file.path,)


def _training_clips(config: MotionsConfig, files: MotionFiles, body: BodyModel) -> list[Clip]:
    """Embedded gait and, where files were given, those that are not filmed."""
    training = config.training
    rng = np.random.default_rng([config.seed, len(config.clips)])
    gaits = embedded_motions(
        body,
        rng,
        count=training.gait_count,
        fps_hz=training.fps_hz,
        duration_s=training.gait_duration_s,
    )
    motions = [
        (f"gait_{index:03d}", motion, np.ones(motion.n_frames, dtype=bool))
        for index, motion in enumerate(gaits)
    ]
    for file in track(files.training, "reading training motions") if files.training else ():
        if (reading := _readable(file, body)) is None:
            continue
        fps_hz, seconds = reading.motion.fps_hz, reading.valid.sum() / reading.motion.fps_hz
        if fps_hz < FPS_HZ or seconds < SHORTEST_S:
            what = f"{seconds:.3g} s at {fps_hz:.3g} Hz are too little to train on"
            remark(f"left out: {file.path}: {what}")
            continue
        valid = resample_valid(reading.valid, fps_hz, training.fps_hz)
        motions.append((file.id, resample(reading.motion, training.fps_hz), valid))
    return [Clip(id, motion, ok, np.full(len(ok), -1), None) for id, motion, ok in motions]


def _render(paths: DemoPaths, recipe: DemoRecipe, pool: Pool, run: Run) -> None:
    job = partial(RenderJob, body_path=paths.body, config=recipe.render)
    clips = {clip.id: paths.clip(clip.id) for clip in recipe.clips}
    jobs = {id: job(clip_path=one.planned, out_dir=one.render_dir) for id, one in clips.items()}
    render_clips(jobs, pool, paths.failures_dir, run=run)


def _regenerate(paths: DemoPaths, recipe: DemoRecipe, pool: Pool, run: Run) -> None:
    ids = [clip.id for clip in recipe.clips]
    shared = {"root": paths.root, "config": recipe.sequence, "run": run}
    stage_dirs = [
        folder
        for clip in map(paths.clip, ids)
        for folder in (clip.sequence_dir, clip.masks_dir, clip.sfm_dir, clip.pseudo_gt_dir)
    ]
    run_jobs(
        "regenerating world poses",
        [Job(id, regenerate, {"clip_id": id} | shared) for id in ids],
        pool,
        paths.failures_dir,
        (len(stage_dirs), lambda: sum(folder.is_dir() for folder in stage_dirs)),
    )


def regenerate(root: Path, clip_id: str, config: SequenceConfig, *, run: Run) -> Path:
    """Frames, intrinsics and camera-frame body of one clip to the folder of its world motion."""
    paths = DemoPaths(root)
    clip = paths.clip(clip_id)
    _remove_truth(paths, clip_id, run)
    people = (PersonFiles(clip.seen, paths.body),)
    return solve_sequence(clip.frames_dir, people, clip.regenerated_dir, config, run=run)


def _remove_truth(paths: DemoPaths, clip_id: str, run: Run) -> None:
    """Keep only what 3DPW gives: local poses, the root in the camera's frame, and K."""
    clip = paths.clip(clip_id)

    def work(out_dir: Path) -> None:
        true = load_clip(clip.true)
        camera = camera_of(true)
        unknown = replace(
            camera,
            world_from_cam=np.full_like(camera.world_from_cam, np.nan),
            has_camera=np.zeros_like(camera.has_camera),
        )
        motion = motion_in_camera(true.motion, camera.world_from_cam)
        seen = replace(true, id=clip_id, motion=motion, camera=unknown)
        rest_pelvis_m = read_body(paths.body).rest_pelvis_m(motion.shape)
        save_clip(out_dir / clip.seen.name, seen, rest_pelvis_m)

    inputs = {"clip": clip.true, "body": paths.body}
    run_stage("sequence", clip.sequence_dir, Config(), inputs, work, run=run)


def write_manifests(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles) -> None:
    """Write the three manifests; the same clips give the same bytes."""
    by = made_by(recipe, {"demo": recipe.seed})
    licence = f"clips as stated by each; body: {read_body(paths.body).licence}"

    def write(path: Path, kind: str, description: str, clips: Sequence[ClipEntry]) -> None:
        about = {"description": description, "kind": kind, "licence": licence, "version": "1.0.0"}
        name = f"demo-{path.stem.replace('_', '-')}"
        write_manifest(path, ManifestHead(name=name, **about), clips, created_by=by, redo=True)

    text = "Motions that the demo's GMR is trained on."
    write(paths.training_manifest, "motions", text, training_entries(paths, files))
    filmed = [
        (clip, files.filmed[index].source if files.filmed else gait_source(clip.gait))
        for index, clip in enumerate(recipe.clips)
    ]
    text = "Rendered clips with exact cameras and exact world motions."
    rendered = [_true_entry(paths, recipe, clip, source) for clip, source in filmed]
    write(paths.synthetic_manifest, "synthetic", text, rendered)
    text = (
        "The same clips, their world motions regenerated from frames, intrinsics and camera-frame "
        "bodies."
    )
    regenerated = [_pseudo_entry(paths, clip, source) for clip, source in filmed]
    write(paths.pseudo_gt_manifest, "pseudo_gt", text, regenerated)


def training_entries(paths: DemoPaths, files: MotionFiles) -> list[ClipEntry]:
    """The training clips, each with the source of its file and what that allows."""
    given, entries = {file.id: file.source for file in files.training}, []
    for path in sorted(paths.training_dir.glob("*.npz")):
        source = given.get(path.stem) or gait_source(path.stem)
        about = ClipAbout(camera_motion="none", licence=licence_of(source), source=source)
        entries.append(clip_entry(paths.root, ClipFiles(path), about))
    return entries


def _true_entry(paths: DemoPaths, recipe: DemoRecipe, clip: DemoClip, source: Source) -> ClipEntry:
    files = paths.clip(clip.id)
    made_dir = files.render_dir
    others = optional_outputs(made_dir, recipe.render)
    listed = ClipFiles(files.true, images=files.frames_dir, masks=made_dir / "masks", **others)
    about = ClipAbout(
        id=clip.id,
        camera_motion=clip.programme.kind,
        licence=licence_of(source),
        source=source,
        quality=Quality(geometry="exact"),
        recipe=stage_recipe(made_dir),
    )
    return clip_entry(paths.root, listed, about)


def _pseudo_entry(paths: DemoPaths, clip: DemoClip, source: Source) -> ClipEntry:
    files = paths.clip(clip.id)
    record = load_record(files.pseudo_gt_dir)
    listed = ClipFiles(files.pseudo, images=files.frames_dir, masks=files.masks_dir)
    about = ClipAbout(
        id=clip.id,
        camera_motion=record.camera_motion,
        licence=licence_of(source),
        source=source,
        dropped_reason=record.people[0].row_reasons,
        quality=quality_record(record, 0),
        recipe=stage_recipe(files.pseudo_gt_dir),
    )
    return clip_entry(paths.root, listed, about)
