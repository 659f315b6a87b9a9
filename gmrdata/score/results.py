"""Other systems' results beside the truth: which person, which frames, on which body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gmrdata.read.systems.entries import Z_UP_FROM_Y_DOWN
from gmrdata.score import SeenAs
from gmrdata.score.predictions import on_rows
from gmrdata.score.records import MatchedResult
from gmrdata.score.result_files import ClipName, ResultSet
from gmrdata.values.body import BodyModel, gender_of, shape_on
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, camera_of, rows_of_numbers
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.people import Crop, EstimatedPeople, EstimatedPerson
from gmrdata.values.transforms import rigid
from gmrdata.world.compose import motion_in_world


@dataclass(frozen=True, eq=False)
class MatchedClip:
    """A result on the rows of a clip."""

    clip: Clip  # the prediction: `valid` where the result has the row's frame, NaN elsewhere
    matched: MatchedResult


def people_of_clips(
    results: ResultSet, clips: Sequence[ClipName], wanted: Mapping[str, str]
) -> dict[str, EstimatedPerson]:
    """The person of a set's results that each clip is, by its id; nobody is guessed.

    That is the person that is named; else the only one of a result that is named by the clip's id,
    or by a sequence of one person; else the one that is left when all others of the sequence are
    named.  A clip whose result has nobody left is not in the table.

    Args:
        wanted: A person by `<set>/<clip id>`, `<clip id>` or "", in this order.

    BadMotionFile lists the people where it is not said which one a clip is, where a named one is
    not there, and where one is named for two people.
    """
    taken: dict[tuple[int, str], ClipName] = {}
    people: dict[str, EstimatedPerson] = {}
    with_result = [clip for clip in clips if clip.id in results.results]
    for clip in with_result:
        keys = (f"{results.name}/{clip.id}", clip.id, "")
        name = next((wanted[key] for key in keys if key in wanted), None)
        if name is not None:
            result = results.results[clip.id]
            person = _named_person(result, clip, name)
            other = taken.setdefault((id(result), person.name), clip)
            if _is_other(other, clip):
                both = f"clips {other.id} and {clip.id}"
                raise BadMotionFile(f"{result.files[0]}: {person.name} is named for {both}")
            people[clip.id] = person
    for clip in with_result:
        if clip.id not in people:
            left = _person_left(results, clip, taken)
            people |= {} if left is None else {clip.id: left}
    return people


def _is_other(one: ClipName, other: ClipName) -> bool:
    return (one.sequence, one.person) != (other.sequence, other.person)


def _named_person(result: EstimatedPeople, clip: ClipName, name: str) -> EstimatedPerson:
    for one in result.people:
        if one.name in (name, f"person_{name}"):
            return one
    raise _unclear(result, clip, f"has no person {name!r} for clip {clip.id}")


def _person_left(
    results: ResultSet, clip: ClipName, taken: Mapping[tuple[int, str], ClipName]
) -> EstimatedPerson | None:
    """Who a clip is without a name; None where all people are others."""
    result = results.results[clip.id]
    owners = {name: owner for (of_result, name), owner in taken.items() if of_result == id(result)}
    free = [
        one
        for one in result.people
        if one.name not in owners or not _is_other(owners[one.name], clip)
    ]
    if not free:
        return None
    own = [one for one in free if one.name in owners]
    n_others = len({(owner.sequence, owner.person) for owner in owners.values()})
    alone = clip.id in results.by_id or clip.n_people - n_others <= 1
    if own or (alone and len(free) == 1):
        return (own or free)[0]
    n = len(result.people)
    people = f"{n} people" if n > 1 else "one person"
    shared = f" of the {clip.n_people} of {clip.sequence}" if clip.n_people > 1 else ""
    what = f"has {people}, and which one{shared} is clip {clip.id} is not said"
    raise _unclear(result, clip, what)


def _unclear(result: EstimatedPeople, clip: ClipName, what: str) -> BadMotionFile:
    listed = f"It has {_listed(result.people)}"
    remedy = f"Name one with --person {clip.id}=NAME, or name the file by the clip's id"
    return BadMotionFile(f"{result.files[0]}: {what}. {listed}. {remedy}")


def _listed(people: Sequence[EstimatedPerson]) -> str:
    shown = [
        f"{one.name} (frames {one.frame_numbers[0]}-{one.frame_numbers[-1]}, "
        f"{len(one.frame_numbers)} of them)"
        for one in people[:12]
    ]
    return ", ".join(shown) + (f" and {len(people) - 12} more" if len(people) > 12 else "")


def frames_of_rows(
    clip: Clip, images: Sequence[int] | None = None, first_image: int | None = None
) -> np.ndarray:
    """(T,) which frame of the video, from 0, each row of a clip is; -1 for none.

    Frame 0 is the image `first_image`, where that is given; else the frames are the clip's images
    in their order (`images`, the numbers of all in the folder); else frame k is the image k.  A
    clip without images is as a video of its rows.
    """
    numbers = clip.image_numbers.astype(np.int64)
    if not (numbers >= 0).any():
        return np.arange(len(numbers))
    if first_image is None and images:
        ordered = np.array(sorted(set(images)), dtype=np.int64)
        at = np.searchsorted(ordered, numbers).clip(max=len(ordered) - 1)
        return np.where(ordered[at] == numbers, at, -1)
    return np.where(numbers >= 0, numbers - (first_image or 0), -1).clip(min=-1)


class RowsOfVideo(NamedTuple):
    """Which frames of a video a clip's rows are."""

    frames: np.ndarray  # (T,) the video's frame of each row; -1 for none
    wanted: np.ndarray | None = None  # (T,) bool the rows to take; None for all


def matched_clip(
    result: EstimatedPeople,
    person: EstimatedPerson,
    true: Clip,
    body: BodyModel,
    seen_as: SeenAs,
    rows: RowsOfVideo,
) -> MatchedClip:
    """A person's motion on the rows of a clip, at its rate, in a world with z up.

    BadMotionFile: the result has none of the frames, or is of frames of another rate.
    """
    file, frames = result.files[0], rows.frames
    _require_rate(result, true, frames)
    at = rows_of_numbers(person.frame_numbers, frames)
    has = has_rows(person, true, frames, seen_as)
    if not (has & true.valid).any():
        valid = frames[true.valid & (frames >= 0)]
        span = f"{valid.min()}-{valid.max()}" if valid.size else "none"
        raise BadMotionFile(
            f"{file}: {person.name} has frames {person.frame_numbers[0]}-"
            f"{person.frame_numbers[-1]}, and clip {true.id} is of frames {span} of the video. "
            "Give the clip's own result, or say with --first-image which image is frame 0"
        )
    shape, notes = _shape_on(person, body)
    others = np.setdiff1d(person.frame_numbers, frames[has])
    has = has if rows.wanted is None else has & rows.wanted
    z_up_from_file = _to_world(person, true, at, has, seen_as)
    matched = MatchedResult(
        file=file.name,
        person=person.name,
        people=len(result.people),
        frames=len(person.frame_numbers),
        used_frames=int(has.sum()),
        unused_frames=len(others),
        first_unused_frame=int(others[0]) if others.size else None,
        notes=notes,
    )
    seen = _seen(person, true, body, shape).take(at[has])
    seen = replace(seen, source=f"{result.system}: {file.name}, {person.name}")
    motion = _spread(motion_in_world(seen, z_up_from_file[has]), has)
    camera = _own_camera(person, true, at, has, z_up_from_file)
    return MatchedClip(Clip(true.id, motion, has, true.image_numbers, camera), matched)


def _require_rate(result: EstimatedPeople, true: Clip, frames: np.ndarray) -> None:
    """Refuse a result of frames of another rate than the video's, which the clip's rows show."""
    rows = np.flatnonzero(frames >= 0)
    if len(rows) < 2:
        return
    video_hz = true.motion.fps_hz * float(np.median(np.diff(frames[rows]) / np.diff(rows)))
    if not result.can_be_at(video_hz):
        raise BadMotionFile(
            f"{result.files[0]}: of frames at {result.fps_hz:g} fps, and clip {true.id} is of a "
            f"video at {video_hz:g} fps. Give a result of that video's own frames"
        )


def _seen(person: EstimatedPerson, true: Clip, body: BodyModel, shape: np.ndarray) -> Motion:
    """The person in the file's frame, in all frames that the file has."""
    placed = person.in_world or person.in_camera
    assert placed is not None
    return Motion(
        local_rotmats=person.local_rotmats,
        root_rotmats=placed.root_rotmats,
        pelvis_m=_transl_m(person, true) + _rest_pelves_m(person, body, shape),
        shape=shape,
        fps_hz=true.motion.fps_hz,
        body=body.name,
        gender=gender_of(body),
        frame="camera",
        source="",
    )


def _own_camera(
    person: EstimatedPerson,
    true: Clip,
    rows: np.ndarray,
    has: np.ndarray,
    z_up_from_file: np.ndarray,
) -> CameraPath | None:
    """The camera that the result saw the person with, in the result's world."""
    world_from_cam = np.tile(np.eye(4), (len(rows), 1, 1))
    if person.in_world is None:
        world_from_cam[has] = z_up_from_file[has]
    elif person.in_world.z_up_from_cam is not None:
        world_from_cam[has] = person.in_world.z_up_from_cam[rows[has]]
    else:
        return None
    if true.camera is None:
        return CameraPath(np.eye(3), 1, 1, world_from_cam, has)
    return replace(true.camera, world_from_cam=world_from_cam, has_camera=has)


def _shape_on(person: EstimatedPerson, body: BodyModel) -> tuple[np.ndarray, tuple[str, ...]]:
    """(S,) the person's mean shape where it is of this body, else the body's mean; and a word."""
    if person.betas is not None and person.betas_body == body.name:
        return shape_on(body, person.betas.mean(axis=0)), ()
    what = "the file has no shape of an SMPL body"
    if person.betas is not None:
        what = f"its shape is of {person.betas_body}"
    said = (
        f"{what}: scored on the mean shape of {body.name}, so limbs have other lengths than there"
    )
    return np.zeros(body.n_shape), (said,)


def _rest_pelves_m(person: EstimatedPerson, body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """(T, 3) J0 of each frame's own shape: SMPL's transl is the pelvis less that."""
    if person.rest_pelvis_m is not None:
        return np.tile(person.rest_pelvis_m, (len(person.frame_numbers), 1))
    shapes = np.tile(shape, (len(person.frame_numbers), 1))
    of_mean = person.in_world is not None and person.in_world.of_mean_shape
    if person.betas is not None and person.betas_body == body.name and not of_mean:
        n_common = min(shapes.shape[1], person.betas.shape[1])
        shapes[:, :n_common] = person.betas[:, :n_common]
    return np.asarray(body.joints_template_m[0] + shapes @ body.joint_shape_dirs_m[0].T)


def _transl_m(person: EstimatedPerson, true: Clip) -> np.ndarray:
    """(T, 3) SMPL's transl in the file's frame; before the clip's camera for a weak camera."""
    if person.in_world is not None:
        return person.in_world.transl_m
    assert person.in_camera is not None
    seen, camera = person.in_camera, camera_of(true)
    (fx, _, cx), (_, _, cy), _ = camera.intrinsics_px
    half_px = np.array([camera.width_px, camera.height_px]) / 2
    if seen.in_picture is not None:
        # One unit of length is scale * half the image's size in pixels, where the person stands.
        px_per_m, shifts_m = seen.in_picture[:, :2] * half_px, seen.in_picture[:, 2:]
    else:
        assert isinstance(seen.camera, Crop)
        factor = 1.0 if seen.size_px is None else camera.width_px / seen.size_px[0]
        px_per_m = factor * (seen.camera.weak[:, :1] * seen.camera.side_px[:, None] / 2)
        middles_px = factor * seen.camera.middle_px - half_px
        shifts_m = middles_px / px_per_m + seen.camera.weak[:, 1:]
        px_per_m = np.tile(px_per_m, (1, 2))
    off_m = (half_px - [cx, cy]) / px_per_m
    return np.column_stack([shifts_m + off_m, fx / px_per_m[:, 0]])


def has_rows(
    person: EstimatedPerson, true: Clip, frames: np.ndarray, seen_as: SeenAs
) -> np.ndarray:
    """(T,) bool: rows of a clip whose frame of the video the person has, in a world."""
    has = rows_of_numbers(person.frame_numbers, frames) >= 0
    if person.in_world is None and seen_as == "true":
        return np.asarray(has & camera_of(true).has_camera)
    return has


def _to_world(
    person: EstimatedPerson, true: Clip, rows: np.ndarray, has: np.ndarray, seen_as: SeenAs
) -> np.ndarray:
    """(T, 4, 4) from the file's frame to a world with z up, by the clip's rows."""
    if person.in_world is None and seen_as == "true":
        return camera_of(true).world_from_cam
    z_up_from_file = np.tile(rigid(Z_UP_FROM_Y_DOWN, np.zeros(3)), (len(rows), 1, 1))
    if person.in_world is not None:
        z_up_from_file[has] = person.in_world.z_up_from_file[rows[has]]
    return z_up_from_file


def _spread(motion: Motion, has: np.ndarray) -> Motion:
    """A motion of some rows on all of them, NaN in the others."""

    def on_all(values: np.ndarray) -> np.ndarray:
        filled = np.full((len(has), *values.shape[1:]), np.nan)
        filled[has] = values
        return filled

    return replace(
        motion,
        local_rotmats=on_all(motion.local_rotmats),
        root_rotmats=on_all(motion.root_rotmats),
        pelvis_m=on_all(motion.pelvis_m),
    )


def timed_clip(
    result: EstimatedPeople,
    person: EstimatedPerson,
    true: Clip,
    body: BodyModel,
    wanted: np.ndarray | None,
) -> MatchedClip:
    """A motion with its own frame rate: row i is the clip's row i, or k i at a k-th of its rate.

    `wanted` (T,) bool are the clip's rows to take; None for all.
    """
    n_rows, fps_hz = len(person.frame_numbers), result.fps_hz or true.motion.fps_hz
    shape, notes = _shape_on(person, body)
    if result.fps_hz is None:
        notes += (f"the file has no frame rate: taken as the clip's {fps_hz:g} fps",)
    motion = replace(
        _seen(person, true, body, shape),
        fps_hz=fps_hz,
        frame="world",
        source=f"{result.system}: {result.files[0].name}",
    )
    whole = Clip(true.id, motion, np.ones(n_rows, dtype=bool), np.full(n_rows, -1), None)
    clip = whole if wanted is None else on_rows(whole, true, wanted)
    matched = MatchedResult(
        file=result.files[0].name,
        person=person.name,
        people=1,
        frames=n_rows,
        used_frames=int(clip.valid.sum()),
        unused_frames=0,
        first_unused_frame=None,
        notes=notes,
    )
    return MatchedClip(clip, matched)
