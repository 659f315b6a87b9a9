"""People who are right and wrong, and what the verdict says of each.

They are made of one person each of clips that were solved, whose true joints are known: as they
are, or with what was seen or found of them changed.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from people.in_world import the_man
from people.real import TWELVE, View, tracks_of
from poses.score import aligned_mm
from poses.world import of_truth
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, VideoFacts

from gmrdata.cameras.lens.intrinsics import load_intrinsics
from gmrdata.people.facing import mirrored
from gmrdata.people.following import load_tracks
from gmrdata.people.landmark_body import HIPS, SeenLandmarks
from gmrdata.people.local_poses import LocalPosesConfig, poses_of, seen_landmarks, sure_frames
from gmrdata.read.frames import read_frames
from gmrdata.solve.request import BODY, FOLLOWED, INTRINSICS, MASKS, SFM, SolveConfig
from gmrdata.solve.solve import people_masks
from gmrdata.solve.verdict import write_doubts
from gmrdata.values.body import N_JOINTS, BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.people import BODIES, PSEUDO_GT, PersonFiles, person_file
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import apply, invert
from gmrdata.world.bodies import BODIES_FILE, BodiesRecord
from gmrdata.world.judge import load_record
from gmrdata.world.pseudo_gt import WorldEvidence, config_of, make_pseudo_gt

MOST_PA_MM, MOST_WRONG = 150.0, 0.2
"""Error of a frame's joints from which it is wrong, and the share of such frames that is."""
RIGHT = ("as found", "legs hidden")
LATE_S = 0.5
KNEES = 25  # landmarks from there on are of knees and feet


@dataclass(frozen=True, eq=False)
class Known:
    """A person of a solved clip whose joints are known."""

    name: str
    solved_dir: Path
    clip: Clip  # before the camera, T rows
    seen: SeenLandmarks  # in the rows of `numbers`
    rows: np.ndarray
    true_m: np.ndarray  # (T, J, 3) before the camera
    joints: list[int]  # of the tree, in that order


@dataclass(frozen=True)
class Judged:
    """One made person."""

    kind: str
    clip: str
    accepted: bool
    wrong_share: float
    """Of the kept frames, or of all of a rejected one: joints or outline are off."""
    reasons: str

    @property
    def is_wrong(self) -> bool:
        return self.wrong_share > MOST_WRONG

    @property
    def is_right(self) -> bool:
        return self.kind in RIGHT and not self.is_wrong


def known_man(view: View, solved_dir: Path, body: BodyModel) -> Known:
    """The man of a view."""
    number = the_man(view, solved_dir, body)
    seen, rows = tracks_of(solved_dir, view.lens)[number]
    clip = load_clip(solved_dir / BODIES / person_file(number))
    return Known(view.name, solved_dir, clip, seen, rows, view.true_m, TWELVE)


def known_rendered(clip_dir: Path, solved_dir: Path, body: BodyModel) -> Known:
    """The person of a rendered clip that `poses.world.solve` solved."""
    truth = load_clip(clip_dir / CLIP_FILE)
    number = of_truth(solved_dir, truth)
    clip = load_clip(solved_dir / BODIES / person_file(number))
    facts = VideoFacts.read(clip_dir / FACTS_FILE)
    frames = read_frames(clip_dir / FRAMES_FOLDER).with_rate(facts.fps_hz)
    lens = load_intrinsics(solved_dir / INTRINSICS).lens
    track = load_tracks(solved_dir / FOLLOWED)[int(clip.id.removeprefix("person_"))]
    true_m = motion_joints_m(body, truth.motion)
    true_m = apply(invert(camera_of(truth).world_from_cam), true_m)
    return Known(
        facts.name,
        solved_dir,
        clip,
        seen_landmarks(track, frames.numbers, frames, lens),
        np.searchsorted(frames.numbers, track.image_numbers),
        true_m,
        list(range(N_JOINTS)),
    )


def made_people(one: Known, other: Known, body: BodyModel) -> Iterator[tuple[str, Clip, str]]:
    """Kinds, bodies before the camera, and what is held against them before any look at them."""
    yield "as found", one.clip, ""
    yield "reversed", *_posed(one, mirrored(one.seen), body)
    yield "legs hidden", *_posed(one, _without_legs(one.seen), body)
    n = one.clip.motion.n_frames
    late = (np.arange(n) - round(LATE_S * one.clip.motion.fps_hz)) % n
    yield "late", replace(one.clip, motion=one.clip.motion.take(late)), ""
    rows = np.linspace(0, other.clip.motion.n_frames - 1, n).round().astype(int)
    another = replace(other.clip.motion.take(rows), fps_hz=one.clip.motion.fps_hz)
    yield "another's", replace(one.clip, motion=another), ""
    here = replace(another, pelvis_m=one.clip.motion.pelvis_m)
    yield "another's, in place", replace(one.clip, motion=here), ""


def _posed(one: Known, seen: SeenLandmarks, body: BodyModel) -> tuple[Clip, str]:
    """The clip with poses of other landmarks."""
    sure, doubt = sure_frames(seen, body, LocalPosesConfig())
    poses = poses_of(seen.take(sure), one.rows[sure], body, LocalPosesConfig())
    valid = np.zeros(one.clip.motion.n_frames, dtype=bool)
    valid[poses.frame_numbers] = True
    known = np.flatnonzero(valid)
    nearest = np.abs(np.arange(len(valid))[:, None] - known).argmin(axis=1)
    motion = replace(
        one.clip.motion,
        local_rotmats=poses.local_rotmats[nearest],
        root_rotmats=poses.root_rotmats[nearest],
        pelvis_m=poses.pelvis_m[nearest],
    )
    return replace(one.clip, motion=motion, valid=valid), doubt


def _without_legs(seen: SeenLandmarks) -> SeenLandmarks:
    """Knees and feet where they are on average: what a network guesses of those it can't see."""
    rays, world_m, visibility = seen.rays.copy(), seen.world_m.copy(), seen.visibility.copy()
    hips = rays[:, HIPS].mean(axis=1, keepdims=True)
    about = (rays[:, KNEES:] - hips) / seen.sizes[:, None, None]
    rays[:, KNEES:] = hips + about.mean(axis=0) * seen.sizes[:, None, None]
    world_m[:, KNEES:] = world_m[:, KNEES:].mean(axis=0)
    visibility[:, KNEES:] = 0.1
    return SeenLandmarks(seen.times_s, rays, world_m, visibility)


def judged(
    one: Known, kind: str, clips: list[Clip], doubt: str, body: BodyModel, out_dir: Path
) -> list[Judged]:
    """What the verdict says of bodies in the place of a clip's person."""
    shutil.rmtree(out_dir, ignore_errors=True)
    out_dir.mkdir(parents=True)
    body_path = one.solved_dir / BODY / "body.npz"
    people = tuple(PersonFiles(out_dir / f"body_{n}.npz", body_path) for n in range(len(clips)))
    for files, clip in zip(people, clips, strict=True):
        save_clip(files.clip_path, clip, body.rest_pelvis_m(clip.motion.shape))
    lens = load_intrinsics(one.solved_dir / INTRINSICS)
    masks = SolveConfig().masks
    assert masks is not None
    evidence = WorldEvidence(
        sfm_dir=one.solved_dir / SFM,
        people=people,
        dataset_camera_path=None,
        doubts_path=write_doubts(out_dir, clips, None, lens, {clip.id: doubt for clip in clips}),
        seen=people_masks(one.solved_dir / MASKS, masks, one.solved_dir / FOLLOWED),
        focal_sigma=lens.focal_sigma,
        size_sigmas=len(clips)
        * (BodiesRecord.read(one.solved_dir / BODIES / BODIES_FILE).people[0].size_sigma,),
    )
    config = config_of(one.solved_dir / PSEUDO_GT)
    try:
        record = load_record(make_pseudo_gt(evidence, out_dir / PSEUDO_GT, config))
    except NoReconstruction as error:
        return [Judged(kind, one.name, False, _wrong_share(one, clip, body), str(error))
                for clip in clips]  # fmt: skip
    made = zip(clips, record.people, record.picture_fits, strict=True)
    return [
        Judged(
            kind,
            one.name,
            verdict.accepted,
            _wrong_share(one, clip, body, () if fit is None else fit.off_rows, verdict.kept),
            "; ".join(verdict.reasons),
        )
        for clip, verdict, fit in made
    ]


def _wrong_share(
    one: Known,
    clip: Clip,
    body: BodyModel,
    off_rows: tuple[int, ...] = (),
    kept: np.ndarray | None = None,
) -> float:
    found_m = motion_joints_m(body, clip.motion)[:, one.joints]
    wrong = aligned_mm(found_m, one.true_m) > MOST_PA_MM
    wrong |= np.isin(np.arange(len(wrong)), off_rows)
    counted = clip.valid if kept is None or not kept.any() else kept
    return float(wrong[counted].mean())
