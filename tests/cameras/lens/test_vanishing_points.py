"""The focal length by straight lines: of rooms that are known, of real pictures, and of none."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.lens.intrinsics import (
    GivenIntrinsics,
    Intrinsics,
    IntrinsicsConfig,
    find_intrinsics,
    load_intrinsics,
)
from gmrdata.cameras.lens.vanishing_points import (
    LOG_FOCALS,
    PARTS,
    FocalOfLines,
    LinesConfig,
    focal_by,
    focal_of_lines,
    log_evidence,
)
from gmrdata.read.frames import read_frames
from gmrdata.values.camera import Lens, straightened

REAL_LINES = Path(__file__).parents[2] / "world" / "real_lines.npz"
END_SIGMA = 1.0 / 640
PAVEMENT_FOCAL = 0.505  # By its own vanishing points, as a person sees them


def seen_lines(
    focal: float, *, pitch_deg: float = 8.0, roll_deg: float = 2.0, n: int = 60
) -> np.ndarray:
    """Edges (N, 2, 2) of boxes in a room, as a 4:3 picture shows them; a third are of nothing."""
    rng = np.random.default_rng(3)
    cam_from_room = Rotation.from_euler(
        "zxy", [roll_deg, pitch_deg, 33.0], degrees=True
    ).as_matrix()
    starts = rng.uniform([-4, -2, 2], [4, 2, 9], (12 * n, 3))
    ways = np.eye(3)[rng.integers(0, 3, len(starts))] @ cam_from_room.T
    astray = rng.random(len(starts)) < 1 / 3
    ways[astray] = rng.normal(size=(astray.sum(), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ends = np.stack([starts, starts + rng.uniform(0.5, 2, (len(starts), 1)) * ways], axis=1)
    ends = ends[(ends[..., 2] > 0.5).all(axis=1)]
    seen = focal * ends[..., :2] / ends[..., 2:]
    seen = seen[(np.abs(seen) < [0.5, 0.375]).all(axis=(1, 2))]
    seen = seen[np.linalg.norm(seen[:, 1] - seen[:, 0], axis=1) > 0.04][:n]
    return np.asarray(seen + rng.normal(0, 0.7 / 640, seen.shape))


def found_by(ends: np.ndarray) -> FocalOfLines | None:
    return focal_by(log_evidence(ends, END_SIGMA))


@pytest.mark.parametrize("focal", [0.55, 0.85, 1.4])
@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(8.0, 2.0), (-35.0, 0.0), (15.0, 40.0)])
def test_lines_along_three_directions_tell_the_focal_length(focal, pitch_deg, roll_deg):
    """However the camera is held: one that looks steeply down, and one that is rolled."""
    found = found_by(seen_lines(focal, pitch_deg=pitch_deg, roll_deg=roll_deg))
    assert found is not None and found.focal_sigma < 0.15
    off = np.log(found.focal / focal)
    assert abs(off) < min(0.12, 2 * found.focal_sigma)


def folds() -> np.ndarray:
    """A cloth on the floor: long folds that lie nearly alike, and no wall about them."""
    rng = np.random.default_rng(0)
    middles = rng.uniform([-0.45, -0.05], [0.45, 0.4], (60, 2))
    slopes_rad = np.deg2rad(np.where(rng.random(60) < 0.6, 8.0, -25.0) + rng.normal(0, 7, 60))
    half = 0.04 * np.stack([np.cos(slopes_rad), np.sin(slopes_rad)], axis=1)
    return np.stack([middles - half, middles + half], axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_lines_of_nothing_tell_nothing(seed):
    rng = np.random.default_rng(seed)
    middles, slopes_rad = rng.uniform(-0.4, 0.4, (80, 2)), rng.uniform(0, np.pi, 80)
    half = rng.uniform(0.02, 0.1, (80, 1)) * np.stack([np.cos(slopes_rad), np.sin(slopes_rad)], 1)
    assert found_by(np.stack([middles - half, middles + half], axis=1)) is None


def test_lines_that_lie_alike_tell_nothing():
    """Folds of a studio's green cloth asked for 2.2 times the right focal length, "± 30 %"."""
    assert found_by(folds()) is None
    rows = np.linspace(-0.4, 0.4, 40)[:, None] * [[0.0, 1.0]]
    planks = rows[:, None] + np.array([[-0.3, 0.0], [0.3, 0.0]])
    assert found_by(planks) is None
    assert found_by(np.concatenate([planks, planks[..., ::-1]])) is None


@pytest.mark.parametrize("n", [0, 1, 9])
def test_a_few_lines_tell_nothing(n):
    logs = log_evidence(seen_lines(0.85)[:n], END_SIGMA)
    assert logs.shape == (len(LOG_FOCALS), 1 + PARTS) and not logs.any()


def test_a_recipe_of_no_lines_is_refused():
    """Lines of no picture ended in a traceback."""
    for said in ({"frames": 0}, {"longest_px": 0}, {"shortest_share": -1.0}, {"end_px": 0.0}):
        with pytest.raises(ValidationError, match=next(iter(said))):
            LinesConfig(**said)


@pytest.mark.parametrize("place", ["cam02", "cam04"])
@pytest.mark.parametrize("focal", [0.7, 1.0])
def test_real_rooms_tell_the_focal_length_of_their_calibration(place, focal):
    """Of calibrated cameras about a man on a treadmill (pose2sim)."""
    with np.load(REAL_LINES) as file:
        ends_sigma, k1, k2, *_ = file[f"{place}_lens"]
        ends = straightened(file[f"{place}_ends"].astype(float), k1, k2)
        picture = file[f"{place}_picture"]
    # In focal lengths of the true lens, so another scale is another picture's size.
    each = [ends[picture == one] for one in np.unique(picture)]
    logs = [log_evidence(lines * focal, ends_sigma * focal) for lines in each]
    found = focal_by(np.mean(logs, axis=0))
    assert found is not None
    assert abs(np.log(found.focal / focal)) < min(0.08, 1.5 * found.focal_sigma)


@pytest.fixture
def pavement(shared_path) -> Frames:
    """Two men before houses."""
    images = sorted(shared_path("video/static_people").glob("*.jpg"))[40:]
    return Frames(images, None, np.eye(3), (960, 540))


def test_a_pavement_and_houses_tell_the_focal_length_of_a_camera_at_rest(pavement):
    found = focal_of_lines(pavement, None, LinesConfig(frames=2))
    assert found is not None and found.focal_sigma < 0.12
    assert found.focal == pytest.approx(PAVEMENT_FOCAL, rel=0.1)


def test_lines_of_a_lens_that_bends_are_made_straight_first(pavement):
    """By the distortion that was given; a focal length that was given makes no difference."""
    config, size_px = LinesConfig(frames=1), pavement.size_px
    plain = focal_of_lines(pavement, None, config)
    other = focal_of_lines(pavement, Lens.centred(800.0, size_px), config)
    assert plain is not None and other is not None
    assert other == pytest.approx(plain)
    bends = Lens((485.0, 485.0), (480.0, 270.0), size_px, radial=(-0.2, 0.0))
    assert focal_of_lines(pavement, bends, config) != pytest.approx(plain)


@pytest.fixture
def at_rest(shared_path, tmp_path) -> Callable[..., Intrinsics]:
    """The lens of four frames of the pavement, whose camera hardly moves; they may note one."""
    images = sorted(shared_path("video/static_people").glob("*.jpg"))[40:51:3]

    def find(*, focal_px: float | None = None, film_mm: int | None = None) -> Intrinsics:
        from PIL import Image

        (folder := tmp_path / "frames").mkdir()
        for number, path in enumerate(images):
            image = Image.open(path)
            exif = image.getexif()
            exif.get_ifd(0x8769).update({} if film_mm is None else {0xA405: film_mm})
            image.save(folder / f"{number:05d}.jpg", exif=exif, quality=95)
        given = None if focal_px is None else GivenIntrinsics(focal_px=focal_px)
        config = IntrinsicsConfig(lines=LinesConfig(frames=2))
        frames = read_frames(folder)
        return load_intrinsics(find_intrinsics(frames, None, tmp_path / "out", config, given=given))

    return find


def test_the_guess_of_a_camera_at_rest_is_that_of_lines(at_rest):
    lens = at_rest()
    assert lens.source == "prior" and lens.is_guess and lens.focal_observable is False
    assert lens.asked_by_lines is not None and lens.objections == ()
    assert lens.focal_px == pytest.approx(lens.asked_by_lines.focal_px)
    assert lens.focal_sigma == lens.asked_by_lines.focal_sigma < 0.12
    assert lens.focal_px == pytest.approx(960 * PAVEMENT_FOCAL, rel=0.1)
    assert lens.notes[0].startswith("Where straight lines of the place meet tells the focal length")


@pytest.mark.parametrize(("focal_px", "is_right"), [(490.0, True), (750.0, False)])
def test_a_given_focal_length_of_a_camera_at_rest_is_held_against_lines(
    at_rest, focal_px, is_right
):
    """Nothing else would notice: a person is put as many times too far away."""
    lens = at_rest(focal_px=focal_px)
    assert lens.focal_px == focal_px and lens.source == "given"
    if is_right:
        assert not lens.objections and "the given one, which agrees" in lens.notes[1]
    else:
        (objection,) = lens.objections
        assert objection.startswith("Straight lines ask for a focal length of 4")
        assert objection.endswith("the lens that is given is not that of these frames.")


@pytest.mark.parametrize(("film_mm", "noted_px"), [(19, 483.7), (28, 712.8)])
def test_a_cameras_note_is_averaged_with_lines_or_doubted(at_rest, film_mm, noted_px):
    lens = at_rest(film_mm=film_mm)
    assert lens.source == "metadata" and lens.asked_by_lines is not None
    lines_px, lines_sigma = lens.asked_by_lines.focal_px, lens.asked_by_lines.focal_sigma
    if film_mm == 19:
        weights = np.array([0.05, lines_sigma]) ** -2
        logs = np.log([noted_px, lines_px])
        assert lens.focal_px == pytest.approx(np.exp(np.average(logs, weights=weights)), rel=1e-3)
        assert lens.focal_sigma == pytest.approx(weights.sum() ** -0.5)
        assert lens.notes[2] == f"Together they make {lens.focal_px:.0f} px."
    else:
        assert lens.focal_px == pytest.approx(noted_px, rel=1e-3)
        assert lens.focal_sigma == pytest.approx(np.hypot(0.05, np.log(lines_px / lens.focal_px)))
        assert "the two disagree" in lens.notes[1]
