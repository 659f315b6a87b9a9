"""Recipes that ask for what no machine has: the error names the key and its limit."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cli.demo_recipe import Training
from gmrdata.film.programmes import Film
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.gmr.config import ModelConfig, TrainConfig
from gmrdata.gmr.train import GmrRecipe
from gmrdata.paper.plan import JointConfig
from gmrdata.people.silhouette import SilhouetteConfig
from gmrdata.stage.recipes import load_recipe
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.values.errors import BadRecipe
from gmrdata.values.records import Config


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        (ModelConfig, {"hidden": 10**6}, "hidden\n.*less than or equal to 65536"),
        (ModelConfig, {"layers": 10**7}, "layers\n.*less than or equal to 64"),
        (ModelConfig, {"hidden": 60_000}, "hidden 60000 in 4 layers are more than 2000000000"),
        (TrainConfig, {"batch_size": 10**9}, "batch_size\n.*less than or equal to 65536"),
        (TrainConfig, {"batch_size": 65_000}, "batch_size 65000 of windows of 64 frames"),
        (TrainConfig, {"windows": {"frames": 10**9}}, r"windows.frames\n.*equal to 1000000"),
        (TrainConfig, {"windows": {"fps_hz": 1e-9}}, r"windows.fps_hz\n.*equal to 0.1"),
        (TrainConfig, {"threads": 10**6}, "threads\n.*less than or equal to 1024"),
        (TrainConfig, {"seed": 2**64}, "seed\n.*less than or equal to"),
        (TrainConfig, {"learning_rate": float("inf")}, "learning_rate\n.*finite number"),
        (JointConfig, {"frames": 600_000}, "batch_size 32 of windows of 600000 frames"),
        (Film, {"duration_s": 1e9}, "duration_s\n.*less than or equal to 86400"),
        (Film, {"width_px": 10**6}, "width_px\n.*less than or equal to 16384"),
        (Training, {"fps_hz": 1e-9}, "fps_hz\n.*greater than or equal to 1"),
        (SfmConfig, {"max_image_size_px": 10**9}, "max_image_size_px\n.*equal to 16384"),
        (SfmConfig, {"max_reprojection_px": float("inf")}, "max_reprojection_px\n.*finite"),
        (ThreedpwRecipe, {"recipe": "threedpw", "workers": 10**6}, "workers\n.*equal to 1024"),
        (SilhouetteConfig, {"dilate_px": 10**9}, "dilate_px\n.*equal to 1000"),
    ],
)
def test_absurd_sizes(kind: type[Config], values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        kind.model_validate(values)


def test_a_recipe_names_file_key_and_limit(tmp_path: Path) -> None:
    path = tmp_path / "gmr.yaml"
    path.write_text(yaml.safe_dump({"recipe": "gmr", "train": {"model": {"hidden": 10**6}}}))
    with pytest.raises(BadRecipe, match=r"gmr\.yaml: 1 wrong:\n  train\.model\.hidden: .* 65536"):
        load_recipe(path, GmrRecipe)


def test_a_hundred_thousand_clips_are_no_problem() -> None:
    clip = {"gait": "walk", "programme": {"kind": "static"}}
    clips = [{"id": f"c{n}", **clip} for n in range(1000)] * 100
    recipe: dict[str, Any] = {"recipe": "synthetic", "name": "many", "clips": clips}
    assert len(SyntheticRecipe.model_validate(recipe).clips) == 100_000
    with pytest.raises(ValidationError, match="clips\n.*at most 100000 items"):
        SyntheticRecipe.model_validate(recipe | {"clips": [*clips, clips[0]]})
