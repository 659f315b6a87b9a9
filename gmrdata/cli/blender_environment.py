"""The verb that makes Blender's environment."""

from typing import Literal

from tyro.conf import Positional

from gmrdata.cli.answers import answer, fail


def blender(
    job: Positional[Literal["setup"]], python: str | None = None, redo: bool = False
) -> None:
    """Make the environment that Blender runs in, 1.1 GB: bpy and what gmrdata's side of it imports.

    It is .venv-blender of a checkout, else $XDG_DATA_HOME/gmrdata/blender (~/.local/share).
    GMRDATA_BLENDER_PYTHON names another one's Python.

    Args:
        job: setup.
        python: Python 3.11 or 3.13 to make it with.  By uv, where that is installed, it may be a
            version, which uv fetches.  When left out: of these the first that is found.
        redo: Make it again.
    """
    from gmrdata.cli.doctor import blender_part
    from gmrdata.film.blender_environment import set_up

    place = set_up(python, redo=redo)
    part = blender_part()
    if part.state != "there":
        fail(f"{place}: Blender does not start: {part.found}. It is needed for {part.note}")
    answer(f"Blender {part.found}: {part.note}")
