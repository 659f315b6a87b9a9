"""A real render with company, a passer-by and a car, against geometry worked out by itself."""

from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import Film, Panning, film_motion, plan_clip
from gmrdata.film.render import RenderConfig, optional_outputs
from gmrdata.film.render_outputs import read_depth, read_flow, read_instances
from gmrdata.film.scene import Extras, SceneConfig
from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ClipFiles, clip_entry, write_manifest
from gmrdata.motion.gait import make_gait
from gmrdata.values.camera import project
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.files import read_npz
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.values.transforms import apply, invert
from tests.blender.jobs import Job, mask_of, overlap, save_job, unprojected
from tests.clip_manifests import a_head, a_walk
from tests.folders import bytes_of

N_FRAMES, WIDTH_PX, HEIGHT_PX = 5, 320, 180
EXTRAS = Extras(company=1, passers_by=1, cars=1)
PERSON, COMPANY, PASSER_BY, CAR = 1, 2, 3, 4
CONFIG = RenderConfig(
    samples=2,
    scene=SceneConfig(seed=2, extras=EXTRAS),
    instances=True,
    depth=True,
    flow=True,
    joints=True,
)
ALONE = RenderConfig(samples=2, scene=SceneConfig(seed=2), instances=True)


@pytest.fixture(scope="module")
def job(small_body, tmp_path_factory) -> Job:
    """A clip of 2.5 s at 2 Hz, and its body."""
    rng = np.random.default_rng(4)
    film = Film(fps_hz=2, duration_s=2.5, width_px=WIDTH_PX, height_px=HEIGHT_PX)
    motion = film_motion(make_gait("walk", 2.5, 30.0, small_body, rng), film)
    clip = plan_clip("walk", motion, Panning(), film, rng)
    job = save_job(tmp_path_factory.mktemp("planned"), small_body, motion, camera_of(clip))
    save_clip(job.clip_path, clip, small_body.rest_pelvis_m(motion.shape))
    return job


@pytest.fixture(scope="module")
def filmed(job, tmp_path_factory) -> Path:
    return job.render(tmp_path_factory.mktemp("with") / "walk", CONFIG)


@pytest.fixture(scope="module")
def instances(filmed) -> np.ndarray:
    """(T, H, W)."""
    files = sorted((filmed / "instances").glob("*.png"))
    return np.stack([read_instances(file) for file in files])


def covered(clip: Clip, vertices_m: np.ndarray, faces: np.ndarray, row: int) -> np.ndarray:
    """(H, W) bool: pixels whose centre is inside a projected triangle; exact, edge by edge."""
    camera = camera_of(clip)
    points_px = project(camera.world_from_cam[row], vertices_m, camera.intrinsics_px)
    inside = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    for a, b, c in points_px[faces]:
        left, top = np.maximum(np.floor(np.min([a, b, c], axis=0)), 0).astype(int)
        right, bottom = np.maximum(np.ceil(np.max([a, b, c], axis=0)), 0).astype(int)
        part = inside[top:bottom, left:right]
        y, x = (axis + 0.5 for axis in np.mgrid[: part.shape[0], : part.shape[1]])
        x, y = x + left, y + top
        sides = [
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        part |= np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
    return inside


def test_everyone_is_seen_and_masked(filmed, instances):
    assert instances.shape == (N_FRAMES, HEIGHT_PX, WIDTH_PX)
    assert set(np.unique(instances)) == {0, PERSON, COMPANY, PASSER_BY, CAR}
    for row, seen in enumerate(instances):
        assert overlap(mask_of(filmed, row), seen > 0) > 0.96


def test_a_person_is_who_their_file_says(filmed, instances, small_body):
    names = {PERSON: "clip", COMPANY: "extras/company_1", PASSER_BY: "extras/passer_by_1"}
    clips = {number: load_clip(filmed / f"{name}.npz") for number, name in names.items()}
    assert clips[COMPANY].id == "walk_company_1"
    compared, unhidden = dict.fromkeys(names, 0), dict.fromkeys(names, 0)
    for number, clip in clips.items():
        vertices_m = motion_vertices_m(small_body, clip.motion)
        for row, seen in enumerate(instances):
            expected = covered(clip, vertices_m[row], small_body.faces, row)
            # What else moves may be in front, and so may what stands there: its depth says so.
            distance_m = camera_of(clip).world_from_cam[row, :3, 2] @ (
                clip.motion.pelvis_m[row] - camera_of(clip).centres_world_m[row]
            )
            depth_m = read_depth(filmed / f"depth/{row:05d}.png")
            hidden = ((seen > 0) & (seen != number)) | (
                (seen == 0) & (depth_m < distance_m - 1.0) & expected
            )
            found, visible = seen == number, expected & ~hidden
            if visible.sum() > 150:
                iou = overlap(found, visible)
                assert iou > 0.98, f"{names[number]}, frame {row}: {iou:.4f}"
                compared[number] += 1
            unhidden[number] += bool(expected.any() and not (hidden & expected).any())
    assert all(compared.values()), compared
    assert unhidden[PERSON] and unhidden[PASSER_BY], unhidden


def test_the_person_is_the_same_without_extras(filmed, instances, job, tmp_path):
    alone = job.render(tmp_path / "alone", ALONE)
    assert not (alone / "extras").exists()
    untouched = 0
    for row, seen in enumerate(instances):
        before = read_instances(alone / f"instances/{row:05d}.png")
        assert set(np.unique(before)) <= {0, PERSON}
        np.testing.assert_array_equal(seen == PERSON, (before == PERSON) & (seen <= PERSON))
        untouched += not ((seen > PERSON) & (before == PERSON)).any()
    assert untouched > 0
    np.testing.assert_array_equal(
        load_clip(alone / "clip.npz").motion.pelvis_m,
        load_clip(filmed / "clip.npz").motion.pelvis_m,
    )


def test_flow_on_the_car_is_its_rigid_motion(filmed, instances):
    camera = camera_of(load_clip(filmed / "clip.npz"))
    car = read_npz(filmed / "extras/car_1.npz")
    world_from_car, size_m = car["world_from_car"], car["size_m"]
    pixels = np.stack(np.meshgrid(np.arange(WIDTH_PX), np.arange(HEIGHT_PX)), axis=-1) + 0.5
    compared = 0
    for row in range(N_FRAMES - 1):
        on_car = instances[row] == CAR
        car_m = apply(invert(world_from_car[row]), unprojected(filmed, row)[on_car])
        assert (np.abs(car_m[:, :2]) < size_m[:2] / 2 + 0.02).all()
        assert ((car_m[:, 2] > -0.02) & (car_m[:, 2] < size_m[2] + 0.02)).all()
        body = car_m[:, 2] > 0.7  # above the wheels
        next_m = apply(world_from_car[row + 1], car_m[body])
        next_px = project(camera.world_from_cam[row + 1], next_m, camera.intrinsics_px)
        flow_px = read_flow(filmed / f"flow/{row:05d}.png")[on_car][body]
        off_px = np.abs(flow_px - (next_px - pixels[on_car][body]))
        known = np.isfinite(off_px).all(axis=1)
        assert off_px[known].max(initial=0.0) < 0.5  # a millimetre of depth, seen from near
        compared += int(known.sum())
    assert compared > 100


def test_the_manifest_lists_the_extras(filmed):
    entry = clip_entry(
        filmed.parent,
        ClipFiles(
            filmed / "clip.npz",
            images=filmed / "frames",
            masks=filmed / "masks",
            **optional_outputs(filmed, CONFIG),
        ),
        a_walk("panning"),
    )
    path = write_manifest(filmed.parent / "set.yaml", a_head("extras"), [entry])
    check_manifest(path)
    listed = read_manifest(path).clips[0]
    names = ["company_1", "passer_by_1", "car_1"]
    assert [(extra.instance, extra.arrays.path) for extra in listed.extras] == [
        (number, f"walk/extras/{name}.npz") for number, name in enumerate(names, start=2)
    ]
    assert listed.instances is not None and listed.instances.count == N_FRAMES


@pytest.mark.slow
def test_the_same_recipe_gives_the_same_bytes(filmed, job, tmp_path):
    assert bytes_of(job.render(tmp_path / "walk", CONFIG, threads=2)) == bytes_of(filmed)
