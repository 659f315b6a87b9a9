"""Protocols against figures that the released code of each system gave for the same motions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.score.protocol_values import WorldBody, WorldPair, protocol_values
from gmrdata.score.protocols import PROTOCOLS

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
