"""A lens whose distortion is known: cameras, tracks and the record are those of the bent frames."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cameras.files import load_cameras, load_points, load_quality
from gmrdata.cameras.frames import Frames, reduced
from gmrdata.cameras.match.tracks import errors_px, load_tracks
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import read_gray
from gmrdata.values.lens import straightened
from tests.cameras.test_reconstruct import rotation_errors_deg

RADIAL_K1 = -0.15
CUT_PX = (8, 5)  # from either side of a frame, beyond which the bent one would show nothing


def bend(source: Path, target: Path, intrinsics_px: np.ndarray, how: int) -> None:
    """A folder of pictures through a lens, cut at the sides."""
    target.mkdir(parents=True)
    focal_px, centre_px = np.diag(intrinsics_px)[:2], intrinsics_px[:2, 2]
    for path in sorted(source.iterdir()):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        high, wide = picture.shape
        x, y = np.meshgrid(np.arange(wide) + 0.5, np.arange(high) + 0.5)
        flat = (np.stack([x, y], axis=-1) - centre_px) / focal_px
        at = (straightened(flat, RADIAL_K1) * focal_px + centre_px - 0.5).astype(np.float32)
        seen = cv2.remap(picture, at, None, how, borderMode=cv2.BORDER_REPLICATE)
        left, top = CUT_PX
        cv2.imwrite(str(target / path.name), seen[top : high - top, left : wide - left])


@pytest.fixture(scope="module")
def bent_arc(film: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A filmed arc through a lens: folder, intrinsics, and what was filmed."""
    filmed, folder = film("arc", 12, person=False), tmp_path_factory.mktemp("bent")
    bend(filmed.images_dir, folder / "frames", filmed.intrinsics_px, cv2.INTER_LANCZOS4)
    intrinsics_px = filmed.intrinsics_px.copy()
    intrinsics_px[:2, 2] -= CUT_PX
    return folder / "frames", intrinsics_px, filmed


def test_cameras_of_a_known_lens_are_right(bent_arc: Any, tmp_path: Path) -> None:
    images_dir, intrinsics_px, filmed = bent_arc
    config = SfmConfig(max_features=600)
    made = reconstruct(
        images_dir, None, intrinsics_px, tmp_path / "sfm", config, radial_k1=RADIAL_K1
    )
    cameras, quality = load_cameras(made), load_quality(made)
    assert cameras.geometry == "full" and cameras.path.has_camera.all()
    found = cameras.path.world_from_cam[:, :3, :3]
    assert rotation_errors_deg(found, filmed.world_from_cam[:, :3, :3]).max() < 0.3
    assert filmed.centre_errors_m(cameras.path.centres_world_m).max() < 0.02
    assert quality.lens is not None
    assert quality.lens.k1 == pytest.approx(RADIAL_K1, abs=0.02)
    # What the tracks show lies in the bent frames, where the record's lens puts the points.
    tracks, points = load_tracks(made).of_adjusted(), load_points(made)
    path = cameras.path.world_from_cam
    apart_px = errors_px(tracks, points, path, intrinsics_px, quality.lens)
    without_px = errors_px(tracks, points, path, intrinsics_px, None)
    assert np.median(apart_px) < 0.4 < 1.0 < np.percentile(without_px, 80)


def test_a_frame_is_straightened_and_what_was_not_seen_is_masked(tmp_path: Path) -> None:
    for name in ("frames", "masks"):
        (tmp_path / name).mkdir()
    picture = np.zeros((120, 200), np.uint8)
    picture[20:23, 40:43] = 255
    cv2.imwrite(str(tmp_path / "frames" / "00000.png"), picture)
    cv2.imwrite(str(tmp_path / "masks" / "00000.png"), np.zeros_like(picture))
    intrinsics_px = np.array([[150.0, 0, 100], [0, 150, 60], [0, 0, 1]])
    given = Frames(
        [tmp_path / "frames" / "00000.png"], tmp_path / "masks", intrinsics_px, (200, 120)
    )
    for k1 in (-0.15, 0.2):
        straight = reduced(given, 400, tmp_path / f"straight{k1}", k1)
        assert straight.size_px == given.size_px
        seen = (np.array([41.5, 21.5]) - [100, 60]) / 150
        expected_px = straightened(seen, k1) * 150 + [100, 60]
        gray = read_gray(straight.images[0]).astype(float)
        rows, columns = np.indices(gray.shape) + 0.5
        found_px = [(gray * columns).sum() / gray.sum(), (gray * rows).sum() / gray.sum()]
        assert found_px == pytest.approx(expected_px.tolist(), abs=0.1)
        covered = straight.mask(straight.images[0]) > 0
        assert covered[0, 0] == (k1 > 0) and not covered[60, 100]
