"""Rates of videos from times that were rounded: the camera's own rate comes back."""

from collections.abc import Sequence

import numpy as np
import pytest

from gmrdata.read.video_rate import rated

NTSC = 1000 / 1001
RATES_HZ = [10, 12.5, 15, 24 * NTSC, 24, 25, 30 * NTSC, 30, 50, 60 * NTSC, 60, 100, 120, 240]
TICKS_S = {"milliseconds": 1e-3, "QuickTime": 1 / 600, "MPEG": 1 / 90000, "exact": 1e-9}


def frame_times_s(rate_hz: float, tick_s: float, shown: Sequence[int] | np.ndarray) -> np.ndarray:
    """Times of some frames as a file that counts in ticks has them."""
    times_s = np.round(np.asarray(shown) / rate_hz / tick_s) * tick_s
    return times_s - times_s[0]


@pytest.mark.parametrize("tick", TICKS_S)
@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("lost", [[], [1, 7, 8, 40, *range(60, 90)]], ids=["whole", "with gaps"])
@pytest.mark.parametrize("counted_s", [None, 1 / 16000], ids=["", "made into mp4"])
def test_a_rate_is_the_cameras_not_that_of_rounded_times(tick, rate_hz, lost, counted_s):
    shown = np.setdiff1d(np.arange(2, 400), np.add(lost, 2))
    times_s = frame_times_s(rate_hz, TICKS_S[tick], shown)
    for stated_hz in ([rate_hz], [], [25.0], [rate_hz * 0.99, 1000.0]):
        found_hz, found_s = rated(times_s, counted_s or TICKS_S[tick], stated_hz)
        assert found_hz == pytest.approx(rate_hz, rel=1e-9)
        assert found_s == pytest.approx((shown - shown[0]) / rate_hz, abs=1e-9)


@pytest.mark.parametrize(
    ("times_s", "stated_hz", "rate_hz"),
    [
        ([0, 0.017], [60], 60),
        ([0, 0.033, 0.067], [], 30),
        ([0, 0.033, 0.066, 0.1], [], 30),
        ([0, 1 / 30, 2 / 30], [30.0003], 30),
        ([0, 0.01, 0.02], [1000, 100], 100),
    ],
)
def test_two_frames_and_more(times_s, stated_hz, rate_hz):
    assert rated(np.array(times_s), 1e-3, stated_hz)[0] == rate_hz


@pytest.mark.parametrize("counted_s", [1e-3, 1 / 15360])
@pytest.mark.parametrize("rate_hz", [60, 60 * NTSC, 50, 30, 30 * NTSC, 120])
def test_the_mean_rate_of_a_short_clip_in_milliseconds(rate_hz, counted_s):
    times_s = frame_times_s(rate_hz, 1e-3, range(90))
    assert rated(times_s, counted_s, [89 / times_s[-1]])[0] == pytest.approx(rate_hz, rel=1e-9)


def test_a_rate_that_varies_is_left_as_it_is():
    rng = np.random.default_rng(0)
    steps_s = {
        "a phone in the dark": [1 / 30] * 90 + [1 / 24] * 60,
        "a call": rng.uniform(0.02, 0.12, 100),
        "33 ms, whatever is said": [0.033] * 400,
        "film with a part at 29.97": [1001 / 24000] * 600 + [1001 / 30000] * 99,
        "a browser's clock": np.diff(np.arange(150) / 30 + rng.uniform(0, 0.006, 150)),
        "a clock that is off": 1 / 29.91 + rng.normal(0, 2e-4, 300),
    }
    rates_hz = {
        "a phone in the dark": 30,
        "a call": 1 / 0.0725,
        "33 ms, whatever is said": 1 / 0.033,
        "film with a part at 29.97": 24 * NTSC,
        "a browser's clock": 30,
        "a clock that is off": 29.91,
    }
    for name, each_s in steps_s.items():
        times_s = np.concatenate([[0.0], np.cumsum(each_s)]).round(5 if "a clock" in name else 3)
        found_hz, found_s = rated(times_s, 1e-5 if "a clock" in name else 1e-3, [30.0003])
        assert found_hz == pytest.approx(rates_hz[name], rel=0.15 if "call" in name else 1e-3), name
        assert found_s is times_s


@pytest.mark.parametrize(("fast_hz", "slow_hz"), [(30, 15), (60, 30), (30, 24)])
def test_a_video_of_two_rates_half_and_half_has_the_faster_one(fast_hz, slow_hz):
    """No step is like the mean of the two in the middle."""
    times_s = np.cumsum([0.0] + [1 / fast_hz] * 30 + [1 / slow_hz] * 30)
    found_hz, found_s = rated(times_s, 1 / 90000, [fast_hz])
    assert found_hz == fast_hz
    assert found_s is times_s
