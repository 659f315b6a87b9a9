# SPDX-License-Identifier: GPL-3.0-or-later
"""What someone looks like and wears, drawn at random.

The distribution: skin anywhere between very light and very dark; tops of seven patterns, a third of
them plain; sleeves none, short, half or long (1 : 4 : 1 : 4); long trousers, shorts or short skirts
painted on the thighs (6 : 3 : 1 for a woman, 2 : 1 : 0 for a man); an open jacket over one top in
five; hair short, cropped, long, tied, bald or under a cap, by gender and age; beards on a third of
men.  A garment's colour is redrawn a few times where it is like the skin or the surroundings.

Patterns of cloth, as functions of the place on the cloth.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np

Kind = Literal["plain", "stripes", "pinstripes", "checks", "dots", "blotches", "two_tone"]
KINDS: tuple[Kind, ...] = get_args(Kind)

BLOCK = 1 << 15
"""Places whose waves are summed at a time: fresh memory for all at once costs far more."""


@dataclass(frozen=True, eq=False)
class Cloth:
    """A cloth with a pattern in two colours."""

    kind: Kind
    first: np.ndarray
    """(3,) sRGB colour."""
    second: np.ndarray
    """(3,) sRGB colour."""
    period_m: float
    """After which the pattern repeats [m]; where two tones meet above or below the middle."""
    seed: int
    """Of blotches and of the weave."""


def colours_at(cloth: Cloth, across_m: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """(M, 3) sRGB colours of a cloth.

    Args:
        cloth: The cloth.
        across_m: (M,) place round the limb [m].
        along_m: (M,) place along the limb [m]; 0 in the garment's middle.
    """
    share = _share_of_second(cloth, across_m, along_m)[:, None]
    colours = cloth.first + share * (cloth.second - cloth.first)
    weave = waves(np.stack([across_m, along_m], axis=-1), 18.0, cloth.seed + 1)[:, None]
    return np.asarray(np.clip(colours * (1 + 0.07 * weave), 0, 1), dtype=np.float32)


def waves(places_m: np.ndarray, radians_per_m: float, seed: int) -> np.ndarray:
    """(M,) smooth random numbers of mean 0 and deviation 1 over places (M, D) [m]."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(0, radians_per_m, (places_m.shape[1], 8)).astype(np.float32)
    phases = rng.uniform(0, 2 * np.pi, 8).astype(np.float32)
    blocks = np.array_split(places_m, len(places_m) // BLOCK + 1)
    return np.concatenate([_summed_sines(block, turns, phases) for block in blocks]) / 2.0


def _summed_sines(places_m: np.ndarray, turns: np.ndarray, phases: np.ndarray) -> np.ndarray:
    w = np.sin(places_m.astype(np.float32) @ turns + phases).T
    # The pairs in which numpy sums eight numbers, which it does far slower row by row.
    return np.asarray(((w[0] + w[1]) + (w[2] + w[3])) + ((w[4] + w[5]) + (w[6] + w[7])))


def _share_of_second(cloth: Cloth, across_m: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """(M,) 0 where a cloth has its first colour, 1 where it has its second."""
    if cloth.kind == "plain":
        return np.zeros(len(along_m))
    if cloth.kind == "stripes":
        return np.asarray((along_m / cloth.period_m) % 1 < 0.45, dtype=np.float64)
    if cloth.kind == "pinstripes":
        return np.asarray((across_m / cloth.period_m) % 1 < 0.25, dtype=np.float64)
    if cloth.kind == "checks":
        warp, weft = ((at / cloth.period_m) % 1 < 0.5 for at in (across_m, along_m))
        return 0.5 * warp + 0.5 * weft
    if cloth.kind == "dots":
        row = np.floor(along_m / cloth.period_m)
        aside = (across_m / cloth.period_m + 0.5 * (row % 2)) % 1 - 0.5
        above = (along_m / cloth.period_m) % 1 - 0.5
        return np.asarray(np.hypot(aside, above) < 0.28, dtype=np.float64)
    if cloth.kind == "blotches":
        places_m = np.stack([across_m, along_m], axis=-1)
        blotches = waves(places_m, 2.2 / cloth.period_m, cloth.seed)
        return np.asarray(blotches > 0.25, dtype=np.float64)
    return np.asarray(along_m > cloth.period_m / 2, dtype=np.float64)


Hair = Literal["short", "cropped", "long", "tied", "bald", "cap"]

SKINS = ((0.96, 0.80, 0.70), (0.88, 0.68, 0.55), (0.73, 0.52, 0.38), (0.52, 0.34, 0.24),
         (0.31, 0.20, 0.15))  # fmt: skip
"""From very light to very dark; a skin lies between two neighbours."""
HAIRS = ((0.09, 0.07, 0.06), (0.20, 0.13, 0.08), (0.36, 0.23, 0.12), (0.62, 0.46, 0.24),
         (0.45, 0.18, 0.08))  # fmt: skip
GREY_HAIR = (0.68, 0.67, 0.65)
CLOTHS = (
    (0.76, 0.13, 0.13), (0.55, 0.07, 0.14), (0.90, 0.42, 0.10), (0.95, 0.75, 0.16),
    (0.42, 0.62, 0.18), (0.09, 0.38, 0.24), (0.10, 0.52, 0.54), (0.30, 0.60, 0.86),
    (0.12, 0.26, 0.62), (0.08, 0.12, 0.30), (0.40, 0.20, 0.55), (0.80, 0.28, 0.52),
    (0.95, 0.72, 0.74), (0.93, 0.91, 0.86), (0.13, 0.13, 0.14), (0.46, 0.47, 0.49),
    (0.74, 0.64, 0.48), (0.36, 0.24, 0.16),
)  # fmt: skip
TROUSERS = (
    (0.12, 0.16, 0.30), (0.22, 0.30, 0.46), (0.40, 0.50, 0.63), (0.10, 0.10, 0.11),
    (0.28, 0.28, 0.29), (0.60, 0.52, 0.38), (0.33, 0.32, 0.20), (0.36, 0.23, 0.16),
    (0.85, 0.83, 0.77), (0.45, 0.10, 0.14),
)  # fmt: skip
SHOES = ((0.92, 0.91, 0.88), (0.30, 0.17, 0.09), (0.08, 0.08, 0.09), (0.70, 0.14, 0.12),
         (0.14, 0.30, 0.60), (0.50, 0.50, 0.50))  # fmt: skip
SOLES = ((0.94, 0.94, 0.92), (0.12, 0.11, 0.10), (0.55, 0.40, 0.26))
LEG_KINDS: tuple[Kind, ...] = ("plain", "pinstripes", "checks")
LEAST_CONTRAST = 22.0
"""Distance in CIELAB at which a colour doesn't count as like the surroundings'."""
DRAWS = 5


@dataclass(frozen=True, eq=False)
class Outfit:
    """Someone's skin, hair and clothes; colours are (3,) sRGB."""

    skin: np.ndarray
    hair_kind: Hair
    hair: np.ndarray
    """Colour of the hair; also of eyebrows and beard."""
    beard: bool
    cap: np.ndarray
    top: Cloth
    sleeve: float
    """Where a sleeve ends: 0 at the shoulder, 1 at the elbow, 2 at the wrist."""
    neckline_m: float
    """Depth of a V below the neck [m]; 0 for a round neck."""
    hem: float
    """Where the top ends: 0 at the waist, 1 at the hips."""
    jacket: Cloth | None
    """Worn open, with long sleeves."""
    print_colour: np.ndarray | None
    """Of a print on the chest."""
    print_bits: np.ndarray
    """(8, 8) bool, the print."""
    legs: Cloth
    leg_end: float
    """Where trousers end: 0 at the hip, 1 at the knee, 2 at the ankle."""
    skirt: bool
    belt: np.ndarray | None
    side_stripe: np.ndarray | None
    """Of a stripe along the outside of each leg."""
    socks: np.ndarray
    sock_m: float
    """Height of the socks above the shoes [m]."""
    shoes: np.ndarray
    soles: np.ndarray
    boot_m: float
    """Height of the shoes above the ankle [m]."""
    seed: int
    """Of the grain of skin and hair."""


def sample_outfit(
    rng: np.random.Generator,
    *,
    female: float = 0.5,
    age: float = 0.75,
    surroundings: np.ndarray | None = None,
) -> Outfit:
    """Dress someone.

    Args:
        female: 0 for a man, 1 for a woman.
        age: 2/3 is young and 1 is old, as in Anny.
        surroundings: (N, 3) sRGB colours that the clothes should differ from.
    """
    is_woman = bool(rng.random() < female)
    avoid = np.zeros((0, 3)) if surroundings is None else surroundings
    skin, hair, hair_kind, beard = _head(rng, is_woman, age)
    avoid = np.concatenate([avoid, skin[None]])
    top = _cloth(rng, CLOTHS, KINDS, 0.34, avoid)
    jacket = _cloth(rng, (*TROUSERS, *CLOTHS[:4]), KINDS[:1], 1.0, avoid)
    sleeve = float(rng.choice([0.12, 0.62, 1.0, 1.96], p=[0.1, 0.4, 0.1, 0.4]))
    has_jacket, has_print, has_belt, has_stripe = rng.random(4) < (0.2, 0.4, 0.4, 0.12)
    leg_kind = rng.choice(3, p=[0.6, 0.3, 0.1] if is_woman else [0.67, 0.33, 0.0])
    if leg_kind < 2:  # trousers have quiet patterns
        legs = _cloth(rng, TROUSERS, LEG_KINDS, 0.85, avoid)
        legs = replace(legs, second=(2 * legs.first + legs.second) / 3)
    else:
        legs = _cloth(rng, CLOTHS, KINDS, 0.34, avoid)
    half_bits = rng.random((8, 4)) < 0.5
    v_neck = rng.random() < 0.3
    colours = [_jittered(rng, CLOTHS) for _ in range(3)]
    return Outfit(
        skin=skin,
        hair_kind=hair_kind,
        hair=hair,
        beard=beard,
        cap=colours[0],
        top=top,
        sleeve=sleeve,
        neckline_m=float(rng.uniform(0.05, 0.12)) if v_neck else 0.0,
        hem=float(rng.choice([0.0, 0.55, 0.9], p=[0.35, 0.4, 0.25])),
        jacket=jacket if has_jacket else None,
        print_colour=colours[1] if has_print and top.kind == "plain" else None,
        print_bits=np.concatenate([half_bits, half_bits[:, ::-1]], axis=1),
        legs=legs,
        leg_end=(1.95, float(rng.uniform(0.65, 0.95)), float(rng.uniform(0.7, 1.1)))[leg_kind],
        skirt=bool(leg_kind == 2),
        belt=_jittered(rng, SHOES) if has_belt else None,
        side_stripe=colours[2] if has_stripe else None,
        socks=_jittered(rng, (*SHOES[:3], *CLOTHS)),
        sock_m=float(rng.choice([0.0, 0.05, 0.15, 0.25])),
        shoes=_jittered(rng, SHOES),
        soles=_jittered(rng, SOLES),
        boot_m=float(rng.choice([0.0, 0.02, 0.10], p=[0.4, 0.4, 0.2])),
        seed=int(rng.integers(2**31)),
    )


def _head(
    rng: np.random.Generator, is_woman: bool, age: float
) -> tuple[np.ndarray, np.ndarray, Hair, bool]:
    """Colours of skin and hair, kind of hair, and whether there is a beard."""
    tone = rng.uniform(0, len(SKINS) - 1)
    skins, n = np.array(SKINS), np.arange(len(SKINS))
    skin = np.array([np.interp(tone, n, skins[:, c]) for c in range(3)])
    skin = np.clip(skin * rng.normal(1, 0.02, 3), 0, 1)
    darkest = 2 if tone > 2 else len(HAIRS)  # fair hair on light skin only
    hair = np.array(HAIRS[int(rng.integers(darkest))]) * rng.uniform(0.85, 1.15)
    grey = np.clip((age - 0.80) / 0.12 + rng.normal(0, 0.3), 0, 1)
    hair = np.clip(hair + grey * (np.array(GREY_HAIR) - hair), 0, 1)
    kinds: tuple[Hair, ...] = get_args(Hair)
    shares = (0.2, 0.0, 0.45, 0.27, 0.0, 0.08) if is_woman else (0.45, 0.22, 0.05, 0.02, 0.12, 0.14)
    kind = kinds[int(rng.choice(len(kinds), p=shares))]
    beard = rng.random() < 0.35
    return skin, hair, kind, bool(beard and not is_woman)


def _cloth(
    rng: np.random.Generator,
    colours: tuple[tuple[float, float, float], ...],
    kinds: tuple[Kind, ...],
    plain_share: float,
    avoid: np.ndarray,
) -> Cloth:
    candidates = np.stack([_jittered(rng, colours) for _ in range(DRAWS)])
    apart = contrasts(candidates, avoid)
    enough = apart > LEAST_CONTRAST
    first = candidates[enough.argmax() if enough.any() else apart.argmax()]
    seconds = np.stack([_jittered(rng, CLOTHS) for _ in range(DRAWS)])
    second = seconds[contrasts(seconds, first[None]).argmax()]
    plain, other = rng.random(), int(rng.integers(1, max(2, len(kinds))))
    kind = kinds[0] if plain < plain_share else kinds[other]
    return Cloth(kind, first, second, float(rng.uniform(0.05, 0.11)), int(rng.integers(2**31)))


def _jittered(
    rng: np.random.Generator, colours: tuple[tuple[float, float, float], ...]
) -> np.ndarray:
    colour = np.array(colours[int(rng.integers(len(colours)))])
    return np.clip(colour * rng.uniform(0.85, 1.15) + rng.normal(0, 0.02, 3), 0.03, 0.97)


def contrasts(colours: np.ndarray, avoid: np.ndarray) -> np.ndarray:
    """(N,) distance in CIELAB of each colour (N, 3) from the nearest of some others (K, 3)."""
    if not len(avoid):
        return np.full(len(colours), np.inf)
    ours, theirs = (
        cv2.cvtColor(c.astype(np.float32)[None], cv2.COLOR_RGB2LAB)[0] for c in (colours, avoid)
    )
    apart: np.ndarray = np.linalg.norm(ours[:, None] - theirs, axis=-1).min(axis=1)
    return apart
