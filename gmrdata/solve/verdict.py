"""Whether what was made of a video can be used: its camera path, and each person in it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import NonNegativeFloat, model_validator

from gmrdata.cameras.again import AGAIN_FILE, AgainRecord
from gmrdata.cameras.check.verdict import (
    camera_reasons,
    frame_tests,
    jump_cause,
    lens_notes,
    lens_reasons,
    turns_too_fast,
)
from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.solve.doubts import lost_frames
from gmrdata.solve.request import EstimatedPeople
from gmrdata.solve.solve import FRAMES, Solved
from gmrdata.values.clip import first_reasons, load_clip
from gmrdata.values.records import Record
from gmrdata.world.quality import load_record
from gmrdata.world.verdict import Verdict, verdict_of

VERDICT_FILE = "verdict.json"
CAMERA = "camera"
NOBODY = "none of the people can be used"
UNCHECKED = (
    "Whether the bodies lie on the people in the pictures was not checked: no masks, or too few, "
    "were made without them. Use --masks person"
)


class VideoVerdict(Record):
    """`verdict.json`: what was decided of a video, and of whom."""

    format: Literal["gmrdata-video-verdict/1"] = "gmrdata-video-verdict/1"
    images_dir: str
    """Where the images are: "frames" beside this file for a video's, else a folder's own path."""
    fps_hz: NonNegativeFloat
    """Images per second."""
    accepted: bool
    """The camera path can be used and, where there are people, one of them at least."""
    reasons: tuple[str, ...]
    """Why not."""
    camera: Verdict
    """On the camera path alone, frame by frame."""
    people: tuple[Verdict, ...]
    """By person; empty for cameras alone."""
    notes: tuple[str, ...]
    """What one should know besides."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.accepted == bool(self.reasons):
            raise ValueError("accepted and reasons do not say alike whether it is")
        return self


def judge_video(solved: Solved) -> VideoVerdict:
    """The verdict on a video that was solved: its cameras, and each person by these."""
    request, frames, lens = solved.request, solved.frames, solved.lens
    assert frames is not None and lens is not None
    notes = list(lens.notes)
    if solved.sfm_dir is None:
        camera = unsolved(_why(solved), len(frames.numbers))
    else:
        thresholds, cameras = solved.config.pseudo_gt.verdict, load_cameras(solved.sfm_dir)
        doubts = [*lost_frames(frames.video), *lens_reasons(cameras, lens, thresholds)]
        if solved.again_dir is not None:
            doubts += AgainRecord.read(solved.again_dir / AGAIN_FILE).reasons(thresholds)
        camera = judge_cameras(solved.sfm_dir, frames.rate_hz, thresholds, doubts)
        notes += lens_notes(cameras, lens)
    people = _judged_people(solved)
    notes += solved.remarks
    if solved.world_dir is not None and None in load_record(solved.world_dir).picture_fits:
        notes.append(UNCHECKED)
    decide = isinstance(request.people, EstimatedPeople) and request.people.asked
    reasons = reasons_of(camera, people if decide else ())
    return VideoVerdict(
        images_dir=FRAMES if frames.video_path else str(frames.folder.absolute()),
        fps_hz=frames.rate_hz,
        accepted=not reasons,
        reasons=reasons,
        camera=camera,
        people=people,
        notes=tuple(notes),
    )


def _why(solved: Solved) -> str:
    """Why there are no cameras, by a path that holds where the folder is moved."""
    assert solved.unsolved is not None and solved.lens is not None and solved.frames is not None
    images_dir = solved.frames.folder
    if images_dir.is_relative_to(solved.out_dir):
        images_dir = images_dir.relative_to(solved.out_dir)
    return "; ".join([str(solved.unsolved.of(images_dir)), *solved.lens.objections])


def _judged_people(solved: Solved) -> tuple[Verdict, ...]:
    """By person; without a world all share the reason."""
    if solved.world_dir is not None:
        return load_record(solved.world_dir).people
    clips = [load_clip(person.clip_path) for person in solved.bodies]
    return tuple(unsolved(str(solved.unsolved), len(c.image_numbers), c.id) for c in clips)


def judge_cameras(
    sfm_dir: Path, fps_hz: float, config: CamerasVerdictConfig, doubts: Sequence[str] = ()
) -> Verdict:
    """The verdict on a camera path by itself, without bodies or metres.

    `doubts` say why its video can't be used at all.
    """
    cameras, quality = load_cameras(sfm_dir), load_quality(sfm_dir)
    n, known = cameras.path.n_frames, cameras.path.has_camera
    world_from_cam = np.where(known[:, None, None], cameras.path.world_from_cam, np.nan)
    fast = turns_too_fast(world_from_cam, fps_hz, config)
    beside = np.zeros(n, dtype=bool)
    beside[:-1], beside[1:] = fast, beside[1:] | fast
    tests = frame_tests(quality, np.arange(n), known, config)
    reasons = first_reasons([""] * n, [*tests, (~beside, "the camera jumps")])
    failed = [*doubts, *camera_reasons(quality, config)]
    if len(fast) and (share := float(fast.mean())) > config.max_cuts_share:
        cause = jump_cause(world_from_cam, quality, config)
        failed.append(f"the camera jumps at {share:.0%} of the steps: {cause}")
    return verdict_of(CAMERA, not failed, failed, reasons)


def unsolved(why: str, n_frames: int, name: str = CAMERA) -> Verdict:
    """The verdict on a video of which no camera path was found, or on a person without a world."""
    return verdict_of(name, False, [why], n_frames * [why])


def reasons_of(camera: Verdict, people: Sequence[Verdict]) -> tuple[str, ...]:
    """Why a video is rejected; none where it is accepted.  A reason that all share stands once."""
    if not camera.accepted:
        return camera.reasons
    if not people or any(person.accepted for person in people):
        return ()
    if len(people) == 1:
        return people[0].reasons
    each = (f"{one.id}: {reason}" for one in people for reason in one.reasons)
    return (NOBODY, *each)
