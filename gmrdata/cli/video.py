"""The verbs of a video: masks, cameras, people, a page and files; one, or a batch."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, answer_json, fail, print_table, then
from gmrdata.stage.progress import remark
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadFrames, BadRecipe, GmrdataError, MissingInput
from gmrdata.values.records import with_absolute_paths


def masks(
    frames: flags.Frames,
    out: Path,
    masks: flags.Masks = ("onnx",),
    camera_body: Path | None = None,
    body: flags.Body = "anny",
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
    *,
    part: flags.PartFlags,
    networks: flags.NetworkFlags,
) -> None:
    """Mask what moves in frames or a video: people, vehicles, animals, or a known body.

    Args:
        out: Output folder: masks/ (`<image stem>.png`, 255 = dynamic), masks_by/ with each
            source's own, sheet/contact.jpg to look at, and frames/ of a video. A run that was
            stopped goes on at the next missing frame.
        camera_body: Clip file (.npz) in the camera's frame, for the silhouette.
    """
    from gmrdata.pages.frames import make_mask_sheet
    from gmrdata.people.sources import SilhouetteSource, masks_named, network_files
    from gmrdata.solve.solve import make_masks

    flags.need(masks, "a source of masks: --masks onnx")
    config = masks_named(masks, **vars(networks))
    drawn = any(isinstance(one, SilhouetteSource) for one in config.sources)
    if camera_body is not None and not drawn:
        raise BadRecipe("--camera-body is for silhouette, which is not named")
    if camera_body is None and drawn:
        raise MissingInput("silhouette needs a clip in the camera's frame: pass --camera-body")
    network_files(config)  # what lacks is said before frames are taken
    people = () if camera_body is None else flags.one_person(camera_body, body)
    if dry_run:
        _show_stages(frames, part, ("frames", "masks"), config)
        return
    run = Run(redo=redo)
    masks_dir = make_masks(frames, out, config, people=people, video=part, run=run)
    answer(masks_dir)
    answer(make_mask_sheet(frames if frames.is_dir() else out / "frames", masks_dir, out / "sheet"))
    flags.say_lost(out / "frames")


def sfm(
    frames: flags.Frames,
    camera_body: Path,
    out: Path,
    masks: flags.Masks = ("silhouette",),
    body: flags.Body = "anny",
    seed: int = 0,
    page: flags.Page = True,
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
    *,
    part: flags.PartFlags,
    networks: flags.NetworkFlags,
) -> None:
    """World motion of one person from a moving-camera video and the person's camera-frame body.

    Args:
        camera_body: Clip file (.npz) whose motion is in the camera's frame; its intrinsics are
            used as they are.
        out: Output folder: masks/, masks_by/, sfm/, pseudo_gt/; index.html, overlay/ and files/.
        seed: Seed of the reconstruction.
    """
    from gmrdata.cameras.files import load_quality
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.people.sources import masks_named, network_files
    from gmrdata.solve.request import SequenceConfig
    from gmrdata.solve.solve import solve_sequence

    flags.need(masks, "a source of masks: --masks silhouette")
    named = masks_named(masks, **vars(networks))
    network_files(named)
    with flags.flags_named():
        config = SequenceConfig(masks=named, sfm=SfmConfig(seed=seed))
    people = flags.one_person(camera_body, body)
    if dry_run:
        _show_stages(frames, part, ("frames", "masks", "sfm"), named)
        return
    answer(solve_sequence(frames, people, out, config, video=part, run=Run(redo=redo)))
    flags.say_lost(out / "frames")
    for name, figure in load_quality(out / "sfm").lens_in_words:
        remark(f"{name}: {figure}")
    if page:
        answer(write_page(out, images=frames if frames.is_dir() else None, body=body))


def _show_stages(frames: Path, part: Any, stages: Sequence[str], config: "MasksConfig") -> None:
    """What some stages would do with frames, and about how long they take."""
    from gmrdata.people.sources import check_folders
    from gmrdata.solve.plan import HEADINGS, plan_stages, planned_frames

    images = planned_frames(frames, part)
    check_folders(config, images)
    planned = plan_stages(images, stages)
    print_table(HEADINGS, planned.rows)
    answer(planned.summary(frames))


if TYPE_CHECKING:
    from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
    from gmrdata.people.sources import MasksConfig
    from gmrdata.solve.request import SolveConfig
    from gmrdata.solve.verdict import VideoVerdict

NO_MASKS = ("none",)
HEADINGS = ("video", "state", "frames", "people", "reasons")


def video(
    sources: Positional[tuple[Path, ...]],
    out: Path,
    poses: Path | None = None,
    body: flags.Body = "anny",
    masks: flags.Masks = ("person",),
    fps_hz: Annotated[
        float | None, arg(help="Images per second of a folder of images [Hz].")
    ] = None,
    dry_run: flags.DryRun = False,
    page: flags.Page = True,
    strict: bool = False,
    as_json: flags.AsJson = False,
    *,
    lens: flags.LensFlags,
    solving: flags.SolvingFlags,
    part: flags.PartFlags,
    networks: flags.NetworkFlags,
    run: flags.RunFlags,
) -> None:
    """Find the cameras of any video, and people's motion in a metric world.

    Several videos, or a folder of video files, are a batch of jobs.

    Args:
        sources: A video file or a folder of numbered images, or several.
        out: Output folder; index.html is the page, and files/ is for other programs. The same
            command resumes a stopped run.
        poses: People of another system, by its file or folder; for a batch a folder of files by
            the videos' names. Without it, people of the built-in estimator. The word own demands
            that one of these is accepted; none is for cameras alone.
        strict: End with exit code 1 for a rejected video.
    """
    flags.need(sources, "a video, or a folder of numbered images or of videos")
    flags.as_text(dry_run, as_json)
    asked: dict[str, Any] = {
        "poses": poses, "body": body, "lens": _lens(lens), "fps_hz": fps_hz, "part": part,
        "config": _solve_config(_masks(masks, networks, poses), lens, solving),
    }  # fmt: skip
    alone = _are_one(sources, solving, run)
    if alone:
        asked["gravity"] = solving.gravity
    if dry_run:
        _show_plan(sources, asked)
    elif alone:
        _solve_one(sources[0], out, asked, run, page=page, strict=strict, as_json=as_json)
    else:
        _solve_many(sources, out, asked, run, page=page, strict=strict, as_json=as_json)


def _solve_config(
    masks: "MasksConfig | None", lens: flags.LensOptions, solving: flags.SolvingOptions
) -> "SolveConfig":
    from gmrdata.cameras.lens.intrinsics import IntrinsicsConfig
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.solve.request import QUICK_SFM, SolveConfig
    from gmrdata.world.bodies import BodiesConfig

    with flags.flags_named():
        sfm = SfmConfig(**dict(QUICK_SFM) | {"seed": solving.seed})
        bodies = BodiesConfig(frames_per_row=solving.poses_every)
    return SolveConfig(
        masks=masks,
        intrinsics=IntrinsicsConfig(look_in_frames=lens.check_lens),
        sfm=sfm,
        check_again=solving.check_again,
        bodies=bodies,
    ).with_heights(_heights(solving.height_m))


def _heights(said: tuple[str, ...]) -> dict[str, float] | None:
    """Heights by name, as `solve_video` takes them; BadRecipe for what is no height, and for a
    second one of the same name."""
    from gmrdata.world.size import EVERYBODY

    heights: dict[str, float] = {}
    for text in said:
        name, _, number = text.rpartition("=")
        name = name or EVERYBODY
        if name in heights:
            what = f"--height-m {text}: {name} has a height already"
            raise BadRecipe(f"{what}. Name each person once, as person_0=1.78 person_1=1.65")
        try:
            heights[name] = float(number)
        except ValueError:
            what = f"--height-m {text}: no height. Give metres, as 1.78 or person_0=1.78"
            raise BadRecipe(what) from None
    return heights or None


def _are_one(sources: Sequence[Path], solving: flags.SolvingOptions, run: Run) -> bool:
    """Whether one video is meant; BadRecipe for flags that are for many."""
    from gmrdata.read.video_files import find_videos

    if find_videos(sources) is not None:
        if solving.gravity is not None:
            raise BadRecipe("--gravity is of one video. Leave it out for several")
        return False
    if run.shard or run.workers or run.scheduler:
        what = "--workers, --scheduler and --shard are for several videos"
        raise BadRecipe(f"{what}, or a folder with video files. Leave them out for one")
    return True


def _show_plan(sources: Sequence[Path], asked: dict[str, Any]) -> None:
    """What would be done, and about how long it takes; BadFrames if some videos can't be read."""
    from gmrdata.solve.plan import BATCH_HEADINGS, HEADINGS, plan_videos

    planned = plan_videos(sources, **asked)
    print_table(HEADINGS if planned.is_of_one else BATCH_HEADINGS, planned.rows)
    answer(planned.summary)
    if planned.unreadable:
        listed = "".join(f"\n  {reason}" for reason in planned.unreadable)
        n = len(planned.rows) - 1
        raise BadFrames(f"{len(planned.unreadable)} of {n} videos can't be read:{listed}")


def _solve_one(
    source: Path, out: Path, asked: dict[str, Any], run: Run,
    *, page: bool, strict: bool, as_json: bool,
) -> None:  # fmt: skip
    from gmrdata.solve.verdict import VideoVerdict
    from gmrdata.solve.videos import solve_video

    verdict = VideoVerdict.read(solve_video(source, out, **asked, run=run))
    if source.is_file():
        flags.say_lost(out / "frames")
    if not as_json:
        _say(verdict)
    made = (leave_files_and_page if page else leave_files)(out, verdict)
    if as_json:
        made_text, said = made and str(made), verdict.model_dump(mode="json")
        answer_json({"out": str(out), "page": made_text, "verdict": said})
    elif made:
        answer(made)
    if strict and not verdict.accepted:
        fail(f"{source}: rejected")


def _solve_many(
    sources: Sequence[Path], out: Path, asked: dict[str, Any], run: Run,
    *, page: bool, strict: bool, as_json: bool,
) -> None:  # fmt: skip
    """Solve the videos of a batch, say which were rejected, and write the index."""
    from gmrdata.solve.verdict import PAGE
    from gmrdata.solve.videos import Videos, solve_videos

    after, leaves = (leave_files_and_page, (PAGE,)) if page else (leave_files, ())
    with then(lambda: _show_videos(out, as_json=as_json)):
        record = solve_videos(sources, out, **asked, after=after, leaves=leaves, run=run)
    videos = Videos.read(record)
    if strict and (n_rejected := len(videos.in_state("rejected"))):
        fail(f"{out}: {n_rejected} of {len(videos.videos)} videos were rejected")


def leave_files(out: Path, verdict: "VideoVerdict") -> None:
    """Files to take along, of people or of cameras alone."""
    from gmrdata.export.export import write_files

    # An absolute path stays as it is.
    for what, why in write_files(out, images=out / verdict.images_dir):
        remark(f"{out}: {what} not written: {why}")


def leave_files_and_page(out: Path, verdict: "VideoVerdict") -> Path:
    """The same, and the page; gives its path."""
    return write_page(out, images=out / verdict.images_dir)


def _masks(
    names: tuple[str, ...], networks: flags.NetworkOptions, poses: Path | None
) -> "MasksConfig | None":
    """The sources of masks; None for the word none, where nothing moves."""
    from gmrdata.people.sources import masks_named, network_files
    from gmrdata.solve.request import NOBODY

    flags.need(names, "a source of masks: --masks person, or none")
    if names == NO_MASKS:
        return None
    config = masks_named(names, **vars(with_absolute_paths(networks)))
    try:
        network_files(config.for_cameras_alone if str(poses) == NOBODY else config)
    except MissingInput as error:
        raise MissingInput(f"{error}; --masks none goes without") from None
    return config


def _lens(lens: flags.LensOptions) -> "GivenIntrinsics | None":
    """What a person said of the lens; BadRecipe for no lens, or for several."""
    from gmrdata.cameras.lens.intrinsics import GivenIntrinsics

    said = {key: getattr(lens, flag) for key, flag in flags.LENS_FLAGS.items()}
    named = {key: value for key, value in said.items() if value is not None}
    if len(named) > 1:
        raise BadRecipe("give one of --focal, --fov and --intrinsics, or none of them")
    with flags.flags_named():
        return GivenIntrinsics.model_validate(named) if named else None


def _say(verdict: "VideoVerdict") -> None:
    """The verdict in words."""
    answer("accepted" if verdict.accepted else "rejected")
    for reason in verdict.reasons:
        answer(f"  {reason}")
    kept = f"{verdict.camera.kept_frames} of {verdict.camera.frames} frames have a camera to use"
    lines = [kept, *verdict.notes]
    for person in verdict.people:
        state = "accepted" if person.accepted else f"rejected: {'; '.join(person.reasons)}"
        lines.append(f"{person.id}: {person.kept_frames} of {person.frames} frames, {state}")
    for line in lines:
        remark(line)


def _show_videos(out: Path, *, as_json: bool) -> None:
    """Write the index, and say which videos were rejected or failed and how many of each."""
    from gmrdata.pages.batches import write_videos_page
    from gmrdata.solve.videos import RECORD_FILE, Videos

    record, page = Videos.read(out / RECORD_FILE), write_videos_page(out)
    if as_json:
        answer_json({"out": str(out), "page": str(page)} | record.model_dump(mode="json"))
        return
    by_state = {state: record.in_state(state) for state in ("accepted", "rejected", "failed")}
    rows = [
        (one.name, state, str(one.frames), str(one.people), "; ".join(one.reasons))
        for state in ("rejected", "failed")
        for one in by_state[state]
    ]
    if rows:
        print_table(HEADINGS, rows)
    answer(", ".join(f"{len(videos)} {state}" for state, videos in by_state.items()))
    answer(page)
    answer(out / RECORD_FILE)


def page(
    folders: Positional[tuple[Path, ...]],
    images: Path | None = None,
    body: str | None = None,
    files: bool = True,
) -> None:
    """Write the page of solved videos: verdict, overlay, paths, figures, and files to take along.

    `gmrdata video` and `gmrdata sfm` do it by themselves.  A sequence of a data set has its page
    only when it is asked for, since drawing over all frames takes its time.

    Args:
        folders: Output folders of `gmrdata video` or `gmrdata sfm`, or sequences of `gmrdata
            threedpw regenerate`: OUT/sequences/<name>.
        images: Folder with the frames of one sequence, or with a folder for each of several, by
            name; their own `frames` when left out, as of a video file.
        body: "anny", or the file of a body model; the one that lies beside the clips when left out.
        files: Write BVH, GLB, AMASS, COLMAP and TUM files of people who were accepted.
    """
    from gmrdata.export.export import images_of

    flags.need(folders, "a folder of a solved video")
    for folder in folders:
        own, alone = images, len(folders) == 1
        if images is not None:
            own = images_of(images, folder.resolve().name, alone=alone)
        else:
            _refuse_frames_elsewhere(folder)
        answer(write_page(folder, images=own, body=body, files=files))


def _refuse_frames_elsewhere(folder: Path) -> None:
    """MissingInput where a record names frames that lie elsewhere: it may be of others, so it is
    not followed, and without frames the page would lose its overlay, and points their colours."""
    from gmrdata.cameras.reconstruct import IMAGES_FACT
    from gmrdata.solve.request import FRAMES, SFM
    from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict
    from gmrdata.stage.store import StageRecord

    elsewhere = None
    with suppress(GmrdataError, OSError):  # the page says what can't be read
        if (folder / VERDICT_FILE).exists():
            named = VideoVerdict.read(folder / VERDICT_FILE).images_dir
        else:  # of one given person, whose frames the cameras' record names
            named = str(StageRecord.of(folder / SFM).facts.get(IMAGES_FACT, FRAMES))
        images_dir = folder.absolute() / named
        if images_dir != folder.absolute() / FRAMES and images_dir.is_dir():
            elsewhere = images_dir
    if elsewhere is not None:
        what = "its frames lie outside of it, where a record alone must not lead"
        raise MissingInput(f"{folder}: {what}. Give them to it alone, with --images {elsewhere}")


def write_page(
    out_dir: Path, *, images: Path | None = None, body: str | None = None, files: bool = True
) -> Path:
    """The page of one solved video, and its files; errors as of `make_video_page`."""
    from gmrdata.export.export import write_files
    from gmrdata.pages.solved_page import make_video_page

    left_out = write_files(out_dir, images=images, body=body) if files else ()
    return make_video_page(out_dir, images_dir=images, body=body, left_out=left_out)
