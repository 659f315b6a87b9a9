"""Stage: world-frame pseudo ground truth from recovered cameras and camera-frame bodies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from gmrdata.cameras import files
from gmrdata.cameras.frames import cuts_in_words
from gmrdata.read.bodies import load_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, fill_gaps
from gmrdata.values.clip import Clip, clip_on_body, load_clip, rows_of_numbers, save_clip
from gmrdata.values.errors import BadIntrinsics, BadMotionFile, BadRecord, NoReconstruction
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.people import PersonFiles, person_file, stage_inputs
from gmrdata.values.records import MAKE_AGAIN, Config
from gmrdata.world.compose import metric_cameras, motion_in_world
from gmrdata.world.judge import SolvedCameras, judge_people, telling_rows
from gmrdata.world.level import (
    ASIDE_RAD,
    ONE_FLOOR_M,
    UNSURE_RAD,
    LevelEstimate,
    UpCue,
    body_cue,
    contact_cue,
    from_picture_rad,
    gravity_cue,
    ground_cue,
    level_from_world,
    seen_steeply,
    soles_on_floor_m,
    steep_size_sigma,
    up_of,
)
from gmrdata.world.picture_fit import PeopleMasks, PictureFit, picture_fits, seen_limbs
from gmrdata.world.planted_feet import (
    SOLE_POINTS,
    GroundPlane,
    count_stances,
    foot_points_m,
    frames_apart,
    ground_plane,
    standing,
)
from gmrdata.world.recipe import (
    Doubts,
    PseudoGtConfig,
    ScaleConfig,
    load_dataset_camera,
    load_gravity,
)
from gmrdata.world.scale import ScaleEstimate, SeenPerson, estimate_scale, with_focal_error
from gmrdata.world.size import of_size
from gmrdata.world.vertical_lines import line_cue, load_lines

LEAST_GROWTH = 1e-3  # change of size, as a share, that is worth another body
GROUND_HEIGHT_SIGMA_M = 0.01  # of the plane of reconstructed points
MOSTLY = 0.5  # share of a person's frames in which legs are seen where they tell the floor surely
OTHER_SPREAD_DEG = 10.0  # between directions that a phone felt in one world: not of this video
OTHER_SIGMAS = 8.0  # of the people's up: 30 degrees where they stand; who lies may lie any way


@dataclass(frozen=True)
class WorldEvidence:
    """What the world of a sequence is made of, as files."""

    sfm_dir: Path  # that `gmrdata.cameras.reconstruct.reconstruct` made
    people: tuple[PersonFiles, ...]  # in the camera frame, all with the same rows
    dataset_camera_path: Path | None = None
    """Of the data set, by `save_dataset_camera`; right over short times."""
    doubts_path: Path | None = None
    """A `Doubts` record: why the data set itself does not vouch for frames."""
    gravity_path: Path | None = None
    """By `save_gravity`: what the camera's own sensors felt as up."""
    lines_dir: Path | None = None
    """By `find_lines`: straight lines of the background."""
    seen: PeopleMasks | None = None
    """Masks of the people that were made without the bodies, which must lie on them; None where
    there are none, and nothing is said of it."""
    focal_sigma: float = 0.0
    """Standard error of the focal length, as a share of it; part of the scale's."""
    size_sigmas: tuple[float, ...] = ()
    """By person: standard error of the body's size, as a share; none where sizes are known."""

    @property
    def files(self) -> dict[str, Path | None]:
        """By role, for the stage's record."""
        return {
            "sfm": self.sfm_dir,
            **stage_inputs(self.people),
            "dataset_camera": self.dataset_camera_path,
            "gravity": self.gravity_path,
            "lines": self.lines_dir,
            "doubts": self.doubts_path,
            "people_masks": None if self.seen is None else self.seen.masks_dir,
            "followed": None if self.seen is None else self.seen.followed_dir,
        }


class _WithErrors(Config):
    """What the stage's record holds where the focal length or people's sizes are uncertain."""

    pseudo_gt: PseudoGtConfig
    focal_sigma: float
    size_sigmas: tuple[float, ...] = ()


def make_pseudo_gt(
    evidence: WorldEvidence, out_dir: Path, config: PseudoGtConfig, *, run: Run = DEFAULT_RUN
) -> Path:
    """Compose camera-frame poses with recovered cameras (eqs. 6-8) into a metric, level world.

    All people of a sequence share one world: one camera solution, one scale, one levelling.  Frames
    without a camera keep an interpolated pose and are not valid; their `world_from_cam` is NaN.
    Makes `out_dir` with `person_<n>.npz` for each person, and `quality.json`.

    Raises:
        BadMotionFile: a clip is not in the camera frame, or has other rows than the first.
        BadRecord: a record is broken, of another version, or of another number of frames.
        NoReconstruction: no frame has pose and camera, or no scale can be found.
    """

    def work(partial: Path) -> None:
        bodies = [load_body(one.body_path) for one in evidence.people]
        clips = list(map(clip_on_body, _camera_clips(evidence.people), bodies))
        cameras = _solved_cameras(evidence, clips)
        doubts = _doubts(evidence.doubts_path, len(clips), len(cameras.rows))
        fits, legs_seen = _in_pictures(evidence, clips, bodies, config)
        told_by = telling_rows(clips, doubts, fits, config.verdict)
        try:
            sizes = _size_sigmas(evidence, clips, bodies)
            people = list(map(CameraPerson, clips, bodies, sizes, told_by, legs_seen))
            world = compose_clips(people, cameras, config)
        except NoReconstruction as error:
            numbers = files.load_cameras(evidence.sfm_dir).image_numbers
            cuts = cuts_in_words(numbers[list(cameras.quality.cuts_after_frames)])
            raise NoReconstruction(f"{error}{cuts}") from None
        scale = with_focal_error(world.scale, evidence.focal_sigma)
        common = float(np.hypot(evidence.focal_sigma, config.scale.body_share))
        away = tuple(float(np.hypot(sigma, common)) for sigma in world.size_sigmas)
        cameras = replace(cameras, scale=scale, level=world.level, distance_sigmas=away)
        record = judge_people(world.clips, cameras, config, doubts, fits)
        for number, (clip, body) in enumerate(zip(world.clips, bodies, strict=True)):
            kept = replace(clip, valid=clip.valid & record.people[number].kept)
            save_clip(partial / person_file(number), kept, body.rest_pelvis_m(clip.motion.shape))
        record.write(partial / files.QUALITY_FILE)

    sigmas = {"focal_sigma": evidence.focal_sigma, "size_sigmas": evidence.size_sigmas}
    known = not any(sigmas.values())
    recipe = config if known else _WithErrors.model_validate({"pseudo_gt": config} | sigmas)
    return run_stage("pseudo_gt", out_dir, recipe, evidence.files, work, run=run)


def _size_sigmas(
    evidence: WorldEvidence, clips: Sequence[Clip], bodies: Sequence[BodyModel]
) -> tuple[float, ...]:
    """Errors of people's sizes, as shares, with those of a view from above; 0 of known ones."""
    if not evidence.size_sigmas:
        return len(clips) * (0.0,)
    steep = [
        steep_size_sigma(body, clip.motion.take(clip.valid)) if clip.valid.any() else 0.0
        for clip, body in zip(clips, bodies, strict=True)
    ]
    return tuple(np.hypot(evidence.size_sigmas, steep).tolist())


def config_of(pseudo_gt_dir: Path) -> PseudoGtConfig:
    """The recipe of a pseudo ground truth, as its stage's record has it; BadRecord for another."""
    said = StageRecord.of(pseudo_gt_dir).config
    try:
        if "focal_sigma" in said:
            return _WithErrors.model_validate(said).pseudo_gt
        return PseudoGtConfig.model_validate(said)
    except ValidationError:
        what = "its recipe is none of a pseudo ground truth"
        raise BadRecord(f"{pseudo_gt_dir / STAGE_FILE}: {what}; {MAKE_AGAIN}") from None


def _solved_cameras(evidence: WorldEvidence, clips: Sequence[Clip]) -> SolvedCameras:
    """The cameras of a reconstruction in the rows of clips, up to scale."""
    sfm_dir = evidence.sfm_dir
    cameras, quality = files.load_cameras(sfm_dir), files.load_quality(sfm_dir)
    if quality.frames != len(cameras.image_numbers):
        raise BadRecord(f"{sfm_dir}: its files are of different frames; {MAKE_AGAIN}")
    rows = rows_of_numbers(cameras.image_numbers, clips[0].image_numbers)
    path = cameras.path.at_rows(rows)

    def of_frames(
        load: Callable[[Path], np.ndarray], path: Path | None, what: str
    ) -> np.ndarray | None:
        values = None if path is None else load(path)
        if values is not None and len(values) != len(rows):
            raise BadRecord(f"{path}: {len(values)} {what} for {len(rows)} frames")
        return values

    return SolvedCameras(
        path=_blanked(replace(path, has_camera=path.has_camera & (rows >= 0))),
        geometry=cameras.geometry,
        points=files.load_points(sfm_dir),
        quality=quality,
        rows=rows,
        dataset_camera=of_frames(load_dataset_camera, evidence.dataset_camera_path, "cameras"),
        up_cam=of_frames(load_gravity, evidence.gravity_path, "directions"),
        lines=None if evidence.lines_dir is None else load_lines(evidence.lines_dir),
    )


def _in_pictures(
    evidence: WorldEvidence,
    clips: Sequence[Clip],
    bodies: Sequence[BodyModel],
    config: PseudoGtConfig,
) -> tuple[list[PictureFit | None], list[np.ndarray]]:
    """By person, how well the body lies on it, None where no masks were made without bodies; and
    (T,) bool: nothing says that the legs are hidden."""
    if evidence.seen is None:
        return [None] * len(clips), [np.ones_like(clip.valid) for clip in clips]
    limbs = seen_limbs(clips, bodies, evidence.seen)
    fits = picture_fits(clips, bodies, evidence.seen, config.verdict, limbs)
    return fits, [~hidden for hidden in limbs.legs_hidden]


def _doubts(path: Path | None, n_people: int, n_frames: int) -> Doubts:
    if path is None:
        return Doubts(frames=n_people * (n_frames * ("",),), sequence=())
    doubts = Doubts.read(path)
    if [len(frames) for frames in doubts.frames] != n_people * [n_frames]:
        raise BadRecord(f"{path}: `frames` is not of {n_people} people and {n_frames} frames")
    return doubts


@dataclass(frozen=True, eq=False)
class CameraPerson:
    """One of the people before the camera, in T frames."""

    clip: Clip
    body: BodyModel
    size_sigma: float  # standard error of the body's size, as a share
    told_by: np.ndarray  # (T,) bool: frames by which the body tells the world's scale and level
    legs_seen: np.ndarray  # (T,) bool: what the legs do is no guess


@dataclass(frozen=True, eq=False)
class ComposedWorld:
    """People of T frames in one metric, level world."""

    clips: list[Clip]
    scale: ScaleEstimate
    level: LevelEstimate
    size_sigmas: tuple[float, ...]  # by person: standard error of the size, as a share


def compose_clips(
    people: Sequence[CameraPerson], cameras: SolvedCameras, config: PseudoGtConfig
) -> ComposedWorld:
    """The clips of the same T frames in one metric, level world, with its scale and its level.

    Who is likely larger or smaller than its body, by the scale that all share, gets another."""
    path = cameras.path
    usable = [path.has_camera & one.clip.valid for one in people]
    if max(rows.sum() for rows in usable) < 2:
        raise NoReconstruction(f"{people[0].clip.id}: no two frames have both pose and camera")
    told_by = [rows & one.told_by for rows, one in zip(usable, people, strict=True)]
    if max(rows.sum() for rows in told_by) < 2:
        told_by = usable
    seen = [
        SeenPerson(p.clip.motion, p.body, _blanked(replace(path, has_camera=rows)), p.size_sigma)
        for p, rows in zip(people, told_by, strict=True)
    ]
    estimate = estimate_scale(
        seen,
        cameras.geometry,
        config.scale,
        points=cameras.points,
        dataset_camera=cameras.dataset_camera,
    )
    sizes = estimate.sizes or [(1.0, one.size_sigma) for one in people]
    camera_clips = [
        replace(one.clip, motion=of_size(one.clip.motion, one.body, factor))
        if abs(factor - 1) >= LEAST_GROWTH
        else one.clip
        for one, (factor, _) in zip(people, sizes, strict=True)
    ]
    # Without a scale the camera stays in place, also one that was seen to travel a little.
    scale = 0.0 if estimate.scale is None else estimate.scale
    metric = metric_cameras(path.world_from_cam, scale)
    filled = fill_gaps(metric, path.has_camera, np.arange(path.n_frames))
    points_m = scale * cameras.points if scale > 0 else np.zeros((0, 3))
    solved = replace(cameras, path=replace(path, world_from_cam=filled), points=points_m)
    level_from_metric, level = _level(camera_clips, people, solved, told_by, config.scale)
    levelled = level_from_metric @ filled
    camera = _blanked(replace(path, world_from_cam=levelled))
    clips = [
        Clip(clip.id, motion_in_world(clip.motion, levelled), rows, clip.image_numbers, camera)
        for clip, rows in zip(camera_clips, usable, strict=True)
    ]
    return ComposedWorld(clips, estimate, level, tuple(sigma for _, sigma in sizes))


def _camera_clips(people: Sequence[PersonFiles]) -> list[Clip]:
    clips = [load_clip(person.clip_path) for person in people]
    for clip, person in zip(clips, people, strict=True):
        if clip.motion.frame != "camera":
            raise BadMotionFile(f"{person.clip_path}: the motion is not in the camera frame")
        if not np.array_equal(clip.image_numbers, clips[0].image_numbers):
            raise BadMotionFile(f"{person.clip_path}: has other rows than {clips[0].id}")
    return clips


def _blanked(path: CameraPath) -> CameraPath:
    """The path, NaN where it has no camera."""
    known = path.has_camera[:, None, None]
    return replace(path, world_from_cam=np.where(known, path.world_from_cam, np.nan))


def _level(
    camera_clips: Sequence[Clip],
    people: Sequence[CameraPerson],
    metric: SolvedCameras,
    usable: Sequence[np.ndarray],
    config: ScaleConfig,
) -> tuple[np.ndarray, LevelEstimate]:
    """level_from_world (4, 4) of a metric world, from everybody's bodies, planted feet, the ground
    about them in reconstructed points, lines of the background, and what the camera felt; and how
    level that is.  Feet that nobody saw tell where the ground is only where all are so."""
    world_from_cam, points_m = metric.path.world_from_cam, metric.points
    motions = [motion_in_world(clip.motion, world_from_cam) for clip in camera_clips]
    bodies, legs = [one.body for one in people], [one.legs_seen for one in people]
    shown = [rows & seen for rows, seen in zip(usable, legs, strict=True)]
    planted_m, of_all_m, stances = [], [], 0
    for motion, rows, body in zip(motions, shown if np.any(shown) else usable, bodies, strict=True):
        apart = frames_apart(motion.fps_hz)
        at = slice(int(rows.argmax()), None, apart)  # from the first known row, to meet any
        soles_m = foot_points_m(body, motion)[at, :, SOLE_POINTS]
        soles_m = np.where(rows[at, None, None, None], soles_m, np.nan)
        still = standing(soles_m, config.slip_m(motion.fps_hz / apart))
        planted_m.append(soles_m[still])
        of_all_m.append(soles_m)
        stances += count_stances(still)
    feet_m = np.concatenate(planted_m)
    known = [
        (body, motion.take(rows), np.flatnonzero(rows), seen[rows])
        for body, motion, rows, seen in zip(bodies, motions, usable, legs, strict=True)
        if rows.any()
    ]
    upright = body_cue(*zip(*known, strict=True))
    # Of people whose size is known the poses are, too, and don't err with the view.
    if any(one.size_sigma for one in people):
        pelvises_m = [
            np.where(rows[:, None], motion.pelvis_m, np.nan)
            for motion, rows in zip(motions, usable, strict=True)
        ]
        upright = seen_steeply(upright, pelvises_m, world_from_cam[:, :3, 3])
    plane = ground_plane(points_m, feet_m, upright.up, 1.0, config) if len(feet_m) else None
    cues = [contact_cue(planted_m, stances, upright.up, config.stance_sigma_m)]
    cues += [] if plane is None else [ground_cue(plane.normal, plane.points, plane.rms)]
    apart_rad, aside_rad = from_picture_rad(world_from_cam[metric.path.has_camera], upright.up)
    tipped = apart_rad > UNSURE_RAD or aside_rad > ASIDE_RAD
    steady = _steady_cues(metric, upright, tipped)
    up, level = up_of(steady, [cue for cue in cues if cue is not None])
    if tipped and steady[0].name != "gravity":
        level = level.beside_picture(float(np.rad2deg(apart_rad)))
    lowest_m = soles_on_floor_m(feet_m, np.concatenate(of_all_m), up)
    floor_m = _floor_m(lowest_m, up, plane, config)
    first = np.any(usable, axis=0).argmax()
    pelvis_m = known[0][1].pelvis_m[0]
    levelled = level_from_world(up, floor_m, pelvis_m, world_from_cam[first, :3, 2])
    on_floor_m = transforms.apply(levelled, lowest_m)
    # Legs that are seen now and then are mostly a network's mistake.
    shares = [some.sum() / max(1, rows.sum()) for some, rows in zip(shown, usable, strict=True)]
    seen = max(shares) > MOSTLY
    return levelled, level.with_soles(feet_m @ up - floor_m, on_floor_m, seen=seen)


def _steady_cues(metric: SolvedCameras, upright: UpCue, tipped: bool) -> list[UpCue]:
    """What tells up on any ground: what the camera felt, bodies, and lines of the background."""
    felt = None
    if metric.up_cam is not None:
        # Who lies says nothing of up beside a phone that feels it.
        unsure = replace(upright, precision=np.eye(3) / UNSURE_RAD**2) if tipped else upright
        felt = _felt(metric, unsure)
        upright = upright if felt is None else unsure
    steady = [upright] if felt is None else [felt, upright]
    # Beside who lies, lines of the floor would tell up as well as vertical ones.
    may_lie = tipped and felt is None
    by_lines = None if metric.lines is None or may_lie else line_cue(metric.lines, steady[0])
    return steady if by_lines is None else [*steady, by_lines]


def _felt(metric: SolvedCameras, upright: UpCue) -> UpCue | None:
    """What the camera's sensors felt as up; BadIntrinsics where that is of another recording."""
    assert metric.up_cam is not None
    there = metric.path.has_camera
    felt = gravity_cue(metric.path.world_from_cam[there], metric.up_cam[there])
    if felt is None:
        return None
    spread_deg, apart_deg = (
        float(np.rad2deg(rad))
        for rad in (felt.precision[0, 0] ** -0.5, np.arccos(np.clip(felt.up @ upright.up, -1, 1)))
    )
    most_deg = OTHER_SIGMAS * float(np.rad2deg(upright.precision[0, 0] ** -0.5))
    if spread_deg < OTHER_SPREAD_DEG and apart_deg < most_deg:
        return felt
    what = f"its up turns by {spread_deg:.0f} degrees, and is {apart_deg:.0f} from the people's"
    remedy = "give that of this video, whose pictures are as they were recorded, or leave it out"
    raise BadIntrinsics(f"--gravity: {what}: it is of another video or way up; {remedy}")


def _floor_m(
    lowest_m: np.ndarray, up: np.ndarray, plane: GroundPlane | None, config: ScaleConfig
) -> float:
    """Height of the floor along up: of soles, and of the ground about them where both are one."""
    soles_m = float(np.median(lowest_m @ up))
    if plane is None:
        return soles_m
    # Below the soles, so that a plane which is not quite level is right there.
    ground_m = float(np.median(lowest_m @ (up - plane.normal)) + plane.offset)
    if abs(ground_m - soles_m) > ONE_FLOOR_M:
        return soles_m
    weights = np.array([config.contact_sigma_m, GROUND_HEIGHT_SIGMA_M]) ** -2.0
    return float(weights @ [soles_m, ground_m] / weights.sum())
