"""What is solved: frames of a clip, changed or not, with one kind of masks and one seed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from real.pictures import (
    Film,
    centre_crop,
    crowd,
    darkness,
    half_size,
    mean_of,
    sea,
    watermark,
)

MaskKind = Literal["none", "boxes", "person"]
MASK_KINDS: tuple[MaskKind, ...] = ("none", "boxes", "person")
Part = tuple[int, int | None, int]
"""Start, stop and step of the frames that are taken of a clip."""
WHOLE: Part = (0, None, 1)
FIRST: Part = (0, 100, 1)
SMALL_FRAMES = 30
Rows = Callable[[int, np.random.Generator], np.ndarray]
"""Rows of a clip's T frames, in the order in which they are shown."""


@dataclass(frozen=True)
class Case:
    """One reconstruction and what it is compared with."""

    name: str
    """`group-clip-what`, which `-k` picks."""
    clip: str
    part: Part = WHOLE
    """Frames of the clip."""
    rows: Rows | None = None
    """Their order, for frames dropped, doubled, ...; as they are if None."""
    change: Callable[[Film], Film] | None = None
    masks: MaskKind = "none"
    focal: float = 1.0
    """Focal length that is given, over the right one."""
    joined_to: str | None = None
    """A clip whose frames follow without a word."""
    seed: int = 0
    plain: bool = False
    """Whether plain pycolmap solves it too."""
    most_ate_mm: float | None = None
    must: Literal["accepted", "rejected", "any"] = "any"
    """What the issue asks for; "any" leaves it to the verdict, if that is not wrong."""
    least_cameras: float = 0.0
    """Share of the frames that must have a camera, where it is accepted."""

    @property
    def sound(self) -> bool:
        """Whether its focal length, its order and its rate are as they are said to be: of what is
        not, right cameras may be refused for a true reason."""
        return self.focal == 1 and self.rows is None and self.joined_to is None


def clip_cases() -> Iterator[Case]:
    """Clips as they are, at lower rates and in worse quality."""
    yield from (
        Case(f"clip-dance-all-{kind}", "dance", masks=kind,
             must="accepted", most_ate_mm=6.5)
        for kind in MASK_KINDS
    )  # fmt: skip
    for kind in MASK_KINDS:
        for start in range(0, 600, 100):
            yield Case(
                f"window-dance{start}-{kind}", "dance", (start, start + 100, 1), masks=kind,
                plain=True, must="accepted", least_cameras=1.0,
            )  # fmt: skip
        for step, most_mm in ((3, 8.0), (10, 8.0), (20, 12.0)):
            yield Case(
                f"rate-dance_every{step}-{kind}", "dance", (0, None, step), masks=kind,
                plain=step > 3, must="accepted", most_ate_mm=most_mm,
            )  # fmt: skip
        yield Case(f"quality-dance_half_jpeg30-{kind}", "dance", FIRST, change=half_size,
                   masks=kind, plain=True, most_ate_mm=12.0, least_cameras=1.0)  # fmt: skip
        yield Case(f"quality-dance_mean5-{kind}", "dance", FIRST, change=mean_of(5), masks=kind,
                   most_ate_mm=60.0, least_cameras=0.6)  # fmt: skip
    for kind, most_mm in (("none", 40.0), ("boxes", 25.0), ("person", 25.0)):
        yield Case(f"crop-dance_half-{kind}", "dance", FIRST, change=centre_crop(0.5),
                   masks=_kind(kind), most_ate_mm=most_mm,
                   least_cameras=0.9 if kind != "none" else 0.0)  # fmt: skip
    for name, most_mm in (("kitti_1", 20.0), ("kitti_2", 320.0)):
        yield Case(f"clip-{name}-none", name, plain=True, most_ate_mm=most_mm, must="accepted")
        yield Case(f"clip-{name}-boxes", name, masks="boxes", plain=True, most_ate_mm=most_mm)
    yield Case("clip-kitchen-none", "kitchen", FIRST, plain=True)
    yield Case("clip-fox-none", "fox", plain=True)
    yield Case("clip-static_people-boxes", "static_people", masks="boxes")
    yield Case("clip-static_people-none", "static_people")
    yield Case("clip-dog-boxes", "dog", masks="boxes", plain=True)


SOURCES = (("dance", FIRST), ("dance", (300, 400, 1)), ("kitti_1", WHOLE), ("kitti_2", WHOLE),
           ("kitchen", FIRST))  # fmt: skip
"""What is broken on purpose."""


def fault_cases() -> Iterator[Case]:
    """Clips broken on purpose, whose result is right or refused."""
    for clip, part in SOURCES:
        name = clip if part == WHOLE else f"{clip}{part[0]}"
        for focal in (0.7, 0.8, 0.9, 1.1, 1.2, 1.3):
            yield Case(f"focal-{name}-{focal:g}", clip, part, focal=focal)
        for what, rows in ORDERS.items():
            yield Case(f"order-{name}-{what}", clip, part, rows=rows)
        yield Case(f"sea-{name}", clip, part, change=sea)
        yield Case(f"crowd-{name}", clip, part, change=crowd)
        yield Case(f"dark-{name}", clip, part, change=darkness)
        yield Case(f"watermark-{name}", clip, part, change=watermark)
        yield Case(f"blur-{name}", clip, part, change=mean_of(9))
    # Its logo was taken for a scene before a camera at rest.
    yield Case("watermark-fox", "fox", change=watermark)
    for first, second in (("dance", "kitchen"), ("kitchen", "dance"), ("kitti_1", "kitti_2"),
                          ("dog", "dance"), ("static_people", "dance")):  # fmt: skip
        part = WHOLE if first.startswith("kitti") else (0, 60, 1)
        yield Case(f"joined-{first}-{second}", first, part, joined_to=second)
    for start in (0, 200, 300, 400, 500):
        # The first at a half is `crop-dance_half-none`, which would count twice.
        for share in (0.5, 0.35) if start else (0.35,):
            yield Case(f"large_person-dance{start}-{share:g}", "dance", (start, start + 100, 1),
                       change=centre_crop(share))  # fmt: skip
    for seed in range(1, 5):
        yield Case(f"seed-dance0-{seed}", "dance", FIRST, seed=seed)
        yield Case(f"seed-kitti_1-{seed}", "kitti_1", seed=seed)


def _kind(name: str) -> MaskKind:
    return next(kind for kind in MASK_KINDS if kind == name)


def _dropped(n: int, rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(n, round(0.6 * n), replace=False))


def _gap(n: int, _: np.random.Generator) -> np.ndarray:
    return np.r_[0 : n // 3, 2 * n // 3 : n]


def _shuffled(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.permutation(n)


def _doubled(n: int, _: np.random.Generator) -> np.ndarray:
    return np.repeat(np.arange(n), 2)


def _frozen(n: int, _: np.random.Generator) -> np.ndarray:
    return np.r_[0 : n // 2, np.full(n // 4, n // 2), n // 2 : n]


def _reversed_half(n: int, _: np.random.Generator) -> np.ndarray:
    return np.r_[0 : n // 2, n - 1 : n // 2 - 1 : -1]


def _there_and_back(n: int, _: np.random.Generator) -> np.ndarray:
    return np.r_[0:n, n - 2 : 0 : -1]


ORDERS: dict[str, Rows] = {
    "dropped": _dropped,
    "gap": _gap,
    "shuffled": _shuffled,
    "doubled": _doubled,
    "frozen": _frozen,
    "reversed_half": _reversed_half,
    "there_and_back": _there_and_back,
}


def small(cases: Sequence[Case]) -> list[Case]:
    """The first frames of one case of each group, to try every part."""
    groups = {case.name.split("-")[0]: case for case in reversed(cases)}
    return [replace(case, part=_first_of(case.part)) for case in groups.values()]


def _first_of(part: Part) -> Part:
    start, stop, step = part
    most = start + SMALL_FRAMES * step
    return start, most if stop is None else min(stop, most), step
