"""The 24-joint SMPL tree; BodyModel, a skinned body of it; which body a motion is of.

SMPL's shape coefficients come by size, so files with 10, 16 or 300 of them are of one space: fewer
are the same shape with zeros behind them.  Those of any other body must be as many as the body has.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.shapes import Float, Int

HANDS = {72: (22, 23), 156: (22, 37), 165: (25, 40)}
"""Where SMPL's two hand joints stand among the joints, by the number of pose values in a frame."""

WORLD_FROM_REST = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""W: from rest axes (y up, z front) to a z-up world."""

JOINT_NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee",
    "spine2", "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot",
    "neck", "left_collar", "right_collar", "head", "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
"""SMPL's joints in SMPL's order (Loper et al. 2015)."""

PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
"""Parent of each joint; the pelvis has none (-1).  A parent always comes before its children."""

SMPL_LEG_M = 0.78
"""Hip-knee-ankle of SMPL's neutral mean shape, rounded [m]; release differences are below 2 %."""
SMPL_REST_PELVIS_M = (-0.002, -0.223, 0.028)
"""J0 of SMPL's neutral mean shape, rounded, rest frame [m]."""

N_JOINTS = 24
N_LOCAL = 23  # joints with a local rotation: all but the pelvis, whose rotation is the root's

JOINT = {name: i for i, name in enumerate(JOINT_NAMES)}

_LEGS = tuple(
    (JOINT[f"{side}_{start}"], JOINT[f"{side}_{end}"])
    for side in ("left", "right")
    for start, end in (("hip", "knee"), ("knee", "ankle"))
)

MIRRORED = (0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20, 23, 22)
"""Index of each joint's counterpart on the other side of the body."""
MIRROR = (-1.0, 1.0, 1.0)
"""Diagonal of the reflection x -> -x that exchanges the sides, in the root's axes."""

PHENOTYPES = ("gender", "age", "muscle", "weight", "height", "proportions")
"""Anny's, each from 0 to 1: gender 0 is male and 1 female; age 2/3 is young and 1 old."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body whose vertices follow 24 joints by linear blend skinning (Loper et al. 2015).

    Rest frame: SMPL's T-pose, metres, x to the body's left, y up, z to the front.  Rest joints and
    rest vertices are linear in the shape, so a regressor is applied once, when the model is read.
    """

    name: str  # which body this is, as stored in clips: "anny-2", "smpl-neutral", ...
    template_m: np.ndarray  # (V, 3) rest vertices of the mean shape, rest frame [m]
    shape_dirs_m: np.ndarray  # (V, 3, S) vertex offset for one unit of each shape coefficient [m]
    joints_template_m: np.ndarray  # (24, 3) rest joints of the mean shape, rest frame [m]
    joint_shape_dirs_m: np.ndarray  # (24, 3, S) joint offset for one unit of each coefficient [m]
    skin_weights: np.ndarray  # (V, 24) share of each joint in each vertex; rows sum to 1
    faces: np.ndarray  # (F, 3) vertex indices, counter-clockwise seen from outside
    pose_dirs_m: np.ndarray | None
    """(V, 3, 207) vertex offset per entry of (local rotation - identity) [m], if it has them."""
    licence: str  # terms under which renders and arrays of this body may be passed on
    adult_shapes: np.ndarray | None = None  # (N, S) shapes of usual adults, to draw people from
    adult_phenotypes: np.ndarray | None = None  # (N, 6) `PHENOTYPES` of those adults

    @property
    def n_shape(self) -> int:
        """Number of shape coefficients S."""
        return int(self.shape_dirs_m.shape[2])

    def require_shape(self, found: tuple[int, ...]) -> None:
        """ValueError for coefficients of another number or form than (S,)."""
        if found != (self.n_shape,):
            raise ValueError(f"body {self.name} has {self.n_shape} shape coefficients, got {found}")

    def rest_joints_m(self, shape: np.ndarray) -> Float[np.ndarray, "24 3"]:
        """Rest joints of one shape (S,), rest frame [m]."""
        shape = np.asarray(shape, dtype=np.float64)
        return self.joints_template_m + self.joint_shape_dirs_m @ shape

    def rest_vertices_m(self, shape: np.ndarray) -> Float[np.ndarray, "vertices 3"]:
        """Rest vertices of one shape (S,), rest frame [m]."""
        return self.template_m + self.shape_dirs_m @ np.asarray(shape, dtype=np.float64)

    def rest_pelvis_m(self, shape: np.ndarray) -> Float[np.ndarray, "3"]:
        """J0(shape), by which SMPL's `trans` differs from the pelvis position [m]."""
        return self.rest_joints_m(shape)[0]


def require_local(motion: Motion) -> None:
    """BadMotionFile for local rotations of other joints, or of other frames than the root's."""
    found, wanted = motion.local_rotmats.shape, (motion.n_frames, N_LOCAL, 3, 3)
    if found != wanted:
        raise BadMotionFile(f"{motion.source}: local rotations {found}, and not {wanted}")


def leg_length_m(rest_joints_m: Float[np.ndarray, "24 3"]) -> float:
    """Hip-knee-ankle length of rest joints, mean of both sides [m]."""
    bones_m = [rest_joints_m[end] - rest_joints_m[start] for start, end in _LEGS]
    return float(sum(np.linalg.norm(bone_m) for bone_m in bones_m) / 2)


def vertex_rows(n_body_vertices: int, n_vertices: int | None) -> Int[np.ndarray, " n"]:
    """Rows of n vertices, evenly spread over the body's list; all of them for None or too few."""
    if n_vertices is None or n_vertices >= n_body_vertices:
        return np.arange(n_body_vertices)
    return (np.arange(n_vertices) * n_body_vertices) // n_vertices


def sole_vertices(
    body: BodyModel, rest_vertices_m: Float[np.ndarray, "vertices 3"], side: str, thickness_m: float
) -> Int[np.ndarray, " n"]:
    """Rows of the vertices of the "left" or "right" sole: so thick, from the foot's lowest one."""
    joints = [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]
    of_foot = np.flatnonzero(body.skin_weights[:, joints].sum(axis=1) > 0.5)
    heights_m = rest_vertices_m[of_foot, 1]
    return of_foot[heights_m < heights_m.min() + thickness_m]


def with_vertices(body: BodyModel, rows: Int[np.ndarray, " n"]) -> BodyModel:
    """The same body with some of its vertices and no faces; joints and shapes stay as they are."""
    return replace(
        body,
        template_m=body.template_m[rows],
        shape_dirs_m=body.shape_dirs_m[rows],
        skin_weights=body.skin_weights[rows],
        pose_dirs_m=None if body.pose_dirs_m is None else body.pose_dirs_m[rows],
        faces=np.zeros((0, 3), dtype=body.faces.dtype),
    )


def gender_of(body: BodyModel) -> str:
    """ "female" or "male" for a body whose name ends so, else "neutral"."""
    ending = body.name.rpartition("-")[2]
    return ending if ending in ("female", "male") else "neutral"


SMPL = "smpl-"
"""What the names of SMPL's bodies begin with; the gender follows."""
NEUTRAL = f"{SMPL}neutral"  # whose betas most other systems estimate
SMPL_SHAPES = 10  # coefficients in files of 3DPW, EMDB and most other systems; AMASS has 16


def shape_on(body: BodyModel, betas: np.ndarray) -> np.ndarray:
    """(S,) SMPL's coefficients, as many as the body has: cut, or zeros behind them."""
    shape = np.zeros(body.n_shape)
    kept = np.asarray(betas, dtype=np.float64)[: body.n_shape]
    shape[: len(kept)] = kept
    return shape


def body_of(motion: Motion, bodies: Iterable[BodyModel]) -> BodyModel | None:
    """The body that a motion is of, all of whose shape it has; None where it is not among them."""
    return next((body for body in bodies if _has_shape(body, motion)), None)


def _has_shape(body: BodyModel, motion: Motion) -> bool:
    shape = motion.shape
    if body.name != motion.body or shape.ndim != 1:
        return False
    by_size = body.name.startswith(SMPL) and not shape[body.n_shape :].any()
    return len(shape) == body.n_shape or by_size


def on_body(motion: Motion, body: BodyModel) -> Motion:
    """A motion with as many coefficients as its body has; itself if it has them or another body."""
    if motion.shape.size == body.n_shape or body_of(motion, [body]) is None:
        return motion
    return replace(motion, shape=shape_on(body, motion.shape))


def sized(body: BodyModel, n_shape: int) -> BodyModel:
    """The same body with so many coefficients: the first, or more that change nothing."""
    if n_shape == body.n_shape:
        return body
    more = ((0, 0), (0, 0), (0, max(0, n_shape - body.n_shape)))
    return replace(
        body,
        shape_dirs_m=np.pad(body.shape_dirs_m[..., :n_shape], more),
        joint_shape_dirs_m=np.pad(body.joint_shape_dirs_m[..., :n_shape], more),
    )


def of_equal_size(bodies: Sequence[BodyModel]) -> tuple[BodyModel, ...]:
    """The same bodies with as many coefficients as the one that has most."""
    size = max(body.n_shape for body in bodies)
    return tuple(sized(body, size) for body in bodies)


def names_of(bodies: Iterable[BodyModel]) -> str:
    """Names of bodies, for records and messages."""
    return ", ".join(body.name for body in bodies)
