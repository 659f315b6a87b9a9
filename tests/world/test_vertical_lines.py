"""Up by vertical lines of the background: of places that are made up, of drawn pictures, and of a
room and an office whose true up something else measured.

`real_lines.npz` has the lines, as ends in focal lengths, of two views of a man on a treadmill
(Pose2Sim's demo, BSD-3; up by its calibration) and of a dancer's video (viser's record3d_dance,
Apache-2.0; up by LiDAR's floor).
"""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import CAMERAS_FILE, SfmCameras, save_cameras
from gmrdata.read.frames import read_frames
from gmrdata.stage.run import Run
from gmrdata.values.camera import CameraPath, Lens, Origin, bent
from gmrdata.values.errors import BadFrames, BadRecord
from gmrdata.values.frame_set import Filmed
from gmrdata.values.transforms import angles_deg, rigid
from gmrdata.world.level import UpCue, across
from gmrdata.world.vertical_lines import (
    LINES_FILE,
    Lines,
    LinesConfig,
    find_lines,
    line_cue,
    load_lines,
)

UP = np.array([0.0, 0.0, 1.0])
UPRIGHT_CAMERA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # looks along +y


def off_by(degrees: float, up: np.ndarray = UP) -> UpCue:
    """Bodies that lean so far to a side and to the front."""
    tilted = up + np.tan(np.deg2rad(degrees)) * across(up).sum(axis=0) / np.sqrt(2)
    return UpCue("bodies", tilted / np.linalg.norm(tilted), np.eye(3) / np.deg2rad(5.0) ** 2)


def seen_lines(ends_m: np.ndarray, pitch_deg: float, k1: float = 0.0, **lens: object) -> Lines:
    """What a camera at the origin that looks down so far sees of lines (N, 2, 3)."""
    rotmat = Rotation.from_euler("x", -pitch_deg, degrees=True).as_matrix() @ UPRIGHT_CAMERA
    cam_m = ends_m @ rotmat
    ends = bent(cam_m[..., :2] / cam_m[..., 2:], k1)
    ends = ends + np.random.default_rng(5).normal(0, 0.0005, ends.shape)
    usual = {"radial": (k1, 0.0), "lens_sigmas": (0.0, 0.0)}
    return Lines(ends, 0.001, np.tile(rotmat, (len(ends), 1, 1)), **usual | lens)  # type: ignore[arg-type]


def place(n_vertical: int, n_level: int, n_others: int = 20, seed: int = 0) -> np.ndarray:
    """Lines (N, 2, 3) before a camera that looks along +y: upright, level and of any direction."""
    rng = np.random.default_rng(seed)
    n = n_vertical + n_level + n_others
    middles_m = rng.uniform([-2.5, 5, -2], [2.5, 8, 1], (n, 3))
    ways = rng.normal(size=(n, 3))
    ways[:n_vertical] = UP + rng.normal(0, 0.005, (n_vertical, 3))
    ways[n_vertical : n_vertical + n_level, 2] = 0.0
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.stack([middles_m - ways, middles_m + ways], axis=1)


def tilt_sigmas_deg(cue: UpCue) -> np.ndarray:
    """Standard errors (2,) of its tilts, the surer one first."""
    precisions = np.linalg.eigvalsh(across(cue.up) @ cue.precision @ across(cue.up).T)[::-1]
    return np.rad2deg(np.maximum(precisions, 1e-9) ** -0.5)


@pytest.mark.parametrize("pitch_deg", [0.0, 15.0, 40.0])
@pytest.mark.parametrize("lean_deg", [0.0, 8.0])
def test_vertical_lines_tell_up_where_bodies_lean(pitch_deg, lean_deg):
    cue = line_cue(seen_lines(place(30, 30), pitch_deg), off_by(lean_deg))
    assert cue is not None and cue.name == "lines"
    assert angles_deg(cue.up, UP) < 1.0
    assert 0.9 < tilt_sigmas_deg(cue)[0] < 1.2 and tilt_sigmas_deg(cue)[1] < 2.5


@pytest.mark.parametrize("seed", range(6))
def test_places_without_vertical_lines_tell_nothing(seed):
    """Of a forest, or of a road, whose edges lie level and lead away from the camera."""
    forest = place(0, 0, 80, seed)
    rng = np.random.default_rng(seed)
    starts_m = rng.uniform([-4, 3, -1.5], [4, 5, -1.4], (40, 3))
    road = np.stack([starts_m, starts_m + rng.uniform(4, 9, (40, 1)) * [0.0, 1.0, 0.0]], axis=1)
    for lines in (forest, np.concatenate([road, place(0, 20, 10, seed)])):
        cue = line_cue(seen_lines(lines, 5.0), off_by(6.0))
        assert cue is None or tilt_sigmas_deg(cue)[0] > 2.0


def test_nothing_hangs_on_one_line():
    """A plank that leans by 10 degrees and two doors: whose place this is nobody knows."""
    plank = np.array([[[0.0, 5.0, -2.0], [0.7, 5.0, 2.0]]])
    cue = line_cue(seen_lines(np.concatenate([plank, place(2, 10)]), 5.0), off_by(4.0))
    assert cue is None or angles_deg(cue.up, UP) < 2.5 * tilt_sigmas_deg(cue)[1]


def test_no_lines_tell_nothing():
    assert line_cue(seen_lines(place(0, 0, 0), 0.0), off_by(0.0)) is None


def test_a_room_that_is_seen_again_and_again_is_one():
    few = place(12, 10)
    once, often = seen_lines(few, 10.0), seen_lines(np.concatenate([few] * 16), 10.0)
    sigmas = [
        tilt_sigmas_deg(cue) for lines in (once, often) if (cue := line_cue(lines, off_by(4)))
    ]
    assert len(sigmas) == 2 and np.all(sigmas[1] > 0.9 * sigmas[0])


def test_a_lens_that_nobody_knows_may_bend_them():
    lines, wrong = place(40, 40), {"radial": (0.0, 0.0)}
    trusted = line_cue(seen_lines(lines, 30.0, -0.15, **wrong), off_by(0.0))
    doubted = line_cue(seen_lines(lines, 30.0, -0.15, **wrong, lens_sigmas=(0.0, 0.1)), off_by(0.0))
    right = line_cue(seen_lines(lines, 30.0, -0.15), off_by(0.0))
    assert trusted is not None and doubted is not None and right is not None
    off = [angles_deg(cue.up, UP) for cue in (trusted, doubted, right)]
    assert off[0] > 8.0 > 5.0 > off[1] > 1.0 > off[2]
    assert off[1] < 2 * np.hypot(*tilt_sigmas_deg(doubted))


def test_a_guessed_focal_length_makes_up_unsure_where_one_looks_down():
    lines = place(30, 30)
    sigmas = [
        tilt_sigmas_deg(cue)[1]
        for focal_sigma in (0.0, 0.3)
        if (cue := line_cue(seen_lines(lines, 30.0, lens_sigmas=(focal_sigma, 0.0)), off_by(0.0)))
    ]
    assert len(sigmas) == 2 and sigmas[1] > 1.5 * sigmas[0]


@pytest.mark.parametrize(("name", "sure_deg"), [("dancer", 1.1), ("cam02", 1.2), ("cam04", 1.2)])
@pytest.mark.parametrize("lean_deg", [0.0, 6.0])
def test_real_rooms_tell_up(name, sure_deg, lean_deg):
    with np.load(Path(__file__).with_name("real_lines.npz")) as file:
        ends, rotmats, picture, told, true = (
            file[f"{name}_{key}"] for key in ("ends", "rotmats", "picture", "lens", "up")
        )
    ends_sigma, k1, k2, *sigmas = told.tolist()
    lines = Lines(ends.astype(float), ends_sigma, rotmats[picture], (k1, k2), (*sigmas,))
    cue = line_cue(lines, off_by(lean_deg, true))
    assert cue is not None
    said_deg = tilt_sigmas_deg(cue)
    assert said_deg[0] < (1.5 if lean_deg else sure_deg) and said_deg[1] < 3.0
    off = across(cue.up) @ (true / (true @ cue.up))
    precision = across(cue.up) @ cue.precision @ across(cue.up).T
    assert off @ precision @ off < 2.0**2, "two standard errors"
    if name != "cam02":  # whose camera hardly looks down, so its tilt is told by few
        assert angles_deg(cue.up, true) < 1.0


def drawn(folder: Path, size_px: tuple[int, int]) -> Filmed:
    """Three pictures with a door of 40 % of their height, and bars on both sides."""
    width, height = size_px
    (folder / "frames").mkdir(parents=True)
    (folder / "masks").mkdir()
    for number in range(3):
        picture = np.full((height, width), 200, np.uint8)
        picture += np.random.default_rng(number).integers(0, 30, picture.shape, dtype=np.uint8)
        picture[:, : width // 8], picture[:, -width // 10 :] = 16, 16
        door = slice(height // 4, int(0.65 * height)), slice(width // 4, width // 2)
        picture[door] = 90
        # Somebody stands there with a pole.
        picture[height // 5 : -height // 5, 3 * width // 4 : 3 * width // 4 + 3] = 30
        mask = np.zeros_like(picture)
        mask[:, 2 * width // 3 :] = 255
        cv2.imwrite(str(folder / "frames" / f"{number:05d}.png"), picture)
        cv2.imwrite(str(folder / "masks" / f"{number:05d}.png"), mask)
    lens = Lens.centred(float(width), size_px, Origin("given", 0.01))
    path = CameraPath(lens.matrix_px, *size_px, np.tile(np.eye(4), (3, 1, 1)), np.arange(3) != 1)
    path.world_from_cam[:] = rigid(UPRIGHT_CAMERA, np.zeros(3))
    path.world_from_cam[1] = np.nan
    (folder / "sfm").mkdir()
    no_gaps = np.zeros(3, dtype=bool)
    cameras = SfmCameras(path, "rotation_only", np.arange(3), no_gaps)
    save_cameras(folder / "sfm" / CAMERAS_FILE, cameras)
    return Filmed(read_frames(folder / "frames"), lens)


@pytest.mark.parametrize("size_px", [(640, 480), (2560, 1920)])
def test_lines_are_found_beside_people_in_pictures_with_a_camera(size_px, tmp_path):
    filmed = drawn(tmp_path, size_px)
    out = find_lines(
        filmed, tmp_path / "masks", tmp_path / "sfm", tmp_path / "lines", LinesConfig()
    )
    lines = load_lines(out)
    assert lines.lens_sigmas == (0.01, 0.1) and lines.radial == (0.0, 0.0)
    ends_px = lines.ends * size_px[0] + np.divide(size_px, 2)
    apart_px = np.abs(ends_px[:, 1] - ends_px[:, 0])
    # Four sides of the door, which is drawn from pixel corner to corner, in two pictures.
    upright, level = apart_px[:, 0] < 2, apart_px[:, 1] < 2
    assert upright.sum() == level.sum() == 4 and len(lines.ends) == 8
    sides_px = np.sort(ends_px[upright][:, :, 0].mean(axis=1)) / size_px[0]
    assert sides_px == pytest.approx([0.25, 0.25, 0.5, 0.5], abs=1.5 / min(640, size_px[0]))
    assert np.allclose(lines.rotmats, UPRIGHT_CAMERA)
    # Without masks the pole is there, too, and bars never are.
    whole = load_lines(
        find_lines(filmed, None, tmp_path / "sfm", tmp_path / "whole", LinesConfig())
    )
    assert len(whole.ends) > len(lines.ends)
    assert np.abs(whole.ends[..., 0] * 2).max() < 0.7


def test_the_stage_is_made_once_and_says_what_is_missing(tmp_path):
    filmed = drawn(tmp_path, (320, 240))
    where = (tmp_path / "masks", tmp_path / "sfm", tmp_path / "lines", LinesConfig())
    first = find_lines(filmed, *where).stat().st_mtime_ns
    assert find_lines(filmed, *where).stat().st_mtime_ns == first
    (tmp_path / "masks" / "00002.png").unlink()
    with pytest.raises(BadFrames, match=r"00002"):
        find_lines(filmed, *where, run=Run(redo=True))
    assert load_lines(tmp_path / "lines").ends.shape[1:] == (2, 2), "what was there is whole"
    np.savez(tmp_path / "lines" / LINES_FILE, format="gmrdata-lines/0")
    with pytest.raises(BadRecord, match=r"lines.npz: `format` is 'gmrdata-lines/0'"):
        load_lines(tmp_path / "lines")


def test_beside_who_is_bent_down_lines_tell_nothing():
    """A studio's ceiling has as many lines as its walls: 61 degrees off, and sure to 3."""
    lines = seen_lines(place(30, 30), 10.0)
    precision = np.eye(3) / np.deg2rad(20.0) ** 2
    assert line_cue(lines, UpCue("bodies", off_by(10.0).up, precision)) is None
