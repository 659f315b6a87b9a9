"""Which way is up, and how high the ground is, from all that tells, each by its own error.

People keep their mass above their feet.  The ground that was reconstructed about a person's feet,
and the soles that stand on it, are one plane, which is level nearly everywhere.  So bodies,
vertical lines of the background, and a phone's own gravity where there is one, say whether that
plane may be level: if it may, it tells up far better than bodies do; if not, as on a slope, a ramp
or stairs, up is theirs and the ground stays as steep as it is (a mixture of two normal
distributions, of which the likelier one is taken).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from pydantic.dataclasses import dataclass as part

from gmrdata.motion.ground import LOW_PERCENTILE, support_m
from gmrdata.values import transforms
from gmrdata.values.body import JOINT, N_JOINTS, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.records import PART, Config, Figure
from gmrdata.values.skinning import motion_joints_m
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m

CueName = Literal["bodies", "gravity", "lines", "contacts", "feet", "ground", "picture"]
BALANCE_SIGMA_RAD = np.deg2rad(4.0)
"""Of the direction in which a person's mass is above its feet, along each of two axes: mostly how a
system sees the body (docs/figures.md).  Where a trunk is upright tells much less."""
TRUNK_SIGMA_RAD = np.deg2rad(12.0)
STEEP_VIEW_RAD = np.deg2rad(50.0)
"""Error of bodies' up toward the camera, per 1 - cos of the angle from which a person is seen above
or below: networks see people more upright than they are.  Of nine people seen by 50 degrees from
above (CMU Panoptic) 15 and 12 (sd) degrees, of twelve by 7 to 27 one and 10."""
STEEP_SIZE = 0.5
"""And that of the distance, as a share: 12 % by 50 degrees."""
BENT_RAD, BENT_SIGMA_RAD = np.deg2rad(45.0), np.deg2rad(20.0)
"""A trunk so far from that direction is bent; of people who are so most of the time, since hands on
the floor may carry them."""
SHARED = 0.5  # share of that variance which people of one system have in common
BODY_TIME_S = 2.0  # over which a person keeps leaning the same way
STANDS = 0.75  # a mass that is lower over the feet, as a share of that at rest, sits or lies
LOW = 0.95
"""And one that is a little lower: of people who crouch, who bow, and who sit on a chair or on the
floor with legs stretched out."""
OVER_SOLES_RAD = np.deg2rad(15.0)
"""From a sole's normal to the direction of the mass: 0 to 5 degrees of who crouches or bows with
flat feet, 25 to 45 on a chair, whose back holds the mass behind the feet."""
STRAIGHT_RAD = np.deg2rad(30.0)  # of a knee that is hardly bent, and of a trunk in line with legs
FEWEST_S = 0.1  # of standing that is believed
SPEED_TIME_S = 0.1
FEET_M2 = 0.04
"""Variance of places of feet on one spot, along each axis: the plane of soles turns with the body
there, and is as wrong as it."""
ON_A_PLANE_M = 0.05  # soles further from one plane (RMS) are not on flat ground
GROUND_SIGMA_RAD = np.deg2rad(0.7)
"""Of the plane of reconstructed points: floors, and a reconstruction that bends."""
MASSES = np.zeros(N_JOINTS)
"""Shares of a body's mass at its joints: each segment's lies between its ends (de Leva 1996)."""
for _start, _end, _mass, _at in (
    ("pelvis", "neck", 0.435, 0.5), ("head", "head", 0.069, 0.0),
    *((f"{side}_{a}", f"{side}_{b}", mass, at) for side in ("left", "right") for a, b, mass, at in (
        ("hip", "knee", 0.142, 0.41), ("knee", "ankle", 0.043, 0.44), ("ankle", "foot", 0.014, 0.5),
        ("shoulder", "elbow", 0.027, 0.58), ("elbow", "wrist", 0.022, 0.7),
    )),
):  # fmt: skip
    MASSES[JOINT[_start]] += _mass * (1 - _at)
    MASSES[JOINT[_end]] += _mass * _at
POINTS_ALIKE = 10  # neighbouring points err together: so many of them tell as much as one
ONE_FLOOR_M = 0.15  # soles further from the ground, or from most others, stand on something else
UNSEEN_FLOOR_SIGMA_M = 0.25
"""Of the floor below legs that nobody saw: hips are 0.9 m above it, or on a chair 0.5."""
GRAVITY_SIGMA_RAD = np.deg2rad(0.5)
"""Of the direction that a phone's sensors give, along each of two axes: 0.4 degrees off a measured
floor, in the one recording at hand that has both."""
STEEP_SHARE, STEEP_SIGMA_RAD = 0.1, np.deg2rad(8.0)
"""Share of grounds that are not level, and how steep those are along each axis."""


UNSURE_RAD = np.deg2rad(60.0)
"""From the picture's up to the bodies', from which one of them is not up; and of up then, along
each axis.  Whoever lies straight has the pose of somebody who stands: only the picture tells."""
ASIDE_RAD = np.deg2rad(30.0)
"""The same to the picture's side alone, where cameras that look up or down tip by few degrees: 7 at
most at hand, and 45 of somebody who leans on the hands."""


@dataclass(frozen=True, eq=False)
class UpCue:
    """A direction that is up, as far as it tells: along some tilts it may tell nothing."""

    name: CueName
    up: np.ndarray  # (3,) unit
    precision: np.ndarray  # (3, 3) of its tilts, inverse variances [1/rad2]

    def near(self, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Its tilt (2,) away from a direction, along `across(up)`, and the precision (2, 2)."""
        axes = across(up)
        return axes @ self.up / max(0.1, float(self.up @ up)), axes @ self.precision @ axes.T


@part(frozen=True, config=PART)
class LevelCue:
    """What one source of evidence says about up."""

    name: CueName
    apart_deg: Figure
    """Between its direction and the one that was taken."""
    sigma_deg: Figure
    """Standard error of its angle, both axes together."""
    used: bool
    """False for a ground that is not level."""


class LevelEstimate(Config):
    """How level a world is."""

    sigma_deg: Figure
    """Standard error of the angle between z and up, both axes together."""
    cues: tuple[LevelCue, ...]
    soles_above_m: Figure | None
    """How high above z = 0 the highest tenth of standing soles stand; null where none stands."""
    floor_at_m: tuple[Figure, Figure] | None
    """x and y of the middle of the soles that say where z = 0 is; null where nobody noted it."""
    floor_sigma_m: Figure
    """Standard error of the height of z = 0, where a picture shows no feet; 0 where it does."""

    def with_soles(
        self, heights_m: np.ndarray, on_floor_m: np.ndarray | None = None, *, seen: bool = True
    ) -> "LevelEstimate":
        """The same of a world with standing soles (N,) that high above the floor, and with soles
        (M, 3) that say where it is: of legs that were seen, or were guessed."""
        high = 100.0 - LOW_PERCENTILE
        above_m = float(np.percentile(heights_m, high)) if len(heights_m) else None
        at_m = None if on_floor_m is None else tuple(np.median(on_floor_m, axis=0)[:2].tolist())
        sigma_m = 0.0 if seen else UNSEEN_FLOOR_SIGMA_M
        return self._with(soles_above_m=above_m, floor_at_m=at_m, floor_sigma_m=sigma_m)

    def beside_picture(self, apart_deg: float) -> "LevelEstimate":
        """The same of a world of which the picture's up is that far off: who knows which is up."""
        sigma_deg = _angle_deg(UNSURE_RAD**2 * np.eye(2))
        said = LevelCue(name="picture", apart_deg=apart_deg, sigma_deg=sigma_deg, used=False)
        return self._with(sigma_deg=sigma_deg, cues=(*self.cues, said))

    def _with(self, **figures: Any) -> "LevelEstimate":
        """The same with other figures, rounded as all are."""
        return LevelEstimate(**dict(self) | figures)

    @property
    def tipped(self) -> str | None:
        """What one should know of a picture that is not upright in the world; None where it is."""
        off = [cue.apart_deg for cue in self.cues if cue.name == "picture"]
        if not off:
            return None
        why = "somebody lies, or the camera was on its side or looked steeply down"
        return f"up by the bodies is {off[0]:.0f} degrees from that of the picture: {why}"

    @property
    def remark(self) -> str | None:
        """What one should know of the floor; None where it is one."""
        above_m = self.soles_above_m or 0.0
        if above_m <= ONE_FLOOR_M:
            return None
        on = f"feet stand on up to {above_m:.1f} m: on steps or a slope, or the heights err"
        return f"{on}. z = 0 is where they stand low"


def across(up: np.ndarray) -> np.ndarray:
    """Two unit axes (2, 3) across a direction (3,)."""
    return np.asarray(np.linalg.svd(up[None])[2][1:])


def from_picture_rad(world_from_cam: np.ndarray, up: np.ndarray) -> tuple[float, float]:
    """Angle between a direction (3,) and up in the pictures of cameras (N, 4, 4), and what of it is
    to their sides: the medians."""
    aside, down, _ = np.clip(up @ world_from_cam[:, :3, :3], -1.0, 1.0).T
    return float(np.median(np.arccos(-down))), float(np.median(np.abs(np.arcsin(aside))))


def body_cue(
    bodies: Sequence[BodyModel],
    motions: Sequence[Motion],
    frames: Sequence[np.ndarray | None] | None = None,
    legs_seen: Sequence[np.ndarray | None] | None = None,
) -> UpCue:
    """Where people's masses are above their feet, on average over time; of a person who never
    stands, along the trunk.  By person, `frames` are as `balance` has them, and `legs_seen` (T,)
    says whether the legs were: what a network guesses of hidden ones goes on as the trunk does.

    Who keeps standing has the mass over the feet, also in a crouch, on one leg or on a walk: what
    it is off by in a moment averages out.  How a system sees people does not, only in part over
    them.
    """
    frames, legs_seen = (given or [None] * len(motions) for given in (frames, legs_seen))
    ups, variances = zip(*map(_upright_of, bodies, motions, frames, legs_seen), strict=True)
    weights = 1 / np.array(variances)
    shares = weights / weights.sum()
    up = shares @ np.array(ups)
    own_rad2, common_rad2 = (1 - SHARED) * shares**2, SHARED * shares
    sigma_rad2 = float((own_rad2 + common_rad2) @ np.array(variances))
    return UpCue("bodies", up / np.linalg.norm(up), np.eye(3) / sigma_rad2)


def seen_steeply(cue: UpCue, pelvis_m: Sequence[np.ndarray], cameras_m: np.ndarray) -> UpCue:
    """Bodies' up with the error that people have who are seen from above or below.

    Args:
        pelvis_m: (T, 3) of each person, in the cue's axes; NaN where unknown.
        cameras_m: (T, 3) where the camera is; NaN where unknown.
    """
    rays = np.concatenate([one - cameras_m for one in pelvis_m])
    rays = rays[np.isfinite(rays).all(axis=1)]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    above = rays @ cue.up
    level = rays - above[:, None] * cue.up
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9)
    # What a camera on the other side sees errs the other way.
    errors = STEEP_VIEW_RAD * (1 - np.sqrt(1 - np.minimum(above**2, 1.0))) * np.sign(above)
    common = (errors[:, None] * level).mean(axis=0)
    covariance = np.linalg.inv(cue.precision) + np.outer(common, common)
    return replace(cue, precision=np.linalg.inv(covariance))


def steep_size_sigma(body: BodyModel, motion: Motion) -> float:
    """Error of a person's distance before the camera, as a share, from the angle between the body
    and the picture: who is seen from above seems further away."""
    trunk_m = motion_joints_m(body, motion)[:, JOINT["neck"]] - motion.pelvis_m
    along = (trunk_m * motion.pelvis_m).sum(axis=1)
    along /= np.linalg.norm(trunk_m, axis=1) * np.linalg.norm(motion.pelvis_m, axis=1)
    return float(STEEP_SIZE * (1 - np.sqrt(1 - np.minimum(along**2, 1.0))).mean())


def _upright_of(
    body: BodyModel,
    motion: Motion,
    frames: np.ndarray | None,
    legs_seen: np.ndarray | None,
) -> tuple[np.ndarray, float]:
    """A person's mean direction (3,), and its variance along each axis [rad2]."""
    above_m, weights = balance(body, motion, frames)
    if legs_seen is not None:
        weights = weights * legs_seen
    joints_m = motion_joints_m(body, motion)
    trunk_m = joints_m[:, JOINT["neck"]] - joints_m[:, 0]
    bent = _cosines(trunk_m, above_m) < np.cos(BENT_RAD)
    sigma_rad = BALANCE_SIGMA_RAD
    if weights.sum() < FEWEST_S * motion.fps_hz:
        above_m, weights, sigma_rad = trunk_m, np.ones(len(joints_m)), TRUNK_SIGMA_RAD
    elif weights @ bent > weights.sum() / 2:
        sigma_rad = BENT_SIGMA_RAD
    up = weights @ above_m
    up /= np.linalg.norm(up)
    directions = above_m / np.linalg.norm(above_m, axis=1, keepdims=True)
    off_rad2 = ((directions @ across(up).T) ** 2).mean(axis=1)
    spread_rad2 = float(weights @ off_rad2 / weights.sum())
    seconds = weights.sum() / motion.fps_hz
    return up, sigma_rad**2 + spread_rad2 / max(1.0, seconds / BODY_TIME_S)


def balance(
    body: BodyModel, motion: Motion, frames: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Where a person's mass is over what the feet stand on, (T, 3) [m], and how far they do, (T,):
    1 at rest, 0 of somebody who sits or lies.

    `frames` (T,) are the rows' numbers at the motion's rate, rising: how long a gap lasts, so that
    who comes back elsewhere did not fly there.  None has no gaps.
    """
    soles_m = foot_points_m(body, motion)[:, :, SOLE_POINTS]
    feet_m = soles_m.mean(axis=2)
    reach = max(1, round(SPEED_TIME_S * motion.fps_hz / 2))
    frames = np.arange(len(feet_m)) if frames is None else frames
    before = np.maximum(np.searchsorted(frames, frames - reach, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(frames, frames + reach), len(frames) - 1)
    seconds = np.maximum(frames[after] - frames[before], 1)[:, None] / motion.fps_hz
    speeds = np.linalg.norm(feet_m[after] - feet_m[before], axis=-1) / seconds
    stood_on_m, carried = support_m(feet_m, speeds)
    joints_m = motion_joints_m(body, motion)
    above_m = np.einsum("j,tjk->tk", MASSES, joints_m) - stood_on_m
    rest_m = body.rest_joints_m(motion.shape)
    usual_m = float((MASSES @ rest_m - rest_m[[JOINT["left_foot"], JOINT["right_foot"]]].min(0))[1])
    heights = np.linalg.norm(above_m, axis=1) / usual_m
    stands = (heights > LOW) | ((heights > STANDS) & ~_sits(joints_m, soles_m, above_m))
    # Little of a moment in which no foot stands, as in a run.
    return above_m, carried * stands


def _sits(joints_m: np.ndarray, soles_m: np.ndarray, above_m: np.ndarray) -> np.ndarray:
    """(T,) bool: of people whose mass is low, by joints (T, 24, 3), soles (T, 2, 3, 3) and where
    the mass is (T, 3): who has it over neither sole, or has straight legs and bent hips.

    The latter sits with legs stretched out, or is in a deep bow: no pose tells which.
    """
    ahead = _cosines(soles_m[:, :, 2] - soles_m[:, :, 0], above_m[:, None])
    beside = np.abs(ahead).min(axis=1) > np.sin(OVER_SOLES_RAD)
    hips_m, knees_m, ankles_m = (
        joints_m[:, [JOINT[f"{side}_{part}"] for side in ("left", "right")]]
        for part in ("hip", "knee", "ankle")
    )
    straight = _cosines(knees_m - hips_m, ankles_m - knees_m).min(axis=1) > np.cos(STRAIGHT_RAD)
    trunk_m = joints_m[:, JOINT["neck"]] - joints_m[:, 0]
    bent = _cosines(trunk_m, above_m) < np.cos(STRAIGHT_RAD)
    return np.asarray(beside | (straight & bent))


def _cosines(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of the angles between vectors (..., 3)."""
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.asarray((a * b).sum(axis=-1) / np.maximum(lengths, 1e-12))


def contact_cue(
    planted_m: Sequence[np.ndarray], stances: int, up: np.ndarray, sigma_m: float
) -> UpCue | None:
    """The plane of each person's soles (M, 3) [m] that stand in so many stances, each off it by a
    standard error, about a rough up; None where they lie on no plane, or are too few.  Soles along
    a line tell of the tilt along it alone, and one person's nothing beside another's: who is larger
    than the body stands too near, and so on another plane.  The less people travel, the more the
    plane tilts as their bodies do."""
    centred = [own_m - own_m.mean(axis=0) for own_m in planted_m if len(own_m)]
    centred_m = np.concatenate([np.zeros((0, 3)), *centred])
    if len(centred_m) < 3:
        return None
    axes = across(up)
    places_m, heights_m = centred_m @ axes.T, centred_m @ up
    weight = min(1.0, max(1, stances) / len(centred_m)) / sigma_m**2
    precision = weight * places_m.T @ places_m
    # Hardly anything is asked of tilts of which the soles tell nothing.
    tilt = np.linalg.solve(precision + np.eye(2), weight * places_m.T @ heights_m)
    if np.sqrt(np.mean((heights_m - places_m @ tilt) ** 2)) > ON_A_PLANE_M:
        return None
    told, along = np.linalg.eigh(precision)
    # Share of the body's own tilt that the plane has.
    own = np.minimum(1.0, FEET_M2 * weight * len(places_m) / np.maximum(told, 1e-12))
    told /= 1 + told * (BALANCE_SIGMA_RAD * own) ** 2
    normal = up - tilt @ axes
    along = along.T @ axes
    return UpCue("contacts", normal / np.linalg.norm(normal), along.T * told @ along)


def ground_cue(normal: np.ndarray, on_plane_m: np.ndarray, rms_m: float) -> UpCue:
    """The plane with a unit normal (3,) through reconstructed points (N, 3) on it [m]."""
    axes = across(normal)
    places_m = (on_plane_m - on_plane_m.mean(axis=0)) @ axes.T
    told = places_m.T @ places_m / POINTS_ALIKE / max(rms_m, 1e-6) ** 2
    precision = np.linalg.inv(np.linalg.inv(told + np.eye(2)) + GROUND_SIGMA_RAD**2 * np.eye(2))
    return UpCue("ground", normal, axes.T @ precision @ axes)


def gravity_cue(world_from_cam: np.ndarray, up_cam: np.ndarray) -> UpCue | None:
    """What a phone felt as up (N, 3), in the axes of cameras (N, 4, 4), NaN where it says nothing;
    as unsure as its directions differ in the world.  None where it says nothing at all."""
    felt = np.einsum("nij,nj->ni", world_from_cam[:, :3, :3], up_cam)
    felt = felt[np.isfinite(felt).all(axis=1)]
    if not len(felt):
        return None
    up = felt.mean(axis=0) / np.linalg.norm(felt.mean(axis=0))
    spread_rad2 = float(((felt @ across(up).T) ** 2).mean())
    return UpCue("gravity", up, np.eye(3) / (GRAVITY_SIGMA_RAD**2 + spread_rad2))


def up_of(steady: Sequence[UpCue], ground: Sequence[UpCue]) -> tuple[np.ndarray, LevelEstimate]:
    """Up (3,), of cues that tell it anywhere, as bodies, lines and what a phone felt, and of cues
    of the ground, and how sure that is."""
    # The second of three, since along its own direction a cue may tell nothing.
    base = max(steady, key=lambda cue: float(np.linalg.eigvalsh(cue.precision)[1])).up
    tilts, precisions = zip(*(cue.near(base) for cue in (*steady, *ground)), strict=True)
    pulls = [p @ t for p, t in zip(precisions, tilts, strict=True)]
    n, none = len(steady), np.zeros((2, 2))
    own, of_ground = sum(precisions[:n], none), sum(precisions[n:], none)
    own_pull, ground_pull = sum(pulls[:n], none[0]), sum(pulls[n:], none[0])
    beside = ground_pull - of_ground @ np.linalg.solve(own, own_pull)
    level = not ground or _may_be_level(of_ground, beside, own)
    covariance = np.linalg.inv(own + of_ground if level else own)
    up = base + covariance @ (own_pull + ground_pull if level else own_pull) @ across(base)
    up /= np.linalg.norm(up)
    cues = tuple(
        LevelCue(
            name=cue.name,
            apart_deg=float(np.rad2deg(np.arccos(np.clip(cue.up @ up, -1.0, 1.0)))),
            sigma_deg=_angle_deg(np.linalg.inv(p + 1e-6 * np.eye(2))),
            used=level or number < n,
        )
        for number, (cue, p) in enumerate(zip((*steady, *ground), precisions, strict=True))
    )
    sigma_deg = _angle_deg(covariance)
    return up, LevelEstimate(
        sigma_deg=sigma_deg, cues=cues, soles_above_m=None, floor_at_m=None, floor_sigma_m=0.0
    )


def _may_be_level(of_ground: np.ndarray, pull: np.ndarray, own: np.ndarray) -> bool:
    """Whether a ground that tilts from the others' up by (of_ground)^-1 pull is likelier level."""
    ground = np.linalg.inv(of_ground + 1e-3 * np.eye(2))
    tilt, spread = ground @ pull, ground + np.linalg.inv(own)
    chances = []
    for share, more_rad in ((1 - STEEP_SHARE, 0.0), (STEEP_SHARE, STEEP_SIGMA_RAD)):
        whole = spread + more_rad**2 * np.eye(2)
        chances.append(
            np.log(share)
            - 0.5 * (np.linalg.slogdet(whole)[1] + tilt @ np.linalg.solve(whole, tilt))
        )
    return bool(chances[0] >= chances[1])


def _angle_deg(covariance: np.ndarray) -> float:
    """Standard error of an angle of two tilts (2, 2) [rad2]; at most that of any direction."""
    return float(min(90.0, np.rad2deg(np.sqrt(np.trace(covariance)))))


def soles_on_floor_m(standing_m: np.ndarray, soles_m: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Those soles (N, 3) of which the median is on the floor.

    Of standing ones (M, 3) all, so that their errors make it neither too low nor too high; on steps
    and slopes the low ones.  Where none stands, as in a run, the low ones of soles (T, ..., 3),
    NaN where unknown: in each frame the lowest.
    """
    if len(standing_m):
        if np.median(standing_m @ up) - _low_m(standing_m, up) <= ONE_FLOOR_M:
            return standing_m
    else:
        of_frames_m = soles_m.reshape(len(soles_m), -1, 3)
        of_frames_m = of_frames_m[np.isfinite(of_frames_m).all(axis=(1, 2))]
        lowest = (of_frames_m @ up).argmin(axis=1)
        standing_m = of_frames_m[np.arange(len(lowest)), lowest]
    return low_soles_m(standing_m, up)


def low_soles_m(soles_m: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Those of soles (N, 3) that are as low as the lowest tenth, or little higher."""
    return np.asarray(soles_m[soles_m @ up <= _low_m(soles_m, up) + ON_A_PLANE_M])


def _low_m(soles_m: np.ndarray, up: np.ndarray) -> float:
    return float(np.percentile(soles_m @ up, LOW_PERCENTILE))


def level_from_world(
    up: np.ndarray, floor_m: float, first_pelvis_m: np.ndarray, forward: np.ndarray
) -> np.ndarray:
    """Transform (4, 4) to a world with z up from one in which `up` (3,) is, and the floor so high
    along it [m].  The first pelvis is above the origin, and `forward` (3,) looks along +y."""
    rotation = _upright(up, forward)
    origin_m = rotation @ first_pelvis_m
    origin_m[2] = floor_m
    return transforms.rigid(rotation, -origin_m)


def _upright(up: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that takes `up` to +z and the horizontal part of `forward` to +y."""
    level_forward = forward - up * (up @ forward)
    if np.linalg.norm(level_forward) < 1e-6:  # looking straight up or down: any heading will do
        level_forward = np.linalg.svd(up[None])[2][1]
    y = level_forward / np.linalg.norm(level_forward)
    return np.stack([np.cross(y, up), y, up])
