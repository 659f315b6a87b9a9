"""Up and the floor, of bodies, soles and reconstructed ground."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import motion_of
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import angles_deg, rigid
from gmrdata.world.level import (
    BALANCE_SIGMA_RAD,
    UpCue,
    body_cue,
    contact_cue,
    gravity_cue,
    ground_cue,
    level_from_world,
    seen_steeply,
    soles_on_floor_m,
    steep_size_sigma,
    up_of,
)
from gmrdata.world.planted_feet import SOLE_POINTS, GroundPlane, foot_points_m
from gmrdata.world.pseudo_gt import _floor_m
from gmrdata.world.recipe import ScaleConfig
from tests.motions import moved

UP = np.array([0.0, 0.0, 1.0])
BODIES = UpCue("bodies", UP, np.eye(3) / BALANCE_SIGMA_RAD**2)


def _turn(degrees: float) -> np.ndarray:
    return np.asarray(Rotation.from_euler("x", degrees, degrees=True).as_matrix())


def leaning(degrees: float) -> np.ndarray:
    return np.asarray(_turn(degrees) @ UP)


def bodies_that_lean(degrees: float) -> UpCue:
    return UpCue("bodies", leaning(degrees), BODIES.precision)


def square_m(n: int = 60) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(-2, 2, (n, 2)), rng.normal(0, 0.005, n)])


def turned(motion: Motion, degrees: float) -> Motion:
    """The motion in a world that leans."""
    return moved(motion, rigid(_turn(degrees), np.zeros(3)))


@pytest.mark.parametrize("kind", ["walk", "side_step", "stand"])
def test_without_ground_up_is_where_a_persons_mass_is_above_its_feet(small_body, kind):
    motion = standing_still(small_body, 240)
    if kind != "stand":
        motion = make_gait(kind, 8.0, 30.0, small_body, np.random.default_rng(0))
    up, level = up_of([body_cue([small_body], [motion])], [])
    assert angles_deg(up, UP) < 2 * level.sigma_deg  # the rest pose stands on its heels
    leant, _ = up_of([body_cue([small_body], [turned(motion, 7.0)])], [])
    assert np.allclose(leant, _turn(7.0) @ up)
    assert 5.6 < level.sigma_deg < 7.5
    assert [(one.name, one.used) for one in level.cues] == [("bodies", True)]


def standing_still(body: BodyModel, n: int) -> Motion:
    rotmats = np.tile(np.eye(3), (n, 24, 1, 1))
    rotmats[:, 0] = _turn(90)
    pelvis_m = np.tile([0.0, 0.0, 0.95], (n, 1))
    return motion_of(body, np.zeros(body.n_shape), rotmats, pelvis_m, 30.0, "rest")


def test_who_sits_tells_up_by_the_trunk(small_body):
    sitting = posed(small_body, trunk=0, hip=-100, knee=130, ankle=0)
    up, level = up_of([body_cue([small_body], [sitting])], [])
    assert angles_deg(up, UP) < 10.0 and level.sigma_deg == pytest.approx(12 * np.sqrt(2), rel=1e-2)


def test_whose_legs_are_hidden_tells_up_by_the_trunk(small_body):
    """Behind a desk the legs that a network guesses go on as the trunk does, which leant by 30
    degrees, and an error of 8 was said."""
    bowing = posed(small_body, trunk=30, hip=0, knee=0, ankle=0)
    legs = [np.arange(bowing.n_frames) < n for n in (60, 0)]
    shown, hidden = (body_cue([small_body], [bowing], legs_seen=[one]) for one in legs)
    assert np.array_equal(shown.precision, body_cue([small_body], [bowing]).precision)
    _, level = up_of([hidden], [])
    assert level.sigma_deg == pytest.approx(12 * np.sqrt(2), rel=1e-2)


def test_a_jump_of_both_feet_tells_nothing_and_breaks_nothing(small_body):
    """A person seen in a frame with a wrong depth: both feet carried 0, and up was NaN."""
    still = standing_still(small_body, 100)
    pelvis_m = still.pelvis_m.copy()
    pelvis_m[50, 1] += 40.0
    cues = [
        body_cue([small_body], [replace(still, pelvis_m=m)]) for m in (still.pelvis_m, pelvis_m)
    ]
    assert angles_deg(cues[0].up, cues[1].up) < 1e-6


def test_who_is_seen_now_and_then_stood_between(small_body):
    """Rows 0.2 s apart counted as neighbours at 30 fps: feet at rest were never slow."""
    motion = make_gait("walk", 8.0, 30.0, small_body, np.random.default_rng(0))
    frames = np.arange(0, motion.n_frames, 6)
    cue = body_cue([small_body], [motion.take(frames)], [frames])
    up, level = up_of([cue], [])
    assert angles_deg(up, UP) < 3.0 and 9.0 < level.sigma_deg < 11.0


def posed(body: BodyModel, trunk: int, hip: int, knee: int, ankle: int) -> Motion:
    """Somebody who keeps still, by angles [degrees]: the trunk's forward, then those of legs."""
    motion = turned(standing_still(body, 60), trunk)
    local = motion.local_rotmats.copy()
    for side in ("left", "right"):
        for joint, degrees in (("hip", hip), ("knee", knee), ("ankle", ankle)):
            local[:, JOINT[f"{side}_{joint}"] - 1] = _turn(degrees)
    return replace(motion, local_rotmats=local)


SITTING = {
    "chair": (0, -90, 90, 0),
    "leaning back on it": (-15, -75, 90, 0),
    "at a desk": (15, -105, 90, 0),
    "legs stretched out": (0, -90, 0, 0),
    "reclined": (-25, -65, 0, 20),
}


@pytest.mark.parametrize("name", SITTING)
def test_who_sits_high_or_with_straight_legs_tells_up_by_the_trunk_too(anny, name):
    """Their mass is as far from the feet as of one who crouches, and was taken for up: it is 25 to
    80 degrees off, and 5.7 were told."""
    trunk_deg, *legs = SITTING[name]
    up, level = up_of([body_cue([anny], [posed(anny, trunk_deg, *legs)])], [])
    assert angles_deg(up, leaning(trunk_deg)) < 0.5
    assert level.sigma_deg == pytest.approx(12 * np.sqrt(2), rel=1e-2)


@pytest.mark.parametrize("pose", [(0, 0, 0, 0), (40, -90, 80, -30), (30, -75, 70, -25)])
def test_who_stands_or_crouches_tells_up_by_the_mass_over_the_soles(anny, pose):
    """Whose trunk may lean by 40 degrees; who stands as the T-pose does is on the heels."""
    up, level = up_of([body_cue([anny], [posed(anny, *pose)])], [])
    assert angles_deg(up, UP) < 5.8
    assert level.sigma_deg == pytest.approx(4 * np.sqrt(2), rel=1e-2)


def test_two_people_tell_more_than_one_and_share_what_their_system_errs(small_body):
    motion = standing_still(small_body, 300)
    one, two = (up_of([body_cue([small_body] * n, [motion] * n)], [])[1] for n in (1, 2))
    assert two.sigma_deg == pytest.approx(np.sqrt(0.75) * one.sigma_deg, rel=1e-3)


def along_deg(cue: UpCue, axis: np.ndarray) -> float:
    """Standard error of a cue's tilt along an axis."""
    return float(np.rad2deg(np.sqrt(axis @ np.linalg.inv(cue.precision) @ axis)))


@pytest.mark.parametrize(
    ("camera_m", "toward_deg"),
    [((0.0, -4.0, 1.0), 4.0), ((0.0, -4.0, 5.0), 15.2), ((0.0, -4.0, -3.0), 15.2)],
)
def test_up_of_who_is_seen_steeply_is_unsure_toward_the_camera(camera_m, toward_deg):
    """Networks see people more upright than they are, as of Panoptic's high cameras."""
    pelvis_m = np.tile([0.0, 0.0, 1.0], (20, 1))
    pelvis_m[3] = np.nan
    steep = seen_steeply(BODIES, [pelvis_m], np.tile(camera_m, (20, 1)))
    assert np.array_equal(steep.up, BODIES.up)
    assert along_deg(steep, np.eye(3)[1]) == pytest.approx(toward_deg, abs=0.1)
    assert along_deg(steep, np.eye(3)[0]) == pytest.approx(4.0)
    # From all around, one view's error is the other's opposite.
    angles = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    around_m = np.column_stack([4 * np.cos(angles), 4 * np.sin(angles), np.full(20, 5.0)])
    standing_m = np.tile([0.0, 0.0, 1.0], (20, 1))
    assert along_deg(seen_steeply(BODIES, [standing_m], around_m), np.eye(3)[1]) < 4.1


@pytest.mark.parametrize(("above_deg", "sigma"), [(0, 0.0), (15, 0.017), (50, 0.179)])
def test_who_is_seen_steeply_is_at_an_unsure_distance(small_body, above_deg, sigma):
    rotmats = np.tile(np.eye(3), (5, 24, 1, 1))
    rotmats[:, 0] = _turn(180 - above_deg)
    pelvis_m = np.tile([0.0, 0.0, 4.0], (5, 1))
    motion = motion_of(small_body, np.zeros(small_body.n_shape), rotmats, pelvis_m, 30.0, "rest")
    # The neck of this body is a little behind the pelvis.
    assert steep_size_sigma(small_body, motion) == pytest.approx(sigma, abs=0.03)


def contact_of(soles_m: np.ndarray, stances: int, up: np.ndarray, sigma_m: float) -> UpCue:
    cue = contact_cue([soles_m], stances, up, sigma_m)
    assert cue is not None
    return cue


def test_soles_all_round_correct_leaning_bodies():
    up, level = up_of([bodies_that_lean(6.0)], [contact_of(square_m(), 60, leaning(6.0), 0.02)])
    assert angles_deg(up, UP) < 0.3 and level.sigma_deg < 0.5


def test_soles_of_one_stance_tell_as_much_as_one_point():
    many, few = (contact_of(square_m(), n, UP, 0.2) for n in (60, 6))
    assert np.trace(many.precision) == pytest.approx(10 * np.trace(few.precision), rel=0.02)


def on_one_spot(body: BodyModel, degrees: float) -> tuple[np.ndarray, UpCue]:
    """The soles (M, 3) [m] of 100 steps on the spot by a body that leans all the time, and the
    direction of its mass."""
    motion = turned(standing_still(body, 100), degrees)
    rng = np.random.default_rng(0)
    steps_m = np.column_stack([rng.normal(0, 0.05, (100, 2)), np.zeros(100)]) @ _turn(degrees).T
    soles_m = foot_points_m(body, motion)[:, :, SOLE_POINTS] + steps_m[:, None, None]
    return soles_m.reshape(-1, 3), body_cue([body], [motion])


def test_soles_on_one_spot_lean_as_the_body_does(anny):
    """A minute of exercises said its level to 1.5 degrees, and was 5 off as the body."""
    soles_m, bodies = on_one_spot(anny, -5.0)
    up, level = up_of([bodies], [contact_cue([soles_m], 100, bodies.up, 0.02)])
    assert level.sigma_deg >= 4.0 and 3.0 < angles_deg(up, UP) < 2 * level.sigma_deg
    # Along a way of 4 m they tell well, and across it as on the spot.
    way_m = np.linspace(-2, 2, len(soles_m))[:, None] * [0.6, 0.8, 0.0]
    _, level = up_of([bodies], [contact_cue([soles_m + way_m], 100, bodies.up, 0.02)])
    assert level.sigma_deg == pytest.approx(4 / np.sqrt(2), rel=0.03)


def test_soles_along_a_line_correct_the_tilt_along_it_only():
    line_m = np.column_stack([np.zeros(30), np.linspace(0, 4, 30), np.zeros(30)])
    for soles_m, left_deg in ((line_m, 0.0), (line_m[:, [1, 0, 2]], 6.0)):
        up, _ = up_of([bodies_that_lean(6.0)], [contact_of(soles_m, 30, leaning(6.0), 0.02)])
        assert angles_deg(up, leaning(left_deg)) < 0.2


def test_people_of_other_sizes_on_planes_of_their_own_tilt_nothing():
    """A woman behind a man seemed to stand on another floor: the world tilted by 2 degrees."""
    one_m, behind_m = square_m(), square_m() + np.array([0.0, 4.0, 0.2])
    up, _ = up_of([bodies_that_lean(0.0)], [contact_cue([one_m, behind_m], 60, UP, 0.02)])
    assert angles_deg(up, UP) < 0.1


def test_soles_on_steps_and_too_few_are_no_plane():
    rng = np.random.default_rng(0)
    jumps_m = np.column_stack([rng.uniform(-1, 1, (40, 2)), rng.choice([0.0, 0.5], 40)])
    assert contact_cue([jumps_m], 40, UP, 0.02) is None
    assert contact_cue([np.zeros((0, 3))], 0, UP, 0.02) is None


def on_steps_m(*heights_m: float) -> np.ndarray:
    """Ten soles on each step, which err by 2 cm."""
    heights = np.repeat(heights_m, 10) + np.random.default_rng(0).normal(
        0, 0.02, 10 * len(heights_m)
    )
    return np.column_stack([np.zeros((len(heights), 2)), heights])


@pytest.mark.parametrize(
    ("heights_m", "floor_m"),
    [
        ([0.0] * 8, 0.0),
        ([0.0, 0.17, 0.34, 0.51, 0.68, 0.85], 0.0),
        ([0.0, -0.17, -0.34, -0.51, -0.68, -0.85], -0.85),
        ([0.0, 0.0, 0.0, 0.0, 0.5], 0.0),
        ([-0.08, 0.0, 0.08], 0.0),  # errors, not steps: nobody shall hover
    ],
)
def test_no_sole_that_stands_is_far_below_the_floor(heights_m, floor_m):
    soles_m = on_steps_m(*heights_m)
    level = up_of([BODIES], [])[1]
    for up, unit in ((UP, soles_m), (-UP, -soles_m)):
        found_m = float(np.median(soles_on_floor_m(unit, unit[:, None], up) @ up))
        assert found_m == pytest.approx(floor_m, abs=0.02)
        remark = level.with_soles(unit @ up - found_m).remark
        assert (remark is None) == (np.percentile(heights_m, 90) - floor_m < 0.15)
    assert level.with_soles(soles_m[:0, 2]).soles_above_m is None
    assert level.with_soles(on_steps_m(0.0, 0.42)[:, 2]).remark == (
        "feet stand on up to 0.4 m: on steps or a slope, or the heights err. z = 0 is where they "
        "stand low"
    )


def test_where_no_foot_stands_the_floor_is_where_soles_come_lowest():
    soles_m = np.zeros((50, 2, 3, 3))
    soles_m[..., 2] = np.abs(np.sin(np.arange(50)))[:, None, None] + [[0.9], [0.1]]
    soles_m[7] = np.nan
    found_m = soles_on_floor_m(np.zeros((0, 3)), soles_m, UP)
    assert np.median(found_m[:, 2]) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(("slope_deg", "level"), [(0, True), (5, True), (18, False), (30, False)])
def test_a_ground_that_is_steep_stays_as_it_is(slope_deg, level):
    """What bodies may lean by is taken for level; a slope and stairs are not made so."""
    ground = ground_cue(leaning(slope_deg), square_m(400) @ _turn(slope_deg).T, 0.01)
    up, found = up_of([BODIES], [ground])
    assert angles_deg(up, leaning(slope_deg) if level else UP) < 0.5
    assert found.cues[1].used == level
    assert found.sigma_deg == pytest.approx(0.98 if level else 4 * np.sqrt(2), rel=0.05)


@given(st.integers(0, 10**6))
def test_any_world_becomes_level(seed):
    rng = np.random.default_rng(seed)
    world = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix()
    shift_m = rng.normal(0, 10, 3)
    pelvis_m = np.column_stack([rng.uniform(-2, 2, (20, 2)), np.full(20, 0.9)])
    there_m, forward = pelvis_m @ world.T + shift_m, np.array([0.6, -0.7, -0.2])
    up = world @ UP
    level = level_from_world(up, float(there_m[0] @ up) - 0.9, there_m[0], world @ forward)
    pelvis_level_m = there_m @ level[:3, :3].T + level[:3, 3]
    assert pelvis_level_m[0] == pytest.approx([0, 0, 0.9], abs=1e-9)
    assert pelvis_level_m[:, 2] == pytest.approx(0.9, abs=1e-9)
    seen = level[:3, :3] @ world @ forward
    assert seen[0] == pytest.approx(0, abs=1e-9) and seen[1] > 0
    assert np.linalg.det(level[:3, :3]) == pytest.approx(1.0)


def test_a_camera_that_looks_straight_down_is_no_problem():
    level = level_from_world(UP, 0.0, UP, -UP)
    assert np.allclose(level[:3, :3] @ level[:3, :3].T, np.eye(3), atol=1e-12)


def felt(up: np.ndarray, sigma_deg: float = 0.0, n: int = 40) -> UpCue:
    """What sensors feel of a direction in a world, before cameras that turn."""
    rng = np.random.default_rng(1)
    world_from_cam = np.tile(np.eye(4), (n, 1, 1))
    world_from_cam[:, :3, :3] = Rotation.random(n, random_state=2).as_matrix()
    noise = Rotation.from_rotvec(np.deg2rad(sigma_deg) * rng.normal(size=(n, 3)))
    up_cam = np.einsum("nji,nj->ni", world_from_cam[:, :3, :3], noise.apply(up))
    cue = gravity_cue(world_from_cam, up_cam)
    assert cue is not None
    return cue


def test_gravity_levels_leaning_bodies_also_on_a_slope():
    slope = ground_cue(leaning(18), square_m(400) @ _turn(18).T, 0.01)
    for ground in ([], [slope]):
        up, level = up_of([felt(UP), bodies_that_lean(6.0)], ground)
        assert angles_deg(up, UP) < 0.1 and level.sigma_deg == pytest.approx(0.70, abs=0.02)
        assert [(one.name, one.used) for one in level.cues][:2] == [
            ("gravity", True), ("bodies", True),
        ]  # fmt: skip
        assert not any(one.used for one in level.cues[2:])


def test_gravity_and_a_level_ground_share_what_they_err_by():
    ground = ground_cue(leaning(1.0), square_m(400) @ _turn(1.0).T, 0.01)
    up, level = up_of([felt(UP), BODIES], [ground])
    assert 0.2 < angles_deg(up, UP) < 0.5 and level.cues[2].used
    assert level.sigma_deg < 0.6


def test_gravity_is_as_unsure_as_it_differs():
    assert np.trace(felt(UP, 4.0).precision) < np.trace(felt(UP).precision) / 30
    assert gravity_cue(np.tile(np.eye(4), (3, 1, 1)), np.full((3, 3), np.nan)) is None


def test_the_floor_does_not_hang_on_the_axes_of_the_reconstruction():
    """Soles of a walk round a corner lie on the ground.  The middle of their x, y and z does not in
    other axes: the floor was up to 9 cm off."""
    way = np.linspace(0, 2, 150)
    corner_m = np.zeros((300, 3))
    corner_m[:150, 0], corner_m[150:, 0], corner_m[150:, 1] = way, 2.0, way
    for turn in Rotation.random(20, random_state=4).as_matrix():
        soles_m, up = corner_m @ turn.T, turn @ UP
        for height_m in (0.0, 0.1):
            plane = GroundPlane(up, height_m, soles_m, 0.01)
            floor_m = _floor_m(soles_m, up, plane, ScaleConfig())
            level = _floor_m(corner_m, UP, replace(plane, normal=UP), ScaleConfig())
            assert floor_m == pytest.approx(level, abs=1e-9)
            assert (level > 0.05) == (height_m > 0)


def test_a_ground_that_is_not_quite_level_is_right_below_the_soles():
    soles_m = np.column_stack([np.linspace(3, 5, 99), np.zeros((99, 2))])
    normal = leaning(2.0)[[1, 0, 2]]
    plane = GroundPlane(normal, float(normal @ [4.0, 0.0, 0.0]), soles_m, 0.01)
    assert _floor_m(soles_m, UP, plane, ScaleConfig()) == pytest.approx(0, abs=1e-9)
