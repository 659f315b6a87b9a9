"""A world motion as BVH: Mixamo's joint names, centimetres, y up, the T-pose as zero pose."""

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.source_motion import HIGHEST_HZ, LOWEST_HEADER_HZ, rate_of_frame_time_hz
from gmrdata.values.body import JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.files import write_text
from gmrdata.values.joint_names import MIXAMO
from gmrdata.values.motion import Motion

ORDER = "ZXY"  # rotation channels, applied in this order about the joint's own moving axes
CENTIMETRES = 100.0
_BVH_NAME = {joint: name for name, joint in MIXAMO.items()}
_CHILDREN = [[c for c, parent in enumerate(PARENTS) if parent == j] for j in range(len(PARENTS))]


def write_bvh(path: Path, motion: Motion, body: BodyModel) -> None:
    """Write a z-up motion with its body's skeleton; in the file y is up and z is what was -y."""
    rest_joints_m = body.rest_joints_m(motion.shape)
    tips_m = _tips_m(body, motion.shape, rest_joints_m)
    order = _depth_first(0)
    rotmats = motion.rotmats
    rotmats[:, 0] = WORLD_FROM_REST.T @ rotmats[:, 0]
    pelvis_cm = motion.pelvis_m @ WORLD_FROM_REST * CENTIMETRES
    rows = np.concatenate([pelvis_cm, _angles_deg(rotmats[:, order])], axis=1)
    lines = [
        "HIERARCHY",
        *_joint_lines(0, 0, rest_joints_m, tips_m),
        "MOTION",
        f"Frames: {motion.n_frames}",
        f"Frame Time: {frame_time(motion.fps_hz)}",
        *(" ".join(f"{value:.6f}" for value in row) for row in rows),
    ]
    write_text(path, "\n".join(lines) + "\n")


def _angles_deg(rotmats: np.ndarray) -> np.ndarray:
    """(T, 3 J) angles of `ORDER` of rotations (T, J, 3, 3), each row's those that are nearest to
    the row before: programs that show a moment between two rows go straight from one to the other.
    """
    with warnings.catch_warnings():
        # At a right angle two of the three angles say the same; any pair of them will do.
        warnings.simplefilter("ignore", UserWarning)
        flat_deg = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_euler(ORDER, degrees=True)
    angles_deg = flat_deg.reshape(*rotmats.shape[:2], 3)
    for before, now in pairwise(angles_deg):
        either = np.stack([now, now * [1, -1, 1] + 180])  # both are the same rotation
        either += 360 * np.round((before - either) / 360)
        nearer = np.abs(either - before).sum(-1).argmin(axis=0)
        now[:] = np.where(nearer[:, None], either[1], either[0])
    return angles_deg.reshape(len(rotmats), -1)


def frame_time(fps_hz: float) -> str:
    """The shortest decimal number of seconds, of 7 digits or more, that is read as this rate.

    For a rate that is believed in no file, and is asked for with --fps-hz, it has 20.
    """
    most = 20 if LOWEST_HEADER_HZ <= fps_hz <= HIGHEST_HZ else 0
    texts = (f"{1 / fps_hz:.{digits}f}" for digits in range(7, most))
    rates = ((text, rate_of_frame_time_hz(text, Path(), 0)) for text in texts)
    return next((text for text, hz in rates if hz == fps_hz), f"{1 / fps_hz:.20f}")


def _joint_lines(
    joint: int, depth: int, rest_joints_m: np.ndarray, tips_m: dict[int, np.ndarray]
) -> list[str]:
    """One joint's block and those below it."""
    pad, is_root = "\t" * depth, PARENTS[joint] < 0
    offset_m = np.zeros(3) if is_root else rest_joints_m[joint] - rest_joints_m[PARENTS[joint]]
    positions = "Xposition Yposition Zposition " if is_root else ""
    rotations = " ".join(f"{axis}rotation" for axis in ORDER)
    lines = [
        f"{pad}{'ROOT' if is_root else 'JOINT'} {_BVH_NAME[JOINT_NAMES[joint]]}",
        pad + "{",
        f"{pad}\tOFFSET {_words(offset_m)}",
        f"{pad}\tCHANNELS {6 if is_root else 3} {positions}{rotations}",
    ]
    for child in _CHILDREN[joint]:
        lines += _joint_lines(child, depth + 1, rest_joints_m, tips_m)
    if joint in tips_m:
        end = ["End Site", "{", f"\tOFFSET {_words(tips_m[joint])}", "}"]
        lines += [f"{pad}\t{line}" for line in end]
    return [*lines, pad + "}"]


def _words(point_m: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in point_m * CENTIMETRES)


def _depth_first(joint: int) -> list[int]:
    """Joints in the order in which the file has them."""
    return [joint, *(j for child in _CHILDREN[joint] for j in _depth_first(child))]


def _tips_m(body: BodyModel, shape: np.ndarray, rest_joints_m: np.ndarray) -> dict[int, np.ndarray]:
    """Ends of the last bones (head, toes, hands) from their joints: the skin's farthest point."""
    vertices_m = body.rest_vertices_m(shape)
    carrier = body.skin_weights.argmax(axis=1)
    tips_m = {}
    for joint in (j for j, children in enumerate(_CHILDREN) if not children):
        bone_m = rest_joints_m[joint] - rest_joints_m[PARENTS[joint]]
        skin_m = vertices_m[carrier == joint] - rest_joints_m[joint]
        away = skin_m @ bone_m
        tips_m[joint] = skin_m[away.argmax()] if len(skin_m) and away.max() > 0 else bone_m / 2
    return tips_m
