"""Cameras taken away, or made noisy, and what is put together then, beside the truth."""

from dataclasses import dataclass, replace

import numpy as np
from fusion.session import FusionSession, Person
from scipy.spatial.transform import Rotation

from gmrdata.fusion.camera_evidence import FusionConfig, known_frames
from gmrdata.fusion.fuse import FusedClip, WeighedGmr, WorldPerson, fuse_person, seen_frames
from gmrdata.gmr.predict import predict_deltas
from gmrdata.values import transforms
from gmrdata.values.camera import fill_gaps
from gmrdata.values.clip import Clip
from gmrdata.values.motion import whole_ratio
from gmrdata.values.motion_metrics import orientation_errors_deg, translation_errors_mm

FEWEST_KNOWN = 8  # frames with a camera that are left on either side of a gap
CONFIG = FusionConfig()


@dataclass(frozen=True, eq=False)
class Case:
    """A person whose cameras were taken away for a while."""

    person: Person
    seconds: float
    cut: Clip
    rows: np.ndarray  # first frames (n,) of the motions that the gap has a part of
    hidden: np.ndarray  # (T,) bool: frames of the gap
    fused: FusedClip


@dataclass(frozen=True)
class Errors:
    """Mean errors of motions."""

    tme_mm: float
    ome_deg: float
    motions: int


def cut_out(
    session: FusionSession, person: Person, seconds: float, rng: np.random.Generator
) -> Case | None:
    """A gap at random, and all put together; None where the clip is too short for one."""
    clip = person.pseudo
    known, fps_hz = known_frames(clip), clip.motion.fps_hz
    n, length = len(known), round(seconds * fps_hz)
    starts = [
        start
        for start in range(n - length)
        if min(known[:start].sum(), known[start + length :].sum()) >= FEWEST_KNOWN
    ]
    if not starts:
        return None
    start = int(rng.choice(starts))
    hidden = np.zeros(n, dtype=bool)
    hidden[start : start + length] = True
    camera = clip.camera
    assert camera is not None
    camera = replace(camera, has_camera=camera.has_camera & ~hidden)
    cut = replace(clip, valid=clip.valid & ~hidden, camera=camera)
    rows = np.flatnonzero(_touched(hidden, _step(session, clip)))
    return Case(person, seconds, cut, rows, hidden, put_together(session, person, cut))


def put_together(session: FusionSession, person: Person, clip: Clip) -> FusedClip:
    errors = session.errors_without(person.trial)
    shown = WorldPerson(clip, seen_frames(clip), errors=person.errors)
    return fuse_person(shown, WeighedGmr(session.gmr, errors), session.body, CONFIG)


def _step(session: FusionSession, clip: Clip) -> int:
    step = whole_ratio(clip.motion.fps_hz, session.gmr.fps_hz)
    assert step is not None
    return step


def _touched(hidden: np.ndarray, step: int) -> np.ndarray:
    """(T - step,) bool: motions over `step` frames of which any frame is hidden."""
    windows = np.lib.stride_tricks.sliding_window_view(hidden, step + 1)
    return np.asarray(windows.any(axis=1))


def fused_errors(session: FusionSession, case: Case) -> Errors:
    motion = case.fused.clip.motion
    return errors_of(session, case.person, motion.root_rotmats, motion.pelvis_m, case.rows)


def interpolated_errors(session: FusionSession, case: Case) -> Errors:
    """Place linearly and orientation by slerp, between the frames with a camera."""
    motion, known = case.cut.motion, known_frames(case.cut)
    poses = transforms.rigid(motion.root_rotmats, motion.pelvis_m)
    filled = fill_gaps(poses, known, np.arange(len(known), dtype=float))
    return errors_of(session, case.person, filled[:, :3, :3], filled[:, :3, 3], case.rows)


def network_errors(session: FusionSession, case: Case) -> Errors:
    """The network alone, as it is scored: its motions at its own rate, from every frame on."""
    local, step = case.cut.motion.local_rotmats, _step(session, case.cut)
    n = len(local) - step
    rotmats, steps_m = np.empty((n, 3, 3)), np.empty((n, 3))
    for phase in range(step):
        rows = np.arange(phase, len(local), step)
        rotmats[rows[:-1]], steps_m[rows[:-1]] = predict_deltas(session.gmr, local[rows])
    true_rotmats, true_m = _true_motions(case.person, case.rows, step)
    return _errors(rotmats[case.rows], steps_m[case.rows], true_rotmats, true_m)


def errors_of(
    session: FusionSession,
    person: Person,
    rotmats: np.ndarray,
    pelvis_m: np.ndarray,
    rows: np.ndarray,
) -> Errors:
    """Errors of motions from some rows on over one step of the network."""
    step = _step(session, person.true)
    return _errors(*_motions(rotmats, pelvis_m, rows, step), *_true_motions(person, rows, step))


def _true_motions(person: Person, rows: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    true = person.true.motion
    return _motions(true.root_rotmats, true.pelvis_m, rows, step)


def _motions(
    rotmats: np.ndarray, pelvis_m: np.ndarray, rows: np.ndarray, step: int
) -> tuple[np.ndarray, np.ndarray]:
    to_root = rotmats[rows].swapaxes(-1, -2)
    moved_m = (pelvis_m[rows + step] - pelvis_m[rows])[..., None]
    return to_root @ rotmats[rows + step], (to_root @ moved_m)[..., 0]


def _errors(
    rotmats: np.ndarray, steps_m: np.ndarray, true_rotmats: np.ndarray, true_m: np.ndarray
) -> Errors:
    tme_mm = translation_errors_mm(steps_m, true_m)
    ome_deg = orientation_errors_deg(rotmats, true_rotmats)
    return Errors(float(tme_mm.mean()), float(ome_deg.mean()), len(tme_mm))


@dataclass(frozen=True)
class Within:
    """Shares of errors along single axes that are within two of their standard deviations."""

    place: float
    turn: float
    place_error_mm: float  # root mean square
    place_sigma_mm: float
    turn_error_deg: float
    turn_sigma_deg: float


def within_two_sigma(person: Person, fused: FusedClip, rows: np.ndarray) -> Within:
    """In some frames (T,) bool."""
    motion, true = fused.clip.motion, person.true.motion
    off_m = (motion.pelvis_m - true.pelvis_m)[rows]
    turned = motion.root_rotmats.swapaxes(-1, -2) @ true.root_rotmats
    off_deg = np.rad2deg(Rotation.from_matrix(turned[rows]).as_rotvec())
    sigma_m, sigma_deg = (fused.arrays[key][rows] for key in ("place_sigma_m", "turn_sigma_deg"))
    return Within(
        float((np.abs(off_m) <= 2 * sigma_m).mean()),
        float((np.abs(off_deg) <= 2 * sigma_deg).mean()),
        float(1000 * np.sqrt((off_m**2).mean())),
        float(1000 * np.sqrt((sigma_m**2).mean())),
        float(np.sqrt((off_deg**2).mean())),
        float(np.sqrt((sigma_deg**2).mean())),
    )


def made_noisy(person: Person, noise_m: float, rng: np.random.Generator) -> Clip:
    """The pseudo ground truth with the pelvis moved in each frame, by `noise_m` in the root mean
    square of its length."""
    clip = person.pseudo
    moved_m = rng.normal(scale=noise_m / np.sqrt(3), size=clip.motion.pelvis_m.shape)
    motion = replace(clip.motion, pelvis_m=clip.motion.pelvis_m + moved_m)
    return replace(clip, motion=motion)


def seen_rows(session: FusionSession, clip: Clip) -> np.ndarray:
    """First frames of motions over one step of the network all of whose frames have a camera."""
    return np.flatnonzero(~_touched(~known_frames(clip), _step(session, clip)))
