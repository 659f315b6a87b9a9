"""What a guessed lens changes in the verdict on a video."""

import pytest

from gmrdata.cameras.intrinsics import Intrinsics, Source
from gmrdata.world.video import VideoSolveConfig, _of_lens


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


@pytest.mark.parametrize("source", ["given", "metadata", "self_calibrated"])
def test_but_not_than_one_that_is_known(source: Source) -> None:
    config = VideoSolveConfig()
    assert _of_lens(config, lens(source, 0.094)) is config
    assert config.pseudo_gt.verdict.max_focal_deviation == 0.01
