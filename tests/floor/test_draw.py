"""What may be asked of drawn twins."""

import pytest

from gmrdata.errors import BadRecipe
from gmrdata.floor.draw import film_of
from gmrdata.threedpw.draw_twins import FILM


def test_sizes_by_name_and_by_number() -> None:
    assert film_of("small", 150) == FILM
    full = film_of("full", 60)
    assert (full.width_px, full.height_px, full.duration_s) == (1080, 1920, 2.0)
    tiny = film_of("180x320", 75)
    assert (tiny.width_px, tiny.height_px, tiny.fps_hz) == (180, 320, 30.0)
    assert tiny.duration_s == 2.5
    assert tiny.hfov_deg == full.hfov_deg == FILM.hfov_deg


@pytest.mark.parametrize("size", ["big", "180", "180x", "0x320", "180x320x3", "-180x320", "63x64"])
def test_other_sizes_are_refused(size: str) -> None:
    with pytest.raises(BadRecipe, match=f"--size {size}: give small, full, or"):
        film_of(size, 150)


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(BadRecipe, match="--frames 59: give 60 or more"):
        film_of("small", 59)
