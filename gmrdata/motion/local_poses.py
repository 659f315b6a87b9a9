"""Reading local poses of any known format as clips, one for each unbroken run of one person.

A local pose is the rotation of each joint in its parent's frame; where the person is and how the
root is turned is not looked at, so it does not matter whether a file's root is in a camera's frame
or in a world.

| file | of | what is read |
|---|---|---|
| `vibe_output.pkl` | VIBE | `pose` (T, 72), `frame_ids`, `betas` of each person |
| `wham_output.pkl` | WHAM | the same |
| `demo_*.pkl` | PHALP, 4D-Humans | `smpl` of each frame's tracks |
| `hmr4d_results.pt`, also as a numpy pickle | GVHMR | `body_pose` (T, 63) |
| `hpe_results.pt`, `smpl_params.pt` | GEM-X, GEM-SMPL | the same |
| `results.pkl` | PromptHMR | `pose` of each person |
| a folder with `camera.npy` and `hps/`; `.npz` | TRAM | `pred_rotmat` of each track, `frame` |
| `*_world_results.npz` with `track_info.json` | SLAHMR | `pose_body` of each person |
| `.npz`, a pickle | SAM 3D Body | `pred_global_rots` of each person |
| a pickle of AMASS's keys | MoSh, AIST++ | local rotations |
| a folder with `local_poses.json` | the built-in estimator | local rotations of each person |
| `.npz` | AMASS (SMPL, SMPL+H, SMPL-X), gmrdata's clips | local rotations |
| `.bvh`, `.amc` | motion capture | retargeted to the SMPL tree |

The folder that a system made for a video stands for its file there.  Most estimators' files do
not say the video's frame rate; a person has to.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from gmrdata.motion.files import SUFFIXES, read_poses
from gmrdata.motion.resample import between_known, slice_motion, valid_runs
from gmrdata.read.bodies import load_body
from gmrdata.read.source_motion import ReadConfig, check_rate_hz
from gmrdata.read.systems import prompthmr
from gmrdata.read.systems.result import is_system_npz, read_system
from gmrdata.values.body import SMPL, BodyModel, gender_of, shape_on
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.motion import Motion
from gmrdata.values.people import EstimatedPeople, EstimatedPerson

MIN_FRAMES = 2
NAMED = (".bvh", ".amc")  # files whose joints have names of their own


def read_local_poses(
    path: Path | str,
    fps_hz: float | None = None,
    *,
    body: BodyModel | None = None,
    joint_map: Mapping[str, str] | Path | None = None,
    bridge_frames: int = 0,
) -> tuple[Clip, ...]:
    """Read the local poses of a file; the table above lists the formats.

    A BVH, AMC or npz is known by its suffix, the others by what they hold.  Gives one clip per
    unbroken run of a person; `valid` is False where a frame was filled.  A run may be a single
    frame, which no motion can be predicted from.  `image_numbers` are the frames' numbers in the
    video, or the rows of the file.

    Args:
        fps_hz: The true frame rate [Hz].  Needed for estimators' files, most of which lack it; one
            that is there counts, and another is refused.
        body: The body that stands for the people; the default body if None.  Motion capture is
            retargeted to it; the shape of the file is kept where it is of this body.
        joint_map: For a BVH or AMC with unknown joint names, as `read_motion` takes it.
        bridge_frames: Gaps of so many frames or fewer in a person's track are filled by slerp.

    Errors are MissingInput, BadMotionFile, UnsafePickle (nothing of it was run), BrokenPickle, and
    BadRecipe for what says nothing of such a file.
    """
    path = Path(path)
    if not path.exists():
        raise MissingInput(f"{path}: no such file")
    body = load_body("anny") if body is None else body
    suffix = path.suffix.lower() if path.is_file() else ""
    arrays = read_npz(path, plain_alone=True) if suffix == ".npz" else {}
    is_clip = {"valid", "image_numbers"} <= arrays.keys()
    is_motion = suffix in SUFFIXES and not is_system_npz(arrays)
    if joint_map is not None and suffix not in NAMED:
        raise _of_no_use("--joint-map: names joints of a .bvh or .amc", path)
    if bridge_frames and (is_clip or is_motion):
        raise _of_no_use("--bridge-frames: fills gaps in people's tracks", path)
    if is_clip:
        return _of_clip(path, fps_hz, body)
    if is_motion:
        config = ReadConfig.of(path, fps_hz=fps_hz, joint_map=joint_map)
        motion, first = read_poses(path, body, config)
        rows = first + np.arange(motion.n_frames)
        return (Clip(path.stem, motion, np.ones(len(rows), bool), rows, None),)
    return _of_people(path, fps_hz, body, bridge_frames)


def _of_no_use(what: str, path: Path) -> BadRecipe:
    return BadRecipe(f"{what}, and {path.name} is another file. Leave it out")


def _of_people(
    path: Path, fps_hz: float | None, body: BodyModel, bridge_frames: int
) -> tuple[Clip, ...]:
    """The runs of everybody whom a system saw."""
    estimate = read_system(path)
    rate_hz = _rate_hz(estimate, fps_hz, path)
    runs = tuple(
        clip
        for person in estimate.people
        for clip in _runs_of(person, body, rate_hz, path, bridge_frames)
    )
    if all(clip.motion.n_frames < MIN_FRAMES for clip in runs):
        what = "no person has two frames in a row, which is no motion"
        raise BadMotionFile(f"{path}: {what}. Give a longer sequence")
    return runs


def _rate_hz(found: EstimatedPeople, said_hz: float | None, path: Path) -> float:
    """Of a system's frames: what is said, else the file's own."""
    fps_hz = found.fps_hz if said_hz is None else said_hz
    if fps_hz is None:
        remedy = "Give the video's with --fps-hz"
        raise BadMotionFile(f"{path}: does not say its frame rate. {remedy}")
    rate_hz = check_rate_hz(fps_hz, path)
    has_own_rate = any(one.has_own_rate for one in found.people)  # of motion capture, which may err
    if not has_own_rate and not found.can_be_at(rate_hz):
        what = f"its frames are at {found.fps_hz:g} fps, as {found.system} took them of the video"
        raise BadRecipe(f"--fps-hz {rate_hz:g}: {path}: {what}. Leave it out")
    every = prompthmr.taken_every(rate_hz) if found.system == "prompt-hmr" else 1
    if every > 1:
        what = f"of a video of {rate_hz:g} fps PromptHMR takes one of each {every} frames"
        raise BadRecipe(f"--fps-hz {rate_hz:g}: {path}: {what}. Say {rate_hz / every:g}")
    return rate_hz


def _runs_of(
    person: EstimatedPerson, body: BodyModel, fps_hz: float, path: Path, bridge_frames: int
) -> list[Clip]:
    """A person's unbroken runs as clips: where frames are missing or a shot ends, one ends.

    The clips have no camera, the identity as root and the pelvis at 0, since the file's do not
    matter; `image_numbers` are the video's frames.  The file's shape is taken where it is of the
    body.  Gaps of `bridge_frames` or fewer are filled instead, by slerp of each joint, but never
    over the beginning of a shot; filled frames are not valid.
    """
    numbers = person.frame_numbers
    begins = np.diff(numbers, prepend=numbers[0]) > 1 + bridge_frames
    shot = np.searchsorted(sorted(person.cuts), numbers, side="right")
    begins |= np.diff(shot, prepend=shot[0]) > 0
    begins[0] = True
    starts = np.flatnonzero(begins)
    clips = []
    for start, stop in pairwise([*starts, len(begins)]):
        first, last = int(numbers[start]), int(numbers[stop - 1])
        frames = np.arange(first, last + 1)
        between = between_known(numbers[start:stop], frames)
        n, valid = len(frames), between.past == 0
        filled = f", {n - valid.sum()} missing frames filled" if not valid.all() else ""
        motion = Motion(
            local_rotmats=between.turned(person.local_rotmats[start:stop]),
            root_rotmats=np.tile(np.eye(3), (n, 1, 1)),
            pelvis_m=np.zeros((n, 3)),
            shape=_shape_on(body, person),
            fps_hz=fps_hz,
            body=body.name,
            gender=gender_of(body),
            frame="camera",
            source=f"{path.name}, {person.name}, frames {first}-{last} at {fps_hz:g} fps{filled}",
        )
        name = person.name if len(starts) == 1 else f"{person.name}_from_{first}"
        clips.append(Clip(name, motion, valid, frames, None))
    return clips


def _shape_on(body: BodyModel, person: EstimatedPerson) -> np.ndarray:
    """(S,) SMPL's neutral betas on SMPL's neutral body; the mean shape of all others."""
    if person.betas is None or not person.has_betas_of(body.name):
        return np.zeros(body.n_shape)
    return shape_on(body, person.betas.mean(axis=0))


def _of_clip(path: Path, fps_hz: float | None, body: BodyModel) -> tuple[Clip, ...]:
    """The runs of valid frames of one of gmrdata's clips, in any frame of reference."""
    clip = load_clip(path)
    runs = valid_runs(clip.valid)
    if not runs:
        raise BadMotionFile(f"{path}: none of its frames is valid. Give another clip")
    rate_hz = clip.motion.fps_hz if fps_hz is None else check_rate_hz(fps_hz, path)
    shape, gender = np.zeros(body.n_shape), gender_of(body)
    by_size = body.name.startswith(SMPL) or len(clip.motion.shape) == body.n_shape
    if clip.motion.body == body.name and by_size:
        shape, gender = shape_on(body, clip.motion.shape), clip.motion.gender
    whole = replace(clip.motion, shape=shape, fps_hz=rate_hz, body=body.name, gender=gender)
    whole = replace(whole, source=f"{path.name}: {clip.motion.source}")
    clips = []
    for start, stop in runs:
        motion = slice_motion(whole, start, stop)
        if not np.isfinite(motion.local_rotmats).all():
            what = "a valid frame holds NaN or infinite poses"
            remedy = "Mark such frames as not valid, or make the clip again"
            raise BadMotionFile(f"{path}: {what}. {remedy}")
        numbers = clip.image_numbers[start:stop]
        numbers = np.arange(start, stop) if (numbers < 0).any() else numbers
        name = clip.id if len(runs) == 1 else f"{clip.id}_from_{start}"
        clips.append(Clip(name, motion, np.ones(stop - start, bool), numbers, None))
    return tuple(clips)
