"""The place that a clip is rendered in: what a recipe may say of it, and its extras."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from gmrdata.film.walkers import CAR_SIZE_M, Drive, Shot, drive_past, keep_company, pass_by, shot_of
from gmrdata.motion.resample import resample, slice_motion
from gmrdata.read.source_motion import DEFAULT_READING, ReadConfig
from gmrdata.values import limits
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadRecipe
from gmrdata.values.files import read_npz, write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config

STRAIGHT_S = 8.0
"""For longer, a passer-by walks in a figure of eight, so that the place needn't be so large [s]."""
EXTRAS_STREAM = 1000
"""Spawn key of the extras' random numbers, so that place and person stay as they are."""


class Extras(Config):
    """Who and what moves through the scene beside the clip's person.

    Their instance numbers go on from the person's 1: company, then passers-by, then cars.
    """

    company: int = Field(default=0, ge=0, le=2)
    """People who go along, about 0.9 to 1.5 m away, in view for at least 4/5 of the frames."""
    passers_by: int = Field(default=0, ge=0, le=8)
    """People who cross the view once, in front of the clip's person or behind."""
    cars: int = Field(default=0, ge=0, le=2)
    """Cars that drive across the view at 3 to 8 m/s; not in a room."""
    hold_s: float | None = Field(default=None, ge=0, le=limits.LONGEST_S)
    """All these people hold the pose that their motion has at this time [s]; None: they move."""
    motions: tuple[Path, ...] = ()
    """Motion files for the passers-by, each at least as long as the clip, and as `hold_s`;
    none: embedded gaits."""
    read: ReadConfig | None = None
    """What these files don't show of themselves; the set's when left out."""

    @model_serializer(mode="wrap")
    def _without_an_empty_read(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # So what was rendered before there was this key is not made with other values.
        dumped: dict[str, Any] = dump(self)
        return {key: value for key, value in dumped.items() if key != "read" or value is not None}

    @property
    def names(self) -> tuple[str, ...]:
        """Each extra's name, in the order of the instance numbers 2, 3, ..."""
        kinds = {"company": self.company, "passer_by": self.passers_by, "car": self.cars}
        return tuple(f"{kind}_{n + 1}" for kind, count in kinds.items() for n in range(count))

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the extras depend on, by name."""
        from gmrdata.motion.files import input_files

        if not (self.passers_by and self.motions):
            return {}
        files = {
            f"extras_{role}{number}": file
            for number, path in enumerate(self.motions)
            for role, file in input_files(path).items()
        }
        read = DEFAULT_READING if self.read is None else self.read
        return files | {f"extras_{role}": file for role, file in read.inputs.items()}


@dataclass(frozen=True, eq=False)
class Cast:
    """The extras; the walkers come first in the order of instance numbers, then the cars."""

    walkers: tuple[Motion, ...]  # world motions of company and passers-by, of one length and rate
    cars: tuple[Drive, ...]

    @property
    def ground_m(self) -> np.ndarray:
        """(N, 3) points that nothing may stand near, at the height of a pelvis [m]."""
        walked_m = [walker.pelvis_m for walker in self.walkers]
        driven_m = [np.c_[car.ground_m, np.ones(len(car.ground_m))] for car in self.cars]
        return np.concatenate([np.empty((0, 3)), *walked_m, *driven_m])


def make_cast(extras: Extras, clips: Sequence[Clip], body: BodyModel, seed: int) -> Cast:
    """Plan all extras of a place; the first clip's camera is the one to be crossed.

    Those of one kind don't depend on how many more of their kind are asked for; passers-by make way
    for company, and cars for both.  BadRecipe: no room for someone, or a motion is too short.
    """
    shot = shot_of(clips, extras.hold_s)
    kinds = np.random.SeedSequence(seed, spawn_key=(EXTRAS_STREAM,)).spawn(3)
    walkers: list[Motion] = []
    cars: list[Drive] = []
    for n, own in enumerate(kinds[0].spawn(extras.company), 1):
        walkers.append(keep_company(f"company_{n}", shot, walkers, body, own))
    for n, own in enumerate(kinds[1].spawn(extras.passers_by), 1):
        rng = np.random.default_rng(own)
        motion = shot.posed(_passing_motion(extras, shot, body, rng))
        walkers.append(pass_by(f"passer_by_{n}", motion, shot, walkers, rng))
    paths_m = [walker.pelvis_m for walker in walkers]
    for n, own in enumerate(kinds[2].spawn(extras.cars), 1):
        cars.append(drive_past(f"car_{n}", shot, paths_m, cars, np.random.default_rng(own)))
    return Cast(tuple(walkers), tuple(cars))


def save_cast(path: Path, cast: Cast) -> None:
    """Write the extras for Blender's process, which makes no motions: it has no scipy."""
    kinds = {"walker": cast.walkers, "car": cast.cars}
    arrays = {
        f"{kind} {number} {name}": np.asarray(value)
        for kind, extras in kinds.items()
        for number, extra in enumerate(extras)
        for name, value in vars(extra).items()
    }
    write_npz(path, arrays)


def load_cast(path: Path) -> Cast:
    """The extras that `save_cast` wrote."""
    extras: dict[str, dict[str, dict[str, Any]]] = {"walker": {}, "car": {}}
    for key, value in read_npz(path).items():
        kind, number, name = key.split()
        extras[kind].setdefault(number, {})[name] = value if value.ndim else value.item()
    walkers = tuple(Motion(**of_one) for of_one in extras["walker"].values())
    return Cast(walkers, tuple(Drive(**of_one) for of_one in extras["car"].values()))


def looks_of(name: str, seed: int) -> np.random.Generator:
    """Chooses an extra's clothes or paint: from the scene's seed and its name alone."""
    key = (EXTRAS_STREAM, 3, *name.encode())
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _passing_motion(
    extras: Extras, shot: Shot, body: BodyModel, rng: np.random.Generator
) -> Motion:
    """One that serves a shot, at its rate, on a build of its own: a piece of a file, or a gait."""
    from gmrdata.motion.gait import make_gait, sample_shape  # slow to load

    if not extras.motions:
        kind = "walk" if shot.motion_s <= STRAIGHT_S else "figure_eight"
        return make_gait(kind, shot.motion_s, shot.fps_hz, body, rng)
    from gmrdata.motion.files import read_file, require_motion

    path = extras.motions[int(rng.integers(len(extras.motions)))]
    said = DEFAULT_READING if extras.read is None else extras.read
    read = read_file(path, body, said, shape=sample_shape(body, rng))
    whole, n_frames = resample(read.motion, shot.fps_hz), shot.motion_frames
    if whole.n_frames < n_frames:
        lasts = f"lasts {whole.n_frames / shot.fps_hz:.2f} s, and it takes {shot.motion_s:.2f} s"
        remedy = "give longer motions, or none for embedded gaits"
        raise BadRecipe(f"extras.motions: {path} {lasts}; {remedy}")
    # A time to hold is one of the file; else any piece of it serves.
    start = int(rng.integers(whole.n_frames - n_frames + 1)) if extras.hold_s is None else 0
    require_motion(read, path, start / shot.fps_hz, (start + n_frames) / shot.fps_hz)
    return slice_motion(whole, start, start + n_frames)


def save_extras(
    folder: Path, names: tuple[str, ...], cast: Cast, filmed: Clip, body: BodyModel
) -> None:
    """Write `<name>.npz` for each of `Extras.names`: of a person a clip with the filmed camera."""
    if names:
        folder.mkdir(exist_ok=True)
    n_frames = filmed.motion.n_frames
    for name, motion in zip(names, cast.walkers, strict=False):
        walk = slice_motion(motion, 0, n_frames)
        everywhere = np.ones(n_frames, dtype=bool)
        clip = Clip(f"{filmed.id}_{name}", walk, everywhere, filmed.image_numbers, filmed.camera)
        save_clip(folder / f"{name}.npz", clip, body.rest_pelvis_m(walk.shape))
    for name, car in zip(names[len(cast.walkers) :], cast.cars, strict=True):
        arrays = {"world_from_car": car.world_from_car[:n_frames], "size_m": CAR_SIZE_M}
        write_npz(folder / f"{name}.npz", arrays)


Light = Literal["sun", "overcast", "indoor"]


class BackdropConfig(Config):
    """A .blend file that the person is filmed in.

    Its meshes, lamps and sky are taken as saved, without cameras, animation, drivers and scripts.
    All that it shows must be inside the file (in Blender: File, External Data, Pack Resources)."""

    path: Path
    scene_name: str | None = None
    """Which of the file's scenes; may be left out when it has one."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the clip's origin, on the ground under the middle of the motion, is in the file [m]."""
    yaw_deg: float = 0.0
    """Direction of the clip's x axis in the file, anticlockwise from the file's own [degrees]."""
    max_bounces: int = Field(default=4, ge=0, le=64)
    """How often light goes from surface to surface; with many, take 64 or more `samples`."""
    allow_collisions: bool = False
    """Film even when somebody or the camera goes through something, or it hides the person."""


class SceneConfig(Config):
    """The place that the person is filmed in."""

    kind: Literal["courtyard", "street", "park", "room", "blend"] = "courtyard"
    """A paved yard with crates and pillars, a street with parked cars, a park with trees and
    hedges, or a furnished room: each with walls or hedges all round, as large as the clip needs.
    `blend`: what the file of `backdrop` shows."""
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)
    """Chooses houses, things, pictures on them, and clothes."""
    light: Light | None = None
    """Sharp sun, an overcast sky without shadows, or a room's lamp; None: sun, or the lamp."""
    hdri_path: Path | None = None
    """An equirectangular .hdr or .exr file to show as the sky; it lights nothing."""
    backdrop: BackdropConfig | None = None
    """The place of kind `blend`."""
    extras: Extras = Extras()

    @model_validator(mode="after")
    def _fits_together(self) -> "SceneConfig":
        if (self.kind == "blend") != (self.backdrop is not None):
            raise ValueError("backdrop: `kind: blend` needs one, and no other kind has one")
        if self.backdrop is not None and (self.light or self.hdri_path):
            raise ValueError("backdrop: has its own light and sky; leave light and hdri_path out")
        if (self.kind == "room") != (self.lit_by == "indoor"):
            raise ValueError("light: `indoor` is for a room, and a room has no other")
        if self.kind == "room" and self.hdri_path is not None:
            raise ValueError("hdri_path: no sky is seen from a room; leave it out")
        if self.kind == "room" and self.extras.cars:
            raise ValueError("extras.cars: a car doesn't fit a room; set it to 0")
        return self._extras_have_people()

    def _extras_have_people(self) -> "SceneConfig":
        """What is said of people who aren't asked for was meant for somebody."""
        extras = self.extras
        if extras.motions and not extras.passers_by:
            raise ValueError("extras.motions: are for passers-by; give their number, passers_by")
        if extras.hold_s is not None and not extras.company + extras.passers_by:
            what = "nobody is asked for who could hold a pose"
            raise ValueError(f"extras.hold_s: {what}; for the clip's own person give its hold_s")
        return self

    @property
    def lit_by(self) -> Light:
        """The light, chosen or the place's own."""
        return self.light or ("indoor" if self.kind == "room" else "sun")

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        files = {} if self.hdri_path is None else {"hdri": self.hdri_path}
        if self.backdrop is not None:
            files["backdrop"] = self.backdrop.path
        return files | self.extras.inputs
