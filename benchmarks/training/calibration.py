"""What is measured on rendered people once, for the files that travel with the package.

`true_track` brings a clip and the landmarks that the network saw of it together; from many of them
come the offsets of landmarks on a body.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmrdata.people.following import Sightings
from gmrdata.people.landmark_body import HANGS_ON, LEG_M, TURNS_WITH, SeenLandmarks
from gmrdata.people.landmark_network import MIRRORED_LANDMARKS
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.clip import Clip, camera_of, rows_of_numbers
from gmrdata.values.shapes import Float
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import invert

ROUNDS, LEAST_ERROR = 10, 0.02
"""Of the robust least squares, and the error from which a landmark counts less, per distance."""


class TrueTrack(NamedTuple):
    """A rendered person over T frames in which the network saw it, in the camera's axes."""

    seen: SeenLandmarks
    rows: np.ndarray  # (T,) of the clip
    joints_m: np.ndarray  # (T, 24, 3)
    turned: np.ndarray  # (T, 24, 3, 3) cam_from_joint
    rotmats: np.ndarray  # (T, 24, 3, 3) local, the root's in the camera's axes
    leg_m: float


def true_track(track: Sightings, seen: SeenLandmarks, clip: Clip, body: BodyModel) -> TrueTrack:
    """The frames of a track that the clip has; `seen` is the same track's."""
    rows = rows_of_numbers(clip.image_numbers, track.image_numbers)
    kept = rows >= 0
    rows = rows[kept]
    cam_from_world = invert(camera_of(clip).world_from_cam[rows])
    motion = clip.motion.take(rows)
    rotmats = motion.rotmats.copy()
    rotmats[:, 0] = cam_from_world[:, :3, :3] @ rotmats[:, 0]
    pelvis_m = (cam_from_world[:, :3, :3] @ motion.pelvis_m[..., None])[..., 0]
    rest_joints_m = body.rest_joints_m(motion.shape)
    joints_m, turned = posed_joints_m(rest_joints_m, rotmats, pelvis_m + cam_from_world[:, :3, 3])
    return TrueTrack(seen.take(kept), rows, joints_m, turned, rotmats, leg_length_m(rest_joints_m))


def measure_offsets(tracks: Sequence[TrueTrack]) -> np.ndarray:
    """Offsets (33, 3) on a leg of `LEG_M` that lay landmarks onto the rays that were seen [m]."""
    joints_m = np.concatenate([one.joints_m for one in tracks])[:, list(HANGS_ON)]
    grown = np.concatenate([np.full(len(one.rows), one.leg_m / LEG_M) for one in tracks])
    turned = np.concatenate([one.turned for one in tracks])[:, list(TURNS_WITH)]
    turned = turned * grown[:, None, None, None]
    rays = np.concatenate([one.seen.rays for one in tracks])
    visible = np.concatenate([one.seen.visibility for one in tracks])
    depths = joints_m[..., 2]
    # (x + o x) - u (z + o z) = 0 in units of the distance, for x and y.
    design = (turned[..., :2, :] - rays[..., None] * turned[..., 2:, :]) / depths[..., None, None]
    target = rays - joints_m[..., :2] / depths[..., None]
    offsets_m = np.zeros((len(HANGS_ON), 3))
    for n in range(len(offsets_m)):
        rows, wanted = design[:, n], target[:, n]
        for _ in range(ROUNDS):
            errors = np.linalg.norm(rows @ offsets_m[n] - wanted, axis=-1)
            weights = visible[:, n] / (1 + (errors / LEAST_ERROR) ** 2)
            normal = np.einsum("f,fij,fik->jk", weights, rows, rows)
            right = np.einsum("f,fij,fi->j", weights, rows, wanted)
            offsets_m[n] = np.linalg.solve(normal + 1e-3 * np.eye(3), right)
    return mirrored_offsets_m(offsets_m)


def mirrored_offsets_m(offsets_m: Float[np.ndarray, "33 3"]) -> Float[np.ndarray, "33 3"]:
    """The mean of both sides of the body."""
    return (offsets_m + offsets_m[list(MIRRORED_LANDMARKS)] * [-1.0, 1.0, 1.0]) / 2
