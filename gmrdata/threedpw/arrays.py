"""The content of a 3DPW sequence file as plain arrays, each with the meaning that it really has."""

from dataclasses import dataclass

import numpy as np

FPS_HZ = 30.0
"""Rate of the images and of all arrays that are aligned to them [Hz]."""
IMU_HZ = 60.0
"""Rate of the IMUs and of `poses_60Hz` and `trans_60Hz` [Hz]."""
N_KEYPOINTS = 18
"""OpenPose's COCO keypoints in `poses2d`."""
GENDERS = {"f": "female", "m": "male"}
"""3DPW's letters for the gender of a person's SMPL body."""


@dataclass(frozen=True, eq=False)
class Person:
    """One person over the N frames of a sequence, in 3DPW's world.

    That world is y-up and drifts: only relative to `SequenceArrays.cam_from_world` of the same
    frame is a person where the image shows them.
    """

    poses_rad: np.ndarray
    """(N, 72) axis-angle of the 24 SMPL joints; the first three are world_from_root [rad].
    `poses` in the file."""
    trans_m: np.ndarray
    """(N, 3) SMPL's `transl` in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""
    betas: np.ndarray
    """(S,) SMPL shape; S is 10, and longer in some files: a body takes as many as it has."""
    gender: str
    """"female" or "male"; `genders` in the files, `gender` in the readme."""
    campose_valid: np.ndarray
    """(N,) bool: the camera of this frame was aligned to this person."""
    poses2d_px: np.ndarray
    """(N, 18, 3) OpenPose keypoints: x [px], y [px], confidence; all zero where fewer than 6 joints
    were found.  The files have (N, 3, 18)."""
    poses_60hz_rad: np.ndarray | None = None
    """(M, 72) as `poses_rad`, at the IMUs' 60 Hz."""
    trans_60hz_m: np.ndarray | None = None
    """(M, 3) as `trans_m`, at 60 Hz."""
    joints_world_m: np.ndarray | None = None
    """(N, 24, 3) SMPL joints in the world [m]; `jointPositions`, (N, 72) in the files."""
    betas_clothed: np.ndarray | None = None
    """(S,) shape of the clothed template."""
    template_clothed_m: np.ndarray | None = None
    """(V, 3) clothed template, rest frame [m]; V is SMPL's 6890."""


@dataclass(frozen=True, eq=False)
class SequenceArrays:
    """A sequence file: one camera and one or two people, N frames at 30 Hz.

    Row t of every array but the 60 Hz ones belongs to `image_{t:05d}.jpg`.
    """

    name: str
    """The name that stands in the file."""
    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix K [px]; pixel (0, 0) is the outer corner of the top-left pixel."""
    cam_from_world: np.ndarray
    """(N, 4, 4) rigid transforms [m], OpenCV camera axes; `cam_poses`, world to camera."""
    img_frame_ids: np.ndarray
    """(N,) rows of the **60 Hz** arrays (0, 2, 4, ...), not numbers of images."""
    people: tuple[Person, ...]
    """One or two people."""

    @property
    def n_frames(self) -> int:
        """Number of frames N."""
        return int(self.cam_from_world.shape[0])
