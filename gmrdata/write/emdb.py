"""Writing a sequence in EMDB's layout: `P0/09_outdoor_walk/P0_09_outdoor_walk_data.pkl`.

The layout is that of EMDB's own description (dataset.md of eth-ait/emdb); `gmrdata.read.emdb` reads
it.  Every key is written: the joints in the image are the body's own, and so are the boxes round
its vertices.
"""

import re
from pathlib import Path

import numpy as np

from gmrdata.read.emdb import FPS_HZ, WORLD_FROM_EMDB, EmdbSequence
from gmrdata.read.numbers import usable_rows
from gmrdata.values.body import SMPL_SHAPES, BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadSequence
from gmrdata.values.files import write_bytes
from gmrdata.values.transforms import invert, rotvecs_from_rotmats
from gmrdata.write.pickles import python3_pickle

_NAME = re.compile(r"(P\d{1,2})_(.+)")


def emdb_name(clip_id: str) -> tuple[str, str]:
    """Folders of the subject and the sequence: P0 and 09_outdoor_walk; others are a P0's."""
    match = _NAME.fullmatch(clip_id)
    return (match[1], match[2]) if match else ("P0", clip_id)


def emdb_sequence(name: str, clip: Clip, body: BodyModel, parts: tuple[bool, bool]) -> EmdbSequence:
    """A clip in the z-up world as a sequence of EMDB; `sequence_clip` makes the clip of it again.

    Frames that are valid and have a camera are good; what is not known of the others is NaN.
    `name` is like `P0_09_outdoor_walk`, `parts` whether it belongs to EMDB 1 and to EMDB 2.

    Raises:
        BadSequence: EMDB has no place for the clip's frame rate, body or shape.
        BadMotionFile: the clip has no camera.
    """
    motion, camera = clip.motion, camera_of(clip)
    shape = np.asarray(motion.shape, dtype=np.float64)
    refused = (
        (motion.fps_hz != FPS_HZ, f"is at {motion.fps_hz:g} Hz, EMDB at {FPS_HZ:g} Hz"),
        (motion.body != f"smpl-{motion.gender}", f"has the body {motion.body}, EMDB has SMPL's"),
        (shape[SMPL_SHAPES:].any(), f"has {len(shape)} shape coefficients, EMDB has {SMPL_SHAPES}"),
        (motion.frame != "world", "is in the camera's frame, EMDB's people are in the world"),
    )
    if reasons := [why for is_so, why in refused if is_so]:
        raise BadSequence(f"clip {clip.id} {'; '.join(reasons)}")
    emdb_from_world = invert(WORLD_FROM_EMDB)[:3, :3]
    known = usable_rows(motion.rotmats, motion.pelvis_m)
    rotmats = motion.rotmats[known]
    rotmats[:, 0] = emdb_from_world @ rotmats[:, 0]
    poses_rad = np.full((motion.n_frames, 72), np.nan)
    poses_rad[known] = rotvecs_from_rotmats(rotmats).reshape(-1, 72)
    cam_from_world = np.full((motion.n_frames, 4, 4), np.nan)
    path_m = camera.world_from_cam[camera.has_camera]
    cam_from_world[camera.has_camera] = invert(path_m) @ WORLD_FROM_EMDB
    return EmdbSequence(
        name=name,
        emdb1=parts[0],
        emdb2=parts[1],
        gender=motion.gender,
        good=clip.valid & known & camera.has_camera,
        poses_rad=poses_rad,
        trans_m=motion.pelvis_m @ emdb_from_world.T - body.rest_pelvis_m(shape),
        betas=np.pad(shape, (0, max(0, SMPL_SHAPES - len(shape))))[:SMPL_SHAPES],
        intrinsics_px=camera.intrinsics_px,
        cam_from_world=cam_from_world,
        width_px=camera.width_px,
        height_px=camera.height_px,
    )


def seen_in_image(clip: Clip, body: BodyModel) -> tuple[np.ndarray, np.ndarray]:
    """SMPL's joints (N, 24, 2) and the box (N, 4) round the vertices in the image [px].

    Boxes end at the image's edges; rows and points that are not in front of a camera are NaN.
    """
    from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

    motion, camera = clip.motion, camera_of(clip)
    joints_px = np.full((motion.n_frames, 24, 2), np.nan)
    boxes_px = np.full((motion.n_frames, 4), np.nan)
    known = usable_rows(motion.rotmats, motion.pelvis_m) & camera.has_camera
    size_px = np.array([camera.width_px, camera.height_px], dtype=np.float64)
    moving, world_from_cam = motion.take(known), camera.world_from_cam[known]
    joints_m = motion_joints_m(body, moving)
    joints_px[known] = project(world_from_cam, joints_m, camera.intrinsics_px)
    for at, row in enumerate(np.flatnonzero(known)):
        vertices_m = motion_vertices_m(body, moving.take(slice(at, at + 1)))
        points_px = project(world_from_cam[at : at + 1], vertices_m, camera.intrinsics_px)[0]
        points_px = points_px[np.isfinite(points_px).all(axis=1)]
        if len(points_px):
            corners_px = np.concatenate([points_px.min(axis=0), points_px.max(axis=0)])
            boxes_px[row] = corners_px.clip(0.0, np.tile(size_px, 2))
    return joints_px, boxes_px


def write_emdb(
    path: Path, sequence: EmdbSequence, kp2d_px: np.ndarray, boxes_px: np.ndarray
) -> None:
    """Write one `*_data.pkl`, as a whole or not at all; the same values give the same bytes.

    Args:
        path: The file.
        sequence: What `read_emdb` gives back.
        kp2d_px: (N, 24, 2) SMPL's joints in the image [px]; NaN where they are not in view.
        boxes_px: (N, 4) x_min, y_min, x_max, y_max round the person [px].

    Raises:
        BadSequence: a frame that is called good has no number for pose or camera.
    """
    good = sequence.good
    given = (sequence.poses_rad, sequence.trans_m, sequence.cam_from_world.reshape(-1, 16))
    finite = np.isfinite(np.concatenate(given, axis=1)).all(axis=1)
    if bad := np.flatnonzero(good & ~finite).tolist():
        raise BadSequence(
            f"{sequence.name}: frame {bad[0]} is called good, and has no pose or camera"
        )
    is_box = np.isfinite(boxes_px).all(axis=1) & (boxes_px[:, 2:] > boxes_px[:, :2]).all(axis=1)
    content: dict[str, object] = {
        "gender": sequence.gender,
        "name": sequence.name,
        "emdb1": sequence.emdb1,
        "emdb2": sequence.emdb2,
        "n_frames": sequence.n_frames,
        "good_frames_mask": good,
        "camera": {
            "intrinsics": sequence.intrinsics_px,
            "extrinsics": sequence.cam_from_world,
            "width": sequence.width_px,
            "height": sequence.height_px,
        },
        "smpl": {
            "poses_root": sequence.poses_rad[:, :3],
            "poses_body": sequence.poses_rad[:, 3:],
            "trans": sequence.trans_m,
            "betas": sequence.betas,
        },
        "kp2d": kp2d_px,
        "bboxes": {"bboxes": boxes_px, "invalid_idxs": np.flatnonzero(~(good & is_box))},
    }
    write_bytes(path, python3_pickle(content))
