"""Verdicts on clips whose faults are put in one at a time."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.check.verdict import is_out_of_order
from gmrdata.cameras.files import Agreement, CamerasQuality, WeakestStep
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid
from gmrdata.world.judge import SolvedCameras, judge, telling_rows
from gmrdata.world.picture_fit import PictureFit
from gmrdata.world.recipe import CueEstimate, Doubts, Dropped, Verdict, VerdictConfig, verdict_of
from gmrdata.world.scale import ScaleEstimate, fuse
from tests.reconstructions import EVIDENCE, good_quality

N, FPS_HZ = 90, 30.0
ROWS = np.arange(N)
CONFIG = VerdictConfig(min_run_s=0.3)
GOOD = good_quality(N)
SCALE = fuse((CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01, 0),))


def clip_of(world_from_cam: np.ndarray) -> Clip:
    eye = np.tile(np.eye(3), (N, 23, 1, 1))
    motion = Motion(
        eye, eye[:, 0], np.zeros((N, 3)), np.zeros(10), FPS_HZ, "b", "neutral", "world", "test"
    )
    has_camera = np.isfinite(world_from_cam[:, 0, 0])
    camera = CameraPath(np.diag([500.0, 500, 1]), 640, 360, world_from_cam, has_camera)
    return Clip("c", motion, has_camera, np.arange(N), camera)


def judged(
    clip: Clip,
    quality: CamerasQuality = GOOD,
    rows: np.ndarray = ROWS,
    scale: ScaleEstimate = SCALE,
    config: VerdictConfig = CONFIG,
    *,
    unusable: Sequence[str] = ("",) * N,
    doubts: tuple[str, ...] = (),
    dataset_camera: np.ndarray | None = None,
    fit: PictureFit | None = None,
) -> Verdict:
    cameras = SolvedCameras(
        camera_of(clip), "full", np.zeros((0, 3)), quality, rows, scale, dataset_camera
    )
    return judge(clip, cameras, config, Doubts(frames=(tuple(unusable),), sequence=doubts), fit)


def circling() -> np.ndarray:
    angles = np.deg2rad(25) * np.arange(N) / FPS_HZ
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    return rigid(turns, turns @ [4.0, 0.0, 1.5])


@pytest.fixture
def clip() -> Clip:
    return clip_of(circling())


def changed(clip: Clip, rows: slice, value: Any) -> Clip:
    world_from_cam = camera_of(clip).world_from_cam.copy()
    world_from_cam[rows] = value
    return clip_of(world_from_cam)


def test_a_good_sequence_is_accepted_whole(clip):
    dataset_camera = circling() @ rigid(Rotation.from_rotvec([0, 1.0, 0]).as_matrix(), np.zeros(3))
    same_motion = rigid(np.eye(3), np.array([5.0, 1, 0])) @ circling()
    for other in (None, same_motion):
        good = verdict_of("c", True, (), [""] * N)
        assert judged(clip, dataset_camera=other) == good
    # Another direction of view of the data set's camera is another motion in its own axes.
    assert not judged(clip, dataset_camera=dataset_camera).accepted


@pytest.mark.parametrize(
    ("figures", "reason"),
    [
        ({"registered_share": 0.6}, "60% of the images have a camera, fewer than 70%"),
        ({"registered_share": 0.696}, "69.6% of the images have a camera, fewer than 70.0%"),
        ({"mean_reprojection_px": 1.004}, "reprojection error is 1.004 px, more than 1 px"),
        ({"mean_reprojection_px": 1.5}, "reprojection error is 1.50 px, more than 1 px"),
        ({"cuts_after_frames": list(range(0, 88, 2))}, "to another place 44 times"),
        (
            {"weakest_step": WeakestStep(40, 52, 0.0123, 0.0, 1.2)},
            "up to row 40 and those from row 52 on hardly hold each other: 1.23% of their way is "
            "open, more than 0.60%; the two may differ in scale",
        ),
        (
            {"weakest_step": WeakestStep(40, 52, 0.0021, 0.1, 46.5)},
            "sees is 46 times as far away as what the next one sees, more than 6: pieces of",
        ),
        (
            {"weakest_step": WeakestStep(40, 52, 0.0048, 0.25, 1.2)},
            "0.48% of their way is open, and up to 25% of what two frames share moves otherwise "
            "than they say, which together is 0.120%, more than 0.100%; they may follow what moves",
        ),
        (
            {"agreement": Agreement(9, 2.14, 0.004)},
            "a part of the keyframes, solved alone, gives another path: the camera turns 2.1 "
            "degrees otherwise, more than 1",
        ),
        (
            {"second_share": 0.4, "agreement": Agreement(9, 0.3, 0.01)},
            "of some keyframes, solved alone, 40% get a camera, fewer than 50%: nothing confirms "
            "the path",
        ),
        ({"agreement": Agreement(9, 1.04, 0.004)}, "turns 1.04 degrees otherwise, more than 1"),
        ({"agreement": Agreement(9, 0.3, 0.08)}, "8.0% of its way off, more than 3.0%"),
        (
            {"travel_set_aside": 0.042},
            "travels by about 4.2% of the background's distance, more than 2.5%, and no path of it "
            "holds: a turn leaves 9.0 px in the worst pairs, more than 1.5",
        ),
        (
            {"focal_factor": 0.95, "focal_sigma": 0.015},
            "0.95 times the one in use (standard error 0.01; 1% and 2 of these may be off)",
        ),
    ],
)
def test_a_sequence_that_misses_a_threshold_is_rejected_with_both_figures(clip, figures, reason):
    verdict = judged(clip, good_quality(N, **figures))
    assert not verdict.accepted and len(verdict.reasons) == 1 and reason in verdict.reasons[0]


def test_a_path_set_aside_rejects_nothing_that_is_short_or_where_a_turn_explains_the_pairs(clip):
    explained = replace(EVIDENCE, rotation_only_wide_median_px=1.4)
    for figures in ({"travel_set_aside": 0.02}, {"travel_set_aside": 0.09, "evidence": explained}):
        assert judged(clip, good_quality(N, **figures)).accepted


@pytest.mark.parametrize(("loose", "moving"), [(0.0014, 0.05), (0.0002, 0.6), (0.005, 0.0)])
def test_a_gap_where_nothing_moves_and_a_crowd_before_what_holds_firmly_are_accepted(
    clip, loose, moving
):
    quality = good_quality(N, weakest_step=WeakestStep(40, 52, loose, moving, 2.6))
    assert judged(clip, quality).accepted


@pytest.mark.parametrize(
    ("factor", "sigma"), [(None, None), (0.77, 0.12), (1.009, 0.001), (1.0, 0.02), (0.97, 0.013)]
)
def test_a_focal_length_that_may_be_right_rejects_nothing(clip, factor, sigma):
    figures = {"focal_factor": factor, "focal_sigma": sigma}
    assert judged(clip, good_quality(N, **figures)).accepted


def test_an_uncertain_scale_and_cues_that_disagree_reject(clip):
    vague = fuse((CueEstimate("planted_feet", 2.0, 0.2, 9, 0.01, 0),))
    assert "uncertain by 10.0%" in judged(clip, scale=vague).reasons[0]
    apart = fuse(
        (
            CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01, 0),
            CueEstimate("ground_contact", 2.15, 0.02, 99, 0.01, 0),
        )
    )
    (reason,) = judged(clip, scale=apart).reasons
    assert "5.3 standard errors apart" in reason
    # Of a camera that hardly travels, an uncertain scale means little.
    assert judged(clip, scale=replace(vague, matters=False)).accepted
    # Where scale doesn't enter, nothing is said of it.
    assert judged(clip, scale=ScaleEstimate(None, None, ())).accepted


@pytest.mark.parametrize("scale", [-2.0, 0.0, float("nan")])
def test_a_scale_that_no_camera_has_rejects(clip, scale):
    for matters in (True, False):
        estimate = ScaleEstimate(scale, 0.02, (), matters=matters)
        (reason,) = judged(clip, scale=estimate).reasons
        assert f"the metric scale is {scale:.3g} ± 0.02 m per unit" in reason


@pytest.mark.parametrize(
    ("fit", "reason"),
    [
        (
            PictureFit(40, 37, 0.18, 24, 0.2, 0, ()),
            "not lie on the person in the picture in 37 of 40",
        ),
        (PictureFit(40, 18, 0.6, 0, 0.6, 0, ()), "in 18 of 40 frames"),
        (PictureFit(40, 0, 0.8, 0, 0.8, 37, ()), "another body lies on the same person"),
        (
            PictureFit(40, 1, 0.57, -20, 0.93, 0, ()),
            "the body is 20 frames early: it lies on the person "
            "in the picture by 93% then, and by 57% now",
        ),
        (PictureFit(40, 20, 0.5, 4, 0.6, 0, ()), "the body is 4 frames late"),
    ],
)  # fmt: skip
def test_a_body_that_lies_on_nobody_or_on_people_of_other_frames_rejects(clip, fit, reason):
    verdict = judged(clip, fit=fit)
    assert len(verdict.reasons) == 1 and reason in verdict.reasons[0]


def test_a_frame_in_which_the_body_is_beside_the_person_is_not_kept(clip):
    verdict = judged(clip, fit=PictureFit(40, 3, 0.8, 0, 0.8, 0, (27, 28, 50)))
    assert verdict.accepted and np.flatnonzero(~verdict.kept).tolist() == [27, 28, 50]
    assert "does not lie on the person" in verdict.frame_reasons[50]


@pytest.mark.parametrize("fps_hz", [10.0, FPS_HZ, 60.0])
@pytest.mark.parametrize("what", ["place", "turn"])
def test_a_frame_to_which_the_body_jumps_is_not_kept(clip, what, fps_hz):
    """Front and back are exchanged from frame 30 on, or the person is 2 m away."""
    motion = clip.motion
    root_rotmats, pelvis_m = motion.root_rotmats.copy(), motion.pelvis_m.copy()
    if what == "turn":
        root_rotmats[30:] = root_rotmats[30:] @ np.diag([-1.0, 1.0, -1.0])
    else:
        pelvis_m[30:] += [2.0, 0.0, 0.0]
    moved = replace(motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m, fps_hz=fps_hz)
    verdict = judged(replace(clip, motion=moved))
    assert np.flatnonzero(~verdict.kept).tolist() == [29, 30]
    assert verdict.frame_reasons[30] == "the body jumps"


@pytest.mark.parametrize(("fps_hz", "turn_deg"), [(240.0, 8.0), (30.0, 33.0), (10.0, 100.0)])
def test_a_body_that_errs_along_the_ray_or_turns_over_does_not_jump(clip, fps_hz, turn_deg):
    """By 4 cm and 8 degrees, where frames follow soon; a somersault is of 1,000 degrees/s."""
    at_rest, rng = changed(clip, slice(None), circling()[0]), np.random.default_rng(0)
    errors_m = rng.uniform(-0.04, 0.04, N)[:, None] * [1.0, 0.0, 0.0]
    turns_deg = turn_deg * ROWS + 4.0 * (ROWS % 2)
    turns = Rotation.from_rotvec(turns_deg[:, None] * [1.0, 0.0, 0.0], degrees=True).as_matrix()
    motion = replace(at_rest.motion, root_rotmats=turns, pelvis_m=errors_m, fps_hz=fps_hz)
    assert judged(replace(at_rest, motion=motion)).kept.all()


def test_a_body_that_lies_on_the_person_is_accepted(clip):
    for fit in (
        PictureFit(40, 2, 0.71, 0, 0.71, 0, ()),
        PictureFit(9, 2, 0.55, 1, 0.58, 0, ()),
        None,
    ):
        assert judged(clip, fit=fit).accepted


def test_who_is_beside_the_person_or_doubted_tells_nothing_of_the_world(clip):
    """A bottle on a desk was followed for 11 frames, and its feet made a dancer's scale 3 % larger
    and 11 % uncertain."""
    right = PictureFit(90, 2, 0.8, 0, 0.8, 0, (27, 28))
    beside = PictureFit(90, 80, 0.1, 0, 0.1, 0, tuple(range(80)))
    nothing, doubted = ("",) * N, ("front and back may be exchanged",) * N

    def known(frames: tuple[tuple[str, ...], ...], *fits: PictureFit | None) -> list[int]:
        doubts = Doubts(frames=frames, sequence=())
        return [int(rows.sum()) for rows in telling_rows([clip] * 2, doubts, fits, CONFIG)]

    assert known((nothing, nothing), right, beside) == [88, 0]
    assert known((nothing, doubted), None, None) == [90, 0]
    assert known((doubted, doubted), right, right) == [90, 90]


def test_a_statue_that_travels_rejects_and_one_that_stands_does_not(clip):
    way_m = 3.0 * np.linspace(0, 1, N)[:, None] * [1.0, 0.0, 0.0]
    statue = replace(clip, motion=replace(clip.motion, pelvis_m=way_m))
    (reason,) = judged(statue).reasons
    assert reason.startswith("the body is stiff: its joints turn by 0.0 degrees")
    swing = np.deg2rad(20) * np.sin(np.arange(N) / 4)
    local = statue.motion.local_rotmats.copy()
    local[:, [0, 1, 3, 4]] = Rotation.from_rotvec(swing[:, None] * [1.0, 0, 0]).as_matrix()[:, None]
    walker = replace(statue, motion=replace(statue.motion, local_rotmats=local))
    assert judged(walker).accepted
    assert judged(clip).accepted


FEW = [10 if 30 <= row < 35 or 40 <= row < 45 else 200 for row in range(N)]


@pytest.mark.parametrize(
    ("lost", "figures", "unusable", "dropped"),
    [
        (slice(40, 52), {}, 0, [Dropped(40, 52, "no camera was found")]),
        (slice(0), {}, 20, [Dropped(0, 20, "campose_valid is 0")]),
        (
            slice(0), {"inliers_per_frame": FEW}, 0,
            [Dropped(30, 35, "fewer than 25 inliers"),
             Dropped(35, 40, "only 5 usable frames in a row"),
             Dropped(40, 45, "fewer than 25 inliers")],
        ),
    ],
)  # fmt: skip
def test_frames_are_dropped_with_the_reason(clip, lost, figures, unusable, dropped):
    """Without a camera; not vouched for by the data set; with few inliers, and too short beside."""
    texts = ["campose_valid is 0" if row < unusable else "" for row in range(N)]
    verdict = judged(changed(clip, lost, np.nan), good_quality(N, **figures), unusable=texts)
    assert verdict.accepted and list(verdict.dropped) == dropped
    left_out = sum(one.stop - one.start for one in dropped)
    assert verdict.kept.mean() == pytest.approx((N - left_out) / N)


def test_a_jump_drops_the_frames_beside_it(clip):
    after = camera_of(clip).world_from_cam[50:].copy()
    after[:, :3, 3] += [0.0, 0.0, 0.5]  # 15 m/s for one frame
    verdict = judged(changed(clip, slice(50, N), after))
    assert verdict.dropped == (Dropped(49, 51, "the camera jumps"),)
    turned = camera_of(clip).world_from_cam[50:].copy()
    turned[:, :3, :3] = turned[:, :3, :3] @ Rotation.from_rotvec([0, 0.4, 0]).as_matrix()
    verdict = judged(changed(clip, slice(50, N), turned))
    assert verdict.dropped == (Dropped(49, 51, "the camera jumps"),)


def test_slow_drift_of_the_data_set_is_no_fault_but_another_motion_is(clip):
    time = np.linspace(0, 1, N)
    drift = rigid(
        Rotation.from_rotvec(np.deg2rad(8) * time[:, None] * [0.0, 0.0, 1.0]).as_matrix(),
        0.6 * time[:, None] * [1.0, 0.0, 0.0],
    )
    assert judged(clip, dataset_camera=drift @ circling()).accepted
    slower = circling()[np.arange(N) // 2]  # wrong intrinsics look like this
    (reason,) = judged(clip, dataset_camera=slower).reasons
    assert reason.startswith("0% of the frames with an undoubted pose can be used")
    assert reason.endswith("50%; in 90: the camera moves otherwise than the data set's")
    unknown = np.full((N, 4, 4), np.nan)
    assert judged(clip, dataset_camera=unknown).accepted
    longer = CONFIG.model_copy(update={"window_s": 2 * N / FPS_HZ})
    assert judged(clip, config=longer, dataset_camera=slower).accepted, "nothing to compare"


def test_why_most_frames_are_lost_is_told_of_those_with_an_undoubted_pose(clip):
    """The reason was that of the 70 frames without a pose, which do not count."""
    valid, beside = (ROWS >= 40) & (ROWS < 60), tuple(range(40, 55))
    unusable = ["" if known else "nobody there" for known in valid]
    fit = PictureFit(20, 15, 0.4, 0, 0.4, 0, beside)
    reason, _ = judged(replace(clip, valid=valid), unusable=unusable, fit=fit).reasons
    assert reason.endswith("; in 15: the body does not lie on the person in the picture")
    (reason,) = judged(replace(clip, valid=~valid), unusable=["nobody there"] * N).reasons
    assert reason.endswith("; in 90: nobody there")


def test_no_usable_frame_is_a_rejection(clip):
    verdict = judged(replace(clip, id="x"), unusable=["bad"] * N)
    assert not verdict.accepted and verdict.kept.mean() == 0.0
    assert verdict.dropped == (Dropped(0, N, "bad"),)


def test_frames_beyond_a_cut_say_so(clip):
    lost = changed(clip, slice(60, N), np.nan)
    verdict = judged(lost, good_quality(N, cuts_after_frames=[59]))
    assert verdict.accepted
    (run,) = verdict.dropped
    assert (run.start, run.stop) == (60, N) and "beyond a cut" in run.reason


def test_frames_without_an_image_are_dropped(clip):
    """The reconstruction has fewer rows then, so its figures are looked up by row."""
    rows = np.r_[np.arange(50), -1, np.arange(50, N - 1)]
    inliers = [200] * 50 + [3] + [200] * (N - 52)
    lost = changed(clip, slice(50, 51), np.nan)
    verdict = judged(lost, good_quality(N - 1, inliers_per_frame=inliers), rows)
    assert [(run.start, run.stop, run.reason) for run in verdict.dropped] == [
        (50, 51, "it has no image"),
        (51, 52, "fewer than 25 inliers"),
    ]


def test_doubts_about_the_data_set_reject_the_sequence(clip):
    verdict = judged(clip, doubts=("the intrinsics are wrong",))
    assert not verdict.accepted and verdict.reasons == ("the intrinsics are wrong",)


def test_few_valid_frames_are_not_held_against_a_sequence(clip):
    unusable = ["campose_valid is 0"] * 60 + [""] * 30
    verdict = judged(clip, unusable=unusable)
    assert verdict.accepted and verdict.kept.mean() == pytest.approx(1 / 3)
    assert np.array_equal(verdict.kept, np.arange(N) >= 60)


def test_a_verdict_as_a_record_gives_its_frames_back(clip):
    verdict = judged(changed(clip, slice(40, 52), np.nan))
    assert verdict.id == "c" and verdict.kept_frames == N - 12 and verdict.accepted
    (run,) = verdict.dropped
    assert run.start == 40 and run.stop == 52
    lost = [40 <= row < 52 for row in range(N)]
    assert [reason != "" for reason in verdict.frame_reasons] == (~verdict.kept).tolist() == lost


def test_interpolated_frames_have_no_inliers_of_their_own(clip):
    inliers = [200] * 40 + [0] * 3 + [200] * (N - 43)
    figures = {"inliers_per_frame": inliers, "interpolated": [40, 41, 42]}
    assert judged(clip, good_quality(N, **figures)).kept.all()


def test_images_out_of_order_say_so():
    order = np.random.default_rng(0).permutation(N)
    slow = VerdictConfig(max_speed_m_per_s=3.0)
    for cameras in (circling(), circling() * [1.0, 1.0, 1.0, 0.0]):
        most = slow.out_of_order_rows
        assert not is_out_of_order(cameras, most) and is_out_of_order(cameras[order], most)
    verdict = judged(clip_of(circling()[order]), config=slow)
    assert not verdict.accepted
    assert any("images out of order" in reason for reason in verdict.reasons)


def test_cameras_that_jump_in_order_are_not_called_out_of_order(clip):
    jumping = camera_of(clip).world_from_cam.copy()
    jumping[::9, :3, 3] += [0.0, 0.0, 0.5]
    (reason,) = judged(clip_of(jumping), config=VerdictConfig()).reasons
    assert reason.endswith("images are missing, or the cameras are wrong")
    wrong_focal = good_quality(N, focal_factor=0.7, focal_sigma=0.02)
    focal, jumps = judged(clip_of(jumping), wrong_focal, config=VerdictConfig()).reasons
    assert "0.70 times the one in use" in focal and "the focal length is wrong" in jumps


def test_a_background_that_moves_is_named(clip):
    """A sea's and a crowd's figures, and those of a large person."""
    for step, is_named in (
        (WeakestStep(36, 45, 0.0032, 0.56, 1.03), True),
        (WeakestStep(70, 73, 0.00131, 0.75, 14.0), True),
        (WeakestStep(11, 12, 0.0022, 0.34, 200.0), False),
    ):
        reasons = judged(clip, good_quality(N, weakest_step=step)).reasons
        named = [reason for reason in reasons if "water, a crowd or leaves" in reason]
        assert reasons and len(named) == is_named


def test_black_images_are_named(clip):
    lost = changed(clip, slice(50, N), np.nan)
    figures = {"registered_share": 50 / N, "featureless": list(range(50, N))}
    verdict = judged(lost, good_quality(N, **figures))
    assert not verdict.accepted and "40 are black or even" in verdict.reasons[0]
    (run,) = verdict.dropped
    assert (run.start, run.stop) == (50, N) and "black" in run.reason
