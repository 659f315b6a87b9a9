"""The verb that makes Blender's environment."""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import OmitSubcommandPrefixes, subcommand

from gmrdata.cli.answers import answer


def blender_setup(python: Path | None = None, redo: bool = False) -> None:
    """Make the environment that Blender runs in, 1.3 GB: bpy and what gmrdata's side of it imports.

    It is .venv-blender of a checkout, else $XDG_DATA_HOME/gmrdata/blender (~/.local/share).
    GMRDATA_BLENDER_PYTHON names another one's Python.

    Args:
        python: Python 3.11 or 3.13 to make it with.  By uv, where that is installed, it may be a
            version, which uv fetches.  When left out: of these the first that is found.
        redo: Make it again.
    """
    from gmrdata.cli.doctor import blender_part
    from gmrdata.film.blender_environment import set_up
    from gmrdata.values.errors import BlenderMissing

    place = set_up(python, redo=redo)
    part = blender_part()
    if part.state != "there":
        raise BlenderMissing(f"{place}: Blender does not start: {part.found}. {part.note}")
    answer(f"Blender {part.found}: {part.note}")


def blender(
    verb: OmitSubcommandPrefixes[Annotated[Any, subcommand("setup", constructor=blender_setup)]],
) -> None:
    """Make the environment that Blender runs in."""
