"""Where EMDB's sequences lie: `P0/09_outdoor_walk/P0_09_outdoor_walk_data.pkl` and the like."""

from pathlib import Path

from gmrdata.errors import MissingInput

FPS_HZ = 30.0
"""Rate of the images and all arrays [Hz]."""


def find_sequences(root: Path) -> list[Path]:
    """The `*_data.pkl` of each sequence, sorted; links that lead out of the folder are left out.

    Raises:
        MissingInput: there is none.
    """
    inside = root.resolve()
    found = sorted(
        path
        for path in root.glob("P*/*/*_data.pkl")
        if path.is_file() and path.resolve().is_relative_to(inside)
    )
    if not found:
        raise MissingInput(
            f"{root}: no P*/<sequence>/*_data.pkl. Name the folder that holds EMDB's P0 to P9"
        )
    return found
