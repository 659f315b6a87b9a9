"""The page's figures are held against what the verdict is held against."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.cameras.files import Agreement, CamerasQuality, WeakestStep
from gmrdata.pages.solved import SolvedSequence
from gmrdata.pages.thresholds import FigureRow, camera_rows, verdict_rows
from gmrdata.values.clip import Clip, camera_of
from gmrdata.world.judge import SolvedCameras, quality_of
from gmrdata.world.recipe import CueEstimate, PseudoGtConfig, Verdict, verdict_of
from gmrdata.world.scale import ScaleEstimate, fuse
from tests.reconstructions import EVIDENCE, good_quality
from tests.world.test_verdict import GOOD, circling, clip_of, judged

NOTHING = SolvedSequence(name="a")

APART = (
    CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01, 0),
    CueEstimate("ground_contact", 2.15, 0.02, 99, 0.01, 0),
)


def solved(quality: CamerasQuality, scale: ScaleEstimate) -> SolvedCameras:
    path = camera_of(clip_of(circling()))
    rows = np.arange(path.n_frames)
    return SolvedCameras(path, "full", np.zeros((0, 3)), quality, rows, scale)


def scale_rows(clip: Clip, verdict: Verdict, scale: ScaleEstimate) -> list[FigureRow]:
    """The figures of the scale on the page of a clip with good cameras."""
    record = quality_of([clip], [verdict], solved(GOOD, scale), PseudoGtConfig(), [None])
    rows = verdict_rows(replace(NOTHING, record=record, clips={0: clip}))
    return [row for row in rows if "scale" in row.name or "two cues" in row.name]


@pytest.mark.parametrize(
    ("matters", "limit"), [(True, "≤ 6"), (False, "≤ 6, or ≤ 0.02 m/s of the camera's speed")]
)
def test_a_vague_scale_is_met_where_the_verdict_lets_it_pass(matters, limit):
    clip = clip_of(circling())
    vague = replace(fuse((CueEstimate("planted_feet", 2.0, 0.2, 9, 0.01, 0),)), matters=matters)
    verdict = judged(clip, scale=vague)
    sigma, _ = scale_rows(clip, verdict, vague)
    assert (sigma.value, sigma.threshold) == ("10", limit)
    assert sigma.met == verdict.accepted == (not matters)


@pytest.mark.parametrize("scale", [-2.0, 0.0])
@pytest.mark.parametrize("matters", [True, False])
def test_a_scale_that_no_camera_has_is_missed(scale, matters):
    clip = clip_of(circling())
    estimate = fuse((CueEstimate("planted_feet", 2.0, 0.02, 9, 0.01, 0),))
    estimate = replace(estimate, scale=scale, matters=matters)
    verdict = judged(clip, scale=estimate)
    assert not verdict.accepted
    first, sigma, _ = scale_rows(clip, verdict, estimate)
    assert (first.value, first.threshold, first.met) == (f"{scale:g} ± 0.02", "> 0", False)
    assert sigma.value == ("1" if scale else "inf")


def test_nothing_is_asked_of_cues_where_no_scale_enters():
    still = clip_of(np.tile(np.eye(4), (90, 1, 1)))
    verdict = verdict_of("c", True, (), [""] * 90)
    no_scale = ScaleEstimate(None, None, fuse(APART).cues, matters=False)
    record = quality_of([still], [verdict], solved(GOOD, no_scale), PseudoGtConfig(), [None])
    assert record.scale_disagreement is not None and record.scale_disagreement > 5
    assert [row.met for row in scale_rows(still, verdict, no_scale)] == [None, None]


def test_a_second_solution_stands_beside_its_thresholds():
    cameras = good_quality(90, second_share=0.75, agreement=Agreement(12, 0.31, 0.052))
    share, turn, place = [row for row in camera_rows(cameras, PseudoGtConfig().verdict)
                          if "second" in row.name or "places" in row.name]  # fmt: skip
    assert (share.value, share.threshold, share.met) == ("75.0", "≥ 50", True)
    assert (turn.value, turn.threshold, turn.met) == ("0.31", "≤ 1", True)
    assert (place.value, place.threshold, place.met) == ("5.2", "≤ 3", False)


def test_what_just_misses_its_threshold_does_not_read_as_if_it_met_it():
    cameras = good_quality(90, registered_share=0.6996, mean_reprojection_px=1.0004)
    share, error, *_ = camera_rows(cameras, PseudoGtConfig().verdict)
    assert (share.value, share.threshold, share.met) == ("69.96", "≥ 70", False)
    assert (error.value, error.threshold, error.met) == ("1.0004", "≤ 1", False)
    met = good_quality(90, registered_share=0.7, mean_reprojection_px=1.0)
    share, error, *_ = camera_rows(met, PseudoGtConfig().verdict)
    assert (share.value, share.met, error.value, error.met) == ("70.0", True, "1", True)


@pytest.mark.parametrize(
    ("travel", "wide_px", "threshold", "met"),
    [
        (0.042, 4.9, "≤ 2.5", False),
        (0.02, 4.9, "≤ 2.5", True),
        (0.09, 1.2, "≤ 2.5, or a turn ≤ 1.5 px off in the worst pairs", True),
    ],
)
def test_a_path_that_was_set_aside_stands_beside_its_thresholds(travel, wide_px, threshold, met):
    evidence = replace(EVIDENCE, rotation_only_wide_median_px=wide_px)
    cameras = good_quality(90, travel_set_aside=travel, evidence=evidence)
    row = camera_rows(cameras, PseudoGtConfig().verdict)[-1]
    assert "set aside" in row.name and (row.threshold, row.met) == (threshold, met)
    assert row.value == f"{100 * travel:.2g}"


def test_the_weakest_step_stands_beside_its_thresholds():
    cameras = good_quality(90, weakest_step=WeakestStep(40, 52, 0.005, 0.3, 1.2))
    still = clip_of(np.tile(np.eye(4), (90, 1, 1)))
    verdict, no_scale = verdict_of("c", True, (), [""] * 90), ScaleEstimate(None, None, (), False)
    record = quality_of([still], [verdict], solved(cameras, no_scale), PseudoGtConfig(), [None])
    rows = verdict_rows(replace(NOTHING, record=record))
    open_, moving = [row for row in rows if "weakest step" in row.name or "moves" in row.name]
    assert (open_.value, open_.threshold, open_.met) == ("0.5", "≤ 0.6", True)
    assert (moving.value, moving.threshold, moving.met) == ("0.15", "≤ 0.1", False)
    (ratio,) = (row for row in rows if "successive" in row.name)
    assert (ratio.value, ratio.threshold, ratio.met) == ("1.2", "≤ 6", True)
