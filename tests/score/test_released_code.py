"""Protocols against figures that the released code of each system gave for the same motions."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.score.protocol_values import WorldBody, WorldPair, protocol_values
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.values.body import BodyModel
from tests.score.made_people import made_people, made_regressor, our_figures

N_FRAMES = 250

RELEASED = {
    "wham": {
        "w_mpjpe_mm": 626.352723382,
        "wa_mpjpe_mm": 296.411716127,
        "rte_percent": 2.10605729826,
        "jitter_10m_per_s3": 1.66610484403,
        "foot_sliding_mm": 7.60180909803,
    },
    "gvhmr": {
        "w_mpjpe_mm": 626.352723382,
        "wa_mpjpe_mm": 296.411716127,
        "rte_percent": 2.10605729826,
        "jitter_10m_per_s3": 1.66610484403,
        "foot_sliding_mm": 7.60180909803,
    },
    "tram": {
        "w_mpjpe_mm": 816.573519135,
        "wa_mpjpe_mm": 309.762498165,
        "rte_percent": 2.10605729826,
        "erve_mm_per_frame": 16.0407572847,
    },
    "slahmr": {
        "w_mpjpe_mm": 814.037085752,
        "wa_mpjpe_mm": 335.528803669,
    },
    "emdb": {
        "jitter_10m_per_s3": 1.06958780157,
    },
}
"""Protocol -> metric -> mean of what the functions that `Protocol.source` names returned, in
float64, at these commits: GVHMR 44fbc19 (its functions are WHAM's), tram 4861c11, emdb 9a4eab6,
slahmr 58518fe."""


def made_up_body(phase: float) -> WorldBody:
    """A root that wanders and turns, joints that sway, feet that creep; all of sines."""
    times, joints = np.arange(N_FRAMES)[:, None], np.arange(24)
    root_m = np.concatenate([0.02 * times, np.sin(0.03 * times + phase), np.cos(0.05 * times)], 1)
    turns = np.concatenate([np.sin(0.04 * times), 0.01 * times + phase, np.sin(0.02 * times)], 1)
    rotmats = Rotation.from_rotvec(turns).as_matrix()
    local_m = np.stack([np.sin(joints), np.cos(2.0 * joints), np.sin(3.0 * joints + 1.0)], axis=-1)
    local_m[0] = 0.0
    sway_m = 0.03 * np.sin(0.3 * times + joints + 2 * phase)[..., None] * [1.0, -0.5, 0.3]
    sway_m[:, 0] = 0.0
    joints_m = (local_m + sway_m) @ np.swapaxes(rotmats, 1, 2) + root_m[:, None]
    feet = np.arange(4) + phase
    creep_m = 0.08 * np.sin(0.17 * times + 1.3 * feet)[..., None] * [1.0, 0.6, 0.0]
    return WorldBody(rotmats, joints_m, creep_m)


@pytest.mark.parametrize(
    ("name", "metric"), [(name, metric) for name, found in RELEASED.items() for metric in found]
)
def test_the_figure_is_the_released_codes(name: str, metric: str) -> None:
    pair = WorldPair(made_up_body(0.4), made_up_body(0.0), ((0, N_FRAMES),), 30.0)
    found = protocol_values(PROTOCOLS[name], pair)[metric]  # type: ignore[index]
    assert found.mean() == pytest.approx(RELEASED[name][metric], rel=1e-9)


FIGURES = json.loads(Path(__file__).with_name("released_figures.json").read_text())
"""Case -> protocol -> metric -> what the released functions of its authors returned for
`made_people`, in double precision; benchmarks/open/protocols.py makes them again.  Commits: WHAM
2b54f77, tram 4861c11, GVHMR 44fbc19, slahmr 58518fe, emdb 9a4eab6, VIBE 851f779."""


@pytest.mark.parametrize(
    ("case", "name"), [(case, name) for case in FIGURES for name in FIGURES[case]]
)
def test_files_are_scored_as_released_code_scores_them(
    case: str, name: str, small_body: BodyModel, tmp_path: Path
) -> None:
    """One person without gaps, and two with gaps; read from files, in the original's mode."""
    people, matrix = made_people(small_body, int(case[0]), gaps="with gaps" in case), None
    if "mesh" in case:
        matrix = made_regressor(small_body, 24 if name == "gvhmr" else 14)
    found = our_figures(name, small_body, people, tmp_path, regressor=matrix)  # type: ignore[arg-type]
    released = FIGURES[case][name]
    assert set(found) - set(released) <= {"roe_deg", "erve_mm_per_frame"}
    for metric, figure in released.items():
        # Feet and meshes are posed in single precision.
        assert found[metric] == pytest.approx(figure, rel=1e-6), metric  # type: ignore[index]


@pytest.mark.parametrize(
    ("name", "metric"),
    [
        ("wham", "rte_percent"),
        ("gvhmr", "jitter_10m_per_s3"),
        ("tram", "rte_percent"),
        ("slahmr", "w_mpjpe_mm"),
        ("emdb", "jitter_10m_per_s3"),
        ("vibe", "accel_error_mm_per_frame2"),
    ],
)
def test_each_deviation_changes_a_figure_until_it_is_switched(
    name: str, metric: str, small_body: BodyModel, tmp_path: Path
) -> None:
    people = made_people(small_body, 2, gaps=True)
    found = our_figures(name, small_body, people, tmp_path, original=())  # type: ignore[arg-type]
    figure = FIGURES["2 people, with gaps"][name][metric]
    assert abs(found[metric] / figure - 1) > 1e-4  # type: ignore[index]
