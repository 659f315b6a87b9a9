"""What the error of a lens changes in the verdict on a video."""

import pytest

from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.solve.video import VideoSolveConfig, _of_lens
from gmrdata.values.lens import Source


def lens(source: Source, sigma: float) -> Intrinsics:
    return Intrinsics(
        source=source, width_px=1280, height_px=720, focal_px=1373.0, focal_y_px=1373.0,
        focal_sigma=sigma, centre_px=(640.0, 360.0), radial_k1=0.0, radial_k1_sigma=None,
        focal_observable=False, asked=None, starts=(), objections=(), notes=(),
    )  # fmt: skip


def most(source: Source, sigma: float) -> float:
    return _of_lens(VideoSolveConfig(), lens(source, sigma)).pseudo_gt.verdict.max_focal_deviation


def test_a_background_may_ask_for_another_focal_length_than_a_guess() -> None:
    # A pan over a street: 1373 px to 9 % was a guess, and the background asks for 1.11 times that.
    assert most("prior", 0.094) == pytest.approx(0.188)
    assert most("prior", 0.3) == pytest.approx(0.6)
    assert most("prior", 0.7) == 0.99


def test_and_so_of_every_lens_by_its_error_but_one_that_is_given() -> None:
    assert most("self_calibrated", 0.03) == pytest.approx(0.06)
    assert most("metadata", 0.12) == pytest.approx(0.24)
    assert most("self_calibrated", 0.002) == most("given", 0.094) == 0.01
