"""Records of what made a manifest and its clips, without times and machine paths."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gmrdata import __version__
from gmrdata.config import Config
from gmrdata.errors import BadManifest
from gmrdata.manifest.current import CreatedBy, Recipe
from gmrdata.store import STAGE_FILE, package_versions, read_json


def created_by(
    recipe: Config | Mapping[str, Any] | None = None, seeds: Mapping[str, int] | None = None
) -> CreatedBy:
    """The record for a manifest's head.

    Args:
        recipe: The whole recipe; absolute paths in it are cut to their last part, because where
            a data set lay on its maker's disk is nobody's business and differs between machines.
        seeds: Seeds by their use.
    """
    values = recipe.model_dump(mode="json") if isinstance(recipe, Config) else dict(recipe or {})
    return CreatedBy(
        gmrdata=__version__,
        recipe=without_machine_paths(values),
        seeds=dict(sorted((seeds or {}).items())),
        packages=package_versions(),
    )


def stage_recipe(stage_dir: Path) -> Recipe:
    """The record of the stage that made a finished folder.

    Raises:
        MissingInput: the folder has no stage record, so it isn't a finished stage's.
        BadManifest: the record lacks a part.
    """
    record = read_json(stage_dir / STAGE_FILE)
    if not isinstance(record, dict) or not {"stage", "config", "inputs"} <= record.keys():
        raise BadManifest(f"{stage_dir / STAGE_FILE}: not a stage's record; make the folder again")
    config = without_machine_paths(record["config"])
    return Recipe(
        stage=record["stage"],
        config=config,
        inputs=record["inputs"],
        sha256=recipe_sha256(record["stage"], config, record["inputs"]),
    )


def recipe_sha256(stage: str, config: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Hex SHA-256 of a stage's recipe, as JSON with sorted keys and no spaces."""
    value = {"stage": stage, "config": config, "inputs": inputs}
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def without_machine_paths(value: Any) -> Any:
    """Plain data with every absolute path cut to its last part."""
    if isinstance(value, Mapping):
        return {str(key): without_machine_paths(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_machine_paths(item) for item in value]
    if isinstance(value, Path):
        value = str(value)
    if isinstance(value, str) and value.startswith("/"):
        return Path(value).name
    return value
