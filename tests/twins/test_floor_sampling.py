"""What may be asked of drawn twins."""

import pytest

from gmrdata.twins.sampling import FILM, film_of, twin_recipe
from gmrdata.values.errors import BadRecipe


def test_sizes_by_name_and_by_number():
    assert film_of("small", 150) == FILM
    full = film_of("full", 60)
    assert (full.width_px, full.height_px, full.duration_s) == (1080, 1920, 2.0)
    tiny = film_of("180x320", 75)
    assert (tiny.width_px, tiny.height_px, tiny.fps_hz) == (180, 320, 30.0)
    assert tiny.duration_s == 2.5
    assert tiny.hfov_deg == full.hfov_deg == FILM.hfov_deg


@pytest.mark.parametrize(
    "size", ["big", "180", "180x", "0x320", "180x320x3", "-180x320", "63x64", "1080x19200"]
)
def test_other_sizes_are_refused(size):
    with pytest.raises(BadRecipe, match=f"--size {size}: give small, full, or"):
        film_of(size, 150)


def test_too_few_frames_are_refused():
    with pytest.raises(BadRecipe, match="--clip-frames 59: give 60 or more"):
        film_of("small", 59)


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_another_seed_and_no_sequences_are_refused(tmp_path, seed):
    """The second ended with a traceback."""
    with pytest.raises(BadRecipe, match=f"--seed {seed}: give 0 or more, at most 9223372036854"):
        twin_recipe(2, seed, tmp_path)
    with pytest.raises(BadRecipe, match="0 sequences: ask for at least one"):
        twin_recipe(0, 1, tmp_path)


@pytest.mark.slow
def test_the_seed_chooses_and_the_workers_do_not(cmu_dir):
    film = film_of("180x320", 60)
    drawn = twin_recipe(2, 7, cmu_dir, film=film, workers=1)
    assert drawn.set.film == film and drawn.set.seed == 7 and drawn.set.workers == 1
    again = twin_recipe(2, 7, cmu_dir, film=film, workers=5)
    assert again.set.clips == drawn.set.clips and again.set.workers == 5
    assert twin_recipe(2, 8, cmu_dir, film=film, workers=1).set.clips != drawn.set.clips
