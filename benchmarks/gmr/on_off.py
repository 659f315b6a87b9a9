"""The paper's synthetic trials, rendered with the camera on and off, and who is misled by that."""

from pathlib import Path
from typing import Any

from gmrdata.film.programmes import Circular, Film
from gmrdata.film.render_set import render_set
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe
from gmrdata.score.camera_as_world import predict_camera_as_world
from gmrdata.score.score import score
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.values.files import read_json

OFF = "_off"
METRICS = ("ome_deg", "tme_mm")
Scores = dict[str, dict[str, float]]
"""OME [deg] and TME [mm] by clip."""


def film_on_and_off(motions_dir: Path, out_dir: Path, *, small: bool) -> Path:
    """Manifest of each trial filmed twice; the frames are small, since nobody looks at them."""
    recipe = load_recipe(find_recipe("synthetic"), SyntheticRecipe)
    film = Film(fps_hz=10, width_px=160, height_px=90)
    update: dict[str, Any] = {"camera_off": True, "film": film}
    if small:
        walk = SyntheticClip(id="walk", gait="walk", programme=Circular(), duration_s=1.5)
        update |= {"published_list": None, "clips": (walk,)}
    return render_set(recipe.model_copy(update=update), out_dir, motions_dir=motions_dir)


def on_off_rows(run_dir: Path, manifest: Path, out_dir: Path) -> list[dict[str, Any]]:
    """Scores of each trial, camera on and off: a network's, and of camera-frame poses.

    Args:
        run_dir: The network's run.
        manifest: What `film_on_and_off` made.
        out_dir: Where predictions and scores go.
    """
    by_network = _scores(*score(run_dir, manifest, out_dir / "gmr").scores)
    poses = predict_camera_as_world(manifest, out_dir / "camera_as_world") / "predictions"
    by_camera = _scores(*score(poses, manifest, out_dir / "as_world").scores)
    rows = []
    for clip in sorted(by_network):
        if clip + OFF in by_network:
            figures = {
                f"{name} {metric}, {state}": round(scores[clip + ending][metric], 6)
                for name, scores in (("GMR", by_network), ("as world", by_camera))
                for metric in METRICS
                for state, ending in (("on", ""), ("off", OFF))
            }
            rows.append({"clip": clip} | figures)
    return rows


def differences(rows: list[dict[str, Any]], name: str, metric: str) -> list[float]:
    """What the camera's motion adds to an error, by clip."""
    return [row[f"{name} {metric}, on"] - row[f"{name} {metric}, off"] for row in rows]


def _scores(path: Path) -> Scores:
    return {row["id"]: row["predicted"] for row in read_json(path)["clips"]}
