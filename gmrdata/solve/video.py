"""Any video: cameras, and where people are asked for, these in a metric world."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.cameras.again import AGAIN_FILE, AgainRecord, solve_again
from gmrdata.cameras.check.verdict import lens_notes, lens_reasons
from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.lens.intrinsics import (
    GivenIntrinsics,
    Intrinsics,
    IntrinsicsConfig,
    find_intrinsics,
    load_intrinsics,
)
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.people.local_poses import ImageTimes, Lens, LocalPosesConfig, local_poses
from gmrdata.people.sources import MasksConfig, PersonSource, make_masks
from gmrdata.read.frames import check_images, image_number, list_images
from gmrdata.read.models import POSE_LANDMARKS, YOLOX_NANO, find_model
from gmrdata.read.video import VideoConfig, VideoRecord, as_frames, is_video, video_record
from gmrdata.solve.sequence import DOUBTS_FILE, lost_frames, people_masks, video_doubts
from gmrdata.solve.video_verdict import (
    VERDICT_FILE,
    VideoVerdict,
    judge_cameras,
    reasons_of,
    unsolved,
)
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, NoReconstruction, StaleOutput
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.local_poses import POSES_FILE, LocalPosesRecord
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT, PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.bodies import (
    BODIES_FILE,
    BodiesConfig,
    BodiesRecord,
    VideoFrames,
    make_bodies,
    unseen_reasons,
)
from gmrdata.world.placement import TrueCamera
from gmrdata.world.pseudo_gt import make_pseudo_gt
from gmrdata.world.quality import load_record
from gmrdata.world.recipe import PseudoGtConfig
from gmrdata.world.verdict import Doubts, Verdict

FRAMES, MASKS, INTRINSICS, SFM = "frames", "masks", "intrinsics", "sfm"
AGAIN, OWN_POSES = "again", "own_poses"
"""The folders of a video but for those of people, in the order in which they are made."""

MOST_OFF = 0.99  # of a deviation, as a share
NOBODY_SEEN = "The built-in estimator sees nobody: these are cameras alone"
UNCHECKED = (
    "Whether the bodies lie on the people in the pictures was not checked: no masks, or too few, "
    "were made without them. Use --masks person"
)


OWN_FEET = {"creep_m_per_s": 0.6, "contact_sigma_m": 0.03}
"""Errors of feet by the built-in estimator, for the scale: its steps are too short, mostly by a
fifth to a half, so feet that stand seem to creep."""
QUICK_SFM = SfmConfig(max_image_size_px=960, max_features=1200, max_orientations=1)
"""What any video is solved by: 107 keyframes of 1280x720 px take 0.6 of the camera stage's own
processor time, and on the dancer's windows the cameras are as exact."""


class VideoSolveConfig(Config):
    """The stages of one video."""

    masks: MasksConfig | None = MasksConfig(sources=(PersonSource(),))
    """Masks of what moves; None for a video in which nothing does."""
    intrinsics: IntrinsicsConfig = IntrinsicsConfig()
    sfm: SfmConfig = QUICK_SFM
    check_again: bool = False
    """Solve the cameras four more times, backward, by every second frame and by other seeds, and
    reject a path that these don't give."""
    own_poses: LocalPosesConfig = LocalPosesConfig()
    """Of people whom the built-in estimator sees."""
    bodies: BodiesConfig = BodiesConfig()
    pseudo_gt: PseudoGtConfig = PseudoGtConfig()


@dataclass(frozen=True)
class GivenBodies:
    """People before the camera."""

    poses_path: Path | None
    """Another system's file or folder, as `read_camera_bodies` takes it; None for whom the built-in
    estimator sees."""
    body_path: Path
    asked: bool = True
    """Whether the video is rejected where none of them can be used."""


def solve_video(
    source: Path,
    out_dir: Path,
    config: VideoSolveConfig,
    *,
    intrinsics: GivenIntrinsics | None = None,
    bodies: GivenBodies | None = None,
    part: VideoConfig | None = None,
    fps_hz: float | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `masks`, `intrinsics`, `sfm`, of given bodies `bodies` and `pseudo_gt`, `verdict.json`.

    A video without a camera path is no error: it is rejected, and the verdict says why.

    Args:
        source: A video file, of which `part` says what is taken, or a folder of numbered images.
        intrinsics: What is known of the images' lens; None for nothing.
        fps_hz: Images per second of a folder; None for a video, which has times.

    Raises:
        BadRecipe: a folder without a rate, or a video with one.
        BadFrames, MissingInput, BadMotionFile and what else the stages raise.
    """
    if bodies is None:
        _drop_people(out_dir, run)
    images_dir = as_frames(source, out_dir / FRAMES, part, run=run)
    frames = video_frames(images_dir, part, fps_hz)
    masks_dir = None
    if config.masks is not None:
        masks_dir = make_masks(images_dir, out_dir / MASKS, config.masks, run=run)
    lens = load_intrinsics(
        find_intrinsics(
            images_dir,
            masks_dir,
            out_dir / INTRINSICS,
            config.intrinsics,
            given=intrinsics,
            video=source if is_video(source) else None,
            run=run,
        )
    )
    config = _of_lens(config, lens)
    video = video_record(images_dir)
    doubts = () if video is None else tuple(lost_frames(video))
    notes: tuple[str, ...] = ()
    people: tuple[Verdict, ...] = ()
    try:
        sfm_dir = reconstruct(
            images_dir,
            masks_dir,
            lens.matrix_px,
            out_dir / SFM,
            config.sfm,
            radial_k1=lens.radial_k1,
            run=run,
        )
    except NoReconstruction as error:
        reason = str(error).replace(f"{out_dir}/", "")  # the folder may be moved
        why = "; ".join([reason, *lens.objections])
        camera = unsolved(why, len(frames.image_numbers))
    else:
        thresholds, found = config.pseudo_gt.verdict, load_cameras(sfm_dir)
        of_lens = lens_reasons(found, lens, thresholds)
        again = _reasons_again(images_dir, masks_dir, out_dir, config, run)
        doubts = (*doubts, *of_lens, *again)
        camera = judge_cameras(sfm_dir, frames.fps_hz, thresholds, doubts)
        notes = tuple(lens_notes(found, lens))
        if bodies is not None:
            people, remarks = _solve_people(
                bodies, images_dir, frames, lens, video, out_dir, config, run
            )
            notes = (*notes, *remarks)
    decide = people if bodies is None or bodies.asked else ()
    reasons = reasons_of(camera, decide)
    path = out_dir / VERDICT_FILE
    VideoVerdict(
        images_dir=FRAMES if is_video(source) else str(images_dir.absolute()),
        fps_hz=frames.fps_hz,
        accepted=not reasons,
        reasons=reasons,
        camera=camera,
        people=people,
        notes=(*lens.notes, *notes),
    ).write(path)
    return path


def _of_lens(config: VideoSolveConfig, lens: Intrinsics) -> VideoSolveConfig:
    """The same, but that a focal length nobody gave may be off by two of its standard errors."""
    if lens.source == "given":
        return config
    thresholds = config.pseudo_gt.verdict
    most = max(thresholds.max_focal_deviation, min(2 * lens.focal_sigma, MOST_OFF))
    thresholds = thresholds.model_copy(update={"max_focal_deviation": most})
    return config.model_copy(
        update={"pseudo_gt": config.pseudo_gt.model_copy(update={"verdict": thresholds})}
    )


def _reasons_again(
    images_dir: Path, masks_dir: Path | None, out_dir: Path, config: VideoSolveConfig, run: Run
) -> Iterator[str]:
    """Why a path can't be used that other solutions of the frames don't give, where it is asked."""
    if config.check_again:
        folder = solve_again(
            out_dir / SFM, images_dir, masks_dir, out_dir / AGAIN, config.sfm, run=run
        )
        yield from AgainRecord.read(folder / AGAIN_FILE).reasons(config.pseudo_gt.verdict)


def _drop_people(out_dir: Path, run: Run) -> None:
    """Refuse, or with --redo remove, the people of an earlier run where none are asked for."""
    for folder in (out_dir / FUSED, out_dir / PSEUDO_GT, out_dir / BODIES):
        if not folder.exists():
            continue
        if not run.redo or not (folder / STAGE_FILE).is_file():
            what = "holds people, and now cameras alone are asked for"
            raise StaleOutput(f"{folder}: {what}. Pass another --out, or --redo to do without them")
        shutil.rmtree(folder)


def _true_camera(lens: Intrinsics, sfm_dir: Path) -> TrueCamera:
    """The camera of the images, with the distortion that was taken out of their points."""
    found = load_quality(sfm_dir).lens
    radial = (lens.radial_k1, 0.0) if found is None else (found.k1, found.k2)
    return TrueCamera(lens.matrix_px, radial)


def own_networks(config: VideoSolveConfig) -> dict[str, Path]:
    """What the built-in estimator reads, by role: the networks of masks of people, or those of
    `fetch models`; MissingInput where they were not fetched."""
    sources = () if config.masks is None else config.masks.sources
    given = next((one for one in sources if isinstance(one, PersonSource)), PersonSource())
    return {
        "detector": find_model(YOLOX_NANO, given.model),
        "landmarks": find_model(POSE_LANDMARKS, given.landmarks),
    }


def _own_poses(
    images_dir: Path,
    frames: VideoFrames,
    camera: TrueCamera,
    body_path: Path,
    out_dir: Path,
    config: VideoSolveConfig,
    run: Run,
) -> Path | None:
    """Poses by the built-in estimator, for `read_camera_bodies`; None where it sees nobody."""
    networks = own_networks(config)
    poses_dir = local_poses(
        images_dir,
        ImageTimes(frames.frame_numbers, frames.fps_hz),
        Lens(camera.intrinsics_px, camera.radial),
        body_path,
        out_dir / OWN_POSES,
        config.own_poses,
        detector_path=networks["detector"],
        landmarks_path=networks["landmarks"],
        run=run,
    )
    seen = LocalPosesRecord.read(poses_dir / POSES_FILE).people
    return poses_dir if seen else None


def _solve_people(
    bodies: GivenBodies,
    images_dir: Path,
    frames: VideoFrames,
    lens: Intrinsics,
    video: VideoRecord | None,
    out_dir: Path,
    config: VideoSolveConfig,
    run: Run,
) -> tuple[tuple[Verdict, ...], tuple[str, ...]]:
    """Each person's verdict, and what one should know of the bodies."""
    bodies_dir, camera = out_dir / BODIES, _true_camera(lens, out_dir / SFM)
    body_path, poses_path = bodies.body_path, bodies.poses_path
    if poses_path is None:
        poses_path = _own_poses(images_dir, frames, camera, body_path, out_dir, config, run)
    if poses_path is None:
        return (), (NOBODY_SEEN,)
    into = bodies_dir, config.bodies
    try:
        people = make_bodies(poses_path, frames, camera, body_path, *into, run=run)
    except BadMotionFile as error:
        if bodies.asked:
            raise
        return (), (str(error),)
    pseudo_gt = config.pseudo_gt
    if bodies.poses_path is None:
        scale = pseudo_gt.scale.model_copy(update=OWN_FEET)
        pseudo_gt = pseudo_gt.model_copy(update={"scale": scale})
    record = BodiesRecord.read(bodies_dir / BODIES_FILE)
    notes = (*record.notes, *record.left_out)
    try:
        made = make_pseudo_gt(
            out_dir / SFM,
            people,
            out_dir / PSEUDO_GT,
            pseudo_gt,
            doubts_path=_write_doubts(people, video, lens, out_dir),
            focal_sigma=lens.focal_sigma,
            seen=None if config.masks is None else people_masks(out_dir / MASKS, config.masks),
            run=run,
        )
    except NoReconstruction as error:
        n = len(frames.image_numbers)
        return tuple(unsolved(str(error), n, person.name) for person in record.people), notes
    found = load_record(made)
    if None in found.picture_fits:
        notes = (*notes, UNCHECKED)
    return found.people, notes


def _write_doubts(
    people: tuple[PersonFiles, ...], video: VideoRecord | None, lens: Intrinsics, out_dir: Path
) -> Path:
    """`doubts.json`: frames without a pose; what the video's times and losses, and the lens say."""
    clips = [load_clip(person.clip_path) for person in people]
    unseen = unseen_reasons(clips)
    found = Doubts(frames=unseen, sequence=lens.objections)
    if video is not None:
        of_video = video_doubts(video, clips)
        frames = tuple(
            tuple(one or other for one, other in zip(mine, its, strict=True))
            for mine, its in zip(unseen, of_video.frames, strict=True)
        )
        found = Doubts(frames=frames, sequence=(*of_video.sequence, *lens.objections))
    path = out_dir / DOUBTS_FILE
    found.write(path)
    return path


def video_frames(
    images_dir: Path, part: VideoConfig | None = None, fps_hz: float | None = None
) -> VideoFrames:
    """Which frames of a video a folder of images holds; of a folder by itself, all in order."""
    images = list_images(images_dir)
    numbers = np.array([image_number(image) for image in images], dtype=np.int64)
    size_px, video = check_images(images), video_record(images_dir)
    if video is None:
        if fps_hz is None:
            what = "a folder of images has no frame rate"
            raise BadRecipe(f"{images_dir}: {what}. Give it with --fps")
        return VideoFrames(numbers, np.arange(len(numbers)), len(numbers), size_px, fps_hz)
    if fps_hz is not None:
        raise BadRecipe(f"{images_dir}: a video has its own times. Leave --fps out")
    whole = part is None or part.to_s is None
    frame_of = {number // video.every: number for number in video.numbers}
    frame_numbers = np.array([frame_of[int(number)] for number in numbers], dtype=np.int64)
    n_frames = video.n_decoded if whole else None
    return VideoFrames(numbers, frame_numbers, n_frames, size_px, video.rate_hz)
