"""Files that travel with the package: recipes, published manifests and the manifest schema.

They live in the repository's root folders `manifests/` and `pipelines/`.  Inside the package the
links `published` and `pipelines` lead there; a wheel carries real folders of these names instead.
"""

from pathlib import Path

from gmrdata.values.errors import MissingInput

_PACKAGE = Path(__file__).parent.parent
_PUBLISHED = _PACKAGE / "published"
_RECIPES = _PACKAGE / "pipelines"


def published_manifest(name: str) -> Path:
    """Path of a manifest that gmrdata publishes, e.g. "paper_table8".

    Raises:
        MissingInput: gmrdata publishes no manifest of this name.
    """
    return _find(_PUBLISHED, name, "published manifest")


def published_names() -> list[str]:
    """Names of the manifests that gmrdata publishes, sorted."""
    return _names(_PUBLISHED)


def recipe(name: str) -> Path:
    """Path of a recipe that gmrdata carries, e.g. "demo" or "paper/table4".

    Raises:
        MissingInput: gmrdata carries no recipe of this name.
    """
    return _find(_RECIPES, name, "recipe")


def recipe_names() -> list[str]:
    """Names of the recipes that gmrdata carries, sorted."""
    return _names(_RECIPES)


def schema_v1() -> Path:
    """Path of the JSON Schema of `format: gmrdata/1`."""
    return _PUBLISHED / "schema" / "v1.json"


def format_page() -> Path:
    """Path of FORMAT.md, the whole manifest format on one page."""
    return _PUBLISHED / "FORMAT.md"


def _names(folder: Path) -> list[str]:
    # rglob would not enter `folder` through a link on every Python, so the link is followed first.
    real = folder.resolve()
    return sorted(
        path.relative_to(real).with_suffix("").as_posix() for path in real.rglob("*.yaml")
    )


def _find(folder: Path, name: str, what: str) -> Path:
    wanted = name.removesuffix(".yaml")
    if wanted not in _names(folder):
        raise MissingInput(f"no {what} {name!r}; there are: {', '.join(_names(folder)) or 'none'}")
    return folder / f"{wanted}.yaml"
