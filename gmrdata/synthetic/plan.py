"""One clip before it is rendered: its person, its motion, cut and centred, and its camera."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.body.file import read_body
from gmrdata.body.model import BodyModel
from gmrdata.body.people import draw_person
from gmrdata.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.config import Config
from gmrdata.film import Film, film_motion, plan_clip
from gmrdata.geometry.static_twin import static_twin
from gmrdata.motion.gait import make_gait
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import input_files, read_motion
from gmrdata.store import run_stage
from gmrdata.synthetic.draw import clip_rng
from gmrdata.synthetic.recipe import PeopleConfig, SyntheticClip, SyntheticRecipe

PLANNED_FILE = "clip.npz"


class PlanConfig(Config):
    """What decides one planned clip."""

    seed: int
    """Seed of the person, the gait and the camera."""
    clip: SyntheticClip
    """The clip."""
    film: Film
    """What the set's clips share."""
    people: PeopleConfig
    """Who is filmed."""


def make_plan(
    clip: SyntheticClip,
    recipe: SyntheticRecipe,
    motion_path: Path | None,
    body_path: Path,
    out_dir: Path,
    *,
    redo: bool = False,
) -> Path:
    """Stage: the planned clip.

    Args:
        clip: The clip; its random choices hang on the set's seed and its id alone.
        recipe: The recipe.
        motion_path: The motion file; None for an embedded gait.
        body_path: The set's body.
        out_dir: The stage's folder.
        redo: Make anew what another recipe made.

    Returns:
        Path of the clip file.
    """

    def work(partial_dir: Path) -> None:
        body = read_body(body_path)
        planned = planned_clip(clip, recipe, motion_path, body)
        save_clip(partial_dir / PLANNED_FILE, planned, body.rest_pelvis_m(planned.motion.shape))

    # The place doesn't matter to the plan: another one must not make it stale.
    config = PlanConfig(
        seed=recipe.seed,
        clip=clip.model_copy(update={"scene": None}),
        film=_film(clip, recipe),
        people=recipe.people,
    )
    inputs = {"body": body_path}
    if motion_path is not None:
        inputs |= input_files(motion_path)
    return run_stage("plan", out_dir, config, inputs, work, redo=redo) / PLANNED_FILE


def planned_clip(
    clip: SyntheticClip, recipe: SyntheticRecipe, motion_path: Path | None, body: BodyModel
) -> Clip:
    """A clip's motion and camera; arguments as for `make_plan`.

    Raises:
        BadMotionFile: the motion can't be read, or is too short.
        BadRecipe: no distance keeps the person in frame, or the body has no such shape.
    """
    film = _film(clip, recipe)
    shape = _shape(clip, recipe, body)
    rng = clip_rng(recipe.seed, clip.id, "motion")
    motion = film_motion(_motion(clip, film, motion_path, body, shape, rng), film)
    return plan_clip(clip.id, motion, clip.programme, film, rng)


class TwinConfig(Config):
    """What decides a planned twin beside the clip that it is the twin of."""

    id: str
    """The twin's id."""


def make_twin(
    twin_id: str,
    planned_path: Path,
    body_path: Path,
    out_dir: Path,
    *,
    redo: bool = False,
) -> Path:
    """Stage: a planned clip once more, with the motion of its camera off.

    Args:
        twin_id: The twin's id.
        planned_path: The planned clip.
        body_path: The set's body.
        out_dir: The stage's folder.
        redo: Make anew what another recipe made.

    Returns:
        Path of the clip file.

    Raises:
        BadRecipe: no static camera keeps the subject in frame.
    """

    def work(partial_dir: Path) -> None:
        clip = load_clip(planned_path)
        camera = static_twin(camera_of(clip), clip.motion.pelvis_m)
        rest_pelvis_m = read_body(body_path).rest_pelvis_m(clip.motion.shape)
        save_clip(
            partial_dir / PLANNED_FILE, replace(clip, id=twin_id, camera=camera), rest_pelvis_m
        )

    inputs = {"clip": planned_path, "body": body_path}
    config = TwinConfig(id=twin_id)
    return run_stage("twin", out_dir, config, inputs, work, redo=redo) / PLANNED_FILE


def _film(clip: SyntheticClip, recipe: SyntheticRecipe) -> Film:
    if clip.duration_s is None:
        return recipe.film
    return recipe.film.model_copy(update={"duration_s": clip.duration_s})


def _motion(
    clip: SyntheticClip,
    film: Film,
    motion_path: Path | None,
    body: BodyModel,
    shape: np.ndarray | None,
    rng: np.random.Generator,
) -> Motion:
    if motion_path is not None:
        return read_motion(motion_path, body, shape=shape)
    return make_gait(clip.gait or "", film.duration_s, 30.0, body, rng, shape=shape)


def _shape(clip: SyntheticClip, recipe: SyntheticRecipe, body: BodyModel) -> np.ndarray | None:
    """The person's shape (S,); None: as the motion has it."""
    if clip.shape is not None:
        return np.array(clip.shape)
    if not recipe.people.vary:
        return None
    return draw_person(body, clip_rng(recipe.seed, clip.id, "person"), recipe.people.spread)
