"""The extras of a clip: who they are and where they go."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadRecipe
from gmrdata.extras.config import Extras
from gmrdata.extras.drive import Drive, drive_past
from gmrdata.extras.shot import Shot, shot_of
from gmrdata.motion.motion import Motion
from gmrdata.motion.resample import resample, slice_motion

EXTRAS_STREAM = 1000
"""Spawn key of the extras' random numbers: apart from those of the place, its meshes and the
person, so that extras leave these as they are."""


@dataclass(frozen=True, eq=False)
class Cast:
    """The extras; the walkers come first in the order of instance numbers, then the cars."""

    walkers: tuple[Motion, ...]
    """World motions of company and passers-by, of one length and rate."""
    cars: tuple[Drive, ...]
    """The cars' ways."""

    @property
    def ground_m(self) -> np.ndarray:
        """(N, 3) points that nothing may stand near, at the height of a pelvis [m]."""
        walked_m = [walker.pelvis_m for walker in self.walkers]
        driven_m = [np.c_[car.ground_m, np.ones(len(car.ground_m))] for car in self.cars]
        return np.concatenate([np.empty((0, 3)), *walked_m, *driven_m])


def make_cast(extras: Extras, clips: Sequence[Clip], body: BodyModel, seed: int) -> Cast:
    """Plan all extras of a place.

    Those of one kind don't depend on how many more of their kind are asked for; passers-by make way
    for company, and cars for both.

    Args:
        extras: The recipe.
        clips: The clips that are filmed there; the first one's camera is the one to be crossed.
        body: Body model of all people.
        seed: The scene's seed.

    Raises:
        BadRecipe: there is no room for someone, or a motion is too short.
        BadMotionFile: a motion file is broken.
        MissingInput: a motion file is not there.
    """
    if not extras.names:
        return Cast((), ())
    from gmrdata.extras.walker import keep_company, pass_by, passing_gait  # scipy's splines

    shot = shot_of(clips)
    kinds = np.random.SeedSequence(seed, spawn_key=(EXTRAS_STREAM,)).spawn(3)
    walkers: list[Motion] = []
    for n, own in enumerate(kinds[0].spawn(extras.company)):
        walkers.append(keep_company(f"company_{n + 1}", shot, walkers, body, own))
    for n, own in enumerate(kinds[1].spawn(extras.passers_by)):
        rng = np.random.default_rng(own)
        if extras.motions:
            file = extras.motions[int(rng.integers(len(extras.motions)))]
            motion = recorded(file, shot, body, rng)
        else:
            motion = passing_gait(shot, body, rng)
        walkers.append(pass_by(f"passer_by_{n + 1}", motion, shot, walkers, rng))
    cars: list[Drive] = []
    for n, own in enumerate(kinds[2].spawn(extras.cars)):
        paths_m = [walker.pelvis_m for walker in walkers]
        cars.append(drive_past(f"car_{n + 1}", shot, paths_m, cars, np.random.default_rng(own)))
    return Cast(tuple(walkers), tuple(cars))


def looks_of(name: str, seed: int) -> np.random.Generator:
    """Chooses an extra's clothes or paint: from the scene's seed and its name alone."""
    key = (EXTRAS_STREAM, 3, *name.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def recorded(path: Path, shot: Shot, body: BodyModel, rng: np.random.Generator) -> Motion:
    """A piece of a motion file as long as the shot, at its frame rate, on a build that is drawn.

    Raises:
        BadRecipe: the motion is shorter than the shot.
    """
    from gmrdata.motion.gait import draw_shape
    from gmrdata.motion.read import read_motion

    whole = resample(read_motion(path, body, shape=draw_shape(body, rng)), shot.fps_hz)
    if whole.n_frames < shot.n_frames:
        raise BadRecipe(
            f"extras.motions: {path} lasts {whole.n_frames / shot.fps_hz:.2f} s, the clip "
            f"{shot.n_frames / shot.fps_hz:.2f} s; give longer motions, or none for embedded gaits"
        )
    start = int(rng.integers(whole.n_frames - shot.n_frames + 1))
    return slice_motion(whole, start, start + shot.n_frames)
