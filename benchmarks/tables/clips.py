"""The paper's synthetic trials with the camera's motion on and off, and videos to train on.

What is scored are the trials of Table 8 that are at hand (02_03, 08_02, 08_04, 08_05), each under
the camera programme of the paper's list and under a camera at rest, at 20 fps, so that landmarks
are followed well.  What the non-sequential model is trained on are trials of other people, at GMR's
10 fps, in other places.
"""

import sys
from pathlib import Path
from typing import Any

from gmrdata.film.programmes import Panning
from gmrdata.film.render_set import render_set
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe
from gmrdata.stage.recipes import find_recipe, load_recipe

SIZE_PX = (480, 360)
SCORED_FPS_HZ, TRAINING_FPS_HZ = 20.0, 10.0
SCORED_S, TRAINING_S = 4.8, 3.6
RENDER = {"samples": 3}
TRAINING_TRIALS = (
    "35_01", "16_15", "12_01", "05_01", "29_01", "09_12", "27_01", "06_13", "26_01", "16_31",
)  # fmt: skip
"""Of people whom nothing is scored on."""
PROGRAMMES = ("circular", "linear", "panning", "linear_panning", "static")
PLACES = ("courtyard", "street", "park", "room")
SMALL_TRAINING = TRAINING_TRIALS[:1]


def scored_set(folder: Path, motions_dir: Path, *, small: bool = False) -> Path:
    """Manifest of each trial filmed twice: as listed, and `<id>_off` with a camera at rest."""
    recipe = load_recipe(find_recipe("synthetic"), SyntheticRecipe)
    update: dict[str, Any] = {
        "name": "tables_scored",
        "camera_off": True,
        "workers": 1,
        "film": recipe.film.model_validate(_film(SCORED_FPS_HZ, 0.6 if small else SCORED_S)),
        "render": recipe.render.model_copy(update=RENDER),
    }
    if small:
        walk = SyntheticClip(id="walk", gait="walk", programme=Panning())
        update |= {"published_list": None, "clips": (walk,)}
    return render_set(recipe.model_copy(update=update), folder, motions_dir=motions_dir)


def training_set(folder: Path, motions_dir: Path, *, small: bool = False) -> Path:
    """Manifest of videos with true motions, of people who are not scored."""
    clips = [
        {
            "id": trial,
            "trial": trial,
            "programme": {"kind": PROGRAMMES[row % len(PROGRAMMES)]},
            "scene": {"kind": PLACES[row % len(PLACES)], "seed": 60 + row},
        }
        for row, trial in enumerate(SMALL_TRAINING if small else TRAINING_TRIALS)
    ]
    film = _film(TRAINING_FPS_HZ, 1.2 if small else TRAINING_S)
    recipe = _recipe("tables_training", 31, film, clips)
    return render_set(recipe, folder, motions_dir=motions_dir)


def _recipe(
    name: str, seed: int, film: dict[str, float], clips: list[dict[str, Any]]
) -> SyntheticRecipe:
    given = {"recipe": "synthetic", "name": name, "seed": seed, "film": film, "clips": clips}
    shared = {"workers": 1, "people": {"vary": True}, "render": RENDER}
    return SyntheticRecipe.model_validate(given | shared)


def _film(fps_hz: float, duration_s: float) -> dict[str, float]:
    width_px, height_px = SIZE_PX
    size_px = {"width_px": width_px, "height_px": height_px}
    return {"fps_hz": fps_hz, "duration_s": duration_s, **size_px}


if __name__ == "__main__":
    scored_set(Path(sys.argv[1]) / "scored", Path(sys.argv[2]))
    training_set(Path(sys.argv[1]) / "training", Path(sys.argv[2]))
