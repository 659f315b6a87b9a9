"""Frame rates: rounding undone, CMU's index believed, nonsense refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import (
    check_rate_hz,
    cmu_rate_hz,
    cmu_subject,
    rate_of_frame_time_hz,
)
from gmrdata.values.errors import BadMotionFile


@pytest.mark.parametrize(
    ("text", "fps_hz"),
    [(".0083333", 120), ("0.008333", 120), ("0.0333333", 30), ("0.0333", 30), ("0.04", 25),
     ("0.0166667", 60), ("1.66667e-2", 60), ("0.010", 100), ("0.0333667", 29.97),
     ("0.0039062", 256), ("0.0341131", 1 / 0.0341131),
     ("0.017", 60), ("0.03", 30), ("0.011", 90), ("0.007", 144), ("0.008", 125), ("0.02", 50),
     ("0.004", 250), ("0.005", 200), ("0.0042", 240),
     ("0.0334", 29.97), ("0.01668", 59.94), ("0.04171", 23.976),
     ("0.03333334", 30), ("0.033333335", 30), ("0.008333334", 120), ("0.016666668", 60)],
)  # fmt: skip
def test_printed_frame_times(text, fps_hz):
    assert rate_of_frame_time_hz(text, Path("a.bvh"), 1) == fps_hz


@given(st.integers(5, 1000), st.integers(7, 12))
def test_every_whole_rate_survives_printing(fps_hz, decimals):
    assert rate_of_frame_time_hz(f"{1 / fps_hz:.{decimals}f}", Path("a.bvh"), 1) == fps_hz


@pytest.mark.parametrize("fps_hz", [23.976, 29.97, 59.94, 119.88, 30000 / 1001, 60000 / 1001, 12.5])
def test_rates_that_are_not_whole_survive_in_full(fps_hz):
    assert rate_of_frame_time_hz(f"{1 / fps_hz:.20f}", Path("a.bvh"), 1) == fps_hz


@pytest.mark.parametrize(
    ("name", "subject", "fps_hz"),
    [("02_03.amc", 2, 120), ("62_11_poses.npz", 62, 60), ("136_01.bvh", 136, 60),
     ("33_01.amc", 33, 60), ("35_01.amc", 35, 120), ("walk.bvh", None, 120),
     ("02_034.bvh", None, 120)],
)  # fmt: skip
def test_cmus_index(name, subject, fps_hz):
    assert cmu_subject(Path(name)) == subject
    assert cmu_rate_hz(Path(name)) == fps_hz


@pytest.mark.parametrize("fps_hz", [0.0, -30.0, 10000.0, float("nan"), float("inf")])
def test_absurd_rates(fps_hz):
    with pytest.raises(BadMotionFile, match=r"a\.bvh.*fps-hz"):
        check_rate_hz(fps_hz, Path("a.bvh"))


@pytest.mark.parametrize("text", ["1.0", "0.5", "0.0001", "-0.03", "nan"])
def test_a_header_that_nobody_set_is_no_rate(text):
    with pytest.raises(BadMotionFile, match=r"a\.bvh:8: .*is no rate.*with --fps-hz"):
        rate_of_frame_time_hz(text, Path("a.bvh"), 8)


CMU_LIKE = """HIERARCHY
ROOT Hips
{{
OFFSET 0 0 0
CHANNELS 3 Zrotation Yrotation Xrotation
JOINT LHipJoint
{{
OFFSET 0 0 0
CHANNELS 0
JOINT LowerBack
{{
OFFSET 0 1 0
CHANNELS 0
End Site
{{
OFFSET 0 1 0
}}
}}
}}
}}
MOTION
Frames: 2
Frame Time: {time}
1 0 0
2 0 0
"""


@pytest.mark.parametrize(
    ("name", "time", "fps_hz"),
    [("62_11.bvh", ".0083333", 60), ("62_11.bvh", "0.0333333", 30), ("walk.bvh", ".0083333", 120),
     ("jumping_jacks.bvh", "0.0333333", 30)],
)  # fmt: skip
def test_cmus_joints_alone_are_no_rate(tmp_path, name, time, fps_hz):
    path = tmp_path / name
    path.write_text(CMU_LIKE.format(time=time))
    assert read_bvh(path).fps_hz == fps_hz


def test_cmus_trials_for_3ds_max_are_known(tmp_path):
    """cgspeed's other release calls joints as 3ds Max wants them, and says 120 Hz of each trial."""
    leg = "JOINT LeftHip\n{\nOFFSET 0 1 0\nCHANNELS 0\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
    text = CMU_LIKE.format(time=".0083333").replace("JOINT LowerBack", f"{leg}JOINT lowerback")
    path = tmp_path / "62_11.bvh"
    path.write_text(text)
    source = read_bvh(path)
    assert (source.fps_hz, source.rate_from) == (60.0, "CMU's index")
    np.testing.assert_allclose(source.offsets_m[2], [0, 0.0254 / 0.45, 0])
