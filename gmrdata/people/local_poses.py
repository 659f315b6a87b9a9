"""Stage: local poses of people who were followed, from their landmarks.

`local_poses.json`, and `person_<n>.npz` of each person: poses, roots and places of a body of usual
size, as the fit lays it onto the landmarks.
"""

from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.people.facing import looks_reversed, unsure_frames
from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.following import FOLLOWED_FILE, FollowedRecord, Sightings, load_tracks
from gmrdata.people.landmark_body import BODY_FILE, SeenLandmarks
from gmrdata.people.pose_prior import PRIOR_FILE
from gmrdata.read.body_file import read_body
from gmrdata.stage.progress import remark
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import Lens
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.values.people import POSES_FILE, LocalPoses, LocalPosesRecord, person_file
from gmrdata.values.records import Config

POSES_FOLDER = "poses"


class LocalPosesConfig(Config):
    """How people's poses are made."""

    fit: FitConfig = FitConfig()
    most_unsure: float = Field(default=0.2, ge=0, le=1)
    """Share of a person's frames whose front and back may be exchanged up to which these frames are
    left out; beyond it the person is doubted.  0.6 and 1.0 of two views that were exchanged in 30
    and 50 % of their frames, 0.006 of a dancer's, 0 of others."""


class _PosesRecipe(Config):
    poses: LocalPosesConfig
    intrinsics_px: tuple[tuple[float, float, float], ...]
    radial: tuple[float, float]
    frame_numbers: tuple[int, ...]
    times_s: tuple[float, ...]


def local_poses(
    followed_dir: Path,
    filmed: Filmed,
    body_path: Path,
    out_dir: Path,
    config: LocalPosesConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Poses of whom `follow_people` left, which `read_system` reads.  A video in which
    nobody is seen leaves poses without people.  MissingInput and BadBodyFile name the file."""
    frames, lens = filmed
    recipe = _PosesRecipe(
        poses=config,
        intrinsics_px=tuple(tuple(row) for row in lens.matrix_px.tolist()),
        radial=lens.radial,
        frame_numbers=tuple(frames.frame_numbers.tolist()),
        times_s=tuple(frames.times_s.tolist()),
    )

    def work(partial: Path) -> None:
        followed = FollowedRecord.read(followed_dir / FOLLOWED_FILE)
        numbers = np.array(followed.images, dtype=np.int64)
        body = read_body(body_path)
        people = load_tracks(followed_dir)
        doubts = []
        for n, track in enumerate(with_bar(people, "poses")):
            seen = seen_landmarks(track, numbers, frames, lens)
            sure, doubt = sure_frames(seen, body, config)
            rows = np.searchsorted(numbers, track.image_numbers[sure])
            poses = poses_of(seen.take(sure), frames.frame_numbers[rows], body, config)
            poses.write(partial / person_file(n))
            doubts.append(doubt)
        LocalPosesRecord(
            people=len(people),
            images=len(numbers),
            frames=int(frames.frame_numbers[-1]) + 1,
            size_px=followed.size_px,
            focal_px=lens.focal_px,
            centre_px=lens.centre_px,
            radial=lens.radial,
            body=body.name,
            doubts=tuple(doubts),
        ).write(partial / POSES_FILE)

    inputs = {"followed": followed_dir, "body": body_path}
    inputs |= {"landmark_body": BODY_FILE, "pose_prior": PRIOR_FILE}
    return run_stage("local_poses", out_dir, recipe, inputs, work, run=run)


def seen_landmarks(
    track: Sightings, numbers: np.ndarray, frames: FrameSet, lens: Lens
) -> SeenLandmarks:
    """A track's landmarks as rays without distortion, at the frames' own times."""
    rows = np.searchsorted(numbers, track.image_numbers)
    return SeenLandmarks(
        times_s=frames.times_s[rows],
        rays=lens.rays(track.image_px),
        world_m=track.world_m,
        visibility=track.visibility,
    )


def sure_frames(
    seen: SeenLandmarks, body: BodyModel, config: LocalPosesConfig
) -> tuple[np.ndarray, str]:
    """(T,) bool: the frames to take, and why the person is doubted; empty where it isn't.
    Of a doubted one all are taken."""
    unsure, n = unsure_frames(seen), len(seen.times_s)
    everything = np.ones(n, dtype=bool)
    if unsure.mean() > config.most_unsure or n - unsure.sum() < 2:
        return everything, f"front and back may be exchanged in {unsure.sum()} of {n} frames"
    if looks_reversed(seen.take(~unsure), body.rest_joints_m(np.zeros(body.n_shape)), config.fit):
        return everything, "a body that looks the other way lies better on the landmarks"
    return ~unsure, ""


def poses_of(
    seen: SeenLandmarks, frame_numbers: np.ndarray, body: BodyModel, config: LocalPosesConfig
) -> LocalPoses:
    """One person's poses and places on a body of mean shape."""
    fitted = fit(seen, body.rest_joints_m(np.zeros(body.n_shape)), config.fit)
    if not fitted.converged:
        first, last = frame_numbers[[0, -1]].tolist()
        what = f"the fit stopped after {config.fit.most_steps} steps, before it stood still"
        remark(f"poses of a person in frames {first} to {last}: {what}")
    return LocalPoses(
        frame_numbers=frame_numbers,
        local_rotmats=fitted.rotmats[:, 1:],
        root_rotmats=fitted.rotmats[:, 0],
        pelvis_m=fitted.pelvis_m,
    )
