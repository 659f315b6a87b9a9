"""One sequence from its frames to a verdict: any video, `sfm`, and a sequence of a data set.

`solve` orders the stages, each of which leaves a folder; `gmrdata.solve.verdict` decides after it.
"""

import shutil
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.cameras.again import solve_again
from gmrdata.cameras.files import load_quality
from gmrdata.cameras.lens.intrinsics import (
    beside_cameras,
    find_intrinsics,
    given_lens,
    load_intrinsics,
)
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.people import sources as mask_sources
from gmrdata.people.facing import rate_remarks
from gmrdata.people.following import FOLLOWED_FILE, FollowedRecord, cut_off, load_tracks
from gmrdata.people.local_poses import POSES_FOLDER, local_poses
from gmrdata.people.sources import (
    MasksConfig,
    OnnxSource,
    PersonSource,
    shows_people,
    sources_dir,
)
from gmrdata.read.bodies import body_file, keep_body
from gmrdata.read.gravity import read_gravity
from gmrdata.read.video import VideoConfig, as_frames
from gmrdata.solve.request import (
    AGAIN,
    BODY,
    FOLLOWED,
    FRAMES,
    INTRINSICS,
    LINES,
    MASKS,
    OWN_POSES,
    SFM,
    GivenPeople,
    PeopleBySystem,
    SequenceConfig,
    SolveConfig,
    Solved,
    SolveRequest,
)
from gmrdata.solve.verdict import VERDICT_FILE, forget_result, with_lens_error, write_doubts
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.body import NEUTRAL
from gmrdata.values.camera import Lens
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.errors import BadMotionFile, MissingInput, NoReconstruction, StaleOutput
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.values.people import (
    BODIES,
    FUSED,
    POSES_FILE,
    PSEUDO_GT,
    EstimatedPeople,
    LocalPosesRecord,
    PersonFiles,
)
from gmrdata.world.bodies import BODIES_FILE, BodiesRecord, check_people, make_bodies
from gmrdata.world.picture_fit import PeopleMasks
from gmrdata.world.pseudo_gt import WorldEvidence, make_pseudo_gt
from gmrdata.world.recipe import PseudoGtConfig, save_gravity
from gmrdata.world.vertical_lines import find_lines

GRAVITY_FILE = "gravity.npz"
NOBODY_SEEN = "The built-in estimator sees nobody: these are cameras alone"

OWN_FEET = {"creep_m_per_s": 0.6, "contact_sigma_m": 0.03, "stance_sigma_m": 0.2}
"""Errors of feet by the built-in estimator, for scale and level: its steps are too short, mostly by
a fifth to a half, so feet that stand seem to creep; and it errs by 6 to 9 cm along the ray, more
where people are far, for a second at a time."""

UNSEEN_FEET_SHARE = 0.25
"""Error of the scale, as a share, of people whose feet and size are unknown: a body lies on the
person all the same, and error bars say how large its world may be."""


def solve(
    request: SolveRequest, out_dir: Path, config: SolveConfig, run: Run = DEFAULT_RUN
) -> Solved:
    """Make `frames` of a video, `masks`, `intrinsics` and `sfm`; of people `bodies`, `lines` and
    `pseudo_gt`, and `fused` of those of the built-in estimator.

    Frames without a camera path, and people without a world, are no error: `unsolved` says why.

    Raises:
        StaleOutput: `out_dir` is the folder of frames, or holds what another run left.
        BadFrames, MissingInput, BadMotionFile and what else `SolveRequest.check` and the stages
            raise.
    """
    estimated = request.check()
    if request.source.is_dir() and out_dir.resolve() == request.source.resolve():
        # Files among frames would be others when the run goes on.
        raise StaleOutput(f"{out_dir}: is the folder of frames. Pass another --out, as one in it")
    if request.people is None:
        config = config.for_cameras_alone
    results = (VERDICT_FILE, f"{PSEUDO_GT}/{STAGE_FILE}")
    judged = _records(out_dir) if any((out_dir / name).exists() for name in results) else None
    body_path = _body(request, out_dir, run)
    frames = _frames(request, out_dir, run)
    require_of_frames(request, estimated, frames, config)
    solved = Solved(request, out_dir, config, frames, run, body_path)
    solved = replace(solved, gravity_path=_gravity(request, out_dir, frames))
    for step in (_followed, _masks, _lens, _cameras, _cameras_again, _people, _world):
        judged = _if_still_true(judged, out_dir)
        solved = step(solved)
    judged = _if_still_true(judged, out_dir)
    made: dict[str, object] = {
        SFM: solved.sfm_dir, LINES: solved.bodies, PSEUDO_GT: solved.world_dir
    }  # fmt: skip
    if not isinstance(request.people, GivenPeople):  # whose own files may lie there
        made[BODIES] = solved.bodies
    left = [out_dir / name for name, result in made.items() if not result]
    _drop(left, run, "is of an earlier run, and now there is none")
    solved = _fusion(solved)
    _if_still_true(judged, out_dir)
    return solved


def _records(out_dir: Path) -> Mapping[str, bytes]:
    """The records of the stages in a folder, by name."""
    records: dict[str, bytes] = {}
    for path in out_dir.glob(f"*/{STAGE_FILE}"):
        with suppress(FileNotFoundError):  # another process makes it now
            records[path.parent.name] = path.read_bytes()
    return records


def _if_still_true(judged: Mapping[str, bytes] | None, out_dir: Path) -> Mapping[str, bytes] | None:
    """The records that a result is of.  Where stages are others now, its verdict and its page are
    removed, and None is given: a run that is killed must not leave them beside other cameras."""
    if judged is not None and judged != _records(out_dir):
        forget_result(out_dir)
        return None
    return judged


def _body(request: SolveRequest, out_dir: Path, run: Run) -> Path | None:
    """The body for people whom a system sees, kept beside the result; of a folder of bodies the
    neutral one, whose shapes theirs are."""
    if request.people is None:
        what = "holds people, and now cameras alone are asked for"
        _drop([out_dir / name for name in (FUSED, PSEUDO_GT, LINES, BODIES)], run, what)
    if not isinstance(request.people, PeopleBySystem):
        return None
    return keep_body(chosen_body(request.people.body), out_dir / BODY, run=run)


def chosen_body(body: str) -> str:
    """The body that people whom a system sees get: of a folder the neutral one."""
    return str(body_file(body, NEUTRAL)) if Path(body).expanduser().is_dir() else body


def _drop(folders: Sequence[Path], run: Run, what: str) -> None:
    """Refuse, or with --redo remove, what an earlier run left of stages that now make nothing."""
    for folder in folders:
        if not folder.exists():
            continue
        if not run.redo or not (folder / STAGE_FILE).is_file():
            raise StaleOutput(f"{folder}: {what}. Pass another --out, or --redo to do without it")
        shutil.rmtree(folder)


def _frames(request: SolveRequest, out_dir: Path, run: Run) -> FrameSet:
    left_out, into = request.given.left_out, out_dir / FRAMES
    frames = as_frames(request.source, into, request.part, left_out=left_out, run=run)
    is_given = isinstance(request.people, GivenPeople)
    return frames if is_given else frames.with_rate(request.fps_hz)


def require_of_frames(
    request: SolveRequest, results: EstimatedPeople | None, frames: FrameSet, config: SolveConfig
) -> None:
    """Refuse a lens, a folder of masks, or a system's people, that can't be of these frames, before
    hours of work."""
    if request.lens is not None:
        given_lens(request.lens, frames.size_px)
    if config.masks is not None:
        mask_sources.check_folders(config.masks, frames)
    if results is not None:
        assert isinstance(request.people, PeopleBySystem) and request.people.results_path
        check_people(results, request.people.results_path, frames, config.bodies)


def _gravity(request: SolveRequest, out_dir: Path, frames: FrameSet) -> Path | None:
    """What the phone felt in each frame; read first, so that a wrong file is said at once."""
    if request.gravity_path is None or request.people is None:
        return None
    path = out_dir / GRAVITY_FILE
    save_gravity(path, read_gravity(request.gravity_path, frames))
    return path


def _followed(solved: Solved) -> Solved:
    """People detected and followed once: their masks and the built-in estimator's poses are made
    of it."""
    config, own = solved.config, solved.request.has_own_people
    sources = () if config.masks is None else config.masks.sources
    if not own and not any(isinstance(source, PersonSource) for source in sources):
        return solved
    into = solved.out_dir / FOLLOWED
    followed_dir = config.person_source.follow(solved.frames, into, solved.run)
    return replace(solved, followed_dir=followed_dir)


def _masks(solved: Solved) -> Solved:
    config = solved.config.masks
    if config is None:
        by_source = sources_dir(solved.out_dir / MASKS).glob(f"*/{STAGE_FILE}")
        left = [solved.out_dir / MASKS, *sorted(path.parent for path in by_source)]
        _drop(left, solved.run, "holds masks, and now none are asked for")
        return solved
    masks_dir = mask_sources.make_masks(
        solved.frames,
        solved.out_dir / MASKS,
        config,
        people=solved.request.given.files,
        followed_dir=solved.followed_dir,
        run=solved.run,
    )
    return replace(solved, masks_dir=masks_dir)


def _lens(solved: Solved) -> Solved:
    """The lens, and the thresholds that its error allows; bodies that are given have theirs."""
    request = solved.request
    if isinstance(request.people, GivenPeople):
        return solved
    folder = find_intrinsics(
        solved.frames,
        solved.masks_dir,
        solved.out_dir / INTRINSICS,
        solved.config.intrinsics,
        given=request.lens,
        run=solved.run,
    )
    lens, config = load_intrinsics(folder), solved.config
    thresholds = {"pseudo_gt": with_lens_error(config.pseudo_gt, lens)}
    return replace(solved, lens=lens, config=config.model_copy(update=thresholds))


def _cameras(solved: Solved) -> Solved:
    lens = solved.lens
    try:
        sfm_dir = reconstruct(
            solved.frames,
            solved.masks_dir,
            _known_lens(solved),
            solved.out_dir / SFM,
            solved.config.sfm,
            run=solved.run,
        )
    except NoReconstruction as error:
        return replace(solved, unsolved=error)
    lens = None if lens is None else beside_cameras(lens, load_quality(sfm_dir))
    return replace(solved, sfm_dir=sfm_dir, lens=lens)


def _cameras_again(solved: Solved) -> Solved:
    """Other solutions of the same frames, where they are asked for."""
    if solved.sfm_dir is None or not solved.config.check_again:
        return solved
    again_dir = solve_again(
        solved.sfm_dir,
        solved.frames,
        solved.masks_dir,
        solved.out_dir / AGAIN,
        solved.config.sfm,
        run=solved.run,
    )
    return replace(solved, again_dir=again_dir)


def _people(solved: Solved) -> Solved:
    """People before the camera."""
    people = solved.request.people
    if solved.sfm_dir is None or people is None:
        return solved
    if isinstance(people, GivenPeople):
        return replace(solved, bodies=people.files)
    filmed = Filmed(solved.frames, _lens_of_frames(solved))
    own = solved.request.has_own_people
    poses_path = _own_poses(solved, filmed) if own else people.results_path
    if poses_path is None:
        return replace(solved, remarks=(NOBODY_SEEN,))
    assert solved.body_path is not None
    bodies_dir, config = solved.out_dir / BODIES, solved.config.bodies
    try:
        bodies = make_bodies(
            poses_path, filmed, solved.body_path, bodies_dir, config, run=solved.run
        )
    except BadMotionFile as error:
        if people.asked:
            raise
        return replace(solved, remarks=(str(error),))
    record = BodiesRecord.read(bodies_dir / BODIES_FILE)
    remarks = (*record.notes, *record.left_out)
    if own and solved.followed_dir is not None:
        followed = FollowedRecord.read(solved.followed_dir / FOLLOWED_FILE)
        video = solved.frames.video
        of_rate = rate_remarks(solved.frames.rate_hz, video.every if video is not None else 1)
        outside = cut_off(load_tracks(solved.followed_dir), followed.size_px)
        remarks = (*remarks, *followed.doubts(), *of_rate, *outside)
    doubts = (f"{name}: {doubt}" for name, doubt in _own_doubts(solved).items())
    return replace(solved, bodies=bodies, remarks=(*remarks, *doubts))


def _known_lens(solved: Solved) -> Lens:
    """What is known of the lens before cameras are; bodies that are given have theirs."""
    people = solved.request.people
    if isinstance(people, GivenPeople):
        return camera_of(load_clip(people.files[0].clip_path)).lens
    assert solved.lens is not None
    return solved.lens.lens


def _lens_of_frames(solved: Solved) -> Lens:
    """The lens with the distortion that was taken out of the image points."""
    assert solved.sfm_dir is not None
    return load_quality(solved.sfm_dir).lens_of(_known_lens(solved))


def _own_poses(solved: Solved, filmed: Filmed) -> Path | None:
    """Poses by the built-in estimator, for `read_system`; None where it sees nobody."""
    assert solved.body_path is not None and solved.followed_dir is not None
    poses_dir = local_poses(
        solved.followed_dir,
        filmed,
        solved.body_path,
        solved.out_dir / OWN_POSES / POSES_FOLDER,
        solved.config.own_poses,
        run=solved.run,
    )
    return poses_dir if LocalPosesRecord.read(poses_dir / POSES_FILE).people else None


def _own_poses_dir(solved: Solved) -> Path | None:
    """The folder of the built-in estimator that people are of: this video's, or one that was given;
    None for people of others."""
    people = solved.request.people
    if not isinstance(people, PeopleBySystem):
        return None
    poses_dir = people.results_path or solved.out_dir / OWN_POSES / POSES_FOLDER
    return poses_dir if (poses_dir / POSES_FILE).is_file() else None


def _own_doubts(solved: Solved) -> dict[str, str]:
    """Why people of the built-in estimator may be wrong as a whole, by their clips' names."""
    poses_dir = _own_poses_dir(solved)
    if poses_dir is None:
        return {}
    doubts = LocalPosesRecord.read(poses_dir / POSES_FILE).doubts
    return {f"person_{n}": doubt for n, doubt in enumerate(doubts) if doubt}


def _world(solved: Solved) -> Solved:
    """The people in a metric, level world."""
    if not solved.bodies:
        return solved
    assert solved.sfm_dir is not None
    given, lens, config = solved.request.given, solved.lens, solved.config
    evidence = WorldEvidence(
        sfm_dir=solved.sfm_dir,
        people=solved.bodies,
        dataset_camera_path=given.dataset_camera_path,
        doubts_path=given.doubts_path or _doubts_of(solved),
        gravity_path=solved.gravity_path,
        lines_dir=_lines(solved),
        seen=_masks_of_people(solved),
        focal_sigma=0.0 if lens is None else lens.focal_sigma,
        size_sigmas=_size_sigmas(solved),
    )
    own = _own_poses_dir(solved) is not None
    pseudo_gt = _with_size_errors(config.pseudo_gt, evidence.size_sigmas, own_feet=own)
    try:
        made = make_pseudo_gt(evidence, solved.out_dir / PSEUDO_GT, pseudo_gt, run=solved.run)
    except NoReconstruction as error:
        return replace(solved, unsolved=error)
    return replace(solved, world_dir=made)


def _lines(solved: Solved) -> Path:
    """Straight lines of the background."""
    assert solved.sfm_dir is not None
    return find_lines(
        Filmed(solved.frames, _lens_of_frames(solved)),
        solved.masks_dir,
        solved.sfm_dir,
        solved.out_dir / LINES,
        solved.config.lines,
        run=solved.run,
    )


def _doubts_of(solved: Solved) -> Path | None:
    """What the frames' video and the lens say against people.  The clips are let go of with this:
    the world reads them again, and those of many people in a film fill gigabytes."""
    clips = [load_clip(person.clip_path) for person in solved.bodies]
    of_people = _own_doubts(solved)
    return write_doubts(solved.out_dir, clips, solved.frames.video, solved.lens, of_people)


def _masks_of_people(solved: Solved) -> PeopleMasks | None:
    """What bodies must lie on; whom a system sees stands before the camera without distortion."""
    if solved.config.masks is None:
        return None
    masks = people_masks(solved.out_dir / MASKS, solved.config.masks, solved.followed_dir)
    if masks is None or not isinstance(solved.request.people, PeopleBySystem):
        return masks
    assert solved.sfm_dir is not None
    return replace(masks, distortion=load_quality(solved.sfm_dir).lens)


def _size_sigmas(solved: Solved) -> tuple[float, ...]:
    """By person, of whom a system sees; of bodies that are given sizes are known."""
    if not isinstance(solved.request.people, PeopleBySystem):
        return ()
    record = BodiesRecord.read(solved.out_dir / BODIES / BODIES_FILE)
    return tuple(person.size_sigma for person in record.people)


def _with_size_errors(
    config: PseudoGtConfig, size_sigmas: tuple[float, ...], *, own_feet: bool
) -> PseudoGtConfig:
    """The recipe with the errors of the built-in estimator's feet; and with a threshold of the
    scale that people of unknown size, and with hidden feet, can meet: error bars have the rest.
    What is set otherwise than usual stays."""
    scale, verdict, usual = config.scale, config.verdict, PseudoGtConfig()
    if own_feet:
        unset = (key for key in OWN_FEET if getattr(scale, key) == getattr(usual.scale, key))
        scale = scale.model_copy(update={key: OWN_FEET[key] for key in unset})
    most = usual.verdict.max_scale_sigma_share
    if size_sigmas and verdict.max_scale_sigma_share == most:
        most = float(np.hypot(most, UNSEEN_FEET_SHARE))
        verdict = verdict.model_copy(update={"max_scale_sigma_share": most})
    return config.model_copy(update={"scale": scale, "verdict": verdict})


def people_masks(
    masks_dir: Path, config: MasksConfig, followed_dir: Path | None = None
) -> PeopleMasks | None:
    """Masks of people among a sequence's that were made without its bodies, outlines before boxes,
    and whom the landmark network followed.

    None where there are none: silhouettes lie on the bodies by themselves, and nobody knows what is
    in a folder.
    """
    by_source = sources_dir(masks_dir)
    shown = [
        PeopleMasks(by_source / name, one.dilate_px, isinstance(one, OnnxSource), followed_dir)
        for name, one in config.named
        if shows_people(one)
    ]
    return min(shown, key=lambda masks: masks.boxed, default=None)


def _fusion(solved: Solved) -> Solved:
    """People of the built-in estimator once more, with the network of the package."""
    if not isinstance(solved.request.people, PeopleBySystem):
        return solved
    # Not for cameras alone, which need no network: torch takes two seconds to import.
    from gmrdata.fusion.fuse import fuse_own_people

    body_path = solved.body_path if solved.request.has_own_people else None
    failed = fuse_own_people(solved.out_dir, body_path, run=solved.run)
    return solved if failed is None else replace(solved, remarks=(*solved.remarks, failed))


def solve_sequence(
    frames: str | Path,
    people: tuple[PersonFiles, ...],
    out_dir: str | Path,
    config: SequenceConfig,
    *,
    dataset_camera_path: Path | None = None,
    doubts_path: Path | None = None,
    left_out: Collection[int] = (),
    video: VideoConfig | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sfm` and, the result, `out_dir/pseudo_gt`.

    The intrinsics of the first of the people are kept.

    Args:
        frames: A folder of numbered images, or a video file, of which `video` says the part.  Where
            bodies are of other times than a video's frames, the verdict says so.
        people: In the camera's frame, all with the same rows.
        dataset_camera_path: The data set's, by `save_dataset_camera`; right over short times.
        doubts_path: A `Doubts` record: why the data set itself does not vouch for frames.
        left_out: Numbers of images that are known to be unusable.

    Raises:
        NoReconstruction: there is no camera path, or no world.
        MissingInput: there are no people.
    """
    given = GivenPeople(people, dataset_camera_path, doubts_path, left_out)
    return solve_given(SolveRequest(Path(frames), given, part=video), Path(out_dir), config, run)


def solve_given(request: SolveRequest, out_dir: Path, config: SequenceConfig, run: Run) -> Path:
    """`solve_sequence` of a request for `GivenPeople`."""
    if not request.given.files:
        what = "nobody is given. Give a person's clip and body; solve_video needs none"
        raise MissingInput(f"{request.source}: {what}")
    asked = {stage: getattr(config, stage) for stage in SequenceConfig.model_fields}
    solved = solve(request, out_dir, SolveConfig(**asked), run)
    if solved.unsolved is not None:
        raise solved.unsolved
    assert solved.world_dir is not None
    return solved.world_dir


def make_masks(
    frames: str | Path,
    out_dir: str | Path,
    config: MasksConfig,
    *,
    people: tuple[PersonFiles, ...] = (),
    video: VideoConfig | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `masks`, `masks_by` and, of a video, `frames` in a folder; gives the path of `masks`.

    Args:
        frames: A folder of numbered images, or a video file, of which `video` says the part.
        people: Camera-frame clips with their bodies, for silhouettes.
    """
    given = as_frames(Path(frames), Path(out_dir) / FRAMES, video, run=run)
    return mask_sources.make_masks(given, Path(out_dir) / MASKS, config, people=people, run=run)
