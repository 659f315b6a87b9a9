"""Two places that a dissolve joins: all frames were accepted as one camera's, without a word."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cameras.check.dissolve import dissolve_after
from gmrdata.cameras.files import CamerasQuality, load_cameras, load_quality
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import MappingConfig, SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import read_frames
from gmrdata.values.camera import Lens
from gmrdata.values.errors import NoReconstruction
from tests.cameras.match.test_keyframes import SIZE_PX, shifted, texture
from tests.filming import write_pictures


def dissolved(
    before: Sequence[np.ndarray], after: Sequence[np.ndarray], first: int, stop: int
) -> list[np.ndarray]:
    """Pictures of one film, which go over into those of another from one frame on to another."""
    shares = np.clip((np.arange(len(before)) - first + 1) / (stop - first + 1), 0, 1)
    both = zip(before, after, shares.tolist(), strict=True)
    return [cv2.addWeighted(a, 1 - share, b, share, 0) for a, b, share in both]


def solved(pictures: list[np.ndarray], lens: Lens, folder: Path, config: SfmConfig) -> Path:
    write_pictures(folder / "frames", pictures)
    return reconstruct(read_frames(folder / "frames"), None, lens, folder / "sfm", config)


def require_one_place(quality: CamerasQuality, has_camera: np.ndarray, first: int, stop: int):
    (after,) = quality.cuts_after_frames
    assert first <= after < stop
    early, late = has_camera[: first + 1], has_camera[stop:]
    assert (early.all() and not late.any()) or (late.all() and not early.any())


def test_of_two_tripods_one_is_taken(tmp_path):
    rng = np.random.default_rng(0)
    films = [
        [
            np.clip(shifted(texture(one), 0) + rng.normal(0, 2, SIZE_PX[::-1]), 0, 255).astype("u1")
            for _ in range(40)
        ]
        for one in (0, 1)
    ]
    pictures, config = dissolved(*films, 16, 23), SfmConfig(keyframe_gap=2)
    out_dir = solved(pictures, Lens.centred(220.0, SIZE_PX), tmp_path, config)
    quality, cameras = load_quality(out_dir), load_cameras(out_dir)
    assert quality.geometry == "static"
    require_one_place(quality, cameras.path.has_camera, 16, 23)


def test_of_two_cameras_that_travel_one_is_taken(film, tmp_path):
    filmed = film("dolly", 24)
    frames = [cv2.imread(str(path)) for path in filmed.taken().paths]
    config = SfmConfig(max_features=400, first_octave=-1, keyframe_gap=1)
    pictures = dissolved(frames, [frame[:, ::-1].copy() for frame in frames], 12, 16)
    out_dir = solved(pictures, filmed.lens, tmp_path, config)
    quality, cameras = load_quality(out_dir), load_cameras(out_dir)
    assert quality.geometry == "full"
    require_one_place(quality, cameras.path.has_camera, 12, 16)
    # Where their lenses differ too, that was taken for a zoom, and nobody heard of the dissolve.
    strict = config.model_copy(update={"mapping": MappingConfig(most_zoom_spread=0.0)})
    said = "film without zooming; the picture changes to another place 1 times, first after frame 1"
    with pytest.raises(NoReconstruction, match=said):
        solved(pictures, filmed.lens, tmp_path / "strict", strict)


def matched(lives: Sequence[tuple[int, int]], at_px: np.ndarray) -> Matches:
    """Matches of neighbours, of points that are seen from one keyframe up to another, in a picture
    that lies at these places (K,) along x."""
    seen = [[n for n, one in enumerate(lives) if key in range(*one)] for key in range(len(at_px))]
    points = [
        np.array([[x + n % 50, n / 10] for n in of]) for x, of in zip(at_px, seen, strict=True)
    ]
    both = [np.array([(a.index(n), b.index(n)) for n in a if n in b]) for a, b in pairwise(seen)]
    pairs = [PairMatches(k, k + 1, one, "CALIBRATED") for k, one in enumerate(both) if len(one)]
    return Matches(points, pairs)


@pytest.mark.parametrize(
    ("second_from", "first_until", "fast", "after"),
    [
        pytest.param(9, 12, 1, 10, id="three keyframes show both places"),
        pytest.param(12, 12, 1, None, id="a cut has no matches"),
        pytest.param(9, 12, 30, None, id="the camera whips round"),
        pytest.param(24, 24, 30, None, id="one place"),
    ],
)
def test_a_dissolve_is_where_no_track_crosses(second_from, first_until, fast, after):
    lives = [(first, first + 12) for first in range(-11, 24) for _ in range(6)]
    early = [(max(first, 0), min(stop, first_until)) for first, stop in lives]
    late = [(max(first, second_from), min(stop, 24)) for first, stop in lives]
    steps_px = np.where(np.abs(np.arange(23) - 10) <= 2, fast, 1) * 2.0
    matches = matched([*early, *late], np.cumsum([0.0, *steps_px]))
    assert dissolve_after(matches, (320, 240), SfmConfig().dissolve) == after
