"""How bodies lie on people in pictures: the right ones, late ones, others', and with several."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from gmrdata.cameras.files import Distortion, bent_points
from gmrdata.film.programmes import Circular, Panning, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.people.following import (
    FOLLOWED_FILE,
    SIGHTINGS_FILE,
    FollowedRecord,
    PersonFacts,
    Sightings,
)
from gmrdata.people.landmark_body import landmarks_about
from gmrdata.people.silhouette import silhouette
from gmrdata.people.sources import (
    FolderSource,
    MaskRcnnSource,
    MasksConfig,
    OnnxSource,
    PersonSource,
    SilhouetteSource,
)
from gmrdata.read.frames import read_gray, write_gray
from gmrdata.solve.solve import people_masks
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import Lens, project_cam
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.world import picture_fit
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.judge import load_record
from gmrdata.world.picture_fit import PeopleMasks, PictureFit, picture_fits, seen_limbs
from gmrdata.world.pseudo_gt import WorldEvidence, make_pseudo_gt
from gmrdata.world.recipe import PseudoGtConfig, VerdictConfig
from tests.world.test_compose import as_input, person_files, reconstruction, true_clip

SIZE_PX = (320, 180)
VERDICT = VerdictConfig()


@pytest.fixture(scope="module")
def walker(small_body) -> Clip:
    return walk_of(small_body, 4.0, 10.0)


def walk_of(body: BodyModel, seconds: float, fps_hz: float) -> Clip:
    """A walk before a camera that follows it, in the camera frame."""
    motion = make_gait("walk", seconds, fps_hz, body, np.random.default_rng(2))
    rng = np.random.default_rng(0)
    path = camera_path(Panning(), motion.pelvis_m, fps_hz, *SIZE_PX, 60.0, rng)
    seen, n = motion_in_camera(motion, path.world_from_cam), motion.n_frames
    return Clip("walk", seen, np.ones(n, dtype=bool), np.arange(n) + 7, path)


def beside(clip: Clip, side_m: float) -> Clip:
    """The same person further to the right."""
    pelvis_m = clip.motion.pelvis_m + np.array([side_m, 0.0, 0.0])
    return replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m))


def later(clip: Clip, rows: int) -> Clip:
    """The body of `rows` frames later under each number."""
    motion, n = clip.motion, clip.motion.n_frames
    at = np.clip(np.arange(n) + rows, 0, n - 1)
    return replace(clip, motion=motion.take(at))


def draw_masks(
    folder: Path,
    clips: Sequence[Clip],
    body: BodyModel,
    empty: int = 0,
    size_px: tuple[int, int] = SIZE_PX,
    lens: Distortion | None = None,
) -> PeopleMasks:
    """The people's outlines, 4 px wider; the last `empty` frames show nobody."""
    folder.mkdir()
    posed_m = [motion_vertices_m(body, clip.motion) for clip in clips]
    for row, number in enumerate(clips[0].image_numbers.tolist()):
        mask = np.zeros(size_px[::-1], np.uint8)
        for vertices_m in posed_m if row < len(posed_m[0]) - empty else ():
            k_px = camera_of(clips[0]).intrinsics_px
            posed = bent_points(vertices_m[row], lens)
            mask |= silhouette(posed, body.faces, k_px, size_px, 4)
        write_gray(folder / f"{number:05d}.png", mask)
    return PeopleMasks(folder, 4, boxed=False)


@pytest.fixture(scope="module")
def masks(walker, small_body, tmp_path_factory) -> PeopleMasks:
    return draw_masks(tmp_path_factory.mktemp("masks") / "person", [walker], small_body)


@pytest.fixture
def fit(small_body, masks) -> Callable[[Clip], PictureFit]:
    def fit_one(clip: Clip) -> PictureFit:
        (found,) = picture_fits([clip], [small_body], masks, VERDICT)
        assert found is not None
        return found

    return fit_one


def test_the_right_body_lies_on_the_person(walker, fit):
    found = fit(walker)
    assert found.overlap > 0.97 and (found.off_frames, found.late_frames) == (0, 0)
    assert found.frames == 40 == walker.motion.n_frames


def test_a_body_elsewhere_and_one_out_of_the_picture_lie_on_nobody(walker, fit):
    for side_m in (0.6, 2.0, 50.0):
        found = fit(beside(walker, side_m))
        assert found.off_frames == found.frames and found.overlap < 0.4


@pytest.mark.parametrize("rows", [8, -8])
def test_a_body_of_other_frames_says_by_how_many(walker, fit, rows):
    found = fit(later(walker, rows))
    assert found.late_frames == -rows
    assert found.late_overlap > 0.97 and found.late_overlap - found.overlap > 0.08


def test_at_a_high_rate_a_body_of_half_a_second_later_says_so(small_body, tmp_path):
    """30 frames of either side were a quarter of a second."""
    quick = walk_of(small_body, 2.0, 120.0)
    masks = draw_masks(tmp_path / "person", [quick], small_body)
    (found,) = picture_fits([later(quick, 60)], [small_body], masks, VERDICT)
    assert found is not None and found.late_frames == -60 and found.late_overlap > 0.95


def test_who_is_seen_for_a_moment_is_compared_in_those_frames(
    walker, small_body, tmp_path, monkeypatch
):
    monkeypatch.setattr(picture_fit, "MOST_FRAMES", 10)
    other = beside(walker, 0.5)
    brief = replace(other, valid=other.valid & (np.arange(len(other.valid)) >= 34))
    seen = draw_masks(tmp_path / "person", [walker, other], small_body)
    found = picture_fits([walker, brief], [small_body] * 2, seen, VERDICT)[1]
    assert found is not None and (found.frames, found.off_frames) == (6, 0)


def test_two_people_are_each_held_against_their_own(walker, small_body, tmp_path):
    both = [walker, beside(walker, 0.5)]
    seen = draw_masks(tmp_path / "person", both, small_body)
    for found in picture_fits(both, [small_body] * 2, seen, VERDICT):
        assert found is not None and found.overlap > 0.9 and found.off_frames == 0
    wrong = [walker, beside(walker, 2.5)]
    right, beside_all = picture_fits(wrong, [small_body] * 2, seen, VERDICT)
    assert right is not None and right.overlap > 0.5
    assert beside_all is not None and beside_all.off_frames == beside_all.frames


def test_boxes_are_compared_with_boxes(walker, small_body, masks, tmp_path):
    import cv2

    for path in masks.masks_dir.iterdir():
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        x, y, width, height = cv2.boundingRect(mask)
        mask[y : y + height, x : x + width] = 255
        write_gray(tmp_path / path.name, mask)
    for clip, low, high in ((walker, 0.9, 1.0), (beside(walker, 1.5), 0.0, 0.3)):
        (found,) = picture_fits([clip], [small_body], PeopleMasks(tmp_path, 4, boxed=True), VERDICT)
        assert found is not None and low <= found.overlap <= high


def test_at_the_edge_of_a_wide_lens_a_right_body_lies_on_the_person(walker, small_body, tmp_path):
    """Its distortion is in the masks and the landmarks: a right body was 10 frames late there."""
    lens = Distortion(-0.5, 0.0, 0.5)
    aside = beside(walker, 0.45 * float(walker.motion.pelvis_m[:, 2].mean()))
    masks = draw_masks(tmp_path / "person", [aside], small_body, lens=lens)
    seen = replace(masks, followed_dir=followed(tmp_path, aside, small_body, lens=lens))
    blind, right = (
        picture_fits([aside], [small_body], replace(seen, distortion=of), VERDICT)
        for of in (None, lens)
    )
    assert blind[0] is not None and blind[0].off_frames > 30
    assert right[0] is not None and right[0].off_frames == 0 and right[0].overlap > 0.97


def followed(
    folder: Path, clip: Clip, body: BodyModel, shown: int = 33, lens: Distortion | None = None
) -> Path:
    """Whom the landmark network would have seen, were it without an error; of the first `shown`
    landmarks it is sure."""
    folder.mkdir(exist_ok=True)
    motion, numbers = clip.motion, clip.image_numbers
    at_m = landmarks_about(motion.rotmats, body.rest_joints_m(motion.shape))
    placed_m = bent_points((at_m + motion.pelvis_m[:, None]).reshape(-1, 3), lens)
    image_px = project_cam(placed_m.reshape(at_m.shape), camera_of(clip).intrinsics_px)
    n, zeros = len(numbers), np.zeros((len(numbers), 4))
    Sightings(
        numbers, np.zeros(n, int), np.zeros(n, int), zeros, image_px, at_m,
        np.tile(np.arange(33) < shown, (n, 1)).astype(float),
        np.ones(n), zeros, zeros, np.zeros((n, 32)),
    ).write(folder / SIGHTINGS_FILE)  # fmt: skip
    FollowedRecord(
        size_px=SIZE_PX,
        images=tuple(numbers.tolist()),
        detections=n * ([],),
        people=(PersonFacts(n, ((int(numbers[0]), int(numbers[-1])),), (), ()),),
        left_out=(),
    ).write(folder / FOLLOWED_FILE)
    return folder


def test_limbs_elsewhere_in_a_like_outline_are_off(walker, small_body, masks, tmp_path):
    """Someone else in a like pose was accepted; here one who faces the other way."""
    motion = walker.motion
    about = replace(motion, root_rotmats=motion.root_rotmats * [-1.0, 1.0, -1.0])
    seen = replace(masks, followed_dir=followed(tmp_path, walker, small_body))
    right, turned, by_outline = (
        picture_fits([replace(walker, motion=one)], [small_body], people, VERDICT)[0]
        for one, people in ((motion, seen), (about, seen), (about, masks))
    )
    assert right is not None and right.off_frames == 0
    assert by_outline is not None and by_outline.overlap > 0.6 and by_outline.off_frames < 8
    assert turned is not None and turned.off_frames > 30


def test_somebody_beside_who_is_not_followed_speaks_against_nobody(small_body, tmp_path):
    """A woman who stood was 50 frames late: a man who was lost came into the mask beside her."""
    still = walk_of(small_body, 4.0, 10.0)
    standing = replace(still, motion=still.motion.take(np.zeros(still.motion.n_frames, dtype=int)))
    seen = draw_masks(tmp_path / "person", [standing], small_body)
    for number in standing.image_numbers[20:].tolist():
        path = seen.masks_dir / f"{number:05d}.png"
        mask = read_gray(path, SIZE_PX)
        rows, columns = np.nonzero(mask)
        mask[rows.min() : rows.max(), columns.min() - 12 : columns.max() + 12] = 255
        write_gray(path, mask)
    tracks = followed(tmp_path / "followed", standing, small_body)
    blind, told = (
        picture_fits([standing], [small_body], people, VERDICT)[0]
        for people in (seen, replace(seen, followed_dir=tracks))
    )
    assert blind is not None and blind.off_frames == 20 and abs(blind.late_frames) > 15
    assert told is not None and (told.off_frames, told.late_frames) == (0, 0)


@pytest.mark.parametrize("rows", [8, -8])
def test_who_is_late_by_mask_and_landmarks_says_so(walker, small_body, masks, tmp_path, rows):
    seen = replace(masks, followed_dir=followed(tmp_path, walker, small_body))
    (found,) = picture_fits([later(walker, rows)], [small_body], seen, VERDICT)
    assert found is not None and found.late_frames == -rows


def test_legs_behind_a_wall_are_not_asked_to_be_in_the_mask(walker, small_body, tmp_path):
    """Whom a desk hides below the hips lay on the person by 0.45 to 0.55, and was rejected."""
    cut = draw_masks(tmp_path / "person", [walker], small_body)
    k_px = camera_of(walker).intrinsics_px
    hips_px = project_cam(walker.motion.pelvis_m, k_px)[:, 1]
    for row, number in enumerate(walker.image_numbers.tolist()):
        path = cut.masks_dir / f"{number:05d}.png"
        mask = read_gray(path, SIZE_PX)
        mask[round(hips_px[row]) :] = 0
        write_gray(path, mask)
    overlaps = {}
    for shown in (25, 33):
        tracks = followed(tmp_path / f"followed_{shown}", walker, small_body, shown)
        (fit,) = picture_fits([walker], [small_body], replace(cut, followed_dir=tracks), VERDICT)
        assert fit is not None
        overlaps[shown] = fit.overlap
        limbs = seen_limbs([walker], [small_body], replace(cut, followed_dir=tracks))
        (hidden,) = limbs.legs_hidden
        assert np.array_equal(hidden, walker.valid & (shown < 33))
    assert overlaps[33] < 0.5 and overlaps[25] > 0.7
    assert not seen_limbs([walker], [small_body], cut).legs_hidden[0].any()


def test_each_track_is_straightened_once_for_all_bodies(walker, small_body, masks, tmp_path):
    """It was for every body: 46 of a film took half a minute of it."""
    seen = replace(masks, followed_dir=followed(tmp_path, walker, small_body))
    with patch.object(Lens, "rays", autospec=True, side_effect=Lens.rays) as rays:
        found = picture_fits([walker, beside(walker, 2.0)], [small_body] * 2, seen, VERDICT)
    assert rays.call_count == 1
    assert [fit and fit.off_frames for fit in found] == [0, 40]


def test_where_hardly_anybody_is_seen_nothing_is_said(walker, small_body, tmp_path):
    n = walker.motion.n_frames
    seen = draw_masks(tmp_path / "person", [walker], small_body, empty=n - 4)
    assert picture_fits([walker], [small_body], seen, VERDICT) == [None]
    nobody = replace(walker, valid=np.zeros(n, dtype=bool))
    assert picture_fits([nobody], [small_body], seen, VERDICT) == [None]


def test_only_masks_that_were_made_without_the_body_count(tmp_path):
    body, folder = SilhouetteSource(), FolderSource(path=tmp_path)
    person, boxes = PersonSource(dilate_px=5), OnnxSource()
    assert people_masks(tmp_path / "masks", MasksConfig(sources=(body, folder))) is None
    found = people_masks(tmp_path / "masks", MasksConfig(sources=(body, boxes, person)))
    assert found == PeopleMasks(tmp_path / "masks_by" / "person", 5, boxed=False)
    found = people_masks(tmp_path / "masks", MasksConfig(sources=(boxes,)))
    assert found is not None and found.boxed and found.masks_dir.name == "onnx"


def test_masks_of_cars_are_not_those_of_people(tmp_path):
    """Right bodies were rejected, as they do not lie on a parked car."""
    cars, others = OnnxSource(classes=("car",)), MaskRcnnSource(classes=("car", "bus"))
    assert people_masks(tmp_path / "masks", MasksConfig(sources=(cars, others))) is None
    sources = (others, PersonSource(), cars)
    found = people_masks(tmp_path / "masks", MasksConfig(sources=sources))
    assert found is not None and found.masks_dir.name == "person"
    found = people_masks(tmp_path / "masks", MasksConfig(sources=(cars, OnnxSource())))
    assert found is not None and found.masks_dir.name == "onnx_2"


def test_the_verdict_and_the_record_of_a_late_body_say_so(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    seen = as_input(true)
    camera = camera_of(seen)
    masks = draw_masks(
        tmp_path / "person", [seen], small_body, size_px=(camera.width_px, camera.height_px)
    )
    sfm_dir = reconstruction(tmp_path / "sfm", true, "full", [])
    for name, clip, given, rejected in (
        ("right", seen, masks, False),
        ("unchecked", seen, None, False),
        ("late", later(seen, -8), masks, True),
    ):
        people = (person_files(tmp_path, clip, small_body, name),)
        out = make_pseudo_gt(
            WorldEvidence(sfm_dir, people, seen=given), tmp_path / name, PseudoGtConfig()
        )
        record = load_record(out)
        (fit,) = record.picture_fits
        assert (fit is None) == (given is None)
        late = [reason for reason in record.people[0].reasons if "8 frames late" in reason]
        assert bool(late) == rejected
