"""A small recovered clip with painted pictures, and a whole report made of such clips."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.programmes import Circular, Linear, Panning, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.pages.report_data import (
    ClipAccuracy,
    ClipReport,
    GmrSummary,
    ReportData,
)
from gmrdata.pages.solved_page import make_video_page
from gmrdata.score.records import PaperMetrics
from gmrdata.values import camera, transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.skinning import motion_vertices_m
from tests.motions import moved
from tests.reconstructions import good_quality, pseudo_gt_quality
from tests.sharing import made_once

PROGRAMMES = {"circular": Circular(), "linear": Linear(), "panning": Panning()}
TRUE_FROM_PSEUDO = transforms.rigid(
    Rotation.from_euler("xyz", [100.0, -20.0, 40.0], degrees=True).as_matrix(),
    np.array([2.0, -1.0, 0.7]),
)
"""A recovered world stands anywhere: here it lies tilted beside the true one."""


def paint_floor(view: CameraPath, row: int) -> np.ndarray:
    """A frame (H, W, 3) BGR of a chequered floor at z = 0 under a pale sky."""
    x, y = np.meshgrid(np.arange(view.width_px) + 0.5, np.arange(view.height_px) + 0.5)
    rays_cam = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(view.intrinsics_px).T
    rays = rays_cam @ view.world_from_cam[row, :3, :3].T
    centre_m = view.centres_world_m[row]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -centre_m[2] / rays[..., 2]
        floor_m = centre_m[:2] + reach[..., None] * rays[..., :2]
    tiles = np.where(np.floor(floor_m * 2).sum(axis=-1) % 2 == 0, 128, 168)
    grey = np.where((reach > 0) & (reach < 40), tiles, 225)
    return np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8)


def paint_clip(folder: Path, clip: Clip, body: BodyModel) -> tuple[Path, Path]:
    """Frames and masks of a clip: the body's silhouette as a flat dark figure."""
    images_dir, masks_dir = folder / "frames", folder / "masks"
    images_dir.mkdir(parents=True)
    masks_dir.mkdir()
    vertices_m = motion_vertices_m(body, clip.motion)
    assert clip.camera is not None
    for row, number in enumerate(clip.image_numbers):
        points_px = camera.project(
            clip.camera.world_from_cam[row], vertices_m[row], clip.camera.intrinsics_px
        )
        mask = np.zeros((clip.camera.height_px, clip.camera.width_px), np.uint8)
        for triangle in np.round(points_px[body.faces] - 0.5).astype(np.int32):
            cv2.fillConvexPoly(mask, triangle, 255)
        image = paint_floor(clip.camera, row)
        image[mask > 0] = (90, 70, 60)
        cv2.imwrite(str(images_dir / f"{number:05d}.jpg"), image)
        cv2.imwrite(str(masks_dir / f"{number:05d}.png"), cv2.dilate(mask, np.ones((5, 5))))
    return images_dir, masks_dir


def recovered(true: Clip, rng: np.random.Generator) -> Clip:
    """A clip as structure from motion gives it: in a world of its own, the cameras a little off."""
    assert true.camera is not None
    n = true.motion.n_frames
    jitter = transforms.rigid(
        Rotation.from_rotvec(np.deg2rad(rng.normal(0, 0.05, (n, 3)))).as_matrix(),
        rng.normal(0, 0.003, (n, 3)),
    )
    world_from_cam = true.camera.world_from_cam @ jitter
    errors = world_from_cam @ transforms.invert(true.camera.world_from_cam)
    pseudo_from_true = transforms.invert(TRUE_FROM_PSEUDO)
    motion = replace(
        true.motion,
        root_rotmats=errors[:, :3, :3] @ true.motion.root_rotmats,
        pelvis_m=transforms.apply(errors, true.motion.pelvis_m[:, None])[:, 0],
    )
    return replace(
        true,
        motion=moved(motion, pseudo_from_true),
        camera=replace(true.camera, world_from_cam=pseudo_from_true @ world_from_cam),
    )


@pytest.fixture(scope="session")
def make_clip(small_body, tmp_path_factory) -> Callable[[str], ClipReport]:
    """Makes the report's value for a clip of 12 frames filmed by the named camera programme."""

    def make(kind: str) -> ClipReport:
        rng = np.random.default_rng(len(kind))
        motion = make_gait("walk", 1.2, 10.0, small_body, rng)
        view = camera_path(PROGRAMMES[kind], motion.pelvis_m, 10.0, 320, 180, 60.0, rng)
        n = motion.n_frames
        true = Clip(f"walk_{kind}", motion, np.ones(n, dtype=bool), np.arange(n), view)
        images_dir, masks_dir = paint_clip(tmp_path_factory.mktemp(kind), true, small_body)
        pans = kind == "panning"
        cameras = good_quality(
            n, geometry="rotation_only" if pans else "full", mean_reprojection_px=0.4321,
            inliers_per_frame=tuple(range(200, 200 + n)),
        )  # fmt: skip
        quality = pseudo_gt_quality(cameras, None if pans else 0.7654)
        return ClipReport(
            id=true.id,
            camera_motion=kind,
            true=true,
            pseudo=recovered(true, rng),
            true_from_pseudo=TRUE_FROM_PSEUDO,
            images_dir=images_dir,
            masks_dir=masks_dir,
            body=small_body,
            figures=ClipAccuracy(
                ome_deg=0.1234,
                tme_mm=4.567,
                camera_rotation_deg=0.0567,
                scale_error_percent=None if pans else -1.234,
                frames=n,
                frames_with_camera=n,
            ),
            quality=quality.model_copy(update={"scale_sigma": None if pans else 0.0123}),
            cameras=cameras,
            predicted=moved(motion, TRUE_FROM_PSEUDO),
        )

    return make


def score(ome_deg: float, tme_mm: float, vme_mm: float) -> PaperMetrics[float]:
    return PaperMetrics[float](ome_deg=ome_deg, tme_mm=tme_mm, vme_mm=vme_mm)


def with_zero(gmr: PaperMetrics[float], zero_motion: PaperMetrics[float]) -> GmrSummary:
    return GmrSummary(**gmr.model_dump(), zero_motion=zero_motion)


@pytest.fixture(scope="session")
def report(make_clip) -> ReportData:
    """A report on three clips with all of its optional parts."""
    steps = range(0, 400, 10)
    return ReportData(
        title="gmrdata demo",
        data_source="Embedded gait: planned footsteps, not motion capture.",
        seconds={"render": 61.25, "reconstruct": 40.5, "train": 12.0},
        versions={"gmrdata": "0.1.0", "numpy": "1.26.4"},
        recipe="fps_hz: 10.0\ncameras: [circular, linear, panning]\n",
        clips=tuple(make_clip(kind) for kind in PROGRAMMES),
        scores={
            "truth": with_zero(score(3.21, 43.2, 54.3), score(7.65, 120.1, 130.2)),
            "pseudo-gt": with_zero(score(3.33, 44.4, 55.5), score(7.77, 121.1, 131.2)),
        },
        learning_curve=tuple((step, 2.0 * 0.99**step + 0.01 * (step % 3)) for step in steps),
    )


@pytest.fixture(scope="session")
def finished(small_body, tmp_path_factory) -> Path:
    """A solved video with its page; nobody changes it."""

    from tests.pages.solved_video import solved_video  # which imports this file

    def make(folder: Path) -> None:
        solved_video(folder, small_body)
        make_video_page(folder)

    return made_once(tmp_path_factory, "finished_video", make)
