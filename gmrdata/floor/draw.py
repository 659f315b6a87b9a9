"""The twins that a floor is measured on, drawn by a seed."""

import re
from pathlib import Path

from gmrdata.errors import BadRecipe
from gmrdata.film import Film
from gmrdata.threedpw.draw_twins import FILM, twin_recipe
from gmrdata.threedpw.twin_recipe import TwinRecipe

SIZES_PX = {"small": (FILM.width_px, FILM.height_px), "full": (1080, 1920)}
"""Width and height by name: half of 3DPW's portrait camera, and the whole."""
MIN_SIDE_PX = 64
MIN_FRAMES = 60
"""In less time the class of a camera's motion does not show."""


def draw_twins(
    n_sequences: int, seed: int, motions_dir: Path, film: Film, workers: int | None
) -> TwinRecipe:
    """The recipe of the twins.

    Args:
        n_sequences: How many sequences.
        seed: Chooses motions, cameras, places, people and faults.
        motions_dir: Folder of motion files.
        film: What `film_of` gave.
        workers: Processes that render; the recipe's number when None.

    Raises:
        BadRecipe: the seed is negative, or as `twin_recipe` says.
        MissingInput: there is no such folder.
    """
    if seed < 0:
        raise BadRecipe(f"--seed {seed}: give 0 or more")
    drawn = twin_recipe(n_sequences, seed, motions_dir, film=film)
    if workers is None:
        return drawn
    clips = drawn.set.model_copy(update={"workers": workers})
    return drawn.model_copy(update={"set": clips})


def film_of(size: str, n_frames: int) -> Film:
    """The twins' film, with 3DPW's horizontal field of view at any size.

    Args:
        size: "small", "full", or width and height like 180x320 [px].
        n_frames: Images of each sequence, at 30 fps.

    Raises:
        BadRecipe: the size is of another form, or there is too little of it.
    """
    width_px, height_px = SIZES_PX.get(size, (0, 0))
    if found := re.fullmatch(r"(\d{1,5})x(\d{1,5})", size):
        width_px, height_px = int(found[1]), int(found[2])
    if min(width_px, height_px) < MIN_SIDE_PX:
        raise BadRecipe(
            f"--size {size}: give small, full, or width x height in pixels, like 180x320, each "
            f"{MIN_SIDE_PX} or more"
        )
    if n_frames < MIN_FRAMES:
        raise BadRecipe(
            f"--frames {n_frames}: give {MIN_FRAMES} or more; in less time the class of a camera's "
            "motion does not show"
        )
    assert FILM.fps_hz is not None
    size_px = {"width_px": width_px, "height_px": height_px}
    return FILM.model_copy(update=size_px | {"duration_s": n_frames / FILM.fps_hz})
