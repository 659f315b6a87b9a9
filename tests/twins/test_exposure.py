"""Changes of exposure: gains inside their range, and light that follows them."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.twins.faults import ExposureConfig, exposed_jpeg, exposure_gains
from gmrdata.values.errors import BadFrames

CONFIG = ExposureConfig()


def gains_of(seed: int, n_frames: int = 150, config: ExposureConfig = CONFIG) -> np.ndarray:
    return exposure_gains(n_frames, 30.0, config, np.random.default_rng(seed))


@given(seed=st.integers(0, 2**32), n_frames=st.integers(1, 300))
def test_gains_stay_in_their_range(seed: int, n_frames: int) -> None:
    gains = gains_of(seed, n_frames)
    assert gains.shape == (n_frames,)
    assert gains.min() >= 0.7 and gains.max() <= 1.4


@given(seed=st.integers(0, 2**32))
def test_a_sequence_uses_most_of_the_range_with_one_fast_correction(seed: int) -> None:
    logs = np.log(gains_of(seed, config=ExposureConfig(steps=(1, 1))))
    assert np.ptp(logs) >= 0.59 * np.log(2.0)
    in_half_a_second = np.abs(logs[15:] - logs[:-15]).max()
    assert in_half_a_second >= 0.2 * np.ptp(logs)
    assert np.abs(np.diff(logs)).max() < 0.5 * np.ptp(logs)  # no cut from one frame to the next


def test_the_same_seed_gives_the_same_gains() -> None:
    assert np.array_equal(gains_of(3), gains_of(3))
    assert not np.array_equal(gains_of(3), gains_of(4))


def test_no_range_is_no_change() -> None:
    assert (gains_of(0, config=ExposureConfig(gain=(1.0, 1.0))) == 1.0).all()


@pytest.mark.parametrize(
    ("value", "gain", "expected"),
    [  # IEC 61966-2-1: 188, 137 and 99 are a half, a quarter and an eighth of white's light
        (255, 0.5, 188),
        (188, 0.5, 137),
        (137, 0.5, 99),
        (99, 2.0, 137),
        (188, 2.5, 255),
        (0, 1.4, 0),
    ],
)
def test_light_is_multiplied_and_not_the_encoded_value(
    value: int, gain: float, expected: int
) -> None:
    _, encoded = cv2.imencode(".jpg", np.full((16, 24, 3), value, dtype=np.uint8))
    found = cv2.imdecode(
        np.frombuffer(exposed_jpeg(encoded.tobytes(), gain, 100), dtype=np.uint8), cv2.IMREAD_COLOR
    )
    assert found is not None and found.shape == (16, 24, 3)
    assert np.abs(found.astype(int) - expected).max() <= 1


def test_bytes_that_are_no_image_are_refused() -> None:
    with pytest.raises(BadFrames, match="cannot be decoded"):
        exposed_jpeg(b"\xff\xd8 no jpeg", 1.1, 92)


@pytest.mark.parametrize(
    "wrong", [{"gain": (1.4, 0.7)}, {"gain": (0, 1)}, {"step_s": (0, 1)}, {"steps": (2, 1)}]
)
def test_ranges_the_wrong_way_round_are_refused(wrong: dict[str, tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match=r"least|above 0"):
        ExposureConfig.model_validate(wrong)
