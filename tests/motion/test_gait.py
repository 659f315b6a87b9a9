"""Embedded motions: what every kind of them keeps, measured on the posed body; a leg of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.motion.gait import GAIT_KINDS, embedded_motions, gait_with_contacts, make_gait
from gmrdata.motion.gait_steps import Leg, turn
from gmrdata.values.body import JOINT
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

FPS_HZ = 120.0
SEEDS = (0, 1, 2)


def stances(planted: np.ndarray) -> list[slice]:
    """Whole stances of one foot: rows from touch-down to toe-off, both inside the clip."""
    edges = np.flatnonzero(np.diff(planted.astype(int)))
    if len(edges) and planted[edges[0]]:
        edges = edges[1:]
    pairs = zip(edges[::2], edges[1::2], strict=False)
    return [slice(start + 1, stop + 1) for start, stop in pairs]


def middle(stance: slice, first: float, last: float) -> slice:
    """The part of a stance between two shares of it."""
    length = stance.stop - stance.start
    return slice(stance.start + int(np.ceil(first * length)), stance.start + int(last * length))


def travel_m(points_m: np.ndarray) -> float:
    return float(np.linalg.norm(points_m - points_m[0], axis=-1).max())


@pytest.fixture(scope="module")
def made(anny) -> dict[str, list[tuple[Motion, np.ndarray, np.ndarray]]]:
    """Per kind and seed: motion, contacts and joints (T, 24, 3), 6 s at 120 frames a second."""
    clips = {}
    for kind in GAIT_KINDS:
        clips[kind] = []
        for seed in SEEDS:
            rng = np.random.default_rng(seed)
            motion, contacts = gait_with_contacts(kind, 6.0, FPS_HZ, anny, rng)
            clips[kind].append((motion, contacts, motion_joints_m(anny, motion)))
    return clips


@pytest.mark.parametrize("kind", GAIT_KINDS)
def test_planted_feet_do_not_slide(kind, made):
    for _, contacts, joints_m in made[kind]:
        for column, side in enumerate(("left", "right")):
            ankle = joints_m[:, JOINT[f"{side}_ankle"]]
            ball = joints_m[:, JOINT[f"{side}_foot"]]
            whole = stances(contacts[:, column])
            assert len(whole) >= 3
            for stance in whole:
                # The whole foot lies flat between these shares; after that it rolls over the ball.
                assert travel_m(ankle[middle(stance, 0.18, 0.55)]) < 0.001
                assert travel_m(ball[middle(stance, 0.18, 1.0)]) < 1e-6


@pytest.mark.parametrize("kind", GAIT_KINDS)
def test_soles_stay_above_the_ground_and_touch_it(kind, made, anny):
    for motion, contacts, _ in made[kind]:
        rows = np.arange(0, motion.n_frames, 9)
        lowest_m = motion_vertices_m(anny, motion, rows)[:, :, 2].min(axis=1)
        assert lowest_m.min() > -0.005
        if kind != "step_up":
            assert np.abs(lowest_m[contacts[rows].any(axis=1)]).max() < 0.005


@pytest.mark.parametrize("kind", GAIT_KINDS)
def test_rotations_are_proper_and_continuous(kind, made):
    for motion, _, _ in made[kind]:
        rotmats = motion.rotmats
        assert np.isfinite(rotmats).all()
        np.testing.assert_allclose(
            rotmats @ np.swapaxes(rotmats, -1, -2),
            np.broadcast_to(np.eye(3), rotmats.shape),
            atol=1e-9,
        )
        traces = np.einsum("tjab,tjab->tj", rotmats[:-1], rotmats[1:])
        jumps_deg = np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))
        assert jumps_deg.max() < 15
        accelerations = np.diff(motion.pelvis_m, n=2, axis=0) * FPS_HZ**2
        assert np.linalg.norm(accelerations, axis=-1).max() < 20


@pytest.mark.parametrize(
    ("kind", "slowest_m_s", "fastest_m_s"),
    [(kind, 0.8, 1.7) for kind in GAIT_KINDS if kind not in ("run", "side_step")]
    + [("run", 2.2, 3.8), ("side_step", 0.2, 0.7)],
)
def test_speeds_are_those_of_people(kind, slowest_m_s, fastest_m_s, made):
    for motion, _, _ in made[kind]:
        steps_m = np.linalg.norm(np.diff(motion.pelvis_m[:, :2], axis=0), axis=-1)
        assert slowest_m_s < steps_m.mean() * FPS_HZ < fastest_m_s


@pytest.mark.parametrize("kind", GAIT_KINDS)
def test_knees_bend_backwards_and_thighs_point_down(kind, made):
    for motion, _, joints_m in made[kind]:
        front = motion.root_rotmats[:, :, 2]
        for side in ("left", "right"):
            hip, knee, ankle = (
                joints_m[:, JOINT[f"{side}_{name}"]] for name in ("hip", "knee", "ankle")
            )
            share = np.linalg.norm(knee - hip, axis=-1) / (
                np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)
            )
            straight = hip + share[:, None] * (ankle - hip)
            assert np.einsum("ti,ti->t", knee - straight, front).min() > 0
            assert (hip[:, 2] > knee[:, 2]).all()


def test_only_running_has_flight_and_walking_has_double_support(made):
    for kind in GAIT_KINDS:
        for _, contacts, _ in made[kind]:
            assert (~contacts).all(axis=1).any() == (kind == "run")
            assert contacts.all(axis=1).any() == (kind != "run")


def test_a_runner_in_flight_falls_freely(made):
    for motion, contacts, _ in made["run"]:
        vertical_m_s2 = np.diff(motion.pelvis_m[:, 2], n=2) * FPS_HZ**2
        aloft = (~contacts).all(axis=1)
        whole = aloft[:-2] & aloft[1:-1] & aloft[2:]
        assert -11.5 < vertical_m_s2[whole].mean() < -6


def test_arms_swing_against_the_legs(made):
    for kind in ("walk", "run", "turn", "circle", "figure_eight", "step_up"):
        for motion, _, joints_m in made[kind]:
            front = motion.root_rotmats[:, :, 2] * (1, 1, 0)
            ahead = {
                name: np.einsum("ti,ti->t", joints_m[:, JOINT[name]] - motion.pelvis_m, front)
                for name in ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
            }
            arms = ahead["left_wrist"] - ahead["right_wrist"]
            legs = ahead["left_ankle"] - ahead["right_ankle"]
            assert np.corrcoef(arms, legs)[0, 1] < -0.8, kind


def test_someone_upright_who_faces_minus_y_has_the_quarter_turn_about_x(made):
    for motion, _, _ in made["walk"]:
        up = motion.root_rotmats[:, :, 1]
        assert up[:, 2].min() > 0.95
        forward = np.diff(motion.pelvis_m[:, :2], axis=0)
        forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
        assert np.einsum("ti,ti->t", forward, motion.root_rotmats[:-1, :2, 2]).min() > 0.9


def test_side_steps_go_sideways_and_both_ways(made):
    ways = set()
    for motion, _, _ in made["side_step"]:
        velocity = np.diff(motion.pelvis_m, axis=0) * FPS_HZ
        to_left = np.einsum("ti,ti->t", velocity, motion.root_rotmats[:-1, :, 0])
        to_front = np.einsum("ti,ti->t", velocity, motion.root_rotmats[:-1, :, 2])
        assert np.abs(to_left).mean() > 4 * np.abs(to_front).mean()
        ways |= set(np.sign(to_left[np.abs(to_left) > 0.1]))
    assert ways == {-1.0, 1.0}


def test_stepping_up_ends_15_to_20_cm_higher(made):
    for motion, contacts, joints_m in made["step_up"]:
        heights_m = []
        for column, side in enumerate(("left", "right")):
            ball = joints_m[:, JOINT[f"{side}_foot"], 2]
            heights_m += [ball[stance.stop - 1] for stance in stances(contacts[:, column])]
        assert 0.15 - 1e-6 < max(heights_m) - min(heights_m) < 0.20 + 1e-6
        assert 0.12 < motion.pelvis_m[-60:, 2].mean() - motion.pelvis_m[:60, 2].mean() < 0.23


def test_circles_turn_one_way_and_eights_both(anny):
    for kind, both in (("circle", False), ("figure_eight", True)):
        motion = make_gait(kind, 20.0, 20.0, anny, np.random.default_rng(4))
        path = motion.pelvis_m[::20, :2]
        steps = np.diff(path, axis=0)
        turned = np.linalg.det(np.stack([steps[:-1], steps[1:]], axis=1))
        share = (turned > 0).mean()
        assert (0.2 < share < 0.8) == both


def test_motion_says_what_it_is(made, anny):
    motion, contacts, _ = made["walk"][0]
    assert motion.n_frames == 720 and contacts.shape == (720, 2) and contacts.dtype == bool
    assert motion.local_rotmats.shape == (720, 23, 3, 3)
    assert (motion.frame, motion.body, motion.fps_hz) == ("world", anny.name, FPS_HZ)
    assert "gait walk" in motion.source and "not motion capture" in motion.source


def test_same_seed_same_bytes_other_seed_other_motion(small_body):
    for kind in GAIT_KINDS:
        first, again, other = (
            make_gait(kind, 2.0, 30.0, small_body, np.random.default_rng(seed))
            for seed in (7, 7, 8)
        )
        assert first.pelvis_m.tobytes() == again.pelvis_m.tobytes()
        assert first.local_rotmats.tobytes() == again.local_rotmats.tobytes()
        assert first.root_rotmats.tobytes() == again.root_rotmats.tobytes()
        assert not np.array_equal(first.shape, other.shape)
        assert np.abs(first.local_rotmats - other.local_rotmats).max() > 0.01


def test_the_frame_rate_only_samples(small_body):
    """Twice the rate gives the same motion, but for the smoothing of the pelvis' height."""
    slow, fast = (
        make_gait("turn", 3.0, fps_hz, small_body, np.random.default_rng(5))
        for fps_hz in (60.0, 120.0)
    )
    np.testing.assert_allclose(slow.root_rotmats, fast.root_rotmats[::2], atol=1e-9)
    np.testing.assert_allclose(slow.pelvis_m[:, :2], fast.pelvis_m[::2, :2], atol=1e-3)
    np.testing.assert_allclose(slow.pelvis_m[:, 2], fast.pelvis_m[::2, 2], atol=0.005)


def test_a_shape_that_is_given_is_kept(small_body):
    shape = np.linspace(-1, 1, small_body.n_shape)
    motion = make_gait("walk", 1.0, 30.0, small_body, np.random.default_rng(0), shape=shape)
    np.testing.assert_array_equal(motion.shape, shape)
    shape[:] = 0
    assert motion.shape[0] == -1


def test_a_set_goes_round_the_kinds_with_seeded_variety(small_body):
    motions = embedded_motions(small_body, np.random.default_rng(3), count=16, duration_s=2.0)
    kinds = [motion.source.removeprefix("gmrdata gait ").split(",")[0] for motion in motions]
    assert kinds == [*GAIT_KINDS, *GAIT_KINDS, "walk", "run"]
    assert len({motion.pelvis_m.tobytes() for motion in motions}) == 16
    assert all(motion.n_frames == 60 for motion in motions)
    again = embedded_motions(small_body, np.random.default_rng(3), count=16, duration_s=2.0)
    assert [m.pelvis_m.tobytes() for m in motions] == [m.pelvis_m.tobytes() for m in again]


@given(
    kind=st.sampled_from(GAIT_KINDS),
    duration_s=st.floats(0.6, 5.0),
    fps_hz=st.floats(1.0, 60.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_length_and_rate_gives_finite_motion(small_body, kind, duration_s, fps_hz, seed):
    motion, contacts = gait_with_contacts(
        kind, duration_s, fps_hz, small_body, np.random.default_rng(seed)
    )
    assert motion.n_frames == len(contacts) == round(duration_s * fps_hz)
    assert np.isfinite(motion.local_rotmats).all() and np.isfinite(motion.pelvis_m).all()
    assert motion.pelvis_m[:, 2].min() > 0.4
    assert motion.pelvis_m[:, 2].max() < 1.6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "moonwalk"}, "choose one of walk, run"),
        ({"duration_s": 0.0}, "must be positive"),
        ({"duration_s": float("nan")}, "must be positive"),
        ({"fps_hz": -30.0}, "must be positive"),
        ({"fps_hz": 0.0}, "must be positive"),
        ({"duration_s": 0.01}, "less than a frame"),
        ({"shape": np.zeros(3)}, "leave it out"),
        ({"shape": np.full(10, np.nan)}, "leave it out"),
    ],
)
def test_arguments_that_cannot_be_are_refused(small_body, change, words):
    arguments = {"kind": "walk", "duration_s": 1.0, "fps_hz": 30.0, "shape": None} | change
    kind, duration_s, fps_hz = (arguments.pop(name) for name in ("kind", "duration_s", "fps_hz"))
    with pytest.raises(BadRecipe, match=words):
        make_gait(kind, duration_s, fps_hz, small_body, np.random.default_rng(0), **arguments)


def test_an_empty_set_is_refused(small_body):
    with pytest.raises(BadRecipe, match="at least 1"):
        embedded_motions(small_body, np.random.default_rng(0), count=0)


def test_a_swinging_foot_passes_beside_the_standing_one(made):
    """On a tight circle, a straight way to the next footfall led through the other leg."""
    for kind in GAIT_KINDS:
        for _, _, joints_m in made[kind]:
            ankles = joints_m[:, JOINT["left_ankle"]] - joints_m[:, JOINT["right_ankle"]]
            assert np.linalg.norm(ankles, axis=-1).min() > 0.06


def test_forearms_keep_off_the_trunk(made):
    """Bent arms that were turned inwards all the time went through a runner's sides."""
    for kind in GAIT_KINDS:
        for motion, _, joints_m in made[kind]:
            root = motion.root_rotmats
            for side, out in (("left", 1), ("right", -1)):
                elbow, wrist = (
                    joints_m[:, JOINT[f"{side}_elbow"]],
                    joints_m[:, JOINT[f"{side}_wrist"]],
                )
                for share in (0.0, 0.5, 1.0):
                    point = elbow + share * (wrist - elbow) - joints_m[:, JOINT["spine1"]]
                    across = out * np.einsum("ti,ti->t", point, root[:, :, 0])
                    ahead = np.einsum("ti,ti->t", point, root[:, :, 2])
                    assert across[ahead < 0.12].min(initial=np.inf) > 0.15


BENT = Leg(np.array([0.03, -0.38, 0.02]), np.array([-0.02, -0.41, -0.03]))


@given(
    flexion_rad=st.floats(0.01, 2.4),
    direction=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda v: np.linalg.norm(np.cross(v, (1, 0.2, 0))) > 0.2
    ),
)
def test_the_ankle_arrives(flexion_rad, direction):
    target = BENT.reach_m(flexion_rad) * np.array([direction]) / np.linalg.norm(direction)
    thigh, knee = BENT.solve(target, np.array([[1.0, 0.2, 0.0]]))
    ankle = thigh[0] @ (BENT.thigh_m + knee[0] @ BENT.shank_m)
    np.testing.assert_allclose(ankle, target[0], atol=1e-9)
    np.testing.assert_allclose(knee[0] @ (1, 0, 0), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(thigh[0] @ thigh[0].T, np.eye(3), atol=1e-12)


def test_reach_is_greatest_when_straight_and_shrinks_with_flexion():
    reaches_m = [BENT.reach_m(angle) for angle in np.linspace(0, 2.5, 20)]
    assert (np.diff(reaches_m) < 0).all()


def test_a_plain_leg_bends_like_a_folding_ruler():
    leg = Leg(np.array([0.0, -0.4, 0.0]), np.array([0.0, -0.4, 0.0]))
    right_angle = leg.knee_rad(np.array([0.4 * np.sqrt(2)]))
    assert right_angle == pytest.approx([np.pi / 2])
    # Straight down, half bent: the knee goes to the front (+z), not to the back.
    thigh, _ = leg.solve(np.array([[0.0, -0.4 * np.sqrt(2), 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    assert (thigh[0] @ leg.thigh_m)[2] == pytest.approx(0.4 * np.sin(np.pi / 4))


def test_targets_out_of_reach_give_the_straight_leg():
    far = np.array([[0.0, -2.0, 0.0]])
    thigh, knee = BENT.solve(far, np.array([[1.0, 0.0, 0.0]]))
    ankle = thigh[0] @ (BENT.thigh_m + knee[0] @ BENT.shank_m)
    # The distance is stationary where the leg is straight, so half of the digits are good.
    np.testing.assert_allclose(ankle, [0.0, -BENT.reach_m(0.0), 0.0], atol=1e-7)


def test_turn_follows_the_right_hand():
    np.testing.assert_allclose(turn("x", np.array(np.pi / 2)) @ (0, 1, 0), (0, 0, 1), atol=1e-12)
    assert turn("y", np.zeros((2, 5))).shape == (2, 5, 3, 3)
