"""The formats of `gmrdata export`: what each is, what a clip must have, and what writes it.

A function here takes loaded clips, and gives what writes them to a path by a writer of
`gmrdata.write`.  What a format can't hold is an error, which is said of that clip alone, of a dry
run too.  Writers are imported where they are called, since the command line knows all formats
before it runs.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from gmrdata.motion.resample import valid_runs
from gmrdata.read.frames import check_images, is_turned, number_in_name, video_record
from gmrdata.stage.progress import remark
from gmrdata.values import transforms
from gmrdata.values.body import SMPL, SMPL_SHAPES
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadMotionFile, BadRecord, BadSequence, some
from gmrdata.values.files import write_bytes
from gmrdata.values.people import FUSED, PSEUDO_GT
from gmrdata.values.records import MAKE_AGAIN

if TYPE_CHECKING:
    from gmrdata.export.sources import ExportedClip
    from gmrdata.values.camera import CameraPath
    from gmrdata.world.compose import Background
    from gmrdata.write.cameras import ColmapPoints
    from gmrdata.write.systems import TrackedPerson

FormatName = Literal[
    "colmap", "tum", "kitti", "gem-x", "3dpw", "emdb", "wham", "gvhmr", "amass", "bvh", "glb",
    "usd", "rrd", "mp4",
]  # fmt: skip
Trajectory = Literal["camera", "person"]
Seen = Literal["keyframes", "all", "none"]
Need = Literal["camera", "world", "trajectory"]
"""world: motions in the world, one of which has a valid frame; trajectory: a camera or a motion in
the world, whichever is asked for."""


@dataclass(frozen=True)
class ExportOptions:
    """What the formats are asked for."""

    of: Trajectory = "camera"  # whose trajectory tum and kitti hold
    observations: Seen = "keyframes"  # which image points a COLMAP model has
    threedpw: Path | None = None  # 3DPW's own folder


Writer = Callable[[Path], None]
"""Writes the clips of one unit to a path that is not there: a file, or a folder to make."""


class Format(NamedTuple):
    """What one format is, and how it is written."""

    says: str  # what a file holds, for those who choose
    unit: Literal["clip", "sequence", "trajectory"]
    """A file for each clip, or for all people of a sequence; a trajectory is the clip's where it is
    the person's, and the sequence's where it is the one camera's."""
    path: str
    """Below OUT/<format>/.  {id} is the clip's or the sequence's name, {split} 3DPW's, {subject}
    and {take} are the two parts of EMDB's name."""
    needs: tuple[Need, ...]  # what is looked at before anything is written
    prepare: Callable[[Sequence["ExportedClip"], ExportOptions], Writer]


def unit_of(format: Format, options: ExportOptions) -> Literal["clip", "sequence"]:
    """Whether a file is a clip's, or that of all people of a sequence."""
    if format.unit == "trajectory":
        return "sequence" if options.of == "camera" else "clip"
    return format.unit


def why_not(format: Format, clips: Sequence["ExportedClip"], options: ExportOptions) -> str:
    """Why clips of one unit can't be written in a format; empty if they can, as far as is known."""
    trajectory: Need = "camera" if options.of == "camera" else "world"
    needs = [trajectory if need == "trajectory" else need for need in format.needs]
    lacks = (_clip_lacks(need, one.clip) for need in needs for one in clips)
    nobody = "world" in needs and not any(one.clip.valid.any() for one in clips)
    return next(filter(None, lacks), "has no valid frame" if nobody else "")


def _clip_lacks(need: Need, clip: Clip) -> str:
    if need == "camera" and clip.camera is None:
        return "has no camera"
    if need == "camera" and clip.camera is not None and not clip.camera.has_camera.any():
        return "has no frame with a known camera"
    outside = need == "world" and clip.motion.frame != "world"
    return "its motion is in the camera's frame, not in a world" if outside else ""


PINHOLES: tuple[FormatName, ...] = ("gem-x", "3dpw", "emdb", "gvhmr", "glb", "usd", "rrd")
"""Formats that hold a camera without the lens's distortion."""
SAME_LEGS = 0.01  # as a share: no remark on what nobody sees
EACH_CAMERA: tuple[FormatName, ...] = ("kitti", "gem-x")
"""Formats that have a camera for each frame, so that none can be left out."""
STEADY: tuple[FormatName, ...] = ("amass", "bvh", "glb", "usd", "rrd", "mp4")
"""Formats that hold a rate, and no times of frames."""


def not_held(format: str, clips: Sequence["ExportedClip"], of: Trajectory) -> Iterator[str]:
    """What a format has no place for, in words: it is written all the same."""
    needs = FORMATS[format].needs
    for one in clips if "world" in needs or ("trajectory" in needs and of == "person") else ():
        if why := _why_rejected(one):
            yield f"{one.id} is rejected, which {format} does not show: {why}"
    if format in PINHOLES and (off_px := _bend_px(clips)) >= 1:
        what = f"the lens bends the pictures by {off_px:.0f} px at the corner"
        yield f"{what}, {format} holds a camera without it; colmap has it"
    if format in EACH_CAMERA and "camera" in (of, *needs):
        kept = kept_images(clips[0].sfm_dir, clips[0].clip.image_numbers)
        if n_dropped := np.count_nonzero(~kept):
            what = f"the verdict drops the cameras of {n_dropped} frames"
            yield f"{what}, which {format} has as all others; tum leaves them out"
    yield from _body_not_held(format, clips)
    fps_hz = clips[0].clip.motion.fps_hz
    if format in STEADY and (off_s := _off_a_rate_s(format, clips[0])) > 0.5 / fps_hz:
        what = f"the video's frames are up to {off_s:.2f} s off a steady {fps_hz:.5g} Hz"
        yield f"{what}, which {format} has; tum has their times"


def _body_not_held(format: str, clips: Sequence["ExportedClip"]) -> Iterator[str]:
    body = clips[0].clip.motion.body
    if format == "3dpw" and not body.startswith(SMPL):
        yield f"shape and path are of the body {body}, and all but gmrdata take them for SMPL's"
    if format == "wham":
        for one in clips:
            if (n := _n_shapes(one)) > SMPL_SHAPES:
                said = f"{n} shape coefficients in wham, WHAM's own files {SMPL_SHAPES}"
                yield f"{one.id} has {said}"
    if format == "amass":
        from gmrdata.write.amass import smpl_legs

        if abs((share := smpl_legs(clips[0].clip.motion, clips[0].body)) - 1) > SAME_LEGS:
            yield f"SMPL's mean legs walk {share:.3f} of the path in amass; bvh has all of it"


def _n_shapes(exported: "ExportedClip") -> int:
    """Shape coefficients of SMPL's up to the last that says something; 0 of another body."""
    motion = exported.clip.motion
    return len(np.trim_zeros(motion.shape, "b")) if motion.body.startswith(SMPL) else 0


def _off_a_rate_s(format: str, exported: "ExportedClip") -> float:
    """How far the frames of one file are off one rate, at most [s]."""
    clip, fps_hz = exported.clip, exported.clip.motion.fps_hz
    late_s = times_of(exported.images_dir, clip.image_numbers, fps_hz)
    late_s = late_s - np.arange(len(late_s)) / fps_hz
    files = valid_runs(clip.valid) if format in ("amass", "bvh") else [(0, len(late_s))]
    return max((float(np.ptp(late_s[slice(*rows)])) for rows in files), default=0.0)


def _bend_px(clips: Sequence["ExportedClip"]) -> float:
    """How far the lens that a sequence was solved with moves the corner of its pictures; 0 where
    nobody solved it."""
    from gmrdata.cameras.files import load_quality

    sfm_dir, camera = clips[0].sfm_dir, clips[0].clip.camera
    lens = None if sfm_dir is None else load_quality(sfm_dir).lens
    if lens is None or camera is None:
        return 0.0
    r = camera.lens.corner_radius
    return abs(lens.k1 * r**3 + lens.k2 * r**5) * max(camera.lens.focal_px)


def export_colmap(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """Cameras, and of a solved sequence its points and tracks, in the clip's world."""
    from gmrdata.cameras.files import load_cameras
    from gmrdata.world.compose import is_kept_in_place, load_background
    from gmrdata.write.cameras import NO_POINTS, write_colmap

    exported = clips[0]
    names: Sequence[str | None]
    if exported.sfm_dir is None:
        camera, names = camera_of(exported.clip), _image_names(exported)
        return partial(write_colmap, camera=camera, image_names=names)
    world_of: Clip | None = exported.clip
    if load_cameras(exported.sfm_dir).geometry == "full" and is_kept_in_place(exported.clip):
        what = "its scale is not known: the model is in the unit and world of its reconstruction"
        remark(f"{exported.sequence}: {what}")
        world_of = None
    background = load_background(exported.sfm_dir, world_of)
    known = background.camera.has_camera & kept_images(exported.sfm_dir, background.image_numbers)
    background = replace(background, camera=replace(background.camera, has_camera=known))
    if options.observations == "none":
        numbers = exported.clip.image_numbers.tolist()
        name_of = dict(zip(numbers, _image_names(exported), strict=True))
        names = [name_of.get(number) for number in background.image_numbers.tolist()]
        points = replace(NO_POINTS, world_m=background.points_m)
    else:
        names, points = seen_points(background, exported.sfm_dir, options.observations)
    return lambda path: write_background(path, background, names, points, exported.images_dir)


def seen_points(
    background: "Background", sfm_dir: Path, observations: Literal["keyframes", "all"]
) -> tuple[Sequence[str], "ColmapPoints"]:
    """Names of solved cameras' images, and the background points as these images see them."""
    from gmrdata.world.compose import load_background_tracks
    from gmrdata.write.cameras import ColmapPoints

    tracks = load_background_tracks(sfm_dir, background)
    seen = tracks if observations == "all" else tracks.of_adjusted()
    points = ColmapPoints(background.points_m, seen.rows, seen.points, seen.image_px)
    return tracks.image_names, points


def write_background(
    folder: Path,
    background: "Background",
    image_names: Sequence[str | None],
    points: "ColmapPoints",
    images_dir: Path | None,
) -> None:
    """Solved cameras and points as a COLMAP model, with the lens that they were solved with."""
    from gmrdata.write.cameras import write_colmap

    radial = None if background.lens is None else (background.lens.k1, background.lens.k2)
    if images_dir is not None:
        paths = (images_dir / name for name in image_names if name)
        if why := _why_no_colours(next(filter(Path.is_file, paths), None), background.camera):
            remark(f"{images_dir}: {why}. Points have no colours")
            images_dir = None
    write_colmap(
        folder, background.camera, image_names, points, radial=radial, images_dir=images_dir
    )


def _why_no_colours(image: Path | None, camera: "CameraPath") -> str:
    """Why COLMAP would not find points' colours in images like this one; empty if it would."""
    if image is None:
        return "has none of the model's images"
    if is_turned(image):
        what = "images are turned by EXIF, which COLMAP and others do not heed"
        return f"{what}: turn their pixels before use"
    if (size_px := check_images([image])) != (camera.width_px, camera.height_px):
        return f"images of {size_px} px, and the model's are {camera.width_px, camera.height_px}"
    return ""


def _image_names(exported: "ExportedClip") -> list[str | None]:
    """File name of each row's image; None for a row without one."""
    return [None if image is None else image.name for image in exported.image_paths()]


def export_tum(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The camera's or the pelvis's path; frames without one are left out, so times have gaps."""
    from gmrdata.write.cameras import write_tum

    (poses, known), clip = _trajectory(clips[0], options.of), clips[0].clip
    if options.of == "camera":
        known = known & kept_images(clips[0].sfm_dir, clip.image_numbers)
    times_s = times_of(clips[0].images_dir, clip.image_numbers, clip.motion.fps_hz)
    return partial(write_tum, world_from_body=poses[known], times_s=times_s[known])


def kept_images(sfm_dir: Path | None, image_numbers: np.ndarray) -> np.ndarray:
    """(N,) bool: images whose cameras a video's verdict keeps; all where there is none."""
    from gmrdata.cameras.files import load_cameras
    from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict

    if sfm_dir is None or not (path := sfm_dir.with_name(VERDICT_FILE)).is_file():
        return np.ones(len(image_numbers), dtype=bool)
    kept, judged = VideoVerdict.read(path).camera.kept, load_cameras(sfm_dir).image_numbers
    if len(kept) != len(judged):
        raise BadRecord(f"{path}: is of {len(kept)} frames, not {len(judged)}; {MAKE_AGAIN}")
    return ~np.isin(image_numbers, judged[~kept])


def times_of(images_dir: Path | None, image_numbers: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T,) times of frames [s]: those of a video itself, else by the rate from the first one on."""
    video = None if images_dir is None else video_record(images_dir)
    by_rate_s = np.arange(len(image_numbers)) / fps_hz
    own_s = by_rate_s if video is None else video.times_of(image_numbers)
    known = np.isfinite(own_s)
    if not known.any():
        return by_rate_s
    # A row without an image has no time of its own: outside of those that have, by the rate.
    return by_rate_s + np.interp(by_rate_s, by_rate_s[known], (own_s - by_rate_s)[known])


def export_kitti(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The same, a line for each frame: one that lacks a pose can't be left out."""
    from gmrdata.write.cameras import write_kitti

    poses, known = _trajectory(clips[0], options.of)
    _require_all(clips[0], known, options.of, "tum leaves such frames out")
    return partial(write_kitti, world_from_body=poses)


def export_gem_x(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """`camera.pt` with cam_from_world of each frame of the video."""
    from gmrdata.write.cameras import write_gem_x

    camera = camera_of(clips[0].clip)
    _require_each_frame(_tracked(clips[0]), "GEM-X has a camera for each frame; tum has times")
    _require_all(clips[0], camera.has_camera, "camera", "GEM-X needs one for each frame")
    return partial(write_gem_x, world_from_cam=camera.world_from_cam)


def _require_all(exported: "ExportedClip", known: np.ndarray, of: Trajectory, remedy: str) -> None:
    if len(missing := np.flatnonzero(~known)):
        what = f"clip {exported.id}: the {of} of frame {some(missing.tolist())} is not known"
        raise BadMotionFile(f"{what}; {remedy}")


def _trajectory(exported: "ExportedClip", of: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """world_from_cam or world_from_root (T, 4, 4), and in which frames it is known, (T,) bool."""
    if of == "camera":
        camera = camera_of(exported.clip)
        return camera.world_from_cam, camera.has_camera
    motion = exported.clip.motion
    return transforms.rigid(motion.root_rotmats, motion.pelvis_m), exported.clip.valid


def export_3dpw(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The people of a sequence; of those who were rejected no frame is `campose_valid`."""
    from gmrdata.read.threedpw_files import N_KEYPOINTS, find_sequence, read_sequence_file
    from gmrdata.threedpw.clips import sequence_arrays, with_original
    from gmrdata.write.threedpw import sequence_bytes

    usable = [one.clip.valid & (not _why_rejected(one)) for one in clips]
    clips = [
        replace(one, clip=replace(one.clip, valid=valid))
        for one, valid in zip(clips, usable, strict=True)
    ]
    _usable(clips, "campose_valid is 0 in all frames")
    _require_images_by_row(clips[0])
    for one in clips:
        if (n := _n_shapes(one)) > SMPL_SHAPES:
            raise BadSequence(f"clip {one.id} has {n} shape coefficients, 3DPW has {SMPL_SHAPES}")
    name = clips[0].sequence
    unseen = [np.zeros((one.clip.motion.n_frames, N_KEYPOINTS, 3)) for one in clips]
    arrays = sequence_arrays(
        name,
        [one.clip for one in clips],
        [one.body for one in clips],
        [one.clip.motion.gender for one in clips],
        unseen,
    )
    if options.threedpw is not None:
        original = read_sequence_file(find_sequence(options.threedpw, name).pickle_path)
        arrays = with_original(arrays, original)
    return partial(write_bytes, content=sequence_bytes(arrays))


def _why_rejected(exported: "ExportedClip") -> str:
    """Why `quality.json` rejects the person; empty where it doesn't.  A manifest says itself which
    frames are kept, also where a person decided otherwise."""
    from gmrdata.cameras.files import QUALITY_FILE
    from gmrdata.world.judge import load_record

    path = exported.clip_path.absolute()
    record_dir, number = path.parent.with_name(PSEUDO_GT), number_in_name(path.name)
    of_sequence = path.parent.name in (PSEUDO_GT, FUSED) and (record_dir / QUALITY_FILE).is_file()
    if exported.listed is not None or number is None or not of_sequence:
        return ""
    person = load_record(record_dir).people[number : number + 1]
    return "".join("; ".join(one.reasons) or "no reason" for one in person if not one.accepted)


def _usable(clips: Sequence["ExportedClip"], rest: str) -> list[bool]:
    """Whether a clip has frames that may be used; says what becomes of the others."""
    usable = [bool(one.clip.valid.any()) for one in clips]
    if not any(usable):
        raise BadMotionFile("has no valid frame")
    for one, is_usable in zip(clips, usable, strict=True):
        if not is_usable:
            remark(f"clip {one.id} has no valid frame: {rest}")
    return usable


def _shown(clips: Sequence["ExportedClip"]) -> list["ExportedClip"]:
    """Those who are seen in some frame; the others are named."""
    return [one for one, seen in zip(clips, _usable(clips, "left out"), strict=True) if seen]


def _require_images_by_row(exported: "ExportedClip") -> None:
    """Refuse a clip whose row t is not image t, where a layout knows images by their row."""
    numbers = exported.clip.image_numbers
    off = np.flatnonzero((numbers >= 0) & (numbers != np.arange(len(numbers))))
    if len(off):
        what = f"row {off[0]} is image {numbers[off[0]]}, and in this layout row {off[0]}"
        raise BadSequence(f"clip {exported.id}: {what}. Export a clip of all images, from 0 on")


def export_emdb(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """One person; the parts of EMDB as it was read, and both for clips from elsewhere."""
    from gmrdata.motion.emdb import ABOUT_FILE, EmdbAbout
    from gmrdata.write.emdb import emdb_name, emdb_sequence, seen_in_image, write_emdb

    (exported,) = clips
    _require_images_by_row(exported)
    about_path, parts = exported.clip_path.parent / ABOUT_FILE, (True, True)
    if about_path.is_file():
        about = EmdbAbout.read(about_path)
        parts = (about.emdb1, about.emdb2)
    name = "_".join(emdb_name(exported.id))
    body = exported.body
    sequence = emdb_sequence(name, exported.clip, body, parts)
    return lambda path: write_emdb(path, sequence, *seen_in_image(exported.clip, body))


def export_wham(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The people of a sequence, each in the frames that may be used."""
    from gmrdata.write.systems import wham_bytes

    usable = zip(clips, _usable(clips, "left out"), strict=True)
    people = [_tracked(one) if is_usable else None for one, is_usable in usable]
    return partial(write_bytes, content=wham_bytes(people))


def export_gvhmr(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """One person, in every frame of the video."""
    from gmrdata.write.systems import gvhmr_bytes

    person = _tracked(clips[0])
    _require_each_frame(person, "GVHMR has a row for each frame; wham names its frames")
    return partial(write_bytes, content=gvhmr_bytes(person))


def _require_each_frame(person: "TrackedPerson", remedy: str) -> None:
    """Refuse rows that are not the video's frames, where a layout knows frames by their row."""
    missed = np.flatnonzero(person.frame_numbers != np.arange(len(person.frame_numbers)))
    if len(missed):
        what = f"row {missed[0]} is frame {person.frame_numbers[missed[0]]} of the video"
        raise BadMotionFile(f"{what}, and {remedy}")


def _tracked(exported: "ExportedClip") -> "TrackedPerson":
    """The person and the frames of the video: by the record beside its images, else counted as
    `gmrdata evaluate` counts them."""
    from gmrdata.export.sources import images_by_number
    from gmrdata.score.results import frames_of_rows
    from gmrdata.write.systems import TrackedPerson

    folder, clip, numbers = exported.images_dir, exported.clip, exported.clip.image_numbers
    video = None if folder is None else video_record(folder)
    if video is not None and (numbers >= 0).any():
        frame_of = video.frame_of
        frames = np.array([frame_of.get(number, -1) for number in numbers.tolist()])
    else:
        frames = frames_of_rows(clip, [] if folder is None else list(images_by_number(folder)))
    rows = clip.valid & (frames >= 0)
    return TrackedPerson(clip.motion, exported.rest_pelvis_m, rows, frames, clip.camera)


def export_usd(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """All who are in a sequence, and the camera."""
    from gmrdata.export.takes import result_take
    from gmrdata.write.usd import write_usd

    return partial(write_usd, take=result_take(_shown(clips)))


def export_rrd(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The same with frames, masks and points, and the truth beside it, as far as they are there."""
    from gmrdata.export.takes import TRUTH, result_take, truth_take, with_points
    from gmrdata.write.recording import write_recording

    people = _shown(clips)
    first, true = people[0], truth_take(people)
    takes = [with_points(result_take(people), first)]
    return partial(
        write_recording,
        takes=[*takes, true[0]] if true else takes,
        shown_from_world={TRUTH: true[1]} if true else {},
        images=first.image_paths() if first.images_dir else [],
        masks=first.mask_paths(),
    )


def export_mp4(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """The frames with all bodies drawn over them, as the lens shows them."""
    from gmrdata.cameras.files import bent_points, load_quality
    from gmrdata.export.takes import result_take
    from gmrdata.write.overlay import write_overlay

    sfm_dir = clips[0].sfm_dir
    lens = None if sfm_dir is None else load_quality(sfm_dir).lens
    take, images = result_take(_shown(clips)), clips[0].image_paths()
    return partial(write_overlay, take=take, images=images, bend=partial(bent_points, lens=lens))


def export_glb(clips: Sequence["ExportedClip"], options: ExportOptions) -> Writer:
    """One person, and the camera."""
    from gmrdata.write.glb import write_glb

    clip, body = clips[0].clip, clips[0].body
    return partial(write_glb, motion=clip.motion, body=body, shown=clip.valid, camera=clip.camera)


def export_runs(clips: Sequence["ExportedClip"], options: ExportOptions, suffix: str) -> Writer:
    """A file of AMASS's layout or BVH for each unbroken stretch of valid frames, named by its first
    and last row; a frame alone is no motion."""
    from gmrdata.write.amass import write_amass
    from gmrdata.write.bvh import write_bvh

    write = {".npz": write_amass, ".bvh": write_bvh}[suffix]
    id, clip, body = clips[0].id, clips[0].clip, clips[0].body
    runs = [(start, stop) for start, stop in valid_runs(clip.valid) if stop - start > 1]
    if not runs:
        raise BadMotionFile("has no two valid frames in a row, and one is no motion")
    if n_alone := int(clip.valid.sum()) - sum(stop - start for start, stop in runs):
        remark(f"clip {id}: {n_alone} valid frames stand alone, in no {suffix}: one is no motion")

    def write_runs(path: Path) -> None:
        for start, stop in runs:
            name = f"{id}_{start:05d}-{stop - 1:05d}{suffix}"
            write(path / name, clip.motion.take(slice(start, stop)), body)

    return write_runs


FORMATS: dict[str, Format] = {
    "colmap": Format(
        "a COLMAP model, binary and text, with the tracks of a solved sequence",
        "sequence", "{id}", ("camera",), export_colmap,
    ),
    "tum": Format(
        "trajectory as TUM's RGB-D benchmark has it, with times",
        "trajectory", "{id}.txt", ("trajectory",), export_tum,
    ),
    "kitti": Format(
        "trajectory as KITTI's odometry has it, a line per frame",
        "trajectory", "{id}.txt", ("trajectory",), export_kitti,
    ),
    "gem-x": Format(
        "GEM-X's camera file, preprocess/camera.pt",
        "sequence", "{id}/preprocess/camera.pt", ("camera",), export_gem_x,
    ),
    "3dpw": Format(
        "3DPW's sequence files, people and cameras in one world that does not drift",
        "sequence", "sequenceFiles/{split}/{id}.pkl", ("camera",), export_3dpw,
    ),
    "emdb": Format(
        "EMDB's files",
        "clip", "{subject}/{take}/{subject}_{take}_data.pkl", ("camera", "world"), export_emdb,
    ),
    "wham": Format(
        "wham_output.pkl", "sequence", "{id}/wham_output.pkl", ("world",), export_wham
    ),
    "gvhmr": Format(
        "hmr4d_results.pt", "clip", "{id}/hmr4d_results.pt", ("world",), export_gvhmr
    ),
    "amass": Format(
        "SMPL+H's npz, a file for each unbroken stretch of valid frames",
        "clip", "{id}", ("world",), partial(export_runs, suffix=".npz"),
    ),
    "bvh": Format(
        "Mixamo's joints [cm], in such files",
        "clip", "{id}", ("world",), partial(export_runs, suffix=".bvh"),
    ),
    "glb": Format(
        "a person and the camera, animated", "clip", "{id}.glb", ("world",), export_glb
    ),
    "usd": Format(
        "all people of a sequence and the camera (extra `export`)",
        "sequence", "{id}.usdc", ("world",), export_usd,
    ),
    "rrd": Format(
        "the same for rerun, with frames, masks, points and truth (extra `view`)",
        "sequence", "{id}.rrd", ("world",), export_rrd,
    ),
    "mp4": Format(
        "the frames with bodies and paths drawn over them",
        "sequence", "{id}.mp4", ("camera", "world"), export_mp4,
    ),
}  # fmt: skip
NETWORK = "the network of a training run, whose folder, or the word bundled, is the source"
"""What the format onnx is, which is not of clips."""
