"""Recipes, YAML files that say what to make, and the other files that travel with the package.

Each kind of recipe has a model that refuses unknown keys.  Recipes, published manifests and the
manifest schema live in the repository's root folders `pipelines/` and `manifests/`.  Inside the
package the links `pipelines` and `published` lead there; a wheel carries real folders instead.
"""

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from gmrdata.values.errors import BadRecipe, MissingInput, nearest
from gmrdata.values.files import require_file, taken_for
from gmrdata.values.limits import MOST_RECIPE_BYTES
from gmrdata.values.plain_yaml import NotPlain, parse
from gmrdata.values.records import Config

_PUBLISHED, _RECIPES = (Path(__file__).parents[1] / name for name in ("published", "pipelines"))
Recipe = TypeVar("Recipe", bound=Config)


def find_recipe(name: str) -> Path:
    """Path of a recipe: a file that exists, or one that travels with gmrdata ("demo")."""
    path = Path(name)
    return path if path.is_file() else recipe_path(name)


def recipe_kind(path: Path) -> str:
    """What a recipe makes: its `recipe` key; BadRecipe if there is none."""
    kind = _read(path).get("recipe")
    if not isinstance(kind, str):
        raise BadRecipe(f"{path}: needs a key `recipe` that says what it makes, e.g. recipe: demo")
    return kind


def load_recipe(path: Path, model: type[Recipe]) -> Recipe:
    """Read a recipe; BadRecipe lists all keys and values that the model refuses."""
    try:
        return model.of_plain(_read(path))
    except ValidationError as error:
        problems = "\n".join(
            f"  {'.'.join(str(part) for part in problem['loc']) or 'recipe'}: {problem['msg']}"
            for problem in error.errors()
        )
        raise BadRecipe(f"{path}: {error.error_count()} wrong:\n{problems}") from None


def read_recipe(recipe: Recipe | Path | str, model: type[Recipe]) -> Recipe:
    """A recipe itself, or the one of a file or of a carried name; errors as of `load_recipe`."""
    return recipe if isinstance(recipe, model) else load_recipe(find_recipe(str(recipe)), model)


def _read(path: Path) -> dict[str, object]:
    require_file(path)
    if path.stat().st_size > MOST_RECIPE_BYTES:
        raise BadRecipe(
            f"{path}: larger than {MOST_RECIPE_BYTES} bytes, more than a recipe. Split it"
        )
    try:
        data, _ = parse(path.read_text(encoding="utf-8"))
    except NotPlain as error:
        where = str(path) if error.line is None else f"{path}:{error.line}"
        raise BadRecipe(f"{where}: {error.problem}") from None
    except UnicodeDecodeError:
        raise BadRecipe(f"{path}: not plain YAML: not UTF-8 text{taken_for(path)}") from None
    if not isinstance(data, dict):
        raise BadRecipe(f"{path}: a recipe is a mapping of keys to values")
    if "format" in data and (kind := taken_for(path)):
        raise BadRecipe(f"{path}: not a recipe{kind}")
    return data


def published_manifest(name: str) -> Path:
    """Path of a manifest that gmrdata publishes, e.g. "paper_table8"; MissingInput if none."""
    return _find(_PUBLISHED, name, "published manifest")


def published_names() -> list[str]:
    """Names of the manifests that gmrdata publishes, sorted."""
    return _names(_PUBLISHED)


def recipe_path(name: str) -> Path:
    """Path of a recipe that gmrdata carries, e.g. "paper/table4"; MissingInput if none."""
    return _find(_RECIPES, name.removeprefix("pipelines/"), "recipe file")


def recipe_names() -> list[str]:
    """Names of the recipes that gmrdata carries, sorted."""
    return _names(_RECIPES)


def schema_v1() -> Path:
    """Path of the JSON Schema of `format: gmrdata/1`."""
    return _PUBLISHED / "schema" / "v1.json"


def _names(folder: Path) -> list[str]:
    # rglob would not enter `folder` through a link on every Python, so the link is followed first.
    real = folder.resolve()
    paths = (path.relative_to(real) for path in real.rglob("*.yaml"))
    return sorted(path.with_suffix("").as_posix() for path in paths)


def _find(folder: Path, name: str, what: str) -> Path:
    wanted, known = name.removesuffix(".yaml"), _names(folder)
    if wanted not in known:
        carried = f"gmrdata carries only: {', '.join(known)}{nearest(wanted, known)}"
        raise MissingInput(f"{name}: no such {what}, and {carried}")
    return folder / f"{wanted}.yaml"
