"""Reader of AMASS .npz files (SMPL+H and SMPL-X releases), SMPL arrays, and gmrdata's own clips.

Poses are local rotations of the SMPL tree already, so they are kept as they are on every body.  Of
the hands, the first index joint stands for SMPL's hand joint: 22 and 37 of SMPL+H's 52 joints, as
the video-based estimators take it, and likewise 25 and 40 of SMPL-X's 55; other fingers are left
out.

A file's betas are kept where its own body is at hand: the motion then is the file's, number by
number, and stays in the file's world.  On any other body it has the mean shape.  AMASS's `trans` is
the pelvis less J0(betas), and the path is scaled by the ratio of the leg lengths.  The leg of
AMASS's subject needs `source_body`.  Without it the subject has the mean leg of SMPL's body at
hand, or on other bodies that of SMPL's neutral one; `gmrdata.write.amass` takes that ratio back.
"""

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.motion.ground import levelled, motion_of
from gmrdata.motion.resample import between_known
from gmrdata.motion.up_axis import turn_upright, turned
from gmrdata.read.amass_keys import FORMS, RATE_KEYS, gender_word, joined_poses
from gmrdata.read.numbers import finite_numbers, require_radians
from gmrdata.read.source_motion import (
    CMU_60_HZ_SUBJECTS,
    DEFAULT_READING,
    ReadConfig,
    check_rate_hz,
    cmu_subject,
    in_cmu,
)
from gmrdata.values.body import (
    HANDS,
    NEUTRAL,
    SMPL,
    SMPL_LEG_M,
    SMPL_REST_PELVIS_M,
    BodyModel,
    leg_length_m,
    shape_on,
)
from gmrdata.values.clip import CLIP_FORMAT, load_clip
from gmrdata.values.errors import BadBodyFile, BadMotionFile
from gmrdata.values.files import read_npz
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rotmats_from_rotvecs

_EXTRA = re.compile(r"(^shape|_stagei|^neutral_stagei)$")


def is_amass_extra(path: Path) -> bool:
    """Whether a file is AMASS's `shape.npz` or a `*_stagei.npz`, which hold no motion."""
    return path.suffix.lower() == ".npz" and bool(_EXTRA.search(path.stem))


def _named_body(arrays: dict[str, np.ndarray]) -> str | None:
    """The body whose shape a file's betas are, "smpl-female"; None where it has none of a known
    body: SMPL-X's betas mean something else."""
    if "betas" not in arrays or "poses" not in arrays or arrays["poses"].shape[-1:] == (165,):
        return None
    return str(arrays["body"]) if "body" in arrays else f"{SMPL}{gender_word(arrays)}"


def chosen_body(path: Path, names: Collection[str]) -> str:
    """Which of some bodies a motion file of any format is put on.

    That of its shape; else SMPL's neutral one; else the only one.  BadBodyFile: none of these.
    """
    wanted = None
    if path.suffix.lower() == ".npz":
        wanted = _named_body(joined_poses(read_npz(path, plain_alone=True), path))
    for name in (wanted, NEUTRAL):
        if name is not None and name in names:
            return name
    if len(names) > 1:
        needs = " or ".join(dict.fromkeys(filter(None, (wanted, NEUTRAL))))
        there = ", ".join(sorted(names))
        raise BadBodyFile(
            f"{path}: needs the body {needs}; there are {there}. Put it into the folder"
        )
    return next(iter(names))


def read_amass(
    path: Path,
    body: BodyModel,
    config: ReadConfig = DEFAULT_READING,
    *,
    shape: np.ndarray | None = None,
    source_body: BodyModel | None = None,
    ground: bool | None = None,
) -> Motion:
    """Read an AMASS motion (156 or 165 pose values), SMPL poses (72) or a clip, onto a body.

    The arguments are those of `read_motion`, and of `config` the rate and what is up.  Without a
    rate CMU's index settles CMU's 60 Hz subjects where the file says 60 or 120 (AMASS's releases
    disagree on them), else the file's counts.  Without `shape` the file's
    betas are kept if they are of this body (its name, or SMPL of the file's gender; SMPL-X's betas
    mean something else); any other body gets its mean shape.
    """
    if is_amass_extra(path):
        motions = "motions are *_poses.npz and *_stageii.npz"
        raise BadMotionFile(f"{path}: holds a subject's shape and no motion; {motions}")
    arrays = joined_poses(read_npz(path, plain_alone=True), path)
    if str(arrays.get("frame", "world")) != "world":
        raise BadMotionFile(f"{path}: a clip in camera frames; make its pseudo ground truth first")
    known = _known_rows(arrays, path)
    poses, trans = _pose_arrays(arrays, known, path)
    trans = trans * (1.0 if config.unit_m is None else config.unit_m)
    rate_hz, rate_note = amass_rate(arrays, config.fps_hz, path)
    kept = _named_body(arrays) == body.name
    betas = _betas(arrays, len(poses), path)
    source_leg_m, source_pelvis_m = _subject(arrays, betas, body, kept, source_body, path)
    is_own = kept and shape is None
    if shape is None:
        shape = shape_on(body, betas) if kept else np.zeros(body.n_shape)
    shape = np.asarray(shape, dtype=np.float64)
    scale = leg_length_m(body.rest_joints_m(shape)) / source_leg_m
    pelvis_m = (trans + source_pelvis_m) * scale
    betas_note = _betas_note(arrays, betas, body, kept)
    source = f"{path.name}: {rate_hz:.7g} Hz ({rate_note}), {betas_note}, path x {scale:.4f}"
    rotvecs = poses.reshape(len(poses), -1, 3)[:, [*range(22), *HANDS[poses.shape[1]]]]
    rotmats = rotmats_from_rotvecs(rotvecs)
    motion = motion_of(body, shape, rotmats, pelvis_m, rate_hz, source)
    up = config.up or ("z" if "frame" in arrays else None)  # a clip of gmrdata's is z-up
    if turning := turn_upright(body, motion, np.eye(3), up, str(path)):
        # AMASS is z-up: somebody turned this file, its roots and `trans`, not J0 between them.
        rest_m = scale * source_pelvis_m
        motion = turned(motion, *turning)
        motion = replace(motion, pelvis_m=motion.pelvis_m + rest_m - turning[0] @ rest_m)
    motion = levelled(body, motion, not is_own if ground is None else ground)
    return motion if known is None else _on_all_rows(motion, known)


def _known_rows(arrays: dict[str, np.ndarray], path: Path) -> np.ndarray | None:
    """(T,) bool: rows of one of gmrdata's clips that hold a motion; None for any other file.

    A row that is not valid may be NaN, where a data set says nothing of the person.
    """
    if str(arrays.get("format")) != CLIP_FORMAT:
        return None
    clip = load_clip(path)
    has_pose = np.isfinite(clip.motion.rotmats).all(axis=(1, 2, 3))
    return np.asarray(clip.valid | (has_pose & np.isfinite(clip.motion.pelvis_m).all(axis=1)))


def _on_all_rows(motion: Motion, known: np.ndarray) -> Motion:
    """A motion of the known rows (T,) of a clip with the others filled, turned and moved evenly."""
    rows = between_known(np.flatnonzero(known), np.arange(len(known)))
    n_filled = int((~known).sum())
    source = motion.source + (f", {n_filled} missing frames filled" if n_filled else "")
    return replace(rows.moved(motion), source=source)


def _pose_arrays(
    arrays: dict[str, np.ndarray], known: np.ndarray | None, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Checked `poses` (N, 72 | 156 | 165) [rad] and `trans` (N, 3) [m] of the known rows."""
    if missing := [key for key in ("poses", "trans") if key not in arrays]:
        lacks = f"it has no array {missing[0]!r} (it has {', '.join(arrays)[:200]})"
        raise BadMotionFile(f"{path}: no AMASS motion, {lacks}")
    poses, trans = arrays["poses"], arrays["trans"]
    if known is not None:  # the other rows are not checked, and errors count the file's rows
        poses, trans = (np.where(known[:, None], array, 0.0) for array in (poses, trans))
    poses, trans = finite_numbers(poses, "poses", path), finite_numbers(trans, "trans", path)
    if poses.ndim != 2 or poses.shape[1] not in HANDS:
        raise BadMotionFile(f"{path}: poses are {poses.shape}; known are {FORMS}")
    if trans.shape != (len(poses), 3):
        what = f"trans is {trans.shape} for {len(poses)} frames"
        raise BadMotionFile(f"{path}: {what}; fetch it again")
    if known is not None:
        poses, trans = poses[known], trans[known]
    if len(poses) < 2:
        raise BadMotionFile(f"{path}: {len(poses)} frames are no motion; it takes at least 2")
    require_radians(poses, "poses", path)
    return poses, trans


def amass_rate(
    arrays: dict[str, np.ndarray], fps_hz: float | None, path: Path
) -> tuple[float, str]:
    """The frame rate [Hz] and why it is that."""
    if fps_hz is not None:
        return check_rate_hz(fps_hz, path), "given"
    key = next((key for key in RATE_KEYS if key in arrays), None)
    if key is None:
        keys = " or ".join(RATE_KEYS)
        raise BadMotionFile(f"{path}: no frame rate ({keys}); give it with --fps-hz")
    values = finite_numbers(arrays[key], key, path).ravel()
    if values.size != 1:
        raise BadMotionFile(f"{path}: {key} is not one number; give the rate with --fps-hz")
    rate_hz = check_rate_hz(float(values[0]), path)
    is_60_hz = cmu_subject(path) in CMU_60_HZ_SUBJECTS and in_cmu(path)
    return (60.0, "CMU's index") if is_60_hz and rate_hz == 120.0 else (rate_hz, "file")


def _betas(arrays: dict[str, np.ndarray], n_frames: int, path: Path) -> np.ndarray:
    """(S,) the file's, or the mean of one row for each frame."""
    betas = finite_numbers(arrays.get("betas", ()), "betas", path)
    while betas.ndim > 1 and len(betas) == 1:
        betas = betas[0]
    if betas.ndim == 2 and len(betas) == n_frames:
        return np.asarray(betas.mean(axis=0))
    if betas.ndim > 1:
        what = f"betas are {betas.shape} for {n_frames} frames, known are (S,) and a row a frame"
        raise BadMotionFile(f"{path}: {what}; keep the subject's one row")
    return betas.reshape(-1)


def _betas_note(
    arrays: dict[str, np.ndarray], betas: np.ndarray, body: BodyModel, kept: bool
) -> str:
    """What became of the file's betas."""
    if kept:
        is_cut = betas[body.n_shape :].any()
        return f"the first {body.n_shape} betas of the file" if is_cut else "betas of the file"
    gendered = None if "body" in arrays else _named_body(arrays)
    whose = f", which are of {gendered}" if gendered else ""
    return f"betas of the file not used{whose}"


def _subject(
    arrays: dict[str, np.ndarray],
    betas: np.ndarray,
    body: BodyModel,
    kept: bool,
    source_body: BodyModel | None,
    path: Path,
) -> tuple[float, np.ndarray]:
    """Leg length [m] and J0 (3,) [m] of the file's subject, as far as they are known."""
    betas_body = body if kept else source_body
    if betas_body is not None:
        return _leg_and_pelvis(betas_body, shape_on(betas_body, betas))
    if not str(arrays.get("body", SMPL)).startswith(SMPL):
        what = f"a clip on the body {str(arrays['body'])!r}"
        raise BadMotionFile(f"{path}: {what}; give that body with --body")
    if body.name.startswith(SMPL):
        leg_m, rest_pelvis_m = _leg_and_pelvis(body, np.zeros(body.n_shape))
    else:
        leg_m, rest_pelvis_m = SMPL_LEG_M, np.array(SMPL_REST_PELVIS_M)
    if "rest_pelvis_m" in arrays:
        rest_pelvis_m = finite_numbers(arrays["rest_pelvis_m"], "rest_pelvis_m", path)
        if rest_pelvis_m.shape != (3,):
            what = f"rest_pelvis_m is {rest_pelvis_m.shape}, not (3,)"
            raise BadMotionFile(f"{path}: {what}; fetch it again")
    return leg_m, rest_pelvis_m


def _leg_and_pelvis(body: BodyModel, shape: np.ndarray) -> tuple[float, np.ndarray]:
    rest_joints_m = body.rest_joints_m(shape)
    return leg_length_m(rest_joints_m), rest_joints_m[0]
