"""Models that share frames become one, others are dropped with a reason, by the real mapper; and
cameras against known points."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.colmap import bundle_adjuster, incremental_options, pycolmap
from gmrdata.cameras.map import mapping
from gmrdata.cameras.map.models import join_models, place_frames
from gmrdata.cameras.match.matches import Matches, PairMatches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import project
from gmrdata.values.transforms import fit_similarity

SMALL = SfmConfig(max_features=400, first_octave=-1)
N_FRAMES = 14


@pytest.fixture(scope="module")
def filmed_parts(film: Callable[[str, int], Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A dolly shot, its matches, and a mapper of any of its frames."""
    filmed = film("dolly", N_FRAMES)
    work_dir = tmp_path_factory.mktemp("parts")
    frames = filmed.frames
    matches = match_frames(frames, work_dir, SMALL)

    @cache
    def mapped(rows: range) -> Any:
        options = incremental_options(SMALL, free_lens=False)
        options.min_model_size = 3
        options.image_names = [frames.images[row].name for row in rows]
        out_dir = work_dir / "_".join(map(str, rows))
        out_dir.mkdir(exist_ok=True)
        models = pycolmap.incremental_mapping(
            work_dir / "database.db", filmed.images_dir, out_dir, options
        )
        (model,) = models.values()
        assert model.num_reg_images() == len(rows)
        return model

    def part(rows: range) -> Any:
        return pycolmap.Reconstruction(mapped(rows))

    return filmed, frames, matches, part


def centres_of(model: Any) -> tuple[list[int], np.ndarray]:
    """Rows and camera centres of a model."""
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda image: image.name)
    rows = [int(Path(image.name).stem) for image in images]
    return rows, np.array([image.projection_center() for image in images])


def errors_m(model: Any, world_from_cam: np.ndarray) -> np.ndarray:
    rows, centres = centres_of(model)
    true = world_from_cam[rows, :3, 3]
    return np.linalg.norm(fit_similarity(true, centres, scale=True).apply(centres) - true, axis=1)


def test_two_models_that_share_frames_become_one(filmed_parts: Any) -> None:
    filmed, *_, part = filmed_parts
    large, small = part(range(9)), part(range(6, N_FRAMES))
    n_points = (large.num_points3D(), small.num_points3D())
    # Any similarity of the small one's world must be found.
    turn = pycolmap.Rotation3d(np.array([0.1, -0.6, 0.3, 0.7]) / np.sqrt(0.95))
    small.transform(pycolmap.Sim3d(3.7, turn, np.array([5.0, -40.0, 8.0])))
    whole, records = join_models([small, large], SMALL)
    assert [(r.frames, r.kept) for r in records] == [(9, True), (8, True)]
    assert records[0].reason == "the largest"
    assert records[1].reason.startswith("joined by 3 frames and ")
    rows, _ = centres_of(whole)
    assert rows == list(range(N_FRAMES))
    # Depths of three frames are rough; bundle adjustment comes after.
    assert errors_m(whole, filmed.world_from_cam).max() < 0.08
    # Points of the shared frames are one point each, not two on top of each other.
    assert max(n_points) < whole.num_points3D() < sum(n_points)
    assert whole.compute_mean_reprojection_error() < 1.0
    for point_id in whole.point3D_ids():
        assert len({e.image_id for e in whole.point3D(point_id).track.elements}) >= 2
    # What was given is left alone.
    assert (large.num_reg_images(), small.num_reg_images()) == (9, 8)


def test_a_model_may_be_joined_through_another(filmed_parts: Any) -> None:
    filmed, *_, part = filmed_parts
    first, middle, last = part(range(7)), part(range(4, 10)), part(range(7, N_FRAMES))
    whole, records = join_models([last, middle, first], SMALL)
    assert [r.kept for r in records] == [True, True, True]
    assert centres_of(whole)[0] == list(range(N_FRAMES))
    bundle_adjuster(whole).solve()
    assert errors_m(whole, filmed.world_from_cam).max() < 0.03


def test_models_without_a_common_frame_are_dropped_with_the_reason(filmed_parts: Any) -> None:
    *_, part = filmed_parts
    whole, records = join_models([part(range(8, N_FRAMES)), part(range(8))], SMALL)
    assert [(r.frames, r.kept) for r in records] == [(8, True), (6, False)]
    assert records[1].reason == "shares no frame with the largest"
    assert centres_of(whole)[0] == list(range(8))


def test_a_bent_model_is_dropped_with_the_reason(filmed_parts: Any) -> None:
    *_, part = filmed_parts
    large, bent = part(range(9)), part(range(6, N_FRAMES))
    rng = np.random.default_rng(0)
    for point_id in sorted(bent.point3D_ids()):
        bent.point3D(point_id).xyz = rng.normal(0, 5, 3)
    _, records = join_models([large, bent], SMALL)
    assert not records[1].kept
    assert records[1].reason.startswith("no similarity fits the ")
    few = part(range(6, N_FRAMES))
    for point_id in sorted(few.point3D_ids())[5:]:
        few.delete_point3D(point_id)
    _, records = join_models([large, few], SMALL)
    assert not records[1].kept
    assert records[1].reason.startswith("shares 3 frames but only ")


def test_the_mapper_joins_and_adjusts(
    filmed_parts: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    filmed, frames, matches, part = filmed_parts
    models = {0: part(range(9)), 1: part(range(6, N_FRAMES))}
    monkeypatch.setattr(
        mapping, "_run", lambda name, *_: [] if name == "global" else list(models.values())
    )
    mapped = [
        mapping.map_frames(frames, matches, folder, SMALL)
        for folder in (tmp_path / "a", tmp_path / "b")
        if folder.mkdir() is None
    ]
    assert mapped[0] is not None and mapped[1] is not None
    assert [record.kept for record in mapped[0].models] == [True, True]
    assert mapped[0].has_camera.all() and mapped[0].n_resected == 0
    assert filmed.centre_errors_m(mapped[0].world_from_cam[:, :3, 3]).max() < 0.015
    assert np.array_equal(mapped[0].world_from_cam, mapped[1].world_from_cam)


def test_a_left_out_frame_is_placed_by_the_points_of_its_neighbours() -> None:
    rng = np.random.default_rng(0)
    intrinsics_px = np.array([[300.0, 0, 160], [0, 300.0, 90], [0, 0, 1]])
    points = rng.uniform([-2, -1, 4], [2, 1, 7], (80, 3))
    cameras = np.tile(np.eye(4), (3, 1, 1))
    cameras[:, 0, 3] = [0.0, 0.3, 0.6]
    keypoints = [project(camera, points, intrinsics_px) for camera in cameras]
    every = np.arange(80)
    shuffled = rng.permutation(80)
    keypoints[1] = keypoints[1][np.argsort(shuffled)]
    pair = PairMatches(0, 1, np.stack([every, shuffled], axis=1), "CALIBRATED")
    seen = dict(enumerate(points))
    world_from_cam = cameras.copy()
    world_from_cam[[1, 2]] = np.nan
    observations = np.array([80, 0, 0])
    matches = Matches(keypoints, [pair])
    placed = place_frames([1, 2], world_from_cam, observations, {0: seen}, matches, intrinsics_px)
    assert placed == 1 and observations.tolist() == [80, 80, 0]
    assert world_from_cam[1] == pytest.approx(cameras[1], abs=1e-6)
    assert np.isnan(world_from_cam[2]).all()
    assert np.allclose(transforms.invert(world_from_cam[1]) @ cameras[1], np.eye(4), atol=1e-6)
