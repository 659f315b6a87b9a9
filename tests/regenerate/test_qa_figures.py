"""The page's figures are held against what the verdict is held against."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.pseudogt.judge import judge
from gmrdata.regenerate.qa.figures import Row, verdict_rows
from gmrdata.regenerate.qa.gather import Found
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.sfm.cues import CueEstimate
from gmrdata.sfm.scale import fuse
from tests.pseudogt.test_verdict import CONFIG, GOOD, ROWS, circling, clip_of

NOTHING = Found({"sequence": "a"}, "", None, {}, {}, (), (), {}, None, None, ())


def scale_rows(found: Found) -> list[Row]:
    rows = verdict_rows(found, ThreedpwRecipe(recipe="threedpw"))
    return [row for row in rows if "scale" in row.name or "two cues" in row.name]


@pytest.mark.parametrize(("way", "accepted"), [(1.0, False), (0.05, True)])
def test_a_vague_scale_is_met_where_the_verdict_lets_it_pass(way: float, accepted: bool) -> None:
    world_from_cam = circling()
    world_from_cam[:, :3, 3] *= way
    clip = clip_of(world_from_cam)
    vague = fuse((CueEstimate("planted_feet", 2.0, 0.2, 9, 0.01),))
    assert judge(clip, GOOD, ROWS, vague, CONFIG).accepted == accepted
    record = {"scale": 2.0, "scale_sigma": 0.2, "scale_disagreement": None}
    sigma, _ = scale_rows(replace(NOTHING, record=record, clips={0: clip}))
    assert (sigma.value, sigma.met) == ("10", accepted)
    assert sigma.limit == "≤ 6, or ≤ 0.01 m/s of the camera's way"


def test_nothing_is_asked_of_cues_where_no_scale_enters() -> None:
    record = {"scale": None, "scale_sigma": None, "scale_disagreement": 9.0}
    found = replace(NOTHING, record=record, clips={0: clip_of(np.tile(np.eye(4), (90, 1, 1)))})
    assert [row.met for row in scale_rows(found)] == [None, None]
