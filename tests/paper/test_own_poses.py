"""What the built-in estimator sees of real pictures, in the files that the baselines read."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.manifest.write import ClipFiles, clip_entry, write_manifest
from gmrdata.motion.gait import make_gait
from gmrdata.paper.joint import load_features
from gmrdata.paper.own_poses import (
    OwnPosesRecord,
    crops_between,
    own_poses,
    rows_between,
    the_person,
)
from gmrdata.paper.placement import PlacementConfig, clip_keypoints, place_person
from gmrdata.paper.vibe_cam import load_poses
from gmrdata.people.following import Networks, Sightings
from gmrdata.people.landmark_network import FEATURE_SHAPES
from gmrdata.read.openpose import PAIRS
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, load_clip, save_clip
from gmrdata.values.errors import BadManifest
from tests.clip_manifests import a_head, a_walk

N_FRAMES, GAP = 5, 2
INTRINSICS_PX = np.array([[820.0, 0, 150], [0, 820, 270], [0, 0, 1]])


def standing(body: BodyModel, id: str, pelvis_m: tuple[float, float, float]) -> Clip:
    """Somebody at a place before a camera that rests."""
    gait = make_gait(
        "walk", 0.5, 10.0, body, np.random.default_rng(0), shape=np.zeros(body.n_shape)
    )
    motion = replace(gait, frame="camera", pelvis_m=np.tile(pelvis_m, (N_FRAMES, 1)))
    rows = np.arange(N_FRAMES)
    poses = np.tile(np.eye(4), (N_FRAMES, 1, 1))
    camera = CameraPath(INTRINSICS_PX, 300, 540, poses, rows >= 0)
    return Clip(id, motion, rows >= 0, rows + 4, camera)


@pytest.fixture(scope="module")
def manifest(shared_path, anny, tmp_path_factory) -> Path:
    """A person of a real video whom one picture lacks; nobody; and a clip without images."""
    folder = tmp_path_factory.mktemp("seen")
    images = sorted(shared_path("video/static_people").glob("*.jpg"))[:N_FRAMES]
    (folder / "frames").mkdir()
    for n, path in enumerate(images):
        picture = cv2.imread(str(path))[:, 450:750]
        picture = np.zeros_like(picture) if n == GAP else picture
        cv2.imwrite(str(folder / "frames" / f"{n + 4:05d}.png"), picture)
    clips = [
        standing(anny, "person", (0.0, 0.0, 5.0)),
        standing(anny, "elsewhere", (40.0, 0.0, 5.0)),
        standing(anny, "unfilmed", (0.0, 0.0, 5.0)),
    ]
    entries = []
    for clip in clips:
        path = folder / f"{clip.id}.npz"
        save_clip(path, clip, anny.rest_pelvis_m(clip.motion.shape))
        files = ClipFiles(path, images=None if clip.id == "unfilmed" else folder / "frames")
        entries.append(clip_entry(folder, files, a_walk("static")))
    return write_manifest(folder / "manifest.yaml", a_head("seen", "pseudo_gt"), entries)


@pytest.fixture(scope="module")
def made(manifest, yolox_nano, pose_landmarks) -> Path:
    networks = ["--detector", str(yolox_nano), "--landmark-network", str(pose_landmarks)]
    out = manifest.parent / "own"
    main(["baseline", "own_poses", str(manifest), "--out", str(out), *networks])
    return out


def test_the_record_says_who_was_seen_and_what_was_left_out(made):
    record = OwnPosesRecord.read(made / "own_poses.json")
    assert record.clips.keys() == {"person"}
    assert (record.clips["person"].frames, record.clips["person"].seen) == (N_FRAMES, N_FRAMES - 1)
    assert record.left_out == {
        "elsewhere": "its person is not seen",
        "unfilmed": "it has no images",
    }


def test_images_behind_a_link_out_of_the_set_are_refused(manifest, tmp_path):
    """It was a traceback."""
    moved = shutil.copytree(manifest.parent, tmp_path / "set")
    (moved / "frames").rename(tmp_path / "frames")
    (moved / "frames").symlink_to(tmp_path / "frames")
    networks = Networks(manifest, manifest)  # which are not read
    with pytest.raises(BadManifest, match=r"clip elsewhere: images\.folder: path .frames. is or"):
        own_poses(moved / "manifest.yaml", tmp_path / "out", networks=networks)


def test_every_baseline_reads_its_file(made, manifest, anny):
    clip = load_clip(manifest.parent / "person.npz")
    posed, body = load_poses(made / "poses" / "person.npz", clip, [anny])
    assert body is anny and posed.valid.all() and not posed.motion.shape.any()
    places_m = posed.motion.pelvis_m
    np.testing.assert_allclose(places_m[GAP], (places_m[GAP - 1] + places_m[GAP + 1]) / 2)
    found = clip_keypoints(clip, made / "keypoints" / "person")
    assert not any(found.missing) and found.n_crowded == 0
    used = list(PAIRS.values())
    assert (np.ptp(found.points[:, used, 1], axis=1) > 150).all()  # from neck to ankles [px]
    features = load_features(made / "features", clip)
    assert features.shape == (N_FRAMES, np.prod(FEATURE_SHAPES[0])) and np.isfinite(features).all()
    # What the empty picture gives differs from the others; they are of a person who hardly moves.
    apart = np.linalg.norm(features - features[0], axis=1)
    assert apart[GAP] > 1.5 * apart[[1, 3, 4]].max()


def test_the_person_is_placed_by_the_same_landmarks(made, manifest, anny):
    clip = load_clip(manifest.parent / "person.npz")
    posed, _ = load_poses(made / "poses" / "person.npz", clip, [anny])
    keypoints = clip_keypoints(clip, made / "keypoints" / "person")
    placed = place_person(posed, keypoints, INTRINSICS_PX, anny, PlacementConfig())
    assert not any(placed.missing)
    np.testing.assert_allclose(placed.pelvis_m[:, 2], posed.motion.pelvis_m[:, 2], rtol=0.15)


def test_rows_without_a_person_lie_between_their_neighbours():
    between = rows_between(np.array([-1, 1, 2, 5]), 7)
    values = np.array([9.0, 10.0, 20.0, 50.0])[:, None]
    assert between.placed(values)[:, 0].tolist() == [10, 10, 20, 30, 40, 50, 50]


def test_a_crop_between_two_turns_the_short_way():
    """Halfway from 170 to -170 degrees it was upright."""
    crops = np.array([[10.0, 20, 100, np.deg2rad(170)], [30.0, 40, 200, np.deg2rad(-170)]])
    found = crops_between(crops, rows_between(np.array([0, 2]), 3))
    np.testing.assert_allclose(found[1], [20, 30, 150, np.pi])
    np.testing.assert_array_equal(found[0], crops[0])


def test_the_clips_person_is_who_is_near_it_in_most_frames(anny):
    clip = standing(anny, "a", (0.0, 0.0, 5.0))

    def track(numbers: list[int], hips_px: tuple[float, float]) -> Sightings:
        crop, zeros = [*hips_px, 200.0, 0.0], np.zeros(33)
        places = {"image_px": np.tile(hips_px, (33, 1)), "world_m": np.zeros((33, 3))}
        known = {"people": 0, "pieces": 0, "boxes_px": zeros[:4], "colours": zeros[:32]}
        rest = {"visibility": zeros + 1, "scores": 1.0, "crops": crop, "next_crops": crop}
        return Sightings.of([{"image_numbers": n} | places | known | rest for n in numbers])

    far, short, right = (
        track([4, 5, 6, 7, 8], (60.0, 270.0)),
        track([4], (150.0, 270.0)),
        track([5, 6, 7], (155.0, 275.0)),
    )
    assert the_person([far, short, right], clip, 0.15) == 2
    assert the_person([far], clip, 0.15) is None
    assert the_person([], clip, 0.15) is None
