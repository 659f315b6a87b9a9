"""A network's path alone over 20 s, and the same told that the person is back where they were."""

from dataclasses import dataclass, replace

import numpy as np
from fusion.session import MEASURE, FusionSession

from gmrdata.fusion.camera_evidence import FusionConfig
from gmrdata.fusion.fuse import WeighedGmr, WorldPerson, fuse_person, seen_frames
from gmrdata.fusion.network_errors import noisy
from gmrdata.fusion.smoothing import SamePlace
from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.runs import split_manifests
from gmrdata.motion.resample import resample
from gmrdata.values.clip import Clip, clip_on_body
from gmrdata.values.motion import Motion

SECONDS, LONGEST_S = 20.0, 26.0
NEAR_M = 0.1  # a person who comes back so near stands on the same spot
SIGMA_M = 0.1
EVERY_S = 1.0


@dataclass(frozen=True)
class Loop:
    """One stretch of a held-out motion that ends where it began, and its end's errors."""

    clip: str
    start_s: float
    seconds: float
    true_apart_m: float
    network_m: float
    """Distance of the end from the true one, seen from above, both from the true first pose on."""
    closed_m: float
    sigma_m: float


def loops(session: FusionSession) -> list[Loop]:
    """All of them in motions of people whom the network was not trained on."""
    data = DataConfig(held_out_subjects=session.subjects, never_train_on=())
    span_s = (0.5, 1.0) if session.small else (SECONDS, LONGEST_S)
    found = []
    for file in split_manifests([session.every], data).held_out:
        clip = clip_on_body(file.load(), session.body)
        motion = resample(clip.motion, MEASURE.fps_hz)
        for start, stop in stretches(motion, *span_s):
            part = replace(clip, motion=motion.take(slice(start, stop + 1)))
            found.append(closed(session, part, start / motion.fps_hz))
    return found


def stretches(motion: Motion, shortest_s: float, longest_s: float) -> list[tuple[int, int]]:
    """First and last frame of stretches that end where they begin; each begins `EVERY_S` after the
    one before, and ends when the person is nearest."""
    fps_hz, places_m = motion.fps_hz, motion.pelvis_m[:, :2]
    least, most = round(shortest_s * fps_hz), round(longest_s * fps_hz)
    found = []
    for start in range(0, motion.n_frames - least, round(EVERY_S * fps_hz)):
        apart_m = np.linalg.norm(places_m[start + least : start + most] - places_m[start], axis=1)
        if apart_m.min() < NEAR_M:
            found.append((start, start + least + int(apart_m.argmin())))
    return found


def closed(session: FusionSession, clip: Clip, start_s: float) -> Loop:
    true = clip.motion
    n = true.n_frames
    shown = replace(clip, motion=noisy(true, MEASURE, np.random.default_rng(0)), camera=None)
    shown = replace(shown, valid=np.ones(n, dtype=bool), image_numbers=np.full(n, -1))
    errors = session.errors_without(clip.id)
    person = WorldPerson(shown, seen_frames(shown), (SamePlace(0, n - 1, SIGMA_M),))
    network = WeighedGmr(session.gmr, errors)
    fused = fuse_person(person, network, session.body, FusionConfig())
    motion = fused.clip.motion
    paths_m = fused.network_m, motion.pelvis_m
    alone_m, closed_m = (end_error_m(path_m, motion.root_rotmats[0], true) for path_m in paths_m)
    apart_m = float(np.linalg.norm((true.pelvis_m[-1] - true.pelvis_m[0])[:2]))
    sigma_m = float(np.sqrt((fused.arrays["place_sigma_m"][-1, :2] ** 2).mean()))
    seconds = (n - 1) / true.fps_hz
    return Loop(clip.id, start_s, seconds, apart_m, alone_m, closed_m, sigma_m)


def end_error_m(path_m: np.ndarray, first_rotmat: np.ndarray, true: Motion) -> float:
    """Distance (xy) of a path's end from the true one, once its first pose is made the true one."""
    true_from_path = true.root_rotmats[0] @ first_rotmat.T
    end_m = true_from_path @ (path_m[-1] - path_m[0])
    return float(np.linalg.norm((end_m - (true.pelvis_m[-1] - true.pelvis_m[0]))[:2]))
