"""People of the default body: usual adults, all different, who stand on the ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.training.default_body import (
    BMI_KG_PER_M2,
    STATURES_M,
    coefficients,
    further_directions,
    principal_directions,
    within_bounds,
)
from gmrdata.film.character import phenotypes_of, sample_person
from gmrdata.motion.files import read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.read.body_file import read_body, save_body
from gmrdata.values.body import JOINT, PHENOTYPES, BodyModel
from gmrdata.values.errors import BadBodyFile
from gmrdata.values.skinning import motion_vertices_m


@pytest.fixture(scope="module")
def shapes(anny: BodyModel) -> np.ndarray:
    """200 people."""
    return np.stack([sample_person(anny, np.random.default_rng(seed)) for seed in range(200)])


def test_200_people_are_within_the_bounds_of_usual_adults(
    anny: BodyModel, shapes: np.ndarray
) -> None:
    vertices_m = anny.template_m + np.einsum("vcs,ns->nvc", anny.shape_dirs_m, shapes)
    stature_m = np.ptp(vertices_m[:, :, 1], axis=1)
    a, b, c = (vertices_m[:, anny.faces[:, k]] for k in range(3))
    bmi = 1000 * np.einsum("nfi,nfi->n", a, np.cross(b, c)) / 6 / stature_m**2
    # Drawn people differ a little from the listed ones, who are within.
    assert STATURES_M[0] - 0.03 < stature_m.min() < 1.55
    assert 1.88 < stature_m.max() < STATURES_M[1] + 0.03
    assert BMI_KG_PER_M2[0] - 1 < bmi.min() < 18 and 30 < bmi.max() < BMI_KG_PER_M2[1] + 1
    joints_m = np.stack([anny.rest_joints_m(shape) for shape in shapes])
    leg_m = joints_m[:, JOINT["left_hip"], 1] - joints_m[:, JOINT["left_ankle"], 1]
    assert (leg_m / stature_m).min() > 0.43 and (leg_m / stature_m).max() < 0.53


def test_all_phenotypes_and_coefficients_vary(anny: BodyModel, shapes: np.ndarray) -> None:
    assert (shapes.std(axis=0) > 0.5).all()
    drawn = [phenotypes_of(anny, shape) for shape in shapes]
    spread = {name: np.ptp([person[name] for person in drawn if person]) for name in PHENOTYPES}
    assert min(spread.values()) > 0.25, spread
    assert anny.adult_phenotypes is not None
    gender = anny.adult_phenotypes[:, PHENOTYPES.index("gender")]
    assert ((gender < 0.1) | (gender > 0.9)).mean() > 0.5


def test_every_person_is_whole(anny: BodyModel, shapes: np.ndarray) -> None:
    """No shape turns triangles over: all are within a right angle of the mean person's."""

    def normals(vertices_m: np.ndarray) -> np.ndarray:
        a, b, c = (vertices_m[anny.faces[:, k]] for k in range(3))
        crossed = np.cross(b - a, c - a)
        return crossed / np.maximum(np.linalg.norm(crossed, axis=1), 1e-12)[:, None]

    usual = normals(anny.template_m)
    for shape in shapes[::10]:
        turned = (normals(anny.template_m + anny.shape_dirs_m @ shape) * usual).sum(axis=1) < 0
        assert turned.mean() < 0.002


def test_the_same_state_gives_the_same_person_and_no_two_are_alike(
    anny: BodyModel, shapes: np.ndarray
) -> None:
    np.testing.assert_array_equal(sample_person(anny, np.random.default_rng(7)), shapes[7])
    assert len(np.unique(shapes, axis=0)) == len(shapes)
    np.testing.assert_array_equal(
        sample_person(anny, np.random.default_rng(7), spread=0.5), 0.5 * shapes[7]
    )


def test_a_body_without_a_list_gets_coefficients_within_two_deviations(
    small_body: BodyModel,
) -> None:
    drawn = np.stack([sample_person(small_body, np.random.default_rng(n)) for n in range(100)])
    assert drawn.shape == (100, 10) and 1.5 < np.abs(drawn).max() <= 2
    assert phenotypes_of(small_body, drawn[0]) is None


def test_feet_are_on_the_ground_for_each_shape(
    anny: BodyModel, shapes: np.ndarray, cmu_dir: Path
) -> None:
    """The short, the tall and someone between, on a captured level walk and the embedded one."""
    legs_m = [-anny.rest_joints_m(shape)[JOINT["left_ankle"], 1] for shape in shapes]
    for person in np.argsort(legs_m)[[0, 100, -1]]:
        shape = shapes[person]
        captured = read_motion(cmu_dir / "amc" / "02_01.amc", anny, shape=shape)
        generated = make_gait("walk", 3.0, 10.0, anny, np.random.default_rng(1), shape=shape)
        for motion, step in ((captured, 24), (generated, 3)):
            np.testing.assert_array_equal(motion.shape, shape)
            rows = np.arange(0, motion.n_frames, step)
            lowest_m = motion_vertices_m(anny, motion, rows)[..., 2].min(axis=1)
            assert np.abs(lowest_m).mean() < 0.02


def test_the_list_of_adults_is_kept_and_checked(small_body: BodyModel, tmp_path: Path) -> None:
    shapes, phenotypes = np.eye(10)[:4], np.full((4, 6), 0.5)
    body = replace(small_body, adult_shapes=shapes, adult_phenotypes=phenotypes)
    save_body(tmp_path / "body.npz", body)
    found = read_body(tmp_path / "body.npz")
    assert found.adult_shapes is not None
    np.testing.assert_array_equal(found.adult_shapes, shapes)
    assert phenotypes_of(found, shapes[2]) == dict.fromkeys(PHENOTYPES, 0.5)
    for wrong in ({"adult_phenotypes": None}, {"adult_shapes": np.eye(9)[:4]}):
        save_body(tmp_path / "wrong.npz", replace(body, **wrong))
        with pytest.raises(BadBodyFile, match="adult_shapes"):
            read_body(tmp_path / "wrong.npz")


def test_further_directions_take_up_what_the_first_leave() -> None:
    rng = np.random.default_rng(0)
    points_m = rng.normal(size=(30, 5, 3)) @ np.diag([3.0, 2.0, 1.0])
    mean_m, dirs_m = principal_directions(points_m, 8)
    others_m = points_m[::2] * 1.5 + 0.1
    more_m = further_directions(others_m, mean_m, dirs_m, 6)
    flat, more = dirs_m.reshape(15, 8), more_m.reshape(15, 6)
    np.testing.assert_allclose(flat.T @ more, 0, atol=1e-10)
    both_m = np.concatenate([dirs_m, more_m], axis=-1)
    shapes = coefficients(others_m, mean_m, both_m)
    left_m = others_m - mean_m - np.einsum("pcs,ns->npc", both_m, shapes)
    np.testing.assert_allclose(left_m.reshape(-1, 15) @ both_m.reshape(15, 14), 0, atol=1e-9)


def test_who_is_too_tall_too_small_too_heavy_or_too_light_is_left_out(anny: BodyModel) -> None:
    mean_m = anny.template_m
    wide = np.array([1.35, 1.0, 1.35])
    people_m = np.stack([mean_m, 1.25 * mean_m, 0.8 * mean_m, mean_m * wide, mean_m / wide])
    assert within_bounds(people_m, anny.faces).tolist() == [True, False, False, False, False]
