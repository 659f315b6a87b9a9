"""Two places that a dissolve joins: all frames were accepted as one camera's, without a word."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cameras.files import CamerasQuality, load_cameras, load_quality
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
