"""Whether what was made of a video can be used: its camera path, and each person in it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import NonNegativeFloat, model_validator

from gmrdata.cameras.check.verdict import camera_reasons, frame_tests, jump_cause, turns_too_fast
from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.values.records import Record
from gmrdata.values.rows import first_reasons
from gmrdata.world.verdict import Verdict, verdict_of

VERDICT_FILE = "verdict.json"
CAMERA = "camera"
NOBODY = "none of the people can be used"


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
    failed = [
        *doubts,
        *camera_reasons(quality, config),
    ]
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
