"""Frames are decoded once; large ones are worked on at a smaller size, as a pinhole shows them."""

import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cameras import frames as module
from gmrdata.cameras.files import Distortion, load_cameras, load_points, load_quality
from gmrdata.cameras.frames import Frames, linked, reduced
from gmrdata.cameras.match.tracks import errors_px, load_tracks
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import known_radial, reconstruct
from gmrdata.read.frames import list_images, read_frames, read_gray
from gmrdata.values.camera import GIVEN, Lens, straightened
from gmrdata.values.errors import BadFrames, NoReconstruction
from tests.filming import tracked_error_px, turn_errors_deg, write_pictures
from tests.read.test_frames import with_exif


@pytest.fixture
def decoded(monkeypatch) -> Counter[Path]:
    return counted(monkeypatch)


def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[Path]:
    """How often each file is decoded from now on."""
    count: Counter[Path] = Counter()

    def read(path: Path, size_px: tuple[int, int] | None = None) -> np.ndarray:
        count[path] += 1
        return read_gray(path, size_px)

    monkeypatch.setattr(module, "read_gray", read)
    return count


@pytest.fixture(scope="module")
def solved(dolly, tmp_path_factory) -> tuple[np.ndarray, Counter[Path]]:
    """World from camera with every frame in memory, and how often each was decoded."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        count = counted(monkeypatch)
        out_dir = tmp_path_factory.mktemp("all_kept") / "sfm"
        reconstruct(dolly.taken(), None, dolly.lens, out_dir, SfmConfig(max_features=300))
    return load_cameras(out_dir).path.world_from_cam, count


def test_the_stage_decodes_each_frame_once(dolly, solved):
    assert solved[1] == dict.fromkeys(list_images(dolly.images_dir), 1)


@pytest.mark.slow
def test_what_memory_is_not_meant_to_hold_is_decoded_again(
    dolly, solved, decoded, tmp_path, monkeypatch
):
    monkeypatch.setattr(module, "MOST_KEPT_BYTES", 3 * 320 * 180)
    reconstruct(dolly.taken(), None, dolly.lens, tmp_path / "sfm", SfmConfig(max_features=300))
    images = list_images(dolly.images_dir)
    assert [decoded[image] for image in images[:3]] == [1, 1, 1] and decoded[images[3]] > 1
    few_kept = load_cameras(tmp_path / "sfm").path.world_from_cam
    np.testing.assert_array_equal(solved[0], few_kept)


def test_some_of_the_frames_share_what_was_decoded(dolly, decoded):
    frames = Frames(list_images(dolly.images_dir), None, dolly.intrinsics_px, (320, 180))
    some = frames.some(np.array([0, 2]))
    assert some.gray(some.images[1]) is frames.gray(frames.images[2])
    assert decoded == {frames.images[2]: 1}


K_PX = np.array([[300.0, 0, 100], [0, 300, 60], [0, 0, 1]])


def a_frame(folder: Path) -> Frames:
    """White from column 100 on; the mask covers pixel (40, 20) alone."""
    image, mask = np.zeros((2, 120, 200), np.uint8)
    image[:, 100:] = 255
    mask[20, 40] = 255
    for name, values in {"frames": image, "masks": mask}.items():
        (folder / name).mkdir()
        cv2.imwrite(str(folder / name / "image_00007.png"), values)
    images = [folder / "frames" / "image_00007.png"]
    return Frames(images, folder / "masks", K_PX, (200, 120))


def test_pixels_scale_from_the_outer_corner(tmp_path):
    small = reduced(a_frame(tmp_path), 50, tmp_path / "small")
    assert small.size_px == (50, 30)
    np.testing.assert_allclose(small.intrinsics_px, [[75, 0, 25], [0, 75, 15], [0, 0, 1]])
    (image,) = small.images
    assert image.stem == "image_00007"
    gray = read_gray(image, small.size_px)
    assert (gray[:, :25] == 0).all() and (gray[:, 25:] == 255).all()


def test_a_pixel_is_dynamic_if_any_part_of_it_is(tmp_path):
    small = reduced(a_frame(tmp_path), 50, tmp_path / "small")
    assert small.masks_dir is not None
    mask = read_gray(small.masks_dir / "image_00007.png", small.size_px)
    assert np.argwhere(mask).tolist() == [[5, 10]] and mask.max() == 255


def test_small_frames_are_taken_as_they_are(tmp_path):
    frames = a_frame(tmp_path)
    assert reduced(frames, 200, tmp_path / "small") is frames
    assert not (tmp_path / "small").exists()


@pytest.mark.slow
def test_no_result_depends_on_how_names_sort_as_texts(dolly, solved, tmp_path):
    """COLMAP goes by that order, in which 10.png comes before 2.png."""
    (plain := tmp_path / "plain").mkdir()
    for number, image in enumerate(list_images(dolly.images_dir), start=1):
        shutil.copyfile(image, plain / f"{number}{image.suffix}")
    other = reconstruct(
        read_frames(plain), None, dolly.lens, tmp_path / "other", SfmConfig(max_features=300)
    )
    np.testing.assert_array_equal(load_cameras(other).path.world_from_cam, solved[0])
    assert load_tracks(other).image_names[1] == "2.jpg"


def test_names_in_another_order_are_linked_with_their_masks(tmp_path):
    for name, values in {"frames": 10, "masks": 0}.items():
        (tmp_path / name).mkdir()
        for number in (9, 10):
            flat = np.full((30, 40), values + number, np.uint8)
            cv2.imwrite(str(tmp_path / name / f"a{number}.png"), flat)
    given = read_frames(tmp_path / "frames")
    for longest_px, size_px in ((50, (40, 30)), (20, (20, 15))):
        frames = Frames(list(given.paths), tmp_path / "masks", K_PX, (40, 30))
        same = reduced(frames, longest_px, tmp_path / f"{longest_px}")
        assert [image.stem for image in same.images] == ["000000009", "000000010"]
        assert [int(read_gray(image).mean()) for image in same.images] == [19, 20]
        assert same.size_px == size_px and same.numbers.tolist() == [9, 10]
        assert same.mask(same.images[1]).all()


@pytest.mark.parametrize("names", [["a 1", "a 2"], ["#1", "#2"]])
def test_names_that_colmaps_list_of_pairs_cannot_hold_get_others(names, tmp_path):
    """Of a long video with a space in its frames' names no place was known again."""
    images = [tmp_path / f"{name}.png" for name in names]
    for image in images:
        cv2.imwrite(str(image), np.zeros((30, 40), np.uint8))
    listed = reduced(Frames(images, None, K_PX, (40, 30)), 50, tmp_path / "small")
    assert [image.stem for image in listed.images] == ["000000001", "000000002"]


def test_frames_that_are_relative_links_are_linked_to_what_they_point_to(tmp_path):
    """As git-annex has them; from another folder the link itself leads nowhere."""
    for name in ("kept", "frames"):
        (tmp_path / name).mkdir()
    cv2.imwrite(str(tmp_path / "kept" / "a.png"), np.full((30, 40), 19, np.uint8))
    (link := tmp_path / "frames" / "1.png").symlink_to(Path("..", "kept", "a.png"))
    (image,), _ = linked({"000000001": link}, None, tmp_path / "work" / "linked")
    assert image == tmp_path / "work" / "linked" / "frames" / "000000001.png"
    assert (read_gray(image) == 19).all()
    assert image.samefile(tmp_path / "kept" / "a.png")


def test_turned_frames_are_written_upright_for_colmap(tmp_path):
    """COLMAP reads pictures as they are stored; the mask is of the upright picture."""
    frames = a_frame(tmp_path)
    (image,) = frames.images
    stored = np.rot90(cv2.imread(str(image)))
    cv2.imwrite(str(image), stored)
    with_exif(image, 6)
    upright = reduced(frames, 200, tmp_path / "small")
    assert upright.size_px == (200, 120) and np.array_equal(upright.intrinsics_px, K_PX)
    written = cv2.imread(str(upright.images[0]), cv2.IMREAD_GRAYSCALE)
    assert (written[:, 100:] == 255).all() and (written[:, :100] == 0).all()
    assert np.array_equal(upright.mask(upright.images[0]), frames.mask(image))


def test_a_mask_of_another_size_is_an_error(tmp_path):
    frames = a_frame(tmp_path)
    cv2.imwrite(str(tmp_path / "masks" / "image_00007.png"), np.zeros((30, 50), np.uint8))
    with pytest.raises(BadFrames, match="image_00007"):
        reduced(frames, 50, tmp_path / "small")


def test_cameras_of_large_frames_have_their_size(dolly, tmp_path):
    """Frames of twice the size, worked on at the size that they had."""
    enlarge(dolly.images_dir, tmp_path / "frames", cv2.INTER_LINEAR)
    enlarge(dolly.masks_dir, tmp_path / "masks", cv2.INTER_NEAREST)
    first = read_gray(list_images(dolly.images_dir)[0])
    height_px, width_px = first.shape
    matrix = np.diag([2.0, 2, 1]) @ dolly.intrinsics_px
    config = SfmConfig(max_features=400, max_image_size_px=width_px)
    frames = read_frames(tmp_path / "frames")
    lens = dolly.lens.at_size(frames.size_px)
    out_dir = reconstruct(frames, tmp_path / "masks", lens, tmp_path / "out", config)
    cameras, quality = load_cameras(out_dir), load_quality(out_dir)
    assert quality.worked_on_px == (width_px, height_px)
    assert (cameras.path.width_px, cameras.path.height_px) == (2 * width_px, 2 * height_px)
    np.testing.assert_array_equal(cameras.path.intrinsics_px, matrix)
    assert cameras.geometry == "full" and cameras.path.has_camera.all()
    assert quality.mean_reprojection_px < 1.0
    # The tracks are in the pixels of the given frames, the record in those worked on.
    again_px = tracked_error_px(out_dir, None) / 2
    assert again_px == pytest.approx(quality.mean_reprojection_px, rel=2e-3)
    assert turn_errors_deg(cameras.path.world_from_cam, dolly.world_from_cam).max() < 0.1
    assert not (out_dir / "colmap").exists()


def test_an_error_names_the_frames_that_were_given(tmp_path):
    write_pictures(tmp_path / "frames", [np.full((120, 160), 128, np.uint8)] * 6)
    config = SfmConfig(max_image_size_px=80)
    with pytest.raises(NoReconstruction) as raised:
        frames = read_frames(tmp_path / "frames")
        reconstruct(frames, None, Lens.centred(150.0, frames.size_px), tmp_path / "out", config)
    assert str(tmp_path / "frames") in str(raised.value)
    assert "reduced" not in str(raised.value)


def enlarge(folder: Path, out_dir: Path, interpolation: int) -> None:
    out_dir.mkdir()
    for image in list_images(folder):
        twice = cv2.resize(read_gray(image), None, fx=2, fy=2, interpolation=interpolation)
        cv2.imwrite(str(out_dir / f"{image.stem}.png"), twice)


RADIAL = (-0.2, 0.25)  # Human3.6M's cameras have these
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
        at = (straightened(flat, *RADIAL) * focal_px + centre_px - 0.5).astype(np.float32)
        seen = cv2.remap(picture, at, None, how, borderMode=cv2.BORDER_REPLICATE)
        left, top = CUT_PX
        cv2.imwrite(str(target / path.name), seen[top : high - top, left : wide - left])


@pytest.fixture(scope="module")
def bent_arc(film, tmp_path_factory) -> Any:
    """A filmed arc through a lens: folder, intrinsics, and what was filmed."""
    filmed, folder = film("arc", 12, person=False), tmp_path_factory.mktemp("bent")
    bend(filmed.images_dir, folder / "frames", filmed.intrinsics_px, cv2.INTER_LANCZOS4)
    intrinsics_px = filmed.intrinsics_px.copy()
    intrinsics_px[:2, 2] -= CUT_PX
    frames = read_frames(folder / "frames")
    return frames, Lens.of_matrix(intrinsics_px, frames.size_px, RADIAL), filmed


def test_cameras_of_a_known_lens_are_right(bent_arc, tmp_path):
    frames, lens, filmed = bent_arc
    config = SfmConfig(max_features=600)
    made = reconstruct(frames, None, lens, tmp_path / "sfm", config)
    cameras, quality = load_cameras(made), load_quality(made)
    assert cameras.geometry == "full" and cameras.path.has_camera.all()
    assert turn_errors_deg(cameras.path.world_from_cam, filmed.world_from_cam).max() < 0.3
    assert filmed.centre_errors_m(cameras.path.centres_world_m).max() < 0.02
    assert quality.lens is not None
    assert quality.lens.k1 == pytest.approx(RADIAL[0], abs=0.02)
    assert quality.lens.k2 == pytest.approx(RADIAL[1], abs=0.1)
    assert known_radial(made) == RADIAL
    # A distortion that was given is not one that was found, as it was called; what is more, is.
    as_given = quality.model_copy(update={"lens": Distortion(*RADIAL, 0.0)})
    assert as_given.lens_of(lens) == lens and lens.radial_from == GIVEN
    more = quality.model_copy(update={"lens": Distortion(RADIAL[0] + 0.01, RADIAL[1], 0.2)})
    assert more.lens_of(lens).radial_from.source == "self_calibrated"
    # What the tracks show lies in the bent frames, where the record's lens puts the points.
    tracks, points = load_tracks(made).of_adjusted(), load_points(made)
    path = cameras.path.world_from_cam
    apart_px = errors_px(tracks, points, path, lens.matrix_px, quality.lens)
    without_px = errors_px(tracks, points, path, lens.matrix_px, None)
    assert np.median(apart_px) < 0.4 < 1.0 < np.percentile(without_px, 80)


def test_a_frame_is_straightened_and_what_was_not_seen_is_masked(tmp_path):
    picture = np.zeros((120, 200), np.uint8)
    picture[20:23, 40:43] = 255
    images = write_pictures(tmp_path / "frames", [picture])
    write_pictures(tmp_path / "masks", [np.zeros_like(picture)])
    intrinsics_px = np.array([[150.0, 0, 100], [0, 150, 60], [0, 0, 1]])
    given = Frames(images, tmp_path / "masks", intrinsics_px, (200, 120))
    for radial in ((-0.15, 0.0), (0.2, 0.0), (0.0, 0.3)):
        straight = reduced(given, 400, tmp_path / f"straight{radial}", radial)
        assert straight.size_px == given.size_px
        seen = (np.array([41.5, 21.5]) - [100, 60]) / 150
        expected_px = straightened(seen, *radial) * 150 + [100, 60]
        gray = read_gray(straight.images[0]).astype(float)
        rows, columns = np.indices(gray.shape) + 0.5
        found_px = [(gray * columns).sum() / gray.sum(), (gray * rows).sum() / gray.sum()]
        assert found_px == pytest.approx(expected_px.tolist(), abs=0.1)
        covered = straight.mask(straight.images[0]) > 0
        assert covered[0, 0] == (sum(radial) > 0) and not covered[60, 100]
