"""A writer of small BVH files, and a person as BVH, for the tests of the motion readers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT_NAMES, PARENTS
from gmrdata.motion.joint_maps import MIXAMO


@dataclass(frozen=True, eq=False)
class WrittenBvh:
    """A skeleton as the test knows it; rows hold the channels of its joints in order."""

    names: Sequence[str]
    parents: Sequence[int]
    offsets: np.ndarray
    channels: Sequence[Sequence[str]]
    rows: np.ndarray
    tips: dict[int, np.ndarray]


def _bvh_lines(bvh: WrittenBvh, joint: int, depth: int) -> list[str]:
    pad = "\t" * depth
    lines = [
        f"{pad}{'ROOT' if bvh.parents[joint] < 0 else 'JOINT'} {bvh.names[joint]}",
        pad + "{",
        f"{pad}\tOFFSET " + " ".join(f"{x:.17g}" for x in bvh.offsets[joint]),
        f"{pad}\tCHANNELS {len(bvh.channels[joint])} " + " ".join(bvh.channels[joint]),
    ]
    children = [child for child, parent in enumerate(bvh.parents) if parent == joint]
    for child in children:
        lines += _bvh_lines(bvh, child, depth + 1)
    if not children:
        tip = " ".join(f"{x:.17g}" for x in bvh.tips.get(joint, np.zeros(3)))
        lines += [f"{pad}\tEnd Site", pad + "\t{", f"{pad}\t\tOFFSET {tip}", pad + "\t}"]
    return [*lines, pad + "}"]


@pytest.fixture(scope="session")
def write_bvh() -> Callable[..., Path]:
    """`write_bvh(path, WrittenBvh fields..., frame_time="0.01")`; joints in depth-first order."""

    def write(
        path: Path,
        names: Sequence[str],
        parents: Sequence[int],
        offsets: np.ndarray,
        channels: Sequence[Sequence[str]],
        rows: np.ndarray,
        tips: dict[int, np.ndarray] | None = None,
        frame_time: str = "0.01",
    ) -> Path:
        bvh = WrittenBvh(names, parents, offsets, channels, rows, tips or {})
        table = [" ".join(f"{x:.17g}" for x in row) for row in rows]
        head = ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {frame_time}"]
        path.write_text("\n".join(["HIERARCHY", *_bvh_lines(bvh, 0, 0), *head, *table, ""]))
        return path

    return write


POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Zrotation", "Xrotation", "Yrotation")


@pytest.fixture(scope="session")
def write_person(write_bvh: Callable[..., Path]) -> Callable[..., Path]:
    """`write_person(path, body, angles_deg (T, 24, 3), pelvis_m (T, 3), ...)`: a body as a BVH.

    Joints have Mixamo's names, lengths are centimetres, angles are in Z, X, Y order, and toes have
    tips ahead of them.  `axes_from_rest` (3, 3) writes it in other axes.
    """

    def write(
        path: Path,
        body: BodyModel,
        angles_deg: np.ndarray,
        pelvis_m: np.ndarray,
        *,
        prefix: str = "mixamorig:",
        axes_from_rest: np.ndarray | None = None,
        names: Sequence[str] | None = None,
        cm_per_unit: float = 1.0,
    ) -> Path:
        axes = np.eye(3) if axes_from_rest is None else axes_from_rest
        by_joint = {joint: prefix + name for name, joint in MIXAMO.items()}
        names = [by_joint[name] for name in JOINT_NAMES] if names is None else names
        rest_m = body.rest_joints_m(np.zeros(body.n_shape))
        offsets = rest_m - np.where(np.array(PARENTS)[:, None] < 0, 0.0, rest_m[list(PARENTS)])
        order = _depth_first(0)
        return write_bvh(
            path,
            [names[j] for j in order],
            [-1 if PARENTS[j] < 0 else order.index(PARENTS[j]) for j in order],
            offsets[order] @ axes.T * 100 / cm_per_unit,
            [(*POSITIONS, *ROTATIONS) if j == 0 else ROTATIONS for j in order],
            np.concatenate(
                [
                    pelvis_m @ axes.T * 100 / cm_per_unit,
                    angles_deg[:, order].reshape(len(angles_deg), -1),
                ],
                axis=1,
            ),
            tips={order.index(j): axes @ [0, 0, 7.0 / cm_per_unit] for j in (10, 11)},
        )

    return write


def _depth_first(joint: int) -> list[int]:
    children = [child for child, parent in enumerate(PARENTS) if parent == joint]
    return [joint, *(j for child in children for j in _depth_first(child))]
