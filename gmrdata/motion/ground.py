"""Feet and floor: the soles of a motion on z = 0, and flat feet of a source as those of the body.

Some recordings stand on a floor that their world's axes do not lie in: CMU's subjects 02 and 08,
for one, rise by up to 7 cm on a walk of 3 m.  Where the standing feet show a plane that is tilted
by at most 2.5 degrees, the whole motion is turned so that it is level; stairs, ramps and props are
left alone.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gmrdata.values.body import JOINT, N_JOINTS, PARENTS, BodyModel, gender_of
from gmrdata.values.motion import Motion
from gmrdata.values.motion_metrics import chunks, speeds_m_per_s
from gmrdata.values.skinning import (
    motion_joints_m,
    motion_vertices_m,
    posed_joints_m,
    with_ancestors,
)
from gmrdata.values.transforms import rotmats_from_quaternions, smallest_rotation

SIDES = ("left", "right")
PLANTED_M_PER_S = 0.2  # a foot counts as standing while its ankle and its toe joint are slower
STILL_M_PER_S = 0.25  # speed of a foot at which it carries a third of what one at rest does
SHORTEST_STAND_S = 0.1
LARGEST_SPREAD_DEG = 15.0
"""Quartile distance of the pitch of standing feet, beyond which it says nothing about flat ones."""
LARGEST_PITCH_DEG = 20.0
SMALLEST_SPLAY_DEG = 8.0
LARGEST_SPLAY_MISMATCH_DEG = 4.0

FOOT_JOINTS = tuple(JOINT[f"{side}_{part}"] for side in SIDES for part in ("ankle", "foot"))
OTHER_JOINTS = tuple(joint for joint in range(N_JOINTS) if joint not in FOOT_JOINTS)
JOINT_RADIUS_M = 0.04  # of what is about a hand, a knee or a head
SOLE_STRIPS = 4
"""Strips from back to front in which the lowest vertices of a foot part are looked for."""
LEVEL_M = 0.015  # standing soles are on a level if they are this near to it
FLOOR_SHARE = 0.25  # a level is a floor if this share of the standing soles is on it
DEEPEST_DIP_M = 0.15
"""A foot on tiptoe whose toes don't bend dips through the floor by no more than that."""
LOW_PERCENTILE = 10.0
"""On stairs, ramps and props, the floor is that percentile of the height of standing soles: low,
but not the lowest, which is where a foot dips through."""
SHORTEST_SPREAD_M = 0.4
"""A tilt is looked for along directions in which the standing feet spread by this (1 sigma)."""
LARGEST_TILT_DEG = 2.5
OFF_FLOOR_M = 0.02  # so far from it feet seem to stand on the floor
LARGEST_RESIDUAL_M = 0.025
"""Standing feet are on one plane if 80 % of them are nearer to it than this."""


def motion_of(
    body: BodyModel,
    shape: np.ndarray,
    rotmats: np.ndarray,
    pelvis_m: np.ndarray,
    fps_hz: float,
    source: str,
) -> Motion:
    """A motion in the z-up world from rotations (T, 24, 3, 3), the root's first, and a path [m]."""
    local, root, person = rotmats[:, 1:], rotmats[:, 0], (body.name, gender_of(body))
    return Motion(local, root, pelvis_m, shape.copy(), fps_hz, *person, "world", source)


def levelled(body: BodyModel, motion: Motion, ground: bool) -> Motion:
    """The same on the floor where `ground` says so; `source` gets the tilt that was taken away."""
    motion, tilt_deg = put_on_floor(body, motion) if ground else (motion, 0.0)
    return replace(motion, source=f"{motion.source}, floor levelled by {tilt_deg:.1f} deg")


def put_on_floor(body: BodyModel, motion: Motion) -> tuple[Motion, float]:
    """Level the floor that a world motion shows and move it to z = 0; and the tilt it had [deg].

    Where no foot stands, the floor is under the lowest points: soles of a runner, and hands, knees
    or back of a person whom these carry.
    """
    soles_m = sole_points_m(body, motion)
    on_foot = _on_foot(body, motion, soles_m)
    # The lowest point of the lower foot in each frame in which it stands still.
    rows, lowest = np.arange(len(soles_m)), soles_m[:, :, 2].argmin(axis=1)
    speeds = speeds_m_per_s(soles_m, motion.fps_hz)[rows, lowest]
    standing_m = soles_m[rows, lowest][on_foot & (speeds < PLANTED_M_PER_S)]
    level_from_world = _level_rotation(standing_m)
    heights_m = (standing_m @ level_from_world.T)[:, 2]
    if not len(heights_m):
        heights_m = soles_m[:, :, 2].min(axis=1)
        heights_m[~on_foot] = _lowest_vertices_m(body, motion.take(~on_foot))
    pelvis_m = motion.pelvis_m @ level_from_world.T
    pelvis_m[:, 2] -= floor_height_m(heights_m)
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(level_from_world[2, 2], -1.0, 1.0))))
    root_rotmats = level_from_world @ motion.root_rotmats
    return replace(motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m), tilt_deg


def on_ground(body: BodyModel, motion: Motion) -> Motion:
    """The same on z = 0 if it is of somebody on foot whose floor lies elsewhere.

    A file of a body's own motion keeps the floor that it has, which need not be there.
    """
    floored, _ = put_on_floor(body, motion)
    off_m = np.abs(floored.pelvis_m - motion.pelvis_m)[:, 2].max()
    if off_m <= OFF_FLOOR_M or _on_foot(body, motion, sole_points_m(body, motion)).mean() < 0.5:
        return motion
    return replace(floored, source=f"{motion.source}, put on the floor")


def support_m(feet_m: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What feet (T, 2, 3) at speeds (T, 2) [m/s] stand on, (T, 3) [m], and how far they do, (T,):
    1 at rest, less the faster the slower one is."""
    # By the slower foot: of a jump, as where a depth is wrong, both feet carry 0 in a float.
    shares = np.exp((speeds.min(axis=1, keepdims=True) - speeds) / STILL_M_PER_S)
    stood_on_m = np.einsum("tf,tfk->tk", shares / shares.sum(axis=1, keepdims=True), feet_m)
    return stood_on_m, np.exp(-speeds.min(axis=1) / STILL_M_PER_S)


def lowest_others_m(joints_m: np.ndarray) -> np.ndarray:
    """(T,) height of the lowest point about joints (T, 24, 3) that are none of a foot [m]."""
    return np.asarray(joints_m[:, OTHER_JOINTS, 2].min(axis=1) - JOINT_RADIUS_M)


def _on_foot(body: BodyModel, motion: Motion, soles_m: np.ndarray) -> np.ndarray:
    """(T,) bool: frames in which a sole is lowest of all, so that hands or knees carry nobody."""
    return soles_m[:, :, 2].min(axis=1) < lowest_others_m(motion_joints_m(body, motion))


def _lowest_vertices_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """(T,) height of the lowest point of the skin [m]."""
    rows = chunks(motion.n_frames, len(body.template_m))
    lowest = [motion_vertices_m(body, motion, part)[..., 2].min(axis=1) for part in rows]
    return np.concatenate([np.zeros(0), *lowest])


def floor_height_m(heights_m: np.ndarray) -> float:
    """The lowest level on which soles stand often: the median of those (N >= 1) on it [m].

    A tenth of them may well be below: some recordings have tiptoes that dip through, or begin with
    toes that point down.  More of them, or further below, stand on a floor of their own.
    """
    heights_m = np.sort(heights_m)
    low_m = float(np.percentile(heights_m, LOW_PERCENTILE))
    lower, upper = (np.searchsorted(heights_m, heights_m + off_m) for off_m in (-LEVEL_M, LEVEL_M))
    on_level = upper - lower
    often = np.flatnonzero(on_level >= FLOOR_SHARE * len(heights_m))
    if not len(often):
        return low_m
    # The first of them lies on the level's lower edge, so the fullest one is looked for above it.
    near = heights_m <= heights_m[often[0]] + 2 * LEVEL_M
    fullest_m = heights_m[int(np.where(near, on_level, 0).argmax())]
    if low_m < fullest_m - DEEPEST_DIP_M:
        return low_m
    return float(np.median(heights_m[np.abs(heights_m - fullest_m) <= LEVEL_M]))


def sole_points_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """Some points of the soles over time, (T, P, 3) [m]."""
    return np.concatenate(soles_of_feet_m(body, motion), axis=1)


def soles_of_feet_m(body: BodyModel, motion: Motion) -> list[np.ndarray]:
    """The same of the left and of the right foot: they follow the ankle and toe joints rigidly, as
    skin hardly bends there."""
    rest_joints_m = body.rest_joints_m(motion.shape)
    legs, parents = with_ancestors(PARENTS, FOOT_JOINTS)
    joints_m, frame_from_joint = posed_joints_m(
        rest_joints_m[legs], motion.rotmats[:, legs], motion.pelvis_m, parents
    )
    soles_m = {
        j: joints_m[:, None, n]
        + (points - rest_joints_m[j]) @ frame_from_joint[:, n].swapaxes(-1, -2)
        for j, points in _sole_vertices_m(body, motion.shape).items()
        for n in [legs.index(j)]
    }
    feet = [[JOINT[f"{side}_{part}"] for part in ("ankle", "foot")] for side in SIDES]
    return [np.concatenate([soles_m[j] for j in foot], axis=1) for foot in feet]


def _level_rotation(points_m: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that makes the plane of standing points (N, 3) level, or identity."""
    if len(points_m) < 3:
        return np.eye(3)
    centred = points_m - np.median(points_m, axis=0)
    variances, directions = np.linalg.eigh(np.cov(centred[:, :2].T))
    wide = directions[:, variances >= SHORTEST_SPREAD_M**2]
    if not wide.shape[1]:
        return np.eye(3)
    design = np.column_stack([centred[:, :2] @ wide, np.ones(len(centred))])
    weights = np.ones(len(centred))
    for _ in range(20):  # least absolute distances, by reweighting
        root = np.sqrt(weights)
        slopes = np.linalg.lstsq(design * root[:, None], centred[:, 2] * root, rcond=None)[0]
        residuals_m = np.abs(centred[:, 2] - design @ slopes)
        weights = 1.0 / np.maximum(residuals_m, 0.005)
    normal = np.append(-wide @ slopes[:-1], 1.0)
    on_plane = np.percentile(residuals_m, 80) <= LARGEST_RESIDUAL_M
    gentle = np.hypot(normal[0], normal[1]) <= np.tan(np.deg2rad(LARGEST_TILT_DEG))
    return smallest_rotation(normal, np.eye(3)[2]) if on_plane and gentle else np.eye(3)


def _sole_vertices_m(body: BodyModel, shape: np.ndarray) -> dict[int, np.ndarray]:
    """Rest positions of the sole's lowest vertices by the joint that carries them most [m].
    They are the lowest of the left and of the right half of each strip of a foot part."""
    vertices_m = body.rest_vertices_m(shape)
    carrier = body.skin_weights.argmax(axis=1)
    soles = {}
    for joint in FOOT_JOINTS:
        part = vertices_m[carrier == joint]
        if not len(part):
            soles[joint] = body.rest_joints_m(shape)[[joint]]
            continue
        edges = np.linspace(part[:, 2].min(), part[:, 2].max(), SOLE_STRIPS + 1)
        strip = np.searchsorted(edges[1:-1], part[:, 2])
        strips = [part[strip == n] for n in np.unique(strip)]
        sides = [(points, points[:, 0] >= points[:, 0].mean()) for points in strips]
        halves = [half for points, left in sides for half in (points[left], points[~left])]
        soles[joint] = np.stack([half[half[:, 1].argmin()] for half in halves if len(half)])
    return soles


def foot_corrections(
    rest_joints_m: np.ndarray,
    toe_tips_m: np.ndarray,
    body_rest_joints_m: np.ndarray,
    rotations: Mapping[int, np.ndarray],
    positions_m: Mapping[int, np.ndarray],
    fps_hz: float,
) -> tuple[dict[int, np.ndarray], float]:
    """C of the ankle and foot joints, and the pitch that a flat foot has in the motion [deg].

    Args:
        rest_joints_m: (24, 3) zero pose of the source in rest axes (x left, y up, z front) [m].
        toe_tips_m: (2, 3) toe tip relative to the toe joint in the zero pose, left and right [m];
            NaN where unknown.
        body_rest_joints_m: (24, 3) rest joints of the body, whose soles are level [m].
        rotations: `{SMPL joint: (T, 3, 3)}` G of the ankles and toe joints that the source has.
        positions_m: `{SMPL joint: (T, 3)}` their positions [m], y up.
    """
    flat = {
        side: _flat_frame(rest_joints_m, body_rest_joints_m, tip, side)
        for side, tip in zip(SIDES, toe_tips_m, strict=True)
    }
    unturned = {side: _heading(_foot_bone(body_rest_joints_m, side)).T for side in SIDES}
    corrections, pitch_deg = {}, {}
    for part in ("ankle", "foot"):
        pitch_deg[part] = _planted_pitch_deg(part, flat, rotations, positions_m, fps_hz)
        level = _turn(0, np.deg2rad(pitch_deg[part]))
        for side in SIDES:
            corrections[JOINT[f"{side}_{part}"]] = flat[side] @ level @ unturned[side]
    return corrections, pitch_deg["ankle"]


def _foot_bone(rest_joints_m: np.ndarray, side: str) -> np.ndarray:
    """Ankle to toe joint (3,) [m]."""
    return np.subtract(*(rest_joints_m[JOINT[f"{side}_{part}"]] for part in ("foot", "ankle")))


def _heading(bone: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) about y that takes z to a bone's horizontal direction."""
    return _turn(1, np.arctan2(bone[0], bone[2]))


def _turn(axis: int, angle_rad: float) -> np.ndarray:
    """The rotation (3, 3) about a coordinate axis."""
    quaternion = np.zeros(4)
    quaternion[[0, 1 + axis]] = np.cos(angle_rad / 2), np.sin(angle_rad / 2)
    return rotmats_from_quaternions(quaternion)


def _flat_frame(
    rest_joints_m: np.ndarray, body_rest_joints_m: np.ndarray, toe_tip_m: np.ndarray, side: str
) -> np.ndarray:
    """Axes of a foot in the zero pose, (3, 3): x sideways, y off the floor, z to the toes."""
    bone = _foot_bone(rest_joints_m, side)
    if not np.all(np.isfinite(bone)):  # no toe joint: as the body's
        return _heading(_foot_bone(body_rest_joints_m, side))
    leg = rest_joints_m[JOINT[f"{side}_ankle"]] - rest_joints_m[JOINT[f"{side}_hip"]]
    roll = _roll(leg, bone, toe_tip_m)
    return roll @ _heading(roll.T @ bone)


def _roll(leg: np.ndarray, foot_bone: np.ndarray, toe_bone: np.ndarray) -> np.ndarray:
    """How the zero pose tilts a foot sideways together with its leg: (3, 3), else identity.

    Only a clear splay counts, and only if the foot's own plane is tilted by the same angle: in a
    zero pose with flat feet, toes that point a little outwards tilt that plane, too.
    """
    splay_deg = np.rad2deg(np.arctan2(leg[0], -leg[1]))
    sideways = np.cross(toe_bone, foot_bone)
    if abs(splay_deg) < SMALLEST_SPLAY_DEG or not np.linalg.norm(sideways) > 0.0:
        return np.eye(3)
    tilt_deg = np.rad2deg(np.arctan2(sideways[1], np.hypot(sideways[0], sideways[2])))
    if abs(tilt_deg - splay_deg) > LARGEST_SPLAY_MISMATCH_DEG:
        return np.eye(3)
    return smallest_rotation(sideways * [1.0, 0.0, 1.0], sideways)


def _planted_pitch_deg(
    part: str,
    flat: Mapping[str, np.ndarray],
    rotations: Mapping[int, np.ndarray],
    positions_m: Mapping[int, np.ndarray],
    fps_hz: float,
) -> float:
    """Pitch of the foot's z axis, toes up, while it stands still; 0 where it can't be told."""
    pitches: list[np.ndarray] = []
    for side in SIDES:
        ankle, foot, joint = (JOINT[f"{side}_{p}"] for p in ("ankle", "foot", part))
        if ankle in positions_m and foot in positions_m:
            paths_m = np.stack([positions_m[ankle], positions_m[foot]], axis=1)
            still = (speeds_m_per_s(paths_m, fps_hz) < PLANTED_M_PER_S).all(axis=1)
            toes_up = (rotations[joint][still] @ flat[side][:, 2])[:, 1]
            pitches.append(np.rad2deg(np.arcsin(np.clip(toes_up, -1.0, 1.0))))
    all_deg = np.concatenate([[], *pitches])
    if all_deg.size < SHORTEST_STAND_S * fps_hz:
        return 0.0
    lower, median, upper = np.percentile(all_deg, [25, 50, 75])
    flat_feet = upper - lower <= LARGEST_SPREAD_DEG and abs(median) <= LARGEST_PITCH_DEG
    return float(median) if flat_feet else 0.0
