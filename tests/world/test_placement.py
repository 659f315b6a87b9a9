"""People before the camera, of files as VIBE, WHAM, GVHMR, TRAM and PHALP would have made them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.film.programmes import Circular, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.read.systems.result import read_system
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import Lens
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.people import EstimatedPeople, Pinhole
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.placement import PlacedBody, assumed_place, place_body
from gmrdata.write.systems import TrackedPerson, gvhmr_bytes, wham_bytes
from tests.damage import bytes_changed, read_or_refused
from tests.joblib_layout import joblib_bytes
from tests.read import system_files
from tests.read.system_files import Seen, write_joblib, write_seen_tram, write_torch

SIZE_PX = (640, 360)
K1 = -0.15
SYSTEMS = ("vibe", "wham", "gvhmr", "tram", "phalp")


@pytest.fixture(scope="module")
def walk(neutral) -> Clip:
    """Somebody at the side of the picture, 3 m away."""
    motion = make_gait("walk", 1.2, 10.0, neutral, np.random.default_rng(2))
    motion = replace(motion, body=neutral.name)
    rng = np.random.default_rng(0)
    path = camera_path(Circular(radius_m=3.0), motion.pelvis_m, 10.0, *SIZE_PX, 60.0, rng)
    turned = Rotation.from_euler("y", -14, degrees=True).as_matrix()
    world_from_cam = path.world_from_cam.copy()
    world_from_cam[:, :3, :3] = world_from_cam[:, :3, :3] @ turned
    n = motion.n_frames
    path = replace(path, world_from_cam=world_from_cam)
    return Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n), path)


def read(path: Path) -> EstimatedPeople:
    return read_system(path, "camera")


def placed_by(path: Path, body: BodyModel, lens: Lens) -> PlacedBody:
    return place_body(read(path).people[0], body, lens, SIZE_PX, path)


def off_shares(placed: PlacedBody, seen: Seen) -> np.ndarray:
    """(T,) how far off a person stands, as a share of the way from the camera."""
    true_m = seen.motion.pelvis_m
    return np.linalg.norm(placed.pelvis_m - true_m, axis=1) / np.linalg.norm(true_m, axis=1)


def written(system: str, folder: Path, seen: Seen) -> Path:
    """A system's file of one person."""
    n, rng = int(seen.frames[-1]) + 1, np.random.default_rng(0)
    match system:
        case "vibe":
            people = system_files.vibe_people([seen], rng)
            return write_joblib(folder / "vibe_output.pkl", people)
        case "wham":
            return write_joblib(folder / "wham_output.pkl", system_files.wham_people([seen]))
        case "gvhmr":
            return write_torch(folder / "hmr4d_results.pt", system_files.gvhmr_result(seen))
        case "tram":
            return write_seen_tram(folder / "tram", [seen], n)
    return write_joblib(folder / "demo_walk.pkl", system_files.phalp_frames([seen], n, rng))


@pytest.fixture(scope="module")
def seen(walk, neutral) -> Seen:
    """The person before a camera without distortion."""
    return system_files.seen_person(walk.motion, camera_of(walk), neutral)


@pytest.fixture(scope="module")
def files(walk, seen, neutral, tmp_path_factory) -> dict[float, dict[str, Path]]:
    """By distortion and system."""
    bent = system_files.seen_person(walk.motion, camera_of(walk), neutral, radial_k1=K1)
    made = {}
    for k1, one in ((0.0, seen), (K1, bent)):
        folder = tmp_path_factory.mktemp("files")
        made[k1] = {system: written(system, folder, one) for system in SYSTEMS}
    return made


@pytest.mark.parametrize("k1", [0.0, K1])
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_person_stands_where_the_picture_shows_it(system, k1, files, walk, seen, neutral):
    found = read(files[k1][system])
    assert found.system == system
    true, person = seen.motion, found.people[0]
    lens = replace(camera_of(walk).lens, radial=(k1, 0.0))
    placed = placed_by(files[k1][system], neutral, lens)
    # The file's own distance is another one: f is 554 px, and each assumed another.
    assert np.abs(placed.assumed_depths_m / true.pelvis_m[:, 2] - 1.0).min() > 0.05
    assert off_shares(placed, seen).max() < 0.005
    np.testing.assert_allclose(placed.root_rotmats, true.root_rotmats, atol=2e-3)
    np.testing.assert_allclose(person.local_rotmats[:, :21], true.local_rotmats[:, :21], atol=1e-5)


def test_a_lens_that_is_left_out_moves_people_by_more_than_a_hundredth(files, walk, seen, neutral):
    placed = placed_by(files[K1]["wham"], neutral, camera_of(walk).lens)
    assert off_shares(placed, seen).max() > 0.01


def test_what_was_exported_stands_where_it_stood(walk, neutral, tmp_path):
    """GVHMR's was put anew along the rays of a pinhole, 3 % off before a lens that bends, or 0.7 %
    where its focal lengths differ; WHAM's was right."""
    camera = camera_of(walk)
    camera = replace(camera, intrinsics_px=camera.intrinsics_px * [[1], [1.008], [1]])
    motion, frames = walk.motion, np.arange(walk.motion.n_frames)
    rest_m = neutral.rest_pelvis_m(motion.shape)
    person = TrackedPerson(motion, rest_m, walk.valid, frames, camera)
    wanted_m = motion_in_camera(motion, camera.world_from_cam).pelvis_m
    for name, content in (("gvhmr.pt", gvhmr_bytes(person)), ("wham.pkl", wham_bytes([person]))):
        (tmp_path / name).write_bytes(content)
        placed = placed_by(tmp_path / name, neutral, replace(camera.lens, radial=(K1, 0.0)))
        np.testing.assert_allclose(placed.pelvis_m, wanted_m, atol=1e-5)


def test_a_file_of_vibe_with_its_drawing_camera_alone_gives_nearly_the_same(
    walk, seen, neutral, tmp_path
):
    """`orig_cam` is a tenth too small, and says nothing of the crop's middle."""
    people = system_files.vibe_people([seen])
    for person in people.values():
        del person["pred_cam"], person["bboxes"]
    path = write_joblib(tmp_path / "vibe_output.pkl", people)
    placed = placed_by(path, neutral, camera_of(walk).lens)
    assert off_shares(placed, seen).max() < 0.02


def test_phalp_of_the_whole_picture_is_the_same_person(walk, seen, neutral, tmp_path):
    """Where the crop is not in the file, `camera` tells the same."""
    frames = system_files.phalp_frames([seen], len(seen.frames))
    for frame in frames.values():
        del frame["camera_bbox"], frame["center"], frame["scale"]
    path = write_joblib(tmp_path / "demo.pkl", frames)
    placed = placed_by(path, neutral, camera_of(walk).lens)
    assert off_shares(placed, seen).max() < 0.01


def test_phalps_scale_as_a_share_of_the_picture_is_the_same_crop(walk, seen, neutral, tmp_path):
    """As 4D-Humans' own demo writes it: one number, the crop's side over the longer side."""
    frames = system_files.phalp_frames([seen], len(seen.frames))
    in_px = write_joblib(tmp_path / "px.pkl", frames)
    for frame in frames.values():
        frame["scale"] = [float(one.max()) / max(SIZE_PX) for one in frame["scale"]]
        s, scale = frame["camera_bbox"][0][0], frame["scale"][0]
        assert frame["camera"][0][2] == pytest.approx(2 * 5000 / (256 * s * scale), rel=1e-5)
    as_share = write_joblib(tmp_path / "share.pkl", frames)
    lens = camera_of(walk).lens
    own, other = (placed_by(path, neutral, lens) for path in (in_px, as_share))
    np.testing.assert_allclose(other.pelvis_m, own.pelvis_m, rtol=1e-9)
    assert off_shares(other, seen).max() < 0.005


def test_the_size_comes_from_the_file_on_smpls_neutral_body_alone(files, neutral, small_body):
    path = files[0.0]["wham"]
    person = read(path).people[0]
    person = replace(person, betas=np.tile(np.eye(10)[0] * 2, (len(person.frame_numbers), 1)))
    lens = Lens.centred(500.0, (640, 360))
    assert place_body(person, neutral, lens, SIZE_PX, path).shape[0] == 2.0
    assert not place_body(person, small_body, lens, SIZE_PX, path).shape.any()


def test_a_copy_of_another_size_is_the_same_video_and_another_shape_is_not(files):
    """TRAM, GVHMR and PHALP say how large their images are."""
    for system in ("tram", "gvhmr", "phalp"):
        path = files[0.0][system]
        seen = read(path).people[0].in_camera
        assert seen is not None
        own, twice = (assumed_place(seen, size, path).camera for size in (SIZE_PX, (1280, 720)))
        assert isinstance(own, Pinhole) and isinstance(twice, Pinhole)
        np.testing.assert_allclose(twice.focal_px, 2 * own.focal_px)
        np.testing.assert_allclose(twice.centre_px, 2 * own.centre_px)
        with pytest.raises(BadMotionFile, match="another video's, or a turned one's") as error:
            assumed_place(seen, (360, 640), path)
        assert str(path) in str(error.value)


def vibe(**changes: Any) -> dict[Any, Any]:
    person = system_files.vibe_person(3) | changes
    return {1: {key: value for key, value in person.items() if value is not None}}


def world_alone() -> dict[Any, Any]:
    world = {"pose_world": np.zeros((3, 72)), "trans_world": np.zeros((3, 3))}
    return {1: system_files.wham_entry(np.arange(3), np.zeros((3, 10)), **world)}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "nobody is seen"),
        (vibe(pose=np.zeros((3, 69))), r"pose of person_1 is \(3, 69\)"),
        (vibe(pred_cam=np.zeros((3, 3))), "is not above 0 at row 0"),
        (vibe(bboxes=np.full((3, 4), -1.0)), "is not above 0 at row 0"),
        (vibe(pred_cam=np.full((3, 3), np.nan)), "pred_cam of person_1 is not finite"),
        (vibe(pred_cam=None, orig_cam=np.zeros((3, 4))), "scale of orig_cam"),
        (vibe(frame_ids=np.array([0, 2, 1])), "not rising"),
        (vibe(frame_ids=None), "no 'frame_ids'"),
        (vibe(betas=None), "no 'betas'"),
        (vibe(pred_cam=None, orig_cam=None), "no 'orig_cam', so no motion before the camera"),
        (world_alone(), "no 'pose', so no motion before the camera"),
        ({"a": 3}, r"\(it has: a\)"),
        ({0: 3}, "its first entry has: no dict"),
        ([1, 2], "a list of 2"),
    ],
)
def test_a_broken_file_is_named_with_the_fault(content, said, tmp_path):
    path = tmp_path / "vibe_output.pkl"
    path.write_bytes(joblib_bytes(content))
    with pytest.raises(BadMotionFile, match=said) as error:
        read(path)
    assert str(path) in str(error.value)


def test_what_a_result_lacks_is_named(tmp_path, seen):
    whole = system_files.gvhmr_result(seen)
    for broken, said in (
        ({"smpl_params_global": whole["smpl_params_global"]}, "no 'smpl_params_incam'"),
        (whole | {"K_fullimg": whole["K_fullimg"][:3]}, r"K_fullimg of person_0 is \(3, 3, 3\)"),
        (whole | {"K_fullimg": 0 * whole["K_fullimg"]}, "focal length in K_fullimg"),
        (whole | {"smpl_params_incam": {"body_pose": whole["K_fullimg"]}}, r"\(12, 3, 3\), not"),
    ):
        path = write_torch(tmp_path / "hmr4d_results.pt", broken)
        with pytest.raises(BadMotionFile, match=said):
            read(path)
    path.unlink()
    with pytest.raises(MissingInput, match=r"no camera\.npy"):
        read(tmp_path)
    with pytest.raises(MissingInput, match="no such file"):
        read(tmp_path / "gone.pkl")
    np.savez(tmp_path / "a.npz", poses=np.zeros((3, 72)))
    with pytest.raises(BadMotionFile, match="not TRAM's"):
        read(tmp_path / "a.npz")


@given(data=st.data())
def test_any_cut_or_changed_file_is_read_or_refused(data, files, tmp_path_factory):
    system = data.draw(st.sampled_from(["vibe", "wham", "gvhmr", "phalp"]))
    whole = files[0.0][system].read_bytes()
    cut = whole[: data.draw(st.integers(0, len(whole) - 1))]
    content = cut if data.draw(st.booleans()) else bytes_changed(data, whole, most=1)
    read_or_refused(tmp_path_factory.mktemp("changed") / files[0.0][system].name, content, read)


def test_several_people_with_gaps_keep_their_frames(walk, seen, neutral, tmp_path):
    n, some = walk.motion.n_frames, np.array([0, 1, 2, 5, 6, 9])
    camera = camera_of(walk).at_rows(some)
    both = [seen, system_files.seen_person(walk.motion.take(some), camera, neutral, some)]
    ways = {
        "vibe": write_joblib(tmp_path / "v.pkl", system_files.vibe_people(both)),
        "wham": write_joblib(tmp_path / "w.pkl", system_files.wham_people(both)),
        "tram": write_seen_tram(tmp_path / "t", both, n),
        "phalp": write_joblib(tmp_path / "p.pkl", system_files.phalp_frames(both, n)),
    }
    for system, path in ways.items():
        found = read(path)
        assert [len(one.frame_numbers) for one in found.people] == [n, 6], system
        np.testing.assert_array_equal(found.people[1].frame_numbers, some)
        assert found.n_frames == {"tram": n, "phalp": n}.get(system)
