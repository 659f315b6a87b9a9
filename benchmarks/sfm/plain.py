"""The plain recipe: COLMAP as it comes, beside which ours is measured.

Every frame, pycolmap's defaults with the incremental mapper, the masks and intrinsics that ours
gets, the largest model, and scale by one similarity fit to the data set's own cam_poses.  Both
steps are stages, so that their wall times are taken as those of ours are.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import matrix_of, pycolmap
from gmrdata.cameras.files import CAMERAS_FILE, SfmCameras, load_cameras, save_cameras
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import check_images, list_images, read_gray, write_gray
from gmrdata.read.numbers import rigid_rows
from gmrdata.read.threedpw_files import read_sequence_file
from gmrdata.stage.store import run_stage
from gmrdata.threedpw.clips import WORLD_FROM_3DPW
from gmrdata.values.camera import CameraPath, fill_gaps
from gmrdata.values.clip import Clip, load_clip, save_clip
from gmrdata.values.files import read_npz
from gmrdata.values.records import Config
from gmrdata.values.transforms import fit_similarity, invert, rigid
from gmrdata.world.compose import motion_in_world

FEWEST_CAMERAS = 3
"""A similarity between fewer points is not fixed."""


class PlainConfig(Config):
    """The plain recipe has one setting."""

    seed: int = 0
    """Seed of COLMAP's random choices."""


class PlainSfmConfig(PlainConfig):
    """What the record of the plain cameras holds."""

    intrinsics_px: tuple[tuple[float, ...], ...]
    """Calibration matrix [px]."""


def plain_cameras(
    images_dir: Path, masks_dir: Path, intrinsics_px: np.ndarray, out_dir: Path
) -> Path:
    """Stage: cameras of all frames that COLMAP's largest model has, up to scale.

    Args:
        images_dir: The frames.
        masks_dir: Masks (255 = dynamic), one per frame.
        intrinsics_px: (3, 3) calibration matrix [px], kept fixed.
        out_dir: Folder to make: `cameras.npz`.
    """
    config = PlainSfmConfig(intrinsics_px=tuple(tuple(row) for row in intrinsics_px.tolist()))

    def work(partial: Path) -> None:
        images = list_images(images_dir)
        size_px = check_images(images)
        work_dir = partial / "colmap"
        database = matched(images, masks_dir, intrinsics_px, work_dir, config.seed)
        models_dir = work_dir / "models"
        models_dir.mkdir()
        given = database, images_dir, models_dir, fixed_lens()
        world_from_cam = largest_model(pycolmap.incremental_mapping(*given), images)
        shutil.rmtree(work_dir)
        has_camera = np.isfinite(world_from_cam[:, 0, 0])
        path = CameraPath(intrinsics_px, *size_px, world_from_cam, has_camera)
        numbers = np.arange(len(images))
        none = np.zeros(len(images), dtype=bool)
        save_cameras(partial / CAMERAS_FILE, SfmCameras(path, "full", numbers, none))

    return run_stage("plain_sfm", out_dir, config, {"images": images_dir, "masks": masks_dir}, work)


def plain_pseudo_gt(
    sfm_dir: Path, pickle_path: Path, camera_clips: Sequence[Path], out_dir: Path
) -> Path:
    """Stage: each person's clip in the data set's world, at its scale (R_w = R_col R_c).

    Args:
        sfm_dir: Folder that `plain_cameras` made.
        pickle_path: The sequence file, for its cam_poses.
        camera_clips: Each person in the camera frame.
        out_dir: Folder to make: `person_<i>.npz`, or nothing where no camera was found.
    """

    def work(partial: Path) -> None:
        dataset = WORLD_FROM_3DPW @ invert(read_sequence_file(pickle_path).cam_from_world)
        path = metric_path(load_cameras(sfm_dir).path, dataset)
        if path is None:
            return
        for number, clip_path in enumerate(camera_clips):
            rest_pelvis_m = read_npz(clip_path)["rest_pelvis_m"]
            clip = composed(load_clip(clip_path), path)
            save_clip(partial / f"person_{number}.npz", clip, rest_pelvis_m)

    inputs = {"sfm": sfm_dir, "sequence": pickle_path}
    inputs |= {f"clip_{number}": path for number, path in enumerate(camera_clips)}
    return run_stage("plain_pseudo_gt", out_dir, PlainConfig(), inputs, work)


def metric_path(path: CameraPath, dataset_world_from_cam: np.ndarray) -> CameraPath | None:
    """Cameras (T) moved into the data set's world by the best similarity of their centres.

    Args:
        path: Cameras up to scale.
        dataset_world_from_cam: (T, 4, 4) the data set's own, metric.

    Returns:
        None where fewer than three cameras were found, or all in one place.
    """
    rows = np.flatnonzero(path.has_camera & rigid_rows(dataset_world_from_cam))
    centres = path.world_from_cam[rows, :3, 3]
    if len(rows) < FEWEST_CAMERAS or np.ptp(centres, axis=0).max() < 1e-9:
        return None
    world_from_model = fit_similarity(dataset_world_from_cam[rows, :3, 3], centres, scale=True)
    moved = rigid(
        world_from_model.rotmat @ path.world_from_cam[:, :3, :3],
        world_from_model.apply(path.world_from_cam[:, :3, 3]),
    )
    moved[~path.has_camera] = np.nan
    return replace(path, world_from_cam=moved)


def composed(camera_clip: Clip, path: CameraPath) -> Clip:
    """The person in the world; frames without a camera are not valid."""
    filled = fill_gaps(path.world_from_cam, path.has_camera, np.arange(path.n_frames))
    motion = motion_in_world(camera_clip.motion, filled)
    return replace(
        camera_clip, motion=motion, camera=path, valid=camera_clip.valid & path.has_camera
    )


def matched(
    images: list[Path],
    masks_dir: Path | None,
    intrinsics_px: np.ndarray,
    work_dir: Path,
    seed: int,
) -> Path:
    """A database of features and matches by pycolmap's defaults, in a folder that is made."""
    work_dir.mkdir(parents=True)
    pycolmap.set_random_seed(seed)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    params = intrinsics_px[[0, 1, 0, 1], [0, 1, 2, 2]]
    reader.camera_params = ",".join(repr(float(value)) for value in params)
    if masks_dir is not None:
        _write_masks(images, masks_dir, work_dir / "masks")
        reader.mask_path = str(work_dir / "masks")
    database = work_dir / "database.db"
    pycolmap.extract_features(
        database,
        images[0].parent,
        image_names=[image.name for image in images],
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
    )
    pycolmap.match_sequential(database)
    return database


def _write_masks(images: list[Path], masks_dir: Path, out_dir: Path) -> None:
    """COLMAP's sense: no features where the mask is 0."""
    out_dir.mkdir()
    size_px = check_images(images)
    for image in images:
        background = read_gray(find_mask(masks_dir, image), size_px) <= 127
        write_gray(out_dir / f"{image.name}.png", 255 * background.astype(np.uint8))


def fixed_lens() -> Any:
    """The incremental mapper's options: the lens is as it is given, all else as it comes."""
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = False
    options.mapper.abs_pose_refine_extra_params = False
    return options


def largest_model(models: Mapping[int, Any], images: list[Path]) -> np.ndarray:
    """world_from_cam (T, 4, 4), NaN where the largest model has no camera."""
    world_from_cam = np.full((len(images), 4, 4), np.nan)
    if models:
        model = max(models.values(), key=lambda model: model.num_reg_images())
        row_of_name = {image.name: row for row, image in enumerate(images)}
        for image_id in model.reg_image_ids():
            image = model.image(image_id)
            cam_from_world = matrix_of(image.cam_from_world())
            world_from_cam[row_of_name[image.name]] = invert(cam_from_world)
    return world_from_cam
