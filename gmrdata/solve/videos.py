"""Many videos as one batch: each a job of its own with a line for it, and one record of all."""

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import NonNegativeInt
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.lens.intrinsics import INTRINSICS_FILE, GivenIntrinsics, load_intrinsics
from gmrdata.people.sources import (
    FolderSource,
    network_files,
    sources_dir,
    without_files,
)
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.video import VideoConfig, has_times
from gmrdata.read.video_files import FoundVideos, NamedVideo, find_videos, with_poses
from gmrdata.solve.request import (
    AGAIN,
    BODY,
    DEFAULT_CONFIG,
    FOLLOWED,
    FRAMES,
    INTRINSICS,
    LINES,
    MASKS,
    OWN_POSES,
    SEEN,
    SFM,
    PeopleBySystem,
    SolveConfig,
    SolveRequest,
    paths_of,
    people_of,
)
from gmrdata.solve.solve import chosen_body, solve
from gmrdata.solve.verdict import (
    FILES,
    OVERLAY,
    PAGE,
    VERDICT_FILE,
    VIEW,
    VideoVerdict,
    forget_result,
    judge_video,
)
from gmrdata.stage.jobs import Job, raise_failures, try_batch
from gmrdata.stage.progress import remark
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import FRAMES_ROLE, NotMade, StageRecord, run_stage
from gmrdata.values.camera import Source
from gmrdata.values.errors import BadRecipe, BadRecord, MissingInput, StaleOutput
from gmrdata.values.files import STAGE_FILE, json_text, remove_orphans, sha256_of_file
from gmrdata.values.frame_set import require_rate
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT
from gmrdata.values.records import PART, Config, Figure, Record, with_absolute_paths

VIDEOS, ENTRIES, FAILED = "videos", "entries", "failed"
"""Folders of a batch: the videos' own, their lines, and the reasons of those that failed."""
RECORD_FILE, ENTRY_FILE = "videos.json", "entry.json"
SOLVING = "solving videos"
PARTS = (
    FRAMES, FOLLOWED, MASKS, sources_dir(Path(MASKS)).name, INTRINSICS, SFM, AGAIN, OWN_POSES,
    LINES, BODIES, PSEUDO_GT, FUSED, BODY, FILES, VERDICT_FILE, PAGE, VIEW, OVERLAY,
)  # fmt: skip
"""What a video's folder may hold."""
OwnPoses = Literal["no", "seen", "asked"]
"""People by the built-in estimator: none; whom it sees; or so that one of them must be accepted."""


@part(frozen=True, config=PART)
class VideoEntry:
    """What became of one video."""

    name: str
    accepted: bool
    failed: bool
    """It could not be solved at all, as a broken file can't."""
    reasons: tuple[str, ...]
    """Why it was rejected, or why it failed."""
    frames: NonNegativeInt
    kept_frames: NonNegativeInt
    """Frames whose camera can be used."""
    fps_hz: Figure | None
    """Images per second; null where it failed, as below."""
    focal_px: Figure | None
    """Focal length along x [px]."""
    focal_sigma: Figure | None
    """Its standard error, as a share of it."""
    focal_from: Source | None
    people: NonNegativeInt
    """0 for cameras alone."""
    accepted_people: NonNegativeInt

    @property
    def state(self) -> str:
        return "failed" if self.failed else "accepted" if self.accepted else "rejected"


class Videos(Record):
    """`videos.json`: what became of each video of a batch."""

    format: Literal["gmrdata-videos/1"] = "gmrdata-videos/1"
    videos: tuple[VideoEntry, ...]
    """In the order of their names."""

    def in_state(self, state: str) -> list[VideoEntry]:
        return [video for video in self.videos if video.state == state]


class EntryRecord(Record):
    """`entry.json`: one video's line of `videos.json`, and what was left in its folder."""

    format: Literal["gmrdata-video-entry/1"] = "gmrdata-video-entry/1"
    video: VideoEntry
    parts: tuple[str, ...]


After = Callable[[Path, VideoVerdict], object]
"""What is made of a solved video's folder besides, such as its page: a module-level function."""


@dataclass(frozen=True)
class VideoBatch:
    """What is asked of every video of a batch."""

    out_dir: Path
    request: SolveRequest  # of each, by `SolveRequest.of`
    config: SolveConfig
    body: str = "anny"  # of people whom another system sees
    after: After | None = None
    leaves: tuple[str, ...] = ()  # what `after` leaves in each video's folder
    files: Mapping[str, Path] = field(default_factory=dict)
    """What all videos read besides, by role: a calibration."""
    networks: Mapping[bool, Mapping[str, Path]] = field(default_factory=dict)
    """The masks' networks by role, of videos without people and of those with them."""
    body_files: Mapping[str, Path] = field(default_factory=dict)
    """The body's, for videos with people."""
    own_files: Mapping[str, Path] = field(default_factory=dict)
    """Networks, for people by the built-in estimator."""

    def of(self, video: NamedVideo) -> SolveRequest:
        request = self.request.of(video, self.body)
        return replace(request, fps_hz=None) if has_times(video.path) else request

    def folder(self, video: NamedVideo) -> Path:
        return video_dir(self.out_dir, video.name)

    def inputs(self, video: NamedVideo) -> dict[str, Path]:
        people = self.of(video).people
        role = FRAMES_ROLE if video.path.is_dir() else "video"
        paths = {role: video.path, **self.files, **self.networks.get(people is not None, {})}
        if isinstance(people, PeopleBySystem):
            results_path = people.results_path
            paths |= self.own_files if results_path is None else {"poses": results_path}
            paths |= self.body_files
        return paths

    def recipe(self, video: NamedVideo) -> "_EntryRecipe":
        request = self.of(video)
        config = self.config if request.people else self.config.for_cameras_alone
        masks = None if config.masks is None else without_files(config.masks)
        people, lens = request.people, request.lens
        estimated = people if isinstance(people, PeopleBySystem) else None
        own: OwnPoses = "no"
        if estimated is not None and request.has_own_people:
            own = "asked" if estimated.asked else "seen"
        return _EntryRecipe(
            solve=config.model_copy(update={"masks": masks}),
            part=request.part or VideoConfig(),
            focal_px=None if lens is None else lens.focal_px,
            fov_deg=None if lens is None else lens.fov_deg,
            fps_hz=request.fps_hz,
            body=None if estimated is None else Path(estimated.body).name,
            own_poses=own,
        )


class _EntryRecipe(Config):
    """What decides the result beside the files that are read."""

    solve: SolveConfig
    part: VideoConfig
    focal_px: float | None
    fov_deg: float | None
    fps_hz: float | None
    body: str | None
    own_poses: OwnPoses


def video_dir(out_dir: Path, name: str) -> Path:
    """Where a video of a batch has its own folder, as if it had been solved alone."""
    return out_dir / VIDEOS / name


def solve_alone(
    request: SolveRequest, out_dir: Path, config: SolveConfig, run: Run, after: After | None = None
) -> VideoVerdict:
    """One video with all of its stages, its `verdict.json`, and what is made of it besides.

    An earlier verdict that said something else goes with all that shows it.
    """
    verdict = judge_video(solve(request, out_dir, config, run))
    path, text = out_dir / VERDICT_FILE, json_text(verdict.model_dump(mode="json"))
    if path.is_file() and path.read_bytes() != text.encode():
        forget_result(out_dir)
    verdict.write(path)
    if after is not None:
        after(out_dir, verdict)
    return verdict


def solve_video(
    source: str | Path,
    out_dir: str | Path,
    *,
    poses: str | Path | None = SEEN,
    body: str = "anny",
    lens: GivenIntrinsics | None = None,
    fps_hz: float | None = None,
    height_m: float | Mapping[str, float] | None = None,
    gravity: str | Path | None = None,
    part: VideoConfig | None = None,
    config: SolveConfig = DEFAULT_CONFIG,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Cameras of any video, and people's motion in a metric world; gives `verdict.json`'s path.

    A video without a camera path is no error: it is rejected, and the verdict says why.

    Args:
        source: A video file, or its `part`, or a folder of numbered images.
        out_dir: Gets a folder of each stage; what is there is kept.
        poses: People before the camera: a file or folder of another system.  Without it, people of
            the built-in estimator, if its networks were fetched.  "own" demands that one of these
            is accepted; "none" is for cameras alone.
        body: "anny", or the path of a body model, or a folder of them.
        lens: The images' lens, as far as it is known.
        fps_hz: Images per second of a folder; None for a video, which has times.
        height_m: How tall people are without shoes [m]: all of them, or by name ("person_0").
            Without it the mean body stands for them, with an error of 7 %.
        gravity: The phone's own gravity while it filmed, as `gmrdata.read.gravity` takes it:
            record3d's `metadata`, Stray Scanner's `odometry.csv`, or a table.  It levels the world.

    Raises:
        BadRecipe: a folder without a rate, or a video with one.
        BadFrames, MissingInput, BadMotionFile: as the stages raise them.
        StaleOutput: `out_dir` holds a batch, or as the stages raise it.
    """
    if (Path(out_dir) / RECORD_FILE).exists():
        remedy = f"Pass one of its videos' folders as --out, in {VIDEOS}/, or solve all of them"
        raise StaleOutput(f"{out_dir}: holds a batch. {remedy}")
    config = config.with_heights(height_m)
    people, results_path = people_of(poses, body, config, gravity)
    felt = None if gravity is None else Path(gravity)
    request = SolveRequest(Path(source), people, lens, fps_hz, part, felt)
    video = NamedVideo("", Path(source), results_path)
    solve_alone(request.of(video, body), Path(out_dir), config, run)
    return Path(out_dir) / VERDICT_FILE


def solve_videos(
    sources: str | Path | Iterable[str | Path],
    out_dir: str | Path,
    *,
    poses: str | Path | None = SEEN,
    body: str = "anny",
    lens: GivenIntrinsics | None = None,
    fps_hz: float | None = None,
    height_m: float | Mapping[str, float] | None = None,
    part: VideoConfig | None = None,
    config: SolveConfig = DEFAULT_CONFIG,
    after: After | None = None,
    leaves: tuple[str, ...] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Many videos, each as `solve_video` does it, as jobs on Dask; gives the path of `videos.json`.

    Args:
        sources: Video files and folders of numbered images, or one folder with video files.
        out_dir: Gets `videos/<name>/` of each.
        height_m: As of `solve_video`, in every video.
        poses: As of `solve_video`; files of systems are in a folder, as `<name>.pkl`, `.pt`,
            `.npz` or `<name>/` for each video that has people.
        after: A module-level function for each solved video's folder.
        leaves: Files that it leaves in the folder: without them the video is solved again.

    Raises:
        StageFailed: some videos failed; the record lists them, and the others are done.
        BadRecipe, MissingInput: of what was given.
    """
    paths = paths_of(sources)
    videos = find_videos(paths)
    if videos is None:
        raise BadRecipe(f"{paths[0]}: is one video. Use solve_video")
    config = config.with_heights(height_m)
    people, results_dir = people_of(poses, body, config)
    request = SolveRequest(Path(), people, lens, fps_hz, part)
    batch = VideoBatch(Path(out_dir), request, config, body, after, leaves)
    return solve_batch(prepared(videos, batch, results_dir).videos, batch, run)


def prepared(found: FoundVideos, batch: VideoBatch, poses_dir: Path | None) -> FoundVideos:
    """The videos with the results of systems that a folder holds; what was passed over is said.

    Raises:
        BadRecipe: what is asked can only be of one video, or of folders of images.
        MissingInput: there are no such results.
    """
    sources = () if batch.config.masks is None else batch.config.masks.sources
    if any(isinstance(source, FolderSource) for source in sources):
        raise BadRecipe("--masks: a folder of masks is of one video. Solve that one alone")
    # Where some have no times, the rate is theirs.
    for path in sorted((video.path for video in found.videos), key=has_times)[:1]:
        require_rate(path, batch.request.fps_hz, has_times=has_times(path))
    found = found if poses_dir is None else with_poses(found, poses_dir)
    for line in found.remarks:
        remark(line)
    return found


def solve_batch(videos: Sequence[NamedVideo], batch: VideoBatch, run: Run) -> Path:
    """Solve videos as independent jobs, and write `videos.json`; gives its path.

    A video that fails leaves its reason in `failed/<name>.txt`, and the others go on.  Where
    nothing is left to make, no worker starts.

    Raises:
        StageFailed: some videos failed; the record lists them.
        OthersLeft: this shard is done, and others are not.
        StaleOutput: the folder holds one video's own result.
    """
    if (batch.out_dir / VERDICT_FILE).exists():
        raise StaleOutput(f"{batch.out_dir}: holds one video's result. Pass another --out")
    batch = _with_files(videos, replace(batch, out_dir=batch.out_dir.resolve()))
    out_dir, failures_dir = batch.out_dir, batch.out_dir / FAILED
    for folder in (out_dir, failures_dir):
        remove_orphans(folder)
    common = {"batch": batch, "run": run}
    jobs = [Job(video.name, solve_listed, common | {"video": video}) for video in videos]
    results, reasons = try_batch(SOLVING, jobs, failures_dir, run)
    entries = [*results.values(), *(_failed(name, why) for name, why in reasons.items())]
    entries.sort(key=lambda entry: entry.name)
    Videos(videos=tuple(entries)).write(out_dir / RECORD_FILE)
    raise_failures(SOLVING, reasons, len(jobs), failures_dir)
    return out_dir / RECORD_FILE


def _with_files(videos: Sequence[NamedVideo], batch: VideoBatch) -> VideoBatch:
    """With all files that the videos have in common, found once, by absolute paths: a worker of
    another machine may run in another folder."""
    batch = with_absolute_paths(batch)
    request, config = batch.request, batch.config
    wanted = {batch.of(video).people is not None for video in videos}
    if (masks := config.masks) is not None:
        by = {people: masks if people else masks.for_cameras_alone for people in wanted}
        batch = replace(batch, networks={people: network_files(of) for people, of in by.items()})
    if request.lens is not None and request.lens.file is not None:
        batch = replace(batch, files={"intrinsics": request.lens.file})
    if True not in wanted:
        return batch
    if isinstance(request.people, PeopleBySystem):
        batch = replace(batch, own_files=config.networks)
    if (body := chosen_body(batch.body)) == "anny":
        return replace(batch, body_files={"body": ANNY_FILE})
    body_path = Path(body).expanduser().absolute()
    if isinstance(request.people, PeopleBySystem):
        request = replace(request, people=replace(request.people, body=str(body_path)))
    return replace(batch, request=request, body=str(body_path), body_files={"body": body_path})


def solve_listed(video: NamedVideo, batch: VideoBatch, run: Run) -> VideoEntry:
    """A job: one video in its own folder as if it were alone, and the stage `entries/<name>` with
    its line.

    A video whose folder has lost a part since, or was solved alone, is solved again, which makes
    what is missing, and refuses what other settings made.
    """
    folder, entry_dir = batch.folder(video), batch.out_dir / ENTRIES / video.name
    if (entry_dir / STAGE_FILE).is_file() and not _is_whole(entry_dir, folder, batch):
        if run.only_look:
            raise NotMade(entry_dir)
        shutil.rmtree(entry_dir)
    solve_it = partial(solve_alone, batch.of(video), folder, batch.config, run, batch.after)

    def work(partial_dir: Path) -> dict[str, str]:
        entry = _entry(video.name, folder, solve_it())
        there = tuple(sorted(name for name in PARTS if (folder / name).exists()))
        EntryRecord(video=entry, parts=there).write(partial_dir / ENTRY_FILE)
        return _hashes(folder)

    run_stage("video", entry_dir, batch.recipe(video), batch.inputs(video), work, run=run)
    return EntryRecord.read(entry_dir / ENTRY_FILE).video


def _is_whole(entry_dir: Path, folder: Path, batch: VideoBatch) -> bool:
    """Whether a video's folder still holds what its line was written of, and what is asked now."""
    try:
        record = EntryRecord.read(entry_dir / ENTRY_FILE)
        is_same = StageRecord.of(entry_dir).facts == _hashes(folder)
    except (MissingInput, BadRecord):
        return False
    return is_same and all((folder / name).exists() for name in (*record.parts, *batch.leaves))


def _hashes(folder: Path) -> dict[str, str]:
    """Of what a video's line is written of: the video may be solved alone since, in its folder."""
    names = (VERDICT_FILE, f"{INTRINSICS}/{INTRINSICS_FILE}")
    return {name: sha256_of_file(folder / name) for name in names}


def _entry(name: str, folder: Path, verdict: VideoVerdict) -> VideoEntry:
    lens = load_intrinsics(folder / INTRINSICS)
    return VideoEntry(
        name=name,
        accepted=verdict.accepted,
        failed=False,
        reasons=verdict.reasons,
        frames=verdict.camera.frames,
        kept_frames=verdict.camera.kept_frames,
        fps_hz=verdict.fps_hz,
        focal_px=lens.focal_px,
        focal_sigma=lens.focal_sigma,
        focal_from=lens.source,
        people=len(verdict.people),
        accepted_people=sum(person.accepted for person in verdict.people),
    )


def _failed(name: str, reason: str) -> VideoEntry:
    return VideoEntry(
        name=name, accepted=False, failed=True, reasons=(reason.splitlines()[0],),
        frames=0, kept_frames=0, fps_hz=None, focal_px=None, focal_sigma=None, focal_from=None,
        people=0, accepted_people=0,
    )  # fmt: skip
