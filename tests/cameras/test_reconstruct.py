"""Structure from motion on filmed rooms whose cameras are known exactly, with the real pycolmap."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cameras.again import solve_again
from gmrdata.cameras.check.verdict import camera_reasons
from gmrdata.cameras.files import Evidence, load_cameras, load_quality
from gmrdata.cameras.match.tracks import load_tracks
from gmrdata.cameras.recipe import CamerasVerdictConfig, SfmConfig
from gmrdata.cameras.reconstruct import IMAGES_FACT, _why_unsolved, reconstruct
from gmrdata.read.frames import list_images, read_frames
from gmrdata.read.video import as_frames
from gmrdata.stage.store import StageRecord
from gmrdata.stage.workers import own_cores
from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.errors import (
    BadFrames,
    BadRecipe,
    GmrdataError,
    MissingInput,
    NoReconstruction,
    StaleOutput,
)
from tests.filming import (
    coarse_noise,
    film_cameras,
    look_at,
    tracked_error_px,
    turn_errors_deg,
    write_pictures,
)
from tests.read.videos import make_video, textured

SMALL = SfmConfig(max_features=600)
FINE = SfmConfig(max_features=400, first_octave=-1)  # takes thrice as long
FIRST_SIX = range(6, 12)  # what to leave out of a film of twelve frames


@pytest.fixture(scope="module")
def pan_dir(pan, tmp_path_factory) -> Path:
    out_dir = tmp_path_factory.mktemp("sfm") / "pan"
    return pan.solved(out_dir, SMALL)


@pytest.fixture(scope="module")
def dolly_dir(dolly, tmp_path_factory) -> Path:
    out_dir = tmp_path_factory.mktemp("sfm") / "dolly"
    return dolly.solved(out_dir, FINE)


def test_a_pan_is_recognised_and_solved_as_a_pure_rotation(pan, pan_dir):
    cameras, quality = load_cameras(pan_dir), load_quality(pan_dir)
    assert cameras.geometry == quality.geometry == "rotation_only"
    assert cameras.path.has_camera.all()
    assert np.array_equal(cameras.path.centres_world_m, np.zeros((12, 3)))
    assert turn_errors_deg(cameras.path.world_from_cam, pan.world_from_cam).max() < 0.05
    assert quality.median_reprojection_px < 0.5
    assert quality.evidence.reason.startswith("a pure rotation explains")
    again = quality.agreement
    assert again is not None and again.turn_deg < 0.1 and again.place_share == 0


def test_cameras_are_sought_and_sought_again_by_the_times_of_the_frames(
    pan, pan_dir, tmp_path, monkeypatch, capsys
):
    """That images repeat was said three times more, of a folder that was gone."""
    shown, images = np.array([0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14]), pan.taken()
    twice = tuple(images.paths[row // 2] for row in range(12))
    frames = replace(images, paths=twice, times_s=shown / 30, rate_hz=30.0)
    heard = []

    def solve(finder, work_dir, in_time):
        heard.append(in_time.tolist())
        raise NoReconstruction("heard", work_dir)

    monkeypatch.setattr("gmrdata.cameras.reconstruct.solve", solve)
    with pytest.raises(NoReconstruction):
        reconstruct(frames, None, pan.lens, tmp_path / "first", SMALL)
    assert "6 of 12 frames repeat the one before" in " ".join(capsys.readouterr().err.split())
    solve_again(pan_dir, frames, None, tmp_path / "again", SMALL)
    assert capsys.readouterr().err == ""
    back, half = (14 - shown[::-1]).tolist(), [0, 1, 2, 4, 5, 6]
    assert heard == [shown.tolist(), back, half, shown.tolist(), shown.tolist()]


def test_a_dolly_is_recognised_and_mapped_with_six_degrees_of_freedom(dolly, dolly_dir):
    cameras, quality = load_cameras(dolly_dir), load_quality(dolly_dir)
    assert cameras.geometry == quality.geometry == "full"
    assert quality.mapper in ("global", "incremental")
    assert cameras.path.has_camera.all() and quality.frames_with_camera == 12
    assert np.array_equal(cameras.image_numbers, np.arange(12))
    assert turn_errors_deg(cameras.path.world_from_cam, dolly.world_from_cam).max() < 0.08
    assert dolly.centre_errors_m(cameras.path.centres_world_m).max() < 0.015
    assert quality.mean_reprojection_px < 1.0
    assert quality.lens is None
    again = quality.agreement
    assert again is not None and again.cameras == 6
    assert again.turn_deg < 0.2 and again.place_share < 0.02
    points = np.load(dolly_dir / "points.npz")
    assert len(points["xyz"]) == len(points["track_lengths"]) == quality.points > 100
    assert points["track_lengths"].min() >= 2


def test_the_tracks_give_the_error_of_the_cameras_again(dolly, dolly_dir):
    quality, tracks = load_quality(dolly_dir), load_tracks(dolly_dir)
    again_px = tracked_error_px(dolly_dir, quality.lens)
    assert again_px == pytest.approx(quality.mean_reprojection_px, rel=2e-3)
    assert tracks.image_names == tuple(image.name for image in list_images(dolly.images_dir))
    assert set(np.flatnonzero(tracks.adjusted)) <= set(quality.keyframes)
    seen = np.stack([tracks.rows, tracks.points])
    assert len(np.unique(seen, axis=1).T) == len(tracks.rows) > 1000
    assert (dolly_dir / "tracks.npz").stat().st_size < 10 * len(tracks.rows)


def test_a_camera_that_only_turns_has_no_tracks(pan_dir):
    tracks = load_tracks(pan_dir)
    assert len(tracks.rows) == 0 and len(tracks.image_names) == 12 and not tracks.adjusted.any()


def test_a_folder_without_tracks_says_how_to_get_them(dolly_dir, tmp_path):
    shutil.copytree(dolly_dir, tmp_path / "sfm")
    (tmp_path / "sfm/tracks.npz").unlink()
    with pytest.raises(MissingInput, match="kept no tracks. Delete .*sfm and run the same command"):
        load_tracks(tmp_path / "sfm")


def test_a_lens_that_bends_the_picture_bends_no_path(film, tmp_path):
    """A dolly as a lens with distortion shows it is as exact as one without."""
    dolly, k1, k2 = film("dolly", 8), 0.1, -0.05
    config = SfmConfig(max_features=1000, first_octave=-1)
    seen = np.stack(np.meshgrid(np.arange(320.0), np.arange(180.0)), axis=-1).reshape(-1, 1, 2)
    matrix = dolly.intrinsics_px - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    terms = np.array([k1, k2, 0, 0])
    source = cv2.undistortPoints(seen, matrix, terms, P=matrix).reshape(180, 320, 2)
    column, row = np.moveaxis(source.astype(np.float32), -1, 0)
    pictures = [cv2.imread(str(image)) for image in list_images(dolly.images_dir)]
    bent = [cv2.remap(picture, column, row, cv2.INTER_CUBIC) for picture in pictures]
    write_pictures(tmp_path / "frames", bent)
    made = reconstruct(read_frames(tmp_path / "frames"), None, dolly.lens, tmp_path / "sfm", config)
    cameras, quality = load_cameras(made), load_quality(made)
    lens = quality.lens
    assert lens is not None and lens.explains > 0.05
    # The tracks are where the image shows them, distorted.
    again_px = tracked_error_px(made, lens)
    assert again_px == pytest.approx(quality.mean_reprojection_px, rel=2e-3)
    # 0.3 of the focal length from the middle it shifts a point by 0.65 px.
    assert lens.k1 * 0.3**3 + lens.k2 * 0.3**5 == pytest.approx(k1 * 0.3**3, abs=0.0006)
    assert turn_errors_deg(cameras.path.world_from_cam, dolly.world_from_cam).max() < 0.08
    assert dolly.centre_errors_m(cameras.path.centres_world_m).max() < 0.015
    assert np.array_equal(cameras.path.intrinsics_px, dolly.intrinsics_px)


@pytest.mark.parametrize("kind", ["pan", "dolly"])
def test_the_same_seed_gives_the_same_bytes(kind, pan, dolly, tmp_path):
    filmed = {"pan": pan, "dolly": dolly}[kind]
    first, second = (
        filmed.solved(
            tmp_path / str(threads),
            # So many features that matches are sampled.
            FINE.model_copy(update={"threads": threads}),
            left_out=FIRST_SIX,
        )
        for threads in (None, 1 if own_cores() > 1 else 2)
    )
    assert load_cameras(first).geometry == {"pan": "rotation_only", "dolly": "full"}[kind]
    for name in ("cameras.npz", "points.npz", "tracks.npz", "quality.json"):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name
    names = "cameras.npz", "points.npz", "quality.json", "stage.json", "tracks.npz"
    assert sorted(path.name for path in second.iterdir()) == list(names)
    assert StageRecord.of(second).facts == {IMAGES_FACT: str(filmed.images_dir)}


def test_masks_keep_the_walking_person_out(dolly, tmp_path):
    def features(masks_dir: Path | None, out_dir: Path) -> float:
        made = replace(dolly, masks_dir=masks_dir).solved(out_dir, SMALL, left_out=FIRST_SIX)
        return load_quality(made).evidence.features_per_frame

    with_masks = features(dolly.masks_dir, tmp_path / "masked")
    assert features(None, tmp_path / "bare") > with_masks + 20


def test_pycolmap_says_nothing_when_all_goes_well(film, tmp_path, capfd):
    filmed = film("arc", 6)
    filmed.solved(tmp_path / "out", SMALL)
    said = capfd.readouterr()
    assert said.out == said.err == ""


def even(greys: Sequence[int]) -> list[np.ndarray]:
    return [np.full((120, 160), grey, np.uint8) for grey in greys]


def behind_a_logo(n: int) -> list[np.ndarray]:
    """A camera that went round a fox, with a logo over a fifth of its frames, was called static."""
    rng = np.random.default_rng(0)
    logo, pictures = np.kron(rng.integers(0, 256, (12, 16)), np.ones((10, 10))), []
    for _ in range(n):
        picture = cv2.GaussianBlur(rng.normal(0, 1, (360, 640)).astype(np.float32), (0, 0), 2)
        picture = 128 + 40 * picture / picture.std()
        picture[:120, :160] = logo
        pictures.append(picture.clip(0, 255).astype(np.uint8))
    return pictures


def zoomed(n: int) -> list[np.ndarray]:
    """A camera that zooms from one place was accepted as one that goes towards a wall."""
    picture, pictures = coarse_noise(1)[0], []
    for zoom in np.linspace(1.0, 1.5, n):
        about_middle = np.array([[zoom, 0, 79.5 * (1 - zoom)], [0, zoom, 59.5 * (1 - zoom)]])
        seen = cv2.warpAffine(picture, about_middle, (160, 120), flags=cv2.INTER_CUBIC)
        pictures.append(np.asarray(seen))
    return pictures


@pytest.mark.parametrize(
    ("pictures", "said"),
    [
        (even(range(90, 94)), "features per frame in the frames.*textureless"),
        (even([3] * 4), "the frames are black"),
        (coarse_noise(5), "no two frames show the same background.*another place"),
        (
            behind_a_logo(8),
            "explains only [0-9]+% of the picture, less than 50%. A logo, a subtitle or the hood",
        ),
        (zoomed(8), "a camera that zooms and turns in its place explains all"),
    ],
    ids=["textureless", "black", "unrelated", "a logo is no scene before a camera at rest", "zoom"],
)
def test_frames_without_a_reconstruction_say_why(pictures, said, tmp_path):
    write_pictures(tmp_path / "frames", pictures)
    with pytest.raises(NoReconstruction, match=said):
        frames = read_frames(tmp_path / "frames")
        lens = Lens((150.0, 150.0), (80.0, 60.0), frames.size_px)
        reconstruct(frames, None, lens, tmp_path / "out", SMALL)
    assert not (tmp_path / "out").exists()


def test_a_zoom_on_the_way_is_refused(film, tmp_path):
    """Its path was accepted, two degrees and 2 % of its extent off."""
    filmed = film("arc", 14, person=False)
    (tmp_path / "zoomed").mkdir()
    for image, zoom in zip(list_images(filmed.images_dir), np.linspace(1.0, 1.5, 14), strict=True):
        about_middle = np.array([[zoom, 0, 159.5 * (1 - zoom)], [0, zoom, 89.5 * (1 - zoom)]])
        seen = cv2.warpAffine(
            cv2.imread(str(image)), about_middle, (320, 180), flags=cv2.INTER_CUBIC
        )
        cv2.imwrite(str(tmp_path / "zoomed" / image.name), seen)
    said = "differ by [0-9.]+%, more than 1.0%: the camera zooms while it moves, or"
    with pytest.raises(NoReconstruction, match=said):
        reconstruct(read_frames(tmp_path / "zoomed"), None, filmed.lens, tmp_path / "out", SMALL)


@pytest.mark.parametrize(("of_video", "n_said"), [(False, 1), (True, 0)])
def test_a_folder_of_a_recording_that_hung_is_said(of_video, n_said, tmp_path, capsys):
    """Of a video it is said where its frames are taken."""
    shown = [textured(n if n < 10 or n > 25 else 10) for n in range(40)]
    write_pictures(tmp_path / "frames", shown)
    frames = read_frames(tmp_path / "frames")
    if of_video:
        frames = as_frames(make_video(tmp_path / "a.mp4", shown), tmp_path / "taken")
        capsys.readouterr()
    lens, few = Lens.centred(150.0, frames.size_px), SfmConfig(min_frames_registered=99)
    with pytest.raises(NoReconstruction, match="40 frames, but a camera path needs 99"):
        reconstruct(frames, None, lens, tmp_path / "out", few)
    said = " ".join(capsys.readouterr().err.split())
    assert said.count("frames 10 to 25 show one picture, and the next is far on") == n_said


def test_a_cut_is_named_by_its_images_number(tmp_path):
    for image in write_pictures(tmp_path / "frames", coarse_noise(5)):
        image.rename(image.with_name(f"{100 + int(image.stem)}.png"))
    frames = read_frames(tmp_path / "frames")
    lens = Lens((150.0, 150.0), (80.0, 60.0), frames.size_px)
    with pytest.raises(NoReconstruction, match="another place 1 times, first after frame 101: cut"):
        reconstruct(frames, None, lens, tmp_path / "out", SMALL)


def test_two_frames_are_too_few_and_not_textureless(dolly, tmp_path):
    with pytest.raises(NoReconstruction, match="frames: 2 frames, but a camera path needs 3"):
        dolly.solved(tmp_path / "out", SMALL, left_out=range(2, 12))


def test_three_frames_of_a_moving_camera_are_not_accepted_as_static(tmp_path):
    ahead = np.array([0.6, 1.0, -0.05])
    places_m = [np.array([-2.0, -2.0, 1.5]) + way_m * ahead for way_m in (0.0, 0.01, 0.02)]
    cameras = np.array([look_at(place_m, place_m + ahead) for place_m in places_m])
    filmed = film_cameras(tmp_path / "film", cameras, None)
    out = reconstruct(filmed.taken(), None, filmed.lens, tmp_path / "out", SMALL)
    quality = load_quality(out)
    (reason,) = camera_reasons(quality, CamerasVerdictConfig())
    assert quality.geometry != "full"
    assert reason.startswith(
        "3 frames, fewer than 10, do not tell a camera that stays in its place"
    )


def test_why_no_model_could_be_built_is_said_by_what_is_known():
    evidence = Evidence("full", "", 8.0, 9.0, 4.0, 0.2, 0.0, 57, 60.0)
    assert "12 frames are too few" not in _why_unsolved(12, evidence, SMALL)
    assert "water, a crowd, leaves" in _why_unsolved(12, evidence, SMALL)
    assert "3 frames are too few" in _why_unsolved(3, evidence, SMALL)
    nearly = replace(evidence, rotation_only_share=0.7)
    assert "hardly travels, a turn explains 70% of the matches" in _why_unsolved(12, nearly, SMALL)


def test_masks_that_cover_everything_leave_no_reconstruction(dolly, tmp_path):
    write_pictures(tmp_path / "masks", [np.full((180, 320), 255, np.uint8)] * 12)
    said = "0 features per frame outside the masks: the masks cover 100%"
    with pytest.raises(NoReconstruction, match=said):
        replace(dolly, masks_dir=tmp_path / "masks").solved(tmp_path / "out", SMALL)


def test_a_missing_mask_is_an_error(dolly, tmp_path):
    shutil.copytree(dolly.masks_dir, tmp_path / "masks")
    (tmp_path / "masks" / "00003.png").unlink()
    with pytest.raises(BadFrames, match="no mask for 00003.jpg"):
        replace(dolly, masks_dir=tmp_path / "masks").solved(tmp_path / "out", SMALL)


def test_left_out_frames_get_no_row(dolly, tmp_path):
    shutil.copytree(dolly.images_dir, tmp_path / "frames")
    (tmp_path / "frames" / "00004.jpg").unlink()
    (tmp_path / "frames" / "00005.jpg").write_bytes(b"")
    fewer = replace(dolly, images_dir=tmp_path / "frames")
    with pytest.raises(BadFrames, match="frame 4 missing between 3 and 5"):
        fewer.solved(tmp_path / "out", SMALL)
    cameras = load_cameras(fewer.solved(tmp_path / "out", SMALL, left_out={4, 5}))
    rows = [0, 1, 2, 3, *range(6, 12)]
    assert cameras.image_numbers.tolist() == rows and cameras.path.has_camera.all()
    some = replace(dolly, world_from_cam=dolly.world_from_cam[rows])
    assert some.centre_errors_m(cameras.path.centres_world_m).max() < 0.015
    with pytest.raises(StaleOutput, match="made with other values of inputs.left out 6"):
        fewer.solved(tmp_path / "out", SMALL, left_out={4, 5, 6})


def test_frames_of_different_sizes_are_an_error(dolly, tmp_path):
    shutil.copytree(dolly.images_dir, tmp_path / "frames")
    cv2.imwrite(str(tmp_path / "frames" / "00005.jpg"), np.zeros((90, 160), np.uint8))
    with pytest.raises(BadFrames, match=r"00005.jpg: 160x90 px, other frames are 320x180"):
        reconstruct(read_frames(tmp_path / "frames"), None, dolly.lens, tmp_path / "out", SMALL)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.eye(4), np.full((3, 3), np.nan), [[500, 1, 80], [0, 500, 60], [0, 0, 1]]],
)
def test_what_is_no_calibration_matrix_is_refused(matrix):
    path = CameraPath(np.array(matrix), 160, 120, np.eye(4)[None], np.ones(1, bool))
    with pytest.raises(BadRecipe, match="expected"):
        _ = path.lens


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        (Lens((500.0, -500.0), (160.0, 90.0), (320, 180)), "no lens has these"),
        (Lens((np.nan, 500.0), (160.0, 90.0), (320, 180)), "no lens has these"),
        (Lens((500.0, 500.0), (80.0, 60.0), (160, 120)), "give that of these frames"),
    ],
)
def test_what_is_no_lens_of_the_frames_is_refused(lens, said, dolly, tmp_path):
    with pytest.raises(BadRecipe, match=said):
        reconstruct(dolly.taken(), None, lens, tmp_path / "out", SMALL)


def test_cameras_of_another_kind_are_refused(tmp_path):
    np.savez(tmp_path / "cameras.npz", poses=np.zeros(3))
    with pytest.raises(
        GmrdataError, match=r"cameras\.npz: has no `format`, so it is no gmrdata-cameras/1.*--redo"
    ):
        load_cameras(tmp_path)


def test_frames_that_go_black_are_named_and_the_others_are_solved(film, tmp_path):
    filmed = film("arc", 15)
    for row in range(10, 15):
        path = filmed.images_dir / f"{row:05d}.jpg"
        cv2.imwrite(str(path), np.zeros((180, 320), np.uint8))
    out_dir = filmed.solved(tmp_path / "out", SMALL)
    cameras, quality = load_cameras(out_dir), load_quality(out_dir)
    assert np.array_equal(cameras.path.has_camera, np.arange(15) < 10)
    assert quality.featureless == tuple(range(10, 15))
