"""One clip before it is rendered: its motion, cut and centred, and its camera."""

from pathlib import Path

import numpy as np

from gmrdata.body.file import read_body
from gmrdata.body.model import BodyModel
from gmrdata.clip import save_clip
from gmrdata.config import Config
from gmrdata.film import Film, film_motion, plan_clip
from gmrdata.motion.gait import make_gait
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import input_files, read_motion
from gmrdata.store import run_stage
from gmrdata.synthetic.recipe import SyntheticClip, SyntheticRecipe

PLANNED_FILE = "clip.npz"


class PlanConfig(Config):
    """What decides one planned clip."""

    seed: int
    """Seed of the gait and of the camera."""
    clip: SyntheticClip
    """The clip."""
    film: Film
    """What the set's clips share."""


def make_plan(
    clip: SyntheticClip,
    index: int,
    recipe: SyntheticRecipe,
    motion_path: Path | None,
    body_path: Path,
    out_dir: Path,
    *,
    redo: bool = False,
) -> Path:
    """Stage: the planned clip.

    Args:
        clip: The clip.
        index: Its place in the recipe, which makes its random choices its own.
        recipe: The recipe.
        motion_path: The motion file; None for an embedded gait.
        body_path: The set's body.
        out_dir: The stage's folder.
        redo: Make anew what another recipe made.

    Returns:
        Path of the clip file.
    """
    film = recipe.film
    if clip.duration_s is not None:
        film = film.model_copy(update={"duration_s": clip.duration_s})

    def work(partial_dir: Path) -> None:
        body = read_body(body_path)
        rng = np.random.default_rng([recipe.seed, index])
        motion = film_motion(_motion(clip, film, motion_path, body, rng), film)
        planned = plan_clip(clip.id, motion, clip.programme, film, rng)
        save_clip(partial_dir / PLANNED_FILE, planned, body.rest_pelvis_m(motion.shape))

    config = PlanConfig(seed=recipe.seed, clip=clip, film=film)
    inputs = {"body": body_path}
    if motion_path is not None:
        inputs |= input_files(motion_path)
    return run_stage("plan", out_dir, config, inputs, work, redo=redo) / PLANNED_FILE


def _motion(
    clip: SyntheticClip,
    film: Film,
    motion_path: Path | None,
    body: BodyModel,
    rng: np.random.Generator,
) -> Motion:
    if motion_path is not None:
        return read_motion(motion_path, body)
    return make_gait(clip.gait or "", film.duration_s, 30.0, body, rng)
