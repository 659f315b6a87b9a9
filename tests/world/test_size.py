"""People of a size that was told, or that the scale of all tells."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.world.recipe import CueEstimate
from gmrdata.world.scale import fuse
from gmrdata.world.size import height_m, height_of, heights_of, of_height, of_size
from tests.motions import made_up


@pytest.fixture
def standing_person(anny) -> Motion:
    local, root = np.tile(np.eye(3), (2, 23, 1, 1)), np.tile(np.diag([1.0, -1, -1]), (2, 1, 1))
    given = {"shape": np.zeros(anny.n_shape), "body": "anny", "frame": "camera"}
    return made_up(local, root, np.array([[0.3, 0.2, 4.0], [0.5, 0.2, 4.0]]), **given)


@pytest.mark.parametrize("told_m", [1.5, 1.64, 1.95])
def test_a_body_of_a_height_lies_where_it_did_in_the_picture(anny, standing_person, told_m):
    told = of_height(standing_person, anny, told_m)
    assert height_m(anny, told.shape) == pytest.approx(told_m, abs=1e-3)
    before, after = (motion_joints_m(anny, one) for one in (standing_person, told))
    seen, now = (joints[..., :2] / joints[..., 2:] for joints in (before, after))
    # Proportions change a little with the height: by 3 % of a body 0.42 high in the picture.
    assert np.abs(seen - now).max() < 0.012


def test_the_dancer_of_whom_the_pelvis_height_is_known(anny, standing_person):
    """Its pelvis stands at 0.897 m, as that of a default body of 1.64 m."""
    shape = of_height(standing_person, anny, 1.64).shape
    pelvis_m = anny.rest_joints_m(shape)[0, 1] - anny.rest_vertices_m(shape)[:, 1].min()
    assert pelvis_m == pytest.approx(0.897, abs=1e-3)


def test_a_factor_moves_a_person_by_it(anny, standing_person):
    larger = of_size(standing_person, anny, 1.05)
    np.testing.assert_allclose(larger.pelvis_m, 1.05 * standing_person.pelvis_m, rtol=1e-3)


def test_a_body_of_one_size_is_no_larger(anny, standing_person):
    stiff = replace(anny, shape_dirs_m=0 * anny.shape_dirs_m)
    assert of_size(standing_person, stiff, 1.05) is standing_person
    with pytest.raises(BadRecipe, match="the body anny-2 has one size only"):
        of_height(standing_person, stiff, 1.6)


def test_a_height_is_of_one_or_of_everybody():
    heights = heights_of({"everybody": 1.7, "person_1": 1.8})
    assert [height_of(name, heights) for name in ("person_0", "person_1")] == [1.7, 1.8]
    assert height_of("person_0", heights_of(None)) is None
    with pytest.raises(BadRecipe, match=r"height 178 m of person_0: it is in metres"):
        heights_of({"person_0": 178.0})


def cue(scale: float, person: int) -> CueEstimate:
    return CueEstimate("ground_contact", scale, 0.02, 9, 0.01, person)


def test_one_person_carries_the_whole_spread_of_sizes():
    feet = replace(cue(2.0, 0), name="planted_feet")
    fused = fuse((feet, cue(2.0, 0)), 0.0, (0.07,))
    assert fused.sigma == pytest.approx(np.hypot(0.14, 0.02 / np.sqrt(2)))
    assert fused.sizes[0] == pytest.approx((1.0, 0.07), rel=1e-3)


def test_two_cues_of_one_person_give_a_scale_between_them():
    """Their common error was a share of each one's own scale: the mean was 0.967."""
    cues = (
        CueEstimate("planted_feet", 1.0, 0.01, 9, 0.01, 0),
        CueEstimate("ground_contact", 1.05, 0.0105, 9, 0.01, 0),
    )
    fused, alone = fuse(cues, 0.0, (0.07,)), fuse(cues)
    assert fused.scale == pytest.approx(1.0238, abs=1e-4) == alone.scale
    assert fused.sigma == pytest.approx(np.hypot(0.07 * 1.0238, alone.sigma or 0.0), rel=1e-3)
    exact = fuse((replace(cues[0], sigma=0.0), cues[1]), 0.0, (0.07,))
    assert exact.scale == pytest.approx(1.0)


def test_two_people_share_the_scale_and_get_their_sizes_from_it():
    """One is of 0.95 of its body's size, the other of 1.05: neither cue is wrong."""
    fused = fuse((cue(1.9, 0), cue(2.1, 1)), 0.0, (0.07, 0.07))
    assert fused.scale == pytest.approx(2.0, rel=0.01) and fused.sigma is not None
    assert fused.sigma < 0.07 * 2 and (fused.disagreement or 9) < 1.5
    assert fused.sizes[0][0] == pytest.approx(1.05, abs=0.006)
    assert fused.sizes[1][0] == pytest.approx(0.95, abs=0.006)


def test_a_height_that_was_told_holds_the_scale_for_all():
    fused = fuse((cue(1.9, 0), cue(2.1, 1)), 0.0, (0.015, 0.07))
    assert fused.scale == pytest.approx(1.92, abs=0.01)
    assert fused.sizes[0][0] == pytest.approx(1.0, abs=0.01)
    assert fused.sizes[1][0] == pytest.approx(0.92, abs=0.01)
    assert fused.sizes[1][1] == pytest.approx(np.hypot(0.015, np.sqrt(2) * 0.01), abs=0.002)
