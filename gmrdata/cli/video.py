"""The verb for any video: cameras, people's world motion of given bodies, a page, and files."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import Positional, arg

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, fail, print_table
from gmrdata.cli.shards import ArrayFlags, print_script
from gmrdata.stage.progress import console, remark
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe, MissingInput

if TYPE_CHECKING:
    from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
    from gmrdata.export.formats import FormatName
    from gmrdata.people.sources import MasksConfig
    from gmrdata.read.video_files import NamedVideo
    from gmrdata.solve.video import GivenBodies, VideoSolveConfig
    from gmrdata.solve.video_verdict import VideoVerdict
    from gmrdata.solve.videos import EachVideo, OwnPoses

FILES = "files"
FRAME_S, MASK_S, SFM_S, BODY_S, OWN_POSE_S = 0.02, 0.12, 0.25, 0.005, 0.08
SFM_START_S, BODIES_S, INTRINSICS_S = 10.0, 15.0, 25.0
"""For a dry run: seconds that one image of 1280x720 px takes on two cores, and that all need."""
TAKEN_ALONG: "tuple[FormatName, ...]" = ("colmap", "tum", "bvh", "glb", "amass")
"""Formats that are written of people; of cameras alone the first two."""
NO_MASKS = ("none",)
OWN, NOBODY = Path("own"), Path("none")  # as poses: by the built-in estimator, and cameras alone


def video(
    sources: Positional[tuple[Path, ...]],
    out: Path,
    poses: Path | None = None,
    body: flags.Body = "anny",
    masks: tuple[str, ...] = ("person",),
    model: flags.MaskModel = None,
    landmarks: flags.MaskLandmarks = None,
    weights: flags.MaskWeights = None,
    classes: flags.MaskClasses = (),
    focal: Annotated[
        float | None,
        arg(help="Focal length of the images, of all videos [px]; one of these three at most."),
    ] = None,
    fov: Annotated[
        float | None, arg(help="Horizontal field of view of the images, of all videos [deg].")
    ] = None,
    intrinsics: Annotated[
        Path | None,
        arg(help="Calibration of the images, of all videos: a file, as docs/video.md lists them."),
    ] = None,
    check_lens: bool = True,
    fps: Annotated[float | None, arg(help="Images per second of a folder of images [Hz].")] = None,
    poses_every: int = 1,
    seed: int = 0,
    from_s: flags.FromS = 0.0,
    to_s: flags.ToS = None,
    every: flags.Every = 1,
    take_what_decodes: flags.TakeWhatDecodes = False,
    check_again: bool = False,
    page: flags.Page = True,
    strict: bool = False,
    dry_run: flags.DryRun = False,
    *,
    run: flags.RunFlags,
    array: ArrayFlags,
) -> None:
    """Cameras of any video, and people's motion in a metric world.

    Several videos, or a folder with video files, are a batch: each is solved by itself, in worker
    processes or shards.

    Args:
        sources: A video file, or a folder of numbered images; for a batch several of them, or a
            folder with video files.
        out: Output folder: frames/ of a video, masks/, intrinsics/, sfm/ and verdict.json; bodies/
            and pseudo_gt/ of people, and fused/ of the built-in estimator's; files/ to take along;
            index.html and overlay/ to look at. Of a batch videos/<name>/ with these, videos.json
            and index.html. A run that was stopped goes on where it was.
        poses: People before the camera: VIBE's vibe_output.pkl, WHAM's wham_output.pkl, GVHMR's
            hmr4d_results.pt, TRAM's folder, or PHALP's or 4D-Humans' .pkl. Of a batch a folder with
            <name>.pkl, <name>.pt or <name>/ for each video that has people. When left out, whom the
            built-in estimator sees, a demonstrator (docs/poses.md), if its networks were fetched;
            cameras decide alone then whether the video is accepted. The word own for the same
            people, one of whom must be accepted; none for cameras alone.
        masks: Where masks of what moves come from, as `gmrdata masks --sources` takes them; none
            where nothing moves.
        check_lens: Seek the lens in the frames too. Without, a given lens is taken as it is, and
            one that nobody knows is guessed.
        poses_every: The poses were made from every n-th frame of the video.
        seed: Seed of the reconstruction.
        check_again: Solve the cameras four more times, backward, by every second frame and by
            other seeds, and reject a path that these don't give.
        strict: End with exit code 1 for a rejected video.
    """
    from gmrdata.cameras.lens.intrinsics import IntrinsicsConfig
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.read.video_files import find_videos
    from gmrdata.solve.video import QUICK_SFM, VideoSolveConfig
    from gmrdata.solve.videos import EachVideo
    from gmrdata.world.bodies import BodiesConfig

    flags.need(sources, "a video, or a folder of numbered images or of videos")
    config = VideoSolveConfig(
        masks=_masks(masks, model, landmarks, weights, classes),
        intrinsics=IntrinsicsConfig(look_in_frames=check_lens),
        sfm=SfmConfig.model_validate(QUICK_SFM.model_dump() | {"seed": seed}),
        check_again=check_again,
        bodies=BodiesConfig(frames_per_row=poses_every),
    )
    own_poses = _own_poses(poses, config)
    each = EachVideo(
        config=config,
        part=flags.video_part(from_s, to_s, every, take_what_decodes),
        lens=_lens(focal, fov, intrinsics),
        fps_hz=fps,
        body=body,
        own_poses=own_poses,
        page=page,
    )
    poses = None if poses in (OWN, NOBODY) else poses
    found = find_videos(sources)
    if found is None:
        _require_alone(run, array)
        if dry_run:
            _show_plan(sources[0], each, poses)
        else:
            _solve_alone(sources[0], out, each, poses, run, strict)
        return
    from gmrdata.cli import videos

    batch = videos.prepare(found, each, poses)
    if array is not None:
        print_script(array)
    elif dry_run:
        videos.show_plan(batch, each)
    else:
        videos.solve(batch, out, each, run, strict)


def _own_poses(poses: Path | None, config: "VideoSolveConfig") -> "OwnPoses":
    """Whether people are those of the built-in estimator; without its networks, and when nobody
    asked for people, that is said."""
    from gmrdata.solve.video import own_networks

    if poses not in (None, OWN):
        return "no"
    try:
        own_networks(config)
    except MissingInput as error:
        if poses == OWN:
            raise
        remark(f"cameras alone, without people: {error}")
        return "no"
    return "asked" if poses == OWN else "seen"


def _require_alone(run: Run, array: object) -> None:
    """Refuse what is for many videos; raises BadRecipe."""
    if run.shard or run.workers or run.scheduler or array is not None:
        what = "--workers, --scheduler, --shard and --print-… are for several videos"
        raise BadRecipe(f"{what}, or a folder with video files. Leave them out for one")


def _solve_alone(
    source: Path, out: Path, each: "EachVideo", poses: Path | None, run: Run, strict: bool
) -> None:
    from gmrdata.read.video import is_video
    from gmrdata.read.video_files import NamedVideo
    from gmrdata.solve.video import FRAMES

    verdict = solve_one(NamedVideo(out.name, source, poses), out, each, run)
    if is_video(source):
        flags.say_lost(out / FRAMES)
    _say(verdict)
    if (made := leave_page(out, verdict, page=each.page)) is not None:
        answer(made)
    if strict and not verdict.accepted:
        fail(f"{source}: rejected")


def solve_one(video: "NamedVideo", out: Path, each: "EachVideo", run: Run) -> "VideoVerdict":
    """One video with all of its stages; errors as of `solve_video`."""
    from gmrdata.fusion.fused_motion import fuse_own_people
    from gmrdata.solve.video import solve_video
    from gmrdata.solve.video_verdict import VideoVerdict

    bodies = _given(video.poses_path, each, out, run) if each.has_people(video) else None
    path = solve_video(
        video.path,
        out,
        each.config,
        intrinsics=each.lens,
        bodies=bodies,
        part=each.part,
        fps_hz=each.fps_hz,
        run=run,
    )
    verdict = VideoVerdict.read(path)
    fuse_own_people(out, bodies.body_path if bodies and each.has_own(video) else None, run=run)
    if not any(person.accepted for person in verdict.people):
        _write_cameras(out, out / verdict.images_dir, verdict)
    return verdict


def leave_page(out: Path, verdict: "VideoVerdict", *, page: bool) -> Path | None:
    """Files to take along of people, and the page where it is wanted; gives its path."""
    from gmrdata.cli.video_page import write_files, write_page

    images = out / verdict.images_dir  # an absolute path stays as it is
    if page:
        return write_page(out, images=images)
    write_files(out, images=images)
    return None


def _masks(
    names: tuple[str, ...],
    model: Path | None,
    landmarks: Path | None,
    weights: Path | None,
    classes: tuple[str, ...],
) -> "MasksConfig | None":
    from gmrdata.people.sources import masks_named, network_files

    flags.need(names, "a source of masks: --masks person, or none")
    if names == NO_MASKS:
        return None
    if "silhouette" in names:
        what = "silhouette needs a body before any camera is known. Use person"
        raise BadRecipe(f"--masks: {what}")
    # Absolute, since a worker of another machine may run in another folder.
    model, landmarks, weights = (file and file.absolute() for file in (model, landmarks, weights))
    config = masks_named(names, model=model, landmarks=landmarks, weights=weights, classes=classes)
    try:
        network_files(config)
    except MissingInput as error:
        raise MissingInput(f"{error}; --masks none goes without") from None
    return config


def _lens(
    focal_px: float | None, fov_deg: float | None, file: Path | None
) -> "GivenIntrinsics | None":
    from pydantic import ValidationError

    from gmrdata.cameras.lens.intrinsics import GivenIntrinsics

    given = {"focal_px": focal_px, "fov_deg": fov_deg, "file": file}
    named = {key: value for key, value in given.items() if value is not None}
    if len(named) > 1:
        raise BadRecipe("give one of --focal, --fov and --intrinsics, or none of them")
    try:
        return GivenIntrinsics.model_validate(named) if named else None
    except ValidationError as error:
        found = error.errors()[0]
        flag = str(found["loc"][0]).split("_")[0]
        raise BadRecipe(f"--{flag} {found['input']}: {found['msg']}") from None


def _given(poses: Path | None, each: "EachVideo", out: Path, run: Run) -> "GivenBodies":
    """The poses' file if there is one, and the body for them, which is kept beside the result."""
    from gmrdata.read.bodies import keep_body
    from gmrdata.solve.video import GivenBodies

    body_path = keep_body(chosen_body(each.body), out / "body", run=run)
    return GivenBodies(poses, body_path, asked=each.own_poses != "seen")


def chosen_body(body: str) -> str:
    """The body that people of poses get: of a folder the neutral one, whose shapes theirs are."""
    from gmrdata.read.bodies import body_file

    return str(body_file(body, "smpl-neutral")) if Path(body).expanduser().is_dir() else body


def _write_cameras(out: Path, images: Path, verdict: "VideoVerdict") -> None:
    """Cameras alone as a COLMAP model and as TUM's trajectory, in their own unit and world; none of
    a rejected video, and nothing of what an earlier run had accepted."""
    from gmrdata.export.formats import seen_points, write_background
    from gmrdata.read.video import video_record
    from gmrdata.world.background import load_background
    from gmrdata.write.trajectories import write_tum

    for name in TAKEN_ALONG:
        shutil.rmtree(out / FILES / name, ignore_errors=True)
    if not verdict.accepted:
        return
    sfm_dir, colmap = out / "sfm", out / FILES / "colmap"
    found = load_background(sfm_dir, None)
    names, points = seen_points(found, sfm_dir, "keyframes")
    known = found.camera.has_camera
    colmap.mkdir(parents=True)
    write_background(colmap, found, names, points, images)
    video = video_record(images)
    times_s = np.arange(len(known)) / verdict.fps_hz
    if video is not None:
        times_s = video.times_of(found.image_numbers)
    write_tum(
        out / FILES / "tum" / "camera.txt", found.camera.world_from_cam[known], times_s[known]
    )


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
        console.print(line, markup=False, soft_wrap=True)


def _show_plan(source: Path, each: "EachVideo", poses: Path | None) -> None:
    """What would be done with so many images, and about how long it takes."""
    from gmrdata.read.video_files import NamedVideo

    n_images, (width_px, height_px), seconds = plan(NamedVideo("", source, poses), each)
    rows = [(name, f"{s:.0f}") for name, s in seconds.items() if s]
    print_table(("stage", "about [s]"), [*rows, ("all", f"{sum(seconds.values()):.0f}")])
    answer(f"{source}: {n_images} images of {width_px}x{height_px} px")


def plan(
    video: "NamedVideo", each: "EachVideo"
) -> tuple[int, tuple[int, int], Mapping[str, float]]:
    """Images of a video, their size [px], and about how long each stage takes [s]."""
    from gmrdata.read.frames import check_images, list_images
    from gmrdata.read.video import count_images, is_video

    if is_video(video.path):
        n_images, size_px = count_images(video.path, each.part)
    else:
        images = list_images(video.path)
        n_images, size_px = len(images), check_images(images)
    share = size_px[0] * size_px[1] / (1280 * 720)
    seconds = {
        "frames": n_images * FRAME_S * share if is_video(video.path) else 0.0,
        "masks": n_images * MASK_S * max(1.0, share) if each.config.masks is not None else 0.0,
        "intrinsics": INTRINSICS_S * each.config.intrinsics.look_in_frames,
        "sfm": SFM_START_S + n_images * SFM_S * min(1.5, max(0.3, share)),
        "own poses": n_images * OWN_POSE_S if each.has_own(video) else 0.0,
        "bodies": BODIES_S + n_images * BODY_S if each.has_people(video) else 0.0,
    }
    return n_images, size_px, seconds
