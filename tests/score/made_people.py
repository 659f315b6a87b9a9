"""Made-up people and predictions of them, on which protocols are held against released code."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.gmr.runs import UsableClip
from gmrdata.score import ProtocolMetric, ProtocolName
from gmrdata.score.clip_errors import ClipErrors, across_clips, clip_errors
from gmrdata.score.predictions import Pairing, PredictedClip, file_clip
from gmrdata.score.protocols import protocol_as, with_mesh_joints
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, rigid

N_FRAMES = 250
FPS_HZ = 30.0
GAPS = (((40, 45), (70, 73), (120, 122), (233, 234)), ((0, 10), (99, 104)))  # of each person
INTRINSICS_PX = np.array([[900.0, 0, 640], [0, 900.0, 360], [0, 0, 1]])
PREDICTED_FROM_WORLD = rigid(
    Rotation.from_euler("xyz", [80, 30, 200], degrees=True).as_matrix(), np.array([3.0, -2.0, 1.0])
)


def made_people(body: BodyModel, n_people: int, *, gaps: bool) -> list[tuple[Clip, Clip]]:
    """The truth and a prediction of each person of one video: all sines, so always the same."""
    return [_person(body, person, gaps=gaps) for person in range(n_people)]


def made_regressor(body: BodyModel, n_joints: int) -> np.ndarray:
    """(J, V) a matrix whose rows sum to 1, as those of regressors of joints do."""
    joints, vertices = np.arange(n_joints)[:, None], np.arange(len(body.template_m))
    weights = np.exp(6 * np.cos(0.7 * joints * (1 + vertices / len(vertices)) + vertices))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def our_figures(
    name: ProtocolName,
    body: BodyModel,
    people: list[tuple[Clip, Clip]],
    folder: Path,
    original: Sequence[str] = ("all",),
    regressor: np.ndarray | None = None,
) -> dict[ProtocolMetric, float]:
    """A protocol's figures of all people together, by way of files."""
    protocol = protocol_as(name, original)
    if regressor is not None:
        protocol = with_mesh_joints(protocol, len(regressor))
    scored: list[ClipErrors] = []
    for true, predicted in people:
        path = folder / f"{true.id}.npz"
        save_clip(path, predicted, body.rest_pelvis_m(predicted.motion.shape))
        found = file_clip(
            folder,
            UsableClip(true, "linear"),
            Pairing(
                10.0, protocol_fps_hz=protocol.fps_hz, smoothing_frames=protocol.smoothing_frames
            ),
        )
        assert isinstance(found, PredictedClip)
        scored.append(clip_errors(found, body, protocol, regressor=regressor))
    scored = across_clips(scored, protocol, {one.clip_id: "video" for one in scored})
    samples = [one.protocol["predicted"] for one in scored]
    return {
        metric: float(np.concatenate([one[metric] for one in samples]).mean())
        for metric in protocol.metrics
    }


def _person(body: BodyModel, person: int, *, gaps: bool) -> tuple[Clip, Clip]:
    shape = np.zeros(body.n_shape)
    shape[:2] = 0.5, -0.3 * person
    motion = _motion(body, shape, person, phase=0.0)
    valid = np.ones(N_FRAMES, bool)
    for start, stop in GAPS[person] if gaps else ():
        valid[start:stop] = False
    numbers = np.arange(N_FRAMES)
    true = Clip(f"person_{person}", motion, valid, numbers, _camera(phase=0.0, scale=1.0))
    shape[0] = 0.1
    guessed = _motion(body, shape, person, phase=0.15)
    moved = Motion(
        guessed.local_rotmats,
        PREDICTED_FROM_WORLD[:3, :3] @ guessed.root_rotmats,
        apply(PREDICTED_FROM_WORLD, 1.04 * guessed.pelvis_m),
        *(guessed.shape, FPS_HZ, body.name, "neutral", "world", "made up"),
    )
    camera = _camera(phase=0.1, scale=1.07)
    own = PREDICTED_FROM_WORLD @ camera.world_from_cam
    own_camera = CameraPath(INTRINSICS_PX, 1280, 720, own, np.ones(N_FRAMES, bool))
    predicted = Clip(true.id, moved, np.ones(N_FRAMES, bool), numbers, own_camera)
    return true, predicted


def _motion(body: BodyModel, shape: np.ndarray, person: int, phase: float) -> Motion:
    """A root that wanders and turns on the ground, joints that swing; z is up."""
    times, joints = np.arange(N_FRAMES)[:, None], np.arange(23)
    waves = np.sin(0.17 * times + joints + person + phase)
    swings = 0.25 * waves[..., None] * np.cos(joints[:, None] + np.array([0.0, 1.0, 2.0]) + phase)
    local = Rotation.from_rotvec(swings.reshape(-1, 3)).as_matrix().reshape(N_FRAMES, 23, 3, 3)
    heading = 0.02 * times[:, 0] + 0.3 * np.sin(0.05 * times[:, 0]) + person + phase
    lean = 0.1 * np.sin(0.11 * times[:, 0] + phase)
    roots = Rotation.from_euler("ZX", np.stack([heading, np.pi / 2 + lean], 1)).as_matrix()
    along, across = 0.02 * times[:, 0], np.sin(0.03 * times[:, 0] + phase) + 1.5 * person
    height = 0.95 + 0.03 * np.sin(0.3 * times[:, 0] + 3 * phase)
    pelvis_m = np.stack([along, across, height], axis=1)
    # The feet creep while the pelvis stands, so that some frames count as standing.
    pelvis_m[60:90] = pelvis_m[60] + 0.3 * phase * np.sin(0.5 * times[60:90])
    roots[60:90], local[60:90] = roots[60], local[60]
    return Motion(local, roots, pelvis_m, shape.copy(), FPS_HZ, body.name, "neutral", "world", "")


def _camera(phase: float, scale: float) -> CameraPath:
    """A camera that goes round and nods, in the world of the people."""
    times = np.arange(N_FRAMES)
    turns = np.stack(
        [0.01 * times + phase, np.full(N_FRAMES, -np.pi / 2), 0.1 * np.sin(0.2 * times)]
    )
    rotmats = Rotation.from_euler("ZXY", turns.T).as_matrix()
    centres_m = scale * np.stack(
        [
            4 * np.cos(0.02 * times),
            4 * np.sin(0.02 * times + phase),
            1.5 + 0.2 * np.sin(0.1 * times),
        ],
        1,
    )
    known = np.ones(N_FRAMES, bool)
    return CameraPath(INTRINSICS_PX, 1280, 720, rigid(rotmats, centres_m), known)
