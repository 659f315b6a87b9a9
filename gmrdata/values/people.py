"""The people of one sequence, as files that stages hand on."""

from dataclasses import dataclass
from pathlib import Path

BODIES, PSEUDO_GT, FUSED = "bodies", "pseudo_gt", "fused"
"""Folders of a sequence's people: before the camera, in the world by the cameras, and there with a
network's motions too."""


@dataclass(frozen=True)
class PersonFiles:
    """One person of a sequence."""

    clip_path: Path  # clip with the person in the camera frame, intrinsics and image numbers
    body_path: Path


def person_file(number: int) -> str:
    """Name of a person's clip in a stage's folder; people are counted from 0."""
    return f"person_{number}.npz"


def stage_inputs(people: tuple[PersonFiles, ...]) -> dict[str, Path]:
    """The files by role, for a stage's record."""
    inputs: dict[str, Path] = {}
    for number, person in enumerate(people):
        inputs |= {f"clip_{number}": person.clip_path, f"body_{number}": person.body_path}
    return inputs
