"""How many frames of one rate there are for one of another."""

import pytest

from gmrdata.values.motion import whole_ratio


@pytest.mark.parametrize(
    ("higher_hz", "lower_hz", "ratio"),
    [(30.0, 10.0, 3), (29.97, 29.97, 1), (59.94, 29.97, 2), (25.0, 10.0, None), (10.0, 30.0, None)],
)
def test_a_whole_ratio_is_found_and_no_other(higher_hz, lower_hz, ratio):
    assert whole_ratio(higher_hz, lower_hz) == ratio
