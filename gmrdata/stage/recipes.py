"""Recipes: YAML files that say what to make.  Each kind has a model that refuses unknown keys."""

from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import ValidationError

from gmrdata.stage import resources
from gmrdata.values.errors import BadRecipe, MissingInput
from gmrdata.values.records import Config

MAX_BYTES = 1 << 20
Recipe = TypeVar("Recipe", bound=Config)


def find_recipe(name: str) -> Path:
    """Path of a recipe: a file that exists, or one that travels with gmrdata ("demo").

    Raises:
        MissingInput: neither is there.
    """
    path = Path(name)
    if path.is_file():
        return path
    try:
        return resources.recipe(name.removeprefix("pipelines/"))
    except MissingInput:
        known = ", ".join(resources.recipe_names())
        raise MissingInput(
            f"{name}: no such recipe file, and gmrdata carries only: {known}"
        ) from None


def recipe_kind(path: Path) -> str:
    """What a recipe makes: its `recipe` key.

    Raises:
        BadRecipe: not YAML, or no such key.
    """
    kind = _read(path).get("recipe")
    if not isinstance(kind, str):
        raise BadRecipe(f"{path}: needs a key `recipe` that says what it makes, e.g. recipe: demo")
    return kind


def load_recipe(path: Path, model: type[Recipe]) -> Recipe:
    """Read a recipe.

    Raises:
        MissingInput: no such file.
        BadRecipe: not YAML, or keys and values that the model refuses; the message lists them all.
    """
    try:
        return model.model_validate(_read(path))
    except ValidationError as error:
        problems = "\n".join(
            f"  {'.'.join(str(part) for part in found['loc']) or 'recipe'}: {found['msg']}"
            for found in error.errors()
        )
        raise BadRecipe(f"{path}: {error.error_count()} wrong:\n{problems}") from None


def _read(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    if path.stat().st_size > MAX_BYTES:
        raise BadRecipe(f"{path}: larger than {MAX_BYTES} bytes, so it is no recipe")
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BadRecipe(f"{path}: not YAML: {error}") from None
    if not isinstance(data, dict):
        raise BadRecipe(f"{path}: a recipe is a mapping of keys to values")
    return data
