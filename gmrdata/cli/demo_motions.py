"""The demo's motions: three to film and a set to train on, embedded or from files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.cli.demo_recipe import DemoClip, DemoPaths, DemoRecipe, Training
from gmrdata.film.shots import Film, film_motion, plan_clip
from gmrdata.motion.files import find_motions, input_files, read_motion
from gmrdata.motion.gait import embedded_motions, make_gait
from gmrdata.motion.resample import resample
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import track
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import MissingInput
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config

SHORTEST_S = 1.2  # a trial shorter than this has too few motions at 10 fps to say anything
WIDEST_M = 7.0  # the scene's free ground; a trial that walks further than this doesn't fit
LEAST_TRAVEL_M = 0.5  # a trial that stays in place would make a dull picture


class MotionsConfig(Config):
    """What decides the motions: parts of the recipe, and the files to film."""

    seed: int
    clips: tuple[DemoClip, ...]
    film: Film
    training: Training
    filmed: tuple[str, ...]
    """Names of the files, one for each clip; empty for the embedded gait."""


@dataclass(frozen=True)
class MotionFiles:
    """Motion files that a person gave: one for each clip to film, and the rest to train on."""

    filmed: tuple[Path, ...] = ()
    training: tuple[Path, ...] = ()


def choose_files(
    folder: Path, trials: tuple[str, ...], recipe: DemoRecipe, body: BodyModel
) -> MotionFiles:
    """Pick the files of a folder to film: `trials` (without suffix), or the first that fit."""
    files = find_motions(folder)
    n_clips = len(recipe.clips)
    named = {path.stem: path for path in reversed(files)}
    if unknown := set(trials) - named.keys():
        raise MissingInput(f"{folder}: no motion file named {min(unknown)} (.bvh, .amc or .npz)")
    if trials:
        filmed = tuple(named[trial] for trial in trials)
    else:
        fitting = (
            path for path in files if _fits(read_motion(path, body, ground=True), recipe.film)
        )
        filmed = tuple(path for path, _ in zip(fitting, range(n_clips), strict=False))
    if len(filmed) != n_clips:
        raise MissingInput(
            f"{folder}: the recipe films {n_clips} motions, but {len(filmed)} of {len(files)} "
            f"files were {'named' if trials else 'found to fit'}. Name {n_clips} with --trials"
        )
    others = tuple(path for path in files if path not in filmed)
    return MotionFiles(filmed, others[: recipe.training.max_files])


def _fits(motion: Motion, film: Film) -> bool:
    n_frames = min(motion.n_frames, round(film.duration_s * motion.fps_hz))
    path = motion.pelvis_m[:n_frames, :2]
    extent_m = float(np.ptp(path, axis=0).max())
    return n_frames >= SHORTEST_S * motion.fps_hz and LEAST_TRAVEL_M <= extent_m <= WIDEST_M


def make_motions(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles, *, run: Run) -> Path:
    """Stage: the planned clips (motion and camera) and the training clips; gives its folder."""
    config = MotionsConfig(
        seed=recipe.seed,
        clips=recipe.clips,
        film=recipe.film,
        training=recipe.training,
        filmed=tuple(path.name for path in files.filmed),
    )

    def work(out_dir: Path) -> None:
        body = read_body(paths.body)
        for index, spec in enumerate(recipe.clips):
            rng = np.random.default_rng([config.seed, index])
            if files.filmed:
                motion = read_motion(files.filmed[index], body, ground=True)
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
    for path in (*files.filmed, *files.training):
        inputs |= {f"file {file.name}": file for file in input_files(path).values()}
    return run_stage("motions", paths.motions_dir, config, inputs, work, run=run)


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
    motions = [(f"gait_{index:03d}", motion) for index, motion in enumerate(gaits)]
    for path in track(files.training, "reading training motions") if files.training else ():
        motion = read_motion(path, body, ground=True)
        if motion.n_frames / motion.fps_hz >= SHORTEST_S:
            motions.append((path.stem, resample(motion, training.fps_hz)))
    return [
        Clip(id, motion, np.ones(n := motion.n_frames, dtype=bool), np.full(n, -1), None)
        for id, motion in motions
    ]
