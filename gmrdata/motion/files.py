"""Reading a motion of any known format onto a body, and finding the motions of a folder."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gmrdata.motion.amass import amass_rate, is_amass_extra, read_amass
from gmrdata.motion.pelvis import NO_TURN, on_pelvis
from gmrdata.motion.rest_pose import TOLD_FROM, in_metres, pose_of
from gmrdata.motion.retarget import Residual, Retargeting, retarget
from gmrdata.motion.up_axis import (
    BY_TRUNK,
    FASTEST_M_PER_S,
    LIES,
    person_of,
    remarks_on,
    shows_z_up,
)
from gmrdata.read.amass_keys import SPLIT_KEYS
from gmrdata.read.amc import find_asf, read_amc
from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import CMU_TRIAL, ReadConfig, RestPose, SourceMotion, UpAxis
from gmrdata.stage.progress import remark
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import CLIP_FORMAT, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput
from gmrdata.values.files import (
    RECIPE_FILE,
    STAGE_FILE,
    files_inside,
    is_hidden,
    read_npz,
    require_text,
    visible,
)
from gmrdata.values.joint_names import CMU_UPRIGHT_PITCH_DEG, find_joints, is_cmu
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import angles_rad

STIFF_DEG, STIFF_WAY_M = 2.0, 1.0  # radians make at most 1.6 degrees of a quarter turn
SUFFIXES = (".amc", ".bvh", ".npz")
POSE_ARRAYS = frozenset({"poses.npy", *(f"{key}.npy" for key in SPLIT_KEYS["body"])})
"""Of which a motion's .npz has one."""


@dataclass(frozen=True, eq=False)
class FileReading:
    """A motion that was read, and how far it can be trusted."""

    motion: Motion
    upright: bool  # False for one who lies or leans in most frames
    remarks: tuple[str, ...]  # what may be wrong: one who lies, or walks faster than people do
    rate_from: str  # where its frame rate is from, as in `ReadingRecord`
    residual: Residual | None  # of a BVH or AMC; other files hold poses of this tree
    valid: np.ndarray  # (T,) bool: False where a clip of gmrdata's own says so


def read_motion(
    path: Path | str,
    body: BodyModel,
    *,
    fps_hz: float | None = None,
    joint_map: Mapping[str, str] | Path | str | None = None,
    unit_m: float | None = None,
    rest_pose: RestPose | Path | None = None,
    up: UpAxis | None = None,
    asf_path: Path | str | None = None,
    drop_rest_frame: bool | None = None,
    shape: np.ndarray | None = None,
    source_body: BodyModel | None = None,
    ground: bool | None = None,
) -> Motion:
    """Read a BVH, AMC or AMASS file, or one of gmrdata's clips, as a motion of `body`.

    The suffix tells the format.  The motion is in a z-up world with the floor at z = 0 (see
    `ground`), and its `source` records what was decided.  Errors are MissingInput, BadRecipe for a
    wrong argument, and BadMotionFile, which names the place and the remedy.

    Args:
        fps_hz: Frame rate to believe instead of the file's [Hz].
        joint_map: `{name in the file: SMPL joint}`, or a YAML or JSON file of it, for a BVH or ASF
            whose names are not known.
        unit_m: Metres per unit of a BVH or ASF; without it the convention's, if the legs are of a
            person's length with it, else what makes them so.  For an .npz that of `trans`, else 1.
        rest_pose: The pose of a BVH or AMC without rotations (`RestPose`), or a BVH of the same
            skeleton in whose first frame the person stands; None looks for itself.
        up: Axis of the file's world that is up; without it the convention's, unless what the person
            does shows another (see `up_axis`).
        asf_path: Skeleton of an AMC, where it does not lie beside it.
        drop_rest_frame: Whether a BVH's frame 0 is an added rest pose; None looks for itself.
        shape: (S,) shape of `body`; without it that of the file if it is of this body, else the
            mean.
        source_body: The body whose betas an AMASS file holds, for the leg length of its subject.
        ground: Whether to level the floor that the feet show and move it to z = 0.  None does so
            for a motion of another body than `body`; one of its own stays where the file has it.
    """
    path = Path(path)
    _check_shape(path, body, shape)
    asf_path = None if asf_path is None else Path(asf_path)
    said = {"fps_hz": fps_hz, "unit_m": unit_m, "joint_map": joint_map, "rest_pose": rest_pose}
    config = ReadConfig.of(path, up=up, **said)
    if path.suffix.lower() == ".npz":
        return read_amass(path, body, config, shape=shape, source_body=source_body, ground=ground)
    source = _read_source(path, config, asf_path, drop_rest_frame)
    return _on_body(source, path, body, config, Retargeting(shape=shape, ground=ground))[0]


def read_file(
    path: Path,
    body: BodyModel,
    config: ReadConfig,
    *,
    shape: np.ndarray | None = None,
    ground: bool | None = None,
) -> FileReading:
    """`read_motion` as a recipe says, with where the rate is from and the residual."""
    require_text(path, BadMotionFile)
    _check_shape(path, body, shape)
    valid = None
    if path.suffix.lower() == ".npz":
        motion, residual = read_amass(path, body, config, shape=shape, ground=ground), None
        turns, arrays = motion.local_rotmats, read_npz(path, plain_alone=True)
        rate_from = amass_rate(arrays, config.fps_hz, path)[1]
        if str(arrays.get("format")) == CLIP_FORMAT:
            valid = load_clip(path).valid
    else:
        source = _read_source(path, config)
        turns = source.local_rotmats[:, 1:]
        said = Retargeting(shape=shape, ground=ground)
        motion, residual = _on_body(source, path, body, config, said)
        rate_from = source.rate_from
    person = person_of(body, motion)
    remarks = remarks_on(person, motion.fps_hz)
    if config.up is None and TOLD_FROM in motion.source and not shows_z_up(person):
        remarks = (*remarks, BY_TRUNK)
    remarks = remarks or _stiffness(motion, turns)
    if NO_TURN in motion.source:
        remarks = (*remarks, f"{NO_TURN} {motion.source.split(NO_TURN)[1].split(',')[0].strip()}")
    valid = np.ones(motion.n_frames, dtype=bool) if valid is None else valid
    remarks += _jump(motion, valid)
    return FileReading(motion, LIES not in remarks, remarks, rate_from, residual, valid)


def require_motion(reading: FileReading, path: Path, first_s: float, last_s: float) -> None:
    """Refuse a part of a file in which frames hold no motion: what fills them is no truth."""
    first, last = (round(at_s * reading.motion.fps_hz) for at_s in (first_s, last_s))
    empty = first + np.flatnonzero(~reading.valid[first : max(last, first + 1)])
    if len(empty):
        what = f"{len(empty)} of its frames, from frame {empty[0]} on, hold no motion"
        raise BadMotionFile(f"{path}: {what}. Take a part that does")


def _jump(motion: Motion, valid: np.ndarray) -> tuple[str, ...]:
    """A remark on a pelvis that is elsewhere in the next frame, which trackers leave."""
    steps_m = np.linalg.norm(np.diff(motion.pelvis_m, axis=0), axis=1) * (valid[1:] & valid[:-1])
    jumps = np.flatnonzero(steps_m * motion.fps_hz > FASTEST_M_PER_S)
    if not 0 < len(jumps) <= len(steps_m) / 10:  # of more `remarks_on` says that they are no path
        return ()
    at = int(jumps[0])
    what = f"jumps by {steps_m[at]:.2f} m from frame {at} to {at + 1}"
    more = f", the first of {len(jumps)} such steps" if len(jumps) > 1 else ""
    return (f"{what}{more}: nobody moves so, and it is trained on and scored as a motion",)


def _stiffness(motion: Motion, turns: np.ndarray) -> tuple[str, ...]:
    """A remark on a body that goes and hardly turns a joint, of which CMU's stiffest turn by 24
    degrees, or that keeps the file's zero pose, from which its joints turn (T, J, 3, 3)."""
    way_m = float(np.linalg.norm(np.ptp(motion.pelvis_m[:, :2], axis=0)))
    moves_deg = _most_deg(turns[len(turns) // 2].swapaxes(-1, -2) @ turns)
    radians = "or angles in radians where the format has degrees"
    if way_m > STIFF_WAY_M and moves_deg < STIFF_DEG:
        what = f"goes {way_m:.1f} m, and hardly a joint turns by more than {moves_deg:.1f} degrees"
        return (f"{what}: a stiff body, {radians}",)
    if (off_deg := _most_deg(turns)) < STIFF_DEG:
        what = f"hardly a joint is more than {off_deg:.1f} degrees off the file's zero pose"
        return (f"{what}: nothing but that, {radians}",)
    return ()


def _most_deg(turns: np.ndarray) -> float:
    """What 95 % of rotations (..., 3, 3) turn by less than [degrees]."""
    return float(np.rad2deg(np.percentile(angles_rad(turns.reshape(-1, 3, 3)), 95)))


def read_poses(path: Path, body: BodyModel, config: ReadConfig) -> tuple[Motion, int]:
    """The same for its local poses: not on the floor, and whichever axis is up; and which row of
    the file is its first."""
    require_text(path, BadMotionFile)
    if path.suffix.lower() == ".npz":
        return read_amass(path, body, config.model_copy(update={"up": "z"}), ground=False), 0
    said, source = Retargeting(ground=False, any_up=True), _read_source(path, config)
    return _on_body(source, path, body, config, said)[0], source.first_row


def _read_source(
    path: Path,
    config: ReadConfig,
    asf_path: Path | None = None,
    drop_rest_frame: bool | None = None,
) -> SourceMotion:
    """Motion capture on its own skeleton."""
    suffix, fps_hz, unit_m = path.suffix.lower(), config.fps_hz, config.unit_m
    if suffix == ".bvh":
        return read_bvh(path, fps_hz=fps_hz, unit_m=unit_m, drop_rest_frame=drop_rest_frame)
    if suffix == ".amc":
        return read_amc(path, asf_path=asf_path, fps_hz=fps_hz, unit_m=unit_m)
    known = "a .bvh, an .amc with its .asf, or an AMASS .npz"
    raise BadMotionFile(f"{path}: no known motion format; a motion is {known}")


def _on_body(
    source: SourceMotion, path: Path, body: BodyModel, config: ReadConfig, said: Retargeting
) -> tuple[Motion, Residual]:
    """The same on the body, as the recipe says."""

    def find(one: SourceMotion) -> dict[int, int]:
        return find_joints(one.names, one.parents, config.joint_map, path)

    rest = config.rest_pose
    if isinstance(rest, Path):  # before the skeleton is hung on its pelvis, and the pose with it
        config.require_rest_file()
        # A pose has no rate, so whatever its header says is no fault.
        standing = read_bvh(rest, fps_hz=30.0, drop_rest_frame=False, fewest_frames=1)
        source = replace(source, added_pose=pose_of(standing, source, str(path)))
    source, joints = on_pelvis(source, find(source), find)
    pitch_deg = CMU_UPRIGHT_PITCH_DEG if is_cmu(source.names) else {}
    said = replace(said, upright_pitch_deg=pitch_deg, rest=rest, up=config.up)
    source = source if config.unit_m is not None else in_metres(source, joints)
    return retarget(source, joints, body, said, str(path))


def input_files(path: Path) -> dict[str, Path]:
    """The files that a motion is read from, by their role: an AMC needs its skeleton."""
    skeleton = {"skeleton": find_asf(path)} if path.suffix.lower() == ".amc" else {}
    return {"motion": path} | skeleton


def find_motions(folder: Path) -> list[Path]:
    """Motion files in a folder and its subfolders, sorted by path.

    Left out are AMASS's `shape.npz` and `*_stagei.npz` and other .npz without poses, and what
    gmrdata made, where there is anything else: it may lie there in several forms.  A remark says
    so.  A trial that is there both as AMC and as BVH (same name in one folder, or the same CMU name
    `02_03` anywhere) is listed once, as AMC: that is CMU's own form.  So is what gmrdata exported
    both as AMASS and as BVH, as AMASS.  Hidden folders, as those of what was deleted, are not
    entered, nor links that lead out.  MissingInput: there is no such folder.
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder")
    paths = (path for path in visible(folder.rglob("*")) if path.suffix.lower() in SUFFIXES)
    shown = (path for path in paths if not is_hidden(path.relative_to(folder)))
    there = [path for path in files_inside(folder, shown) if _is_motion(path)]
    of_stages = {parent for parent in {path.parent for path in there} if _is_of_a_stage(parent)}
    made = [path for path in there if path.parent in of_stages]
    others = dict.fromkeys(path for path in there if path.parent not in of_stages)
    if made:
        more = f" and {len(made) - 1} more" if len(made) > 1 else ""
        is_bad = "made by gmrdata, which may have rejected it"
        remark(f"{made[0]}{more}: {'left out, as gmrdata made it' if others else is_bad}")
    listed = others or dict.fromkeys(made)
    as_amc = {_trial(file) for file in listed if file.suffix.lower() == ".amc"}
    bvhs = [file for file in listed if file.suffix.lower() == ".bvh"]
    twice = {file for file in bvhs if _trial(file) in as_amc or _as_amass(file) in listed}
    return [file for file in listed if file not in twice]


def _is_of_a_stage(folder: Path) -> bool:
    """Whether a folder lies in that of a stage, finished or not.  What a stage makes is often there
    in another form as well, and doesn't say whether it was accepted."""
    real = folder.resolve()
    return any(
        (one / STAGE_FILE).is_file() or (one.suffix == ".partial" and (one / RECIPE_FILE).is_file())
        for one in (real, *real.parents)
    )


def _check_shape(path: Path, body: BodyModel, shape: np.ndarray | None) -> None:
    if shape is not None and (np.shape(shape) != (body.n_shape,) or not np.isfinite(shape).all()):
        what = f"body {body.name} takes a shape of {body.n_shape} finite numbers"
        raise BadRecipe(f"{path}: {what}; leave it out for the mean shape")


def _trial(file: Path) -> str:
    """What two forms of one recording have in common."""
    return file.stem if CMU_TRIAL.match(file.stem) else str(file.with_suffix(""))


def _as_amass(file: Path) -> Path | None:
    """What `gmrdata export` calls the AMASS form of a BVH that it writes too."""
    of_format = file.parent.parent
    if file.suffix != ".bvh" or of_format.name != "bvh":
        return None
    return of_format.with_name("amass") / file.parent.name / f"{file.stem}.npz"


def _is_motion(file: Path) -> bool:
    """False for an .npz of something else.  A broken one counts, so that reading it says so."""
    if file.suffix.lower() != ".npz":
        return True
    if is_amass_extra(file):
        return False
    try:
        with zipfile.ZipFile(file) as archive:
            return not POSE_ARRAYS.isdisjoint(archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return True
