"""Eqs. 6-8, levelling, and pseudo ground truth from exact cameras."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import (
    CAMERAS_FILE,
    POINTS_FILE,
    QUALITY_FILE,
    SfmCameras,
    load_quality,
    save_cameras,
    save_points,
)
from gmrdata.film.programmes import Circular, Panning, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import sole_points_m
from gmrdata.read.body_file import save_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, fill_gaps
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadIntrinsics, BadMotionFile, BadRecord, NoReconstruction
from gmrdata.values.files import read_json
from gmrdata.values.people import PersonFiles, person_file
from gmrdata.world.compose import metric_cameras, motion_in_camera, motion_in_world
from gmrdata.world.judge import SolvedCameras, load_record
from gmrdata.world.pseudo_gt import (
    CameraPerson,
    ComposedWorld,
    WorldEvidence,
    compose_clips,
    make_pseudo_gt,
)
from gmrdata.world.recipe import PseudoGtConfig, save_gravity
from tests.motions import made_up, random_motion
from tests.reconstructions import quality_of_path

# About where SMPL's rest pelvis is: 0.22 m below the model's origin.
REST_PELVIS_M = np.array([-0.002, -0.223, 0.028])


def random_cameras(rng: np.random.Generator, n: int) -> np.ndarray:
    rotmats = Rotation.random(n, random_state=rng.integers(1 << 30)).as_matrix()
    return transforms.rigid(rotmats, rng.normal(0, 5, (n, 3)))


@given(st.integers(0, 10**6), st.integers(2, 8), st.floats(0.01, 100))
def test_into_the_camera_and_back_is_the_same_motion(seed, n, scale):
    rng = np.random.default_rng(seed)
    motion, cameras = random_motion(rng, n), random_cameras(rng, n)
    person = motion_in_camera(motion, cameras)
    assert person.frame == "camera"
    again = motion_in_world(person, metric_cameras(cameras, 1 / scale), scale)
    assert again.frame == "world"
    assert np.abs(again.root_rotmats - motion.root_rotmats).max() < 1e-12
    assert np.abs(again.pelvis_m - motion.pelvis_m).max() < 1e-9
    assert again.local_rotmats is motion.local_rotmats


@given(st.integers(0, 10**6))
def test_eqs_7_and_8_are_taken_literally(seed):
    rng = np.random.default_rng(seed)
    cameras = random_cameras(rng, 4)
    person = replace(random_motion(rng, 4), frame="camera")
    world = motion_in_world(person, cameras, 2.5)
    for i in range(4):
        r_col, t_col = cameras[i, :3, :3], cameras[i, :3, 3]
        assert np.allclose(world.root_rotmats[i], r_col @ person.root_rotmats[i], atol=1e-12)
        assert np.allclose(world.pelvis_m[i], r_col @ person.pelvis_m[i] + 2.5 * t_col, atol=1e-12)


def test_smpl_trans_in_place_of_the_pelvis_costs_11_8_mm_per_frame():
    """A camera that tilts at 30 degrees/s films a still person, at 10 fps."""
    n, fps_hz = 20, 10.0
    angles_rad = np.deg2rad(30.0) * np.arange(n) / fps_hz
    tilt = Rotation.from_rotvec(angles_rad[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    cameras = transforms.rigid(tilt, np.zeros(3))
    rng = np.random.default_rng(0)
    still = replace(
        random_motion(rng, n),
        root_rotmats=np.tile(Rotation.from_euler("x", 90, degrees=True).as_matrix(), (n, 1, 1)),
        pelvis_m=np.tile([0.3, 4.0, 0.9], (n, 1)),
    )
    person = motion_in_camera(still, cameras)
    exact = motion_in_world(person, cameras)
    assert np.linalg.norm(np.diff(exact.pelvis_m, axis=0), axis=1).max() < 1e-12
    naive = motion_in_world(replace(person, pelvis_m=person.pelvis_m - REST_PELVIS_M), cameras)
    errors_mm = 1000 * np.linalg.norm(np.diff(naive.pelvis_m, axis=0), axis=1)
    assert errors_mm == pytest.approx(11.8, abs=0.1)


def test_the_frame_of_reference_is_checked():
    rng = np.random.default_rng(0)
    motion, cameras = random_motion(rng, 3), random_cameras(rng, 3)
    with pytest.raises(BadMotionFile, match="in the world frame, expected the camera frame"):
        motion_in_world(motion, cameras)
    with pytest.raises(BadMotionFile, match="in the camera frame, expected the world frame"):
        motion_in_camera(motion_in_camera(motion, cameras), cameras)
    with pytest.raises(BadMotionFile, match=r"3 frames of motion, but cameras \(2, 4, 4\)"):
        motion_in_camera(motion, cameras[:2])


def true_clip(body: BodyModel, programme: Circular | Panning, fps_hz: float = 10.0) -> Clip:
    motion = make_gait("circle", 4.0, fps_hz, body, np.random.default_rng(2))
    rng = np.random.default_rng(0)
    path = camera_path(programme, motion.pelvis_m, fps_hz, 640, 360, 60.0, rng)
    n = motion.n_frames
    return Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n) + 100, path)


def as_input(clip: Clip) -> Clip:
    """What 3DPW gives: the person in the camera frame, and intrinsics."""
    n, true = clip.motion.n_frames, camera_of(clip)
    unknown = np.full((n, 4, 4), np.nan)
    camera = replace(true, world_from_cam=unknown, has_camera=np.zeros(n, dtype=bool))
    return replace(clip, motion=motion_in_camera(clip.motion, true.world_from_cam), camera=camera)


def reconstruction(folder: Path, clip: Clip, geometry: str, lost: list[int]) -> Path:
    """The true cameras in another world and unit, without the rows `lost`, as sfm writes them."""
    true = camera_of(clip)
    world = transforms.rigid(Rotation.from_rotvec([0.4, 1.0, -2.0]).as_matrix(), np.ones(3))
    world_from_cam = metric_cameras(world @ true.world_from_cam, 1 / 0.37)
    if geometry == "rotation_only":
        world_from_cam[:, :3, 3] = 0.0
    has_camera = np.ones(len(world_from_cam), dtype=bool)
    has_camera[lost] = False
    world_from_cam[lost] = np.nan
    path = CameraPath(true.intrinsics_px, 640, 360, world_from_cam, has_camera)
    folder.mkdir()
    cameras = SfmCameras(
        path,
        "full" if geometry == "full" else "rotation_only",
        clip.image_numbers,
        np.zeros(len(has_camera), dtype=bool),
    )
    save_cameras(folder / CAMERAS_FILE, cameras)
    save_points(folder / POINTS_FILE, np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
    quality = quality_of_path(path, geometry=cameras.geometry, registered_share=1.0)
    quality.write(folder / QUALITY_FILE)
    return folder


def person_files(folder: Path, clip: Clip, body: BodyModel, name: str = "in") -> PersonFiles:
    """A clip and its body on disk."""
    save_body(folder / "body.npz", body)
    save_clip(folder / f"{name}.npz", clip, body.rest_pelvis_m(clip.motion.shape))
    return PersonFiles(folder / f"{name}.npz", folder / "body.npz")


def made(tmp_path: Path, clip: Clip, body: BodyModel, geometry: str, lost: list[int]) -> Path:
    people = (person_files(tmp_path, as_input(clip), body),)
    return made_of(reconstruction(tmp_path / "sfm", clip, geometry, lost), people)


def made_of(
    sfm_dir: Path, people: tuple[PersonFiles, ...], run: Run = DEFAULT_RUN, **evidence: Any
) -> Path:
    """The pseudo ground truth beside a reconstruction, by the usual recipe."""
    given, out_dir = WorldEvidence(sfm_dir, people, **evidence), sfm_dir.with_name("out")
    return make_pseudo_gt(given, out_dir, PseudoGtConfig(), run=run)


def test_exact_cameras_give_back_the_true_motion(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    out_dir = made(tmp_path, true, small_body, "full", [])
    found, quality = load_clip(out_dir / person_file(0)), read_json(out_dir / "quality.json")
    assert found.motion.frame == "world" and found.valid.all()
    assert quality["scale"] == pytest.approx(0.37, rel=0.005)
    assert (
        quality["cameras"]["geometry"] == "full"
        and quality["people"][0]["kept_frames"] == true.motion.n_frames
    )
    assert quality["scale_cues"][0]["name"] == "planted_feet"
    error = compare_clips(found, true)
    assert error.ome_deg < 1e-4 and error.tme_mm < 2.0
    # Level: z up to a degree, feet on the ground.
    assert error.true_from_pseudo[2, 2] > np.cos(np.deg2rad(1.0))
    assert found.motion.pelvis_m[:, 2] == pytest.approx(true.motion.pelvis_m[:, 2], abs=0.03)
    assert found.motion.pelvis_m[0, :2] == pytest.approx([0, 0], abs=1e-9)


def test_a_pan_needs_no_scale(small_body, tmp_path):
    true = true_clip(small_body, Panning())
    out_dir = made(tmp_path, true, small_body, "rotation_only", [])
    quality = read_json(out_dir / "quality.json")
    assert quality["scale"] is None and quality["scale_sigma"] is None
    error = compare_clips(load_clip(out_dir / person_file(0)), true)
    assert error.ome_deg < 1e-4 and error.tme_mm < 1e-3


@pytest.mark.parametrize(("rise_m", "way_m"), [(0.0, 0.0), (0.8, 0.0), (-0.8, 0.0), (0.0, 24.0)])
def test_nobody_sinks_into_the_floor(small_body, tmp_path, rise_m, way_m):
    """Up and down steps, and where no foot stands."""
    true = true_clip(small_body, Panning())
    shares = np.linspace(0, 1, true.motion.n_frames)[:, None]
    steps = [way_m, 0.0, 0.0] * shares + [0.0, 0.0, rise_m] * (np.round(4 * shares) / 4)
    pelvis_m = true.motion.pelvis_m + steps
    true = replace(true, motion=replace(true.motion, pelvis_m=pelvis_m))
    out_dir = made(tmp_path, true, small_body, "rotation_only", [])
    soles_m = sole_points_m(small_body, load_clip(out_dir / person_file(0)).motion)[:, :, 2]
    lowest_m = soles_m.min(axis=1)
    assert np.percentile(lowest_m, 5) > -0.1 and np.percentile(lowest_m, 10) < 0.1
    level = load_record(out_dir).level
    assert level is not None
    assert (level.soles_above_m is None) == bool(way_m)
    assert ((level.soles_above_m or 0.0) > 0.5) == (level.remark is not None) == bool(rise_m)


def test_slow_motion_shows_the_same_world(small_body, tmp_path):
    """At 240 frames per second a foot that swung at 1.4 m/s was taken to stand."""
    records, heights_m = [], []
    for fps_hz in (30.0, 240.0):
        true, folder = true_clip(small_body, Circular(), fps_hz), tmp_path / f"{fps_hz:g}"
        folder.mkdir()
        out_dir = made(folder, true, small_body, "full", [])
        records.append(load_record(out_dir))
        heights_m.append(load_clip(out_dir / person_file(0)).motion.pelvis_m[:, 2].mean())
    usual, slow = records
    assert slow.scale == pytest.approx(usual.scale, rel=0.01)
    assert heights_m[1] == pytest.approx(heights_m[0], abs=0.01)
    assert usual.level is not None and slow.level is not None
    assert slow.level.remark is None and usual.level.remark is None
    assert slow.level.soles_above_m == pytest.approx(usual.level.soles_above_m, abs=0.01)


def before_a_still_camera(
    body: BodyModel,
    pelvis_m: np.ndarray,
    known: np.ndarray,
    fps_hz: float,
    legs_seen: np.ndarray | None = None,
) -> ComposedWorld:
    """A person who stands with the pelvis there (T, 3), upright in the picture, in known rows."""
    n, half_turn = len(pelvis_m), np.tile(np.diag([1.0, -1.0, -1.0]), (len(pelvis_m), 1, 1))
    rest = np.tile(np.eye(3), (n, 23, 1, 1))
    motion = made_up(rest, half_turn, pelvis_m, frame="camera", fps_hz=fps_hz)
    intrinsics_px = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 180.0], [0.0, 0.0, 1.0]])
    path = CameraPath(intrinsics_px, 640, 360, np.tile(np.eye(4), (n, 1, 1)), np.ones(n, bool))
    quality = quality_of_path(path, geometry="static")
    cameras = SolvedCameras(path, "static", np.zeros((0, 3)), quality, np.arange(n))
    clip = Clip("stands", motion, known, np.arange(n), None)
    legs_seen = np.ones_like(known) if legs_seen is None else legs_seen
    person = CameraPerson(clip, body, 0.07, known, legs_seen)
    return compose_clips([person], cameras, PseudoGtConfig())


STANDS_M = 1.195 - 0.223  # height of the small body's pelvis over its soles


def test_who_comes_back_far_away_still_stands(small_body):
    """After ten seconds in which nobody was seen, 16 m further on."""
    pelvis_m, known = np.tile([0.0, 0.0, 4.0], (350, 1)), np.ones(350, dtype=bool)
    known[50:300] = False
    pelvis_m[50:, 2] += np.append(np.linspace(0, 16, 250), np.full(50, 16.0))
    world = before_a_still_camera(small_body, pelvis_m, known, 25.0)
    found_m = world.clips[0].motion.pelvis_m[known]
    assert np.isfinite(world.clips[0].motion.root_rotmats).all()
    assert found_m[:, 2] == pytest.approx(STANDS_M, abs=0.02)
    assert found_m[-1, 1] - found_m[0, 1] == pytest.approx(16.0, abs=0.02)


@pytest.mark.parametrize("first", [5, 6])
def test_poses_between_the_frames_that_are_watched_for_feet_tell_the_floor(small_body, first):
    """Of 120 fps every second frame is watched, and with a pose in each 24th from an odd one on
    no frame was left."""
    known = np.zeros(240, dtype=bool)
    known[first::24] = True
    world = before_a_still_camera(small_body, np.tile([0.0, 0.0, 4.0], (240, 1)), known, 120.0)
    assert world.clips[0].motion.pelvis_m[:, 2] == pytest.approx(STANDS_M, abs=0.02)


@pytest.mark.parametrize("seen", [60, 20, 0])
def test_feet_that_nobody_saw_say_where_the_floor_is_only_where_none_was_seen(small_body, seen):
    """Of somebody who walks behind a desk and seems lower there.  A few seen legs may be wrong."""
    known, legs_seen = np.ones(100, dtype=bool), np.arange(100) < seen
    pelvis_m = np.tile([0.0, 0.0, 4.0], (100, 1))
    pelvis_m[seen or 20 :, 1] += 0.5
    world = before_a_still_camera(small_body, pelvis_m, known, 25.0, legs_seen)
    heights_m = world.clips[0].motion.pelvis_m[:, 2]
    assert heights_m[0] == pytest.approx(STANDS_M + 0.5 * (not seen), abs=0.02)
    assert world.level.floor_sigma_m == (0.0 if seen == 60 else 0.25)


def on_its_side(clip: Clip, turn_deg: float = 90.0) -> Clip:
    """The same before a camera that was turned about its axis."""
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    return filmed_from(clip, camera_of(clip).world_from_cam @ transforms.rigid(turn, np.zeros(3)))


def filmed_from(clip: Clip, world_from_cam: np.ndarray) -> Clip:
    """The same before cameras (T, 4, 4) elsewhere."""
    return replace(clip, camera=replace(camera_of(clip), world_from_cam=world_from_cam))


def test_a_picture_on_its_side_makes_up_unsure_and_is_said(small_body, tmp_path):
    """Who lies straight before an upright camera gives the same numbers, and up was told to 5
    degrees; of somebody on hands and feet, who leans by 45 in the picture, to 6.  People who stand
    before a camera on its side still stand."""
    true = true_clip(small_body, Circular())
    levels = []
    for name, clip in (
        ("upright", on_its_side(true, 20.0)),
        ("side", on_its_side(true)),
        ("aslant", on_its_side(true, 40.0)),
    ):
        (tmp_path / name).mkdir()
        out_dir = made(tmp_path / name, clip, small_body, "full", [])
        error = compare_clips(load_clip(out_dir / person_file(0)), clip)
        assert error.true_from_pseudo[2, 2] > np.cos(np.deg2rad(1.0))
        levels.append(load_record(out_dir).level)
    upright, side, aslant = levels
    assert upright is not None and upright.sigma_deg < 10 and upright.tipped is None
    assert side is not None and side.sigma_deg == pytest.approx(60 * np.sqrt(2), rel=1e-3)
    assert aslant is not None and aslant.sigma_deg == side.sigma_deg and aslant.tipped is not None
    assert [cue.name for cue in side.cues] == [*(cue.name for cue in upright.cues), "picture"]
    off_deg = side.cues[-1].apart_deg
    assert off_deg == pytest.approx(90, abs=4) and not side.cues[-1].used
    assert side.tipped == (
        f"up by the bodies is {off_deg:.0f} degrees from that of the picture: somebody lies, or "
        "the camera was on its side or looked steeply down"
    )


def test_a_phone_tells_up_of_who_lies(small_body, tmp_path):
    """It was refused as another video's, as it was 90 degrees from the body's."""
    true = true_clip(small_body, Panning())
    at_rest = np.tile(camera_of(true).world_from_cam[:1], (true.motion.n_frames, 1, 1))
    lying = on_its_side(filmed_from(true, at_rest))
    people = (person_files(tmp_path, as_input(lying), small_body),)
    sfm_dir = reconstruction(tmp_path / "sfm", lying, "rotation_only", [])
    gravity_path = tmp_path / "g.npz"
    save_gravity(gravity_path, np.tile([0.0, -1.0, 0.0], (len(at_rest), 1)))
    out_dir = made_of(sfm_dir, people, gravity_path=gravity_path)
    found, level = load_clip(out_dir / person_file(0)), load_record(out_dir).level
    assert level is not None
    np.testing.assert_allclose(-camera_of(found).world_from_cam[:, 2, 1], 1.0, atol=1e-3)
    assert level.sigma_deg < 1.0 and level.tipped is None


def test_frames_without_a_camera_are_not_valid_but_finite(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    lost = [0, 7, 8, true.motion.n_frames - 1]
    found = load_clip(made(tmp_path, true, small_body, "full", lost) / person_file(0))
    assert np.flatnonzero(~found.valid).tolist() == lost
    assert np.array_equal(camera_of(found).has_camera, found.valid)
    assert np.isnan(camera_of(found).world_from_cam[lost]).all()
    assert np.isfinite(found.motion.pelvis_m).all() and np.isfinite(found.motion.root_rotmats).all()
    # Row 7 lies in a short gap of a smooth path: interpolation is near the truth.
    steps_m = np.linalg.norm(np.diff(found.motion.pelvis_m, axis=0), axis=1)
    true_steps_m = np.linalg.norm(np.diff(true.motion.pelvis_m, axis=0), axis=1)
    assert steps_m[6:9] == pytest.approx(true_steps_m[6:9], abs=0.03)
    error = compare_clips(found, true)
    assert error.frames_with_camera == true.motion.n_frames - 4 and error.tme_mm < 3.0


def test_gaps_are_filled_between_neighbours():
    rotmats = Rotation.from_rotvec([[0, 0, 0.1 * i] for i in range(5)]).as_matrix()
    cameras = transforms.rigid(rotmats, np.arange(15.0).reshape(5, 3))
    holes = cameras.copy()
    holes[[0, 2, 4]] = np.nan
    filled = fill_gaps(holes, np.array([False, True, False, True, False]), np.arange(5))
    assert filled[1:4] == pytest.approx(cameras[1:4], abs=1e-12)
    assert filled[[0, 4]] == pytest.approx(cameras[[1, 3]], abs=1e-12)


def test_no_common_frame_is_an_error(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    with pytest.raises(NoReconstruction, match="walk: no two frames have both pose and camera"):
        made(tmp_path, true, small_body, "full", list(range(true.motion.n_frames)))
    assert not (tmp_path / "out").exists()


def test_why_there_is_no_world_names_the_image_before_a_cut(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    people = (person_files(tmp_path, as_input(true), small_body),)
    lost = list(range(true.motion.n_frames))
    sfm_dir = reconstruction(tmp_path / "sfm", true, "full", lost)
    quality = load_quality(sfm_dir).model_copy(update={"cuts_after_frames": (7, 20)})
    quality.write(sfm_dir / QUALITY_FILE)
    with pytest.raises(NoReconstruction, match="place 2 times, first after frame 107: cut"):
        made_of(sfm_dir, people)


def test_clips_that_do_not_fit_are_refused(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    sfm_dir = reconstruction(tmp_path / "sfm", true, "full", [])
    later = replace(as_input(true), image_numbers=true.image_numbers + 1)
    for clips, said in (
        ({"a": true}, "not in the camera frame"),
        ({"a": as_input(true), "b": later}, r"b\.npz: has other rows than walk"),
    ):
        people = tuple(person_files(tmp_path, clip, small_body, n) for n, clip in clips.items())
        with pytest.raises(BadMotionFile, match=said):
            made_of(sfm_dir, people)


def test_what_the_phone_felt_levels_the_world_and_another_videos_is_refused(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    up_cam = camera_of(true).world_from_cam[:, 2, :3]  # the third row: the world's z in each camera
    people = (person_files(tmp_path, as_input(true), small_body),)
    sfm_dir, gravity_path = reconstruction(tmp_path / "sfm", true, "full", []), tmp_path / "g.npz"

    def make(felt: np.ndarray) -> Path:
        save_gravity(gravity_path, felt)
        return made_of(sfm_dir, people, Run(redo=True), gravity_path=gravity_path)

    out_dir = make(up_cam)
    error = compare_clips(load_clip(out_dir / person_file(0)), true)
    assert error.true_from_pseudo[2, 2] > np.cos(np.deg2rad(0.2))
    cues = read_json(out_dir / "quality.json")["level"]["cues"]
    assert cues[0]["name"] == "gravity" and cues[0]["used"]
    lying = np.stack([up_cam[:, 1], -up_cam[:, 0], up_cam[:, 2]], axis=1)  # pictures turned by 90
    nods = Rotation.from_rotvec(np.linspace(0, 1, len(up_cam))[:, None] * [1.0, 0.0, 0.0])
    wrong = [(lying, "or way up"), (nods.apply(up_cam), "turns by 1"), (up_cam[1:], "directions")]
    for felt, said in wrong:
        with pytest.raises((BadIntrinsics, BadRecord), match=said):
            make(felt)
    assert (out_dir / "quality.json").is_file()  # what was there stays
