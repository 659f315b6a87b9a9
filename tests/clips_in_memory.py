"""Counts the clips of manifests that are in memory."""

import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gmrdata.gmr import runs
from gmrdata.manifest.current import ClipEntry
from gmrdata.manifest.read import load_entry
from gmrdata.values.clip import Clip


def counted_clips(monkeypatch: pytest.MonkeyPatch) -> tuple[list[int], Callable[[], int]]:
    """How many clips there were at each reading of one, and how many there are."""
    before: list[int] = []
    poses: list[weakref.ref] = []

    def alive() -> int:
        return sum(one() is not None for one in poses)

    def counted(path: Path, entry: ClipEntry) -> Clip:
        before.append(alive())
        clip = load_entry(path, entry)
        # An array of its own, which also those keep that look at some of its rows.
        local_rotmats = clip.motion.local_rotmats.copy()
        poses.append(weakref.ref(local_rotmats))
        return replace(clip, motion=replace(clip.motion, local_rotmats=local_rotmats))

    monkeypatch.setattr(runs, "load_entry", counted)
    return before, alive
