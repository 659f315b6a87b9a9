"""Many videos as one batch: each a job of its own with a line for it, and one record of all."""

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import NonNegativeInt
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics, load_intrinsics
from gmrdata.people.sources import sources_dir, without_files
from gmrdata.read.video import VideoConfig, is_video
from gmrdata.read.video_files import NamedVideo
from gmrdata.solve.video import (
    AGAIN,
    FRAMES,
    INTRINSICS,
    MASKS,
    OWN_POSES,
    SFM,
    VideoSolveConfig,
)
from gmrdata.solve.video_verdict import VERDICT_FILE, VideoVerdict
from gmrdata.stage.jobs import Job, Outcome, raise_failures, try_here, try_jobs, worker_pool
from gmrdata.stage.run import Run
from gmrdata.stage.store import NotMade, run_stage
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import STAGE_FILE, remove_orphans
from gmrdata.values.lens import Source
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT
from gmrdata.values.records import PART, Config, Figure, Record

VIDEOS, ENTRIES, FAILED = "videos", "entries", "failed"
"""Folders of a batch: the videos' own, their lines, and the reasons of those that failed."""
RECORD_FILE, ENTRY_FILE = "videos.json", "entry.json"
SOLVING = "solving videos"
BODY, FILES, PAGE, OVERLAY = "body", "files", "index.html", "overlay"
PARTS = (
    FRAMES, MASKS, sources_dir(Path(MASKS)).name, INTRINSICS, SFM, AGAIN, OWN_POSES, BODIES,
    PSEUDO_GT, FUSED, BODY, FILES, VERDICT_FILE, PAGE, OVERLAY,
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


@dataclass(frozen=True)
class EachVideo:
    """What is asked of every video of a batch."""

    config: VideoSolveConfig
    part: VideoConfig
    lens: GivenIntrinsics | None = None
    fps_hz: float | None = None
    """Of folders of images."""
    body: str = "anny"
    """The body of people, as `keep_body` takes it."""
    own_poses: OwnPoses = "no"
    """People by the built-in estimator, in videos without poses of another system."""
    page: bool = True
    files: Mapping[str, Path] = field(default_factory=dict)
    """What all videos read besides, by role: networks, a calibration."""
    body_files: Mapping[str, Path] = field(default_factory=dict)
    """The body's, for videos with people."""
    own_files: Mapping[str, Path] = field(default_factory=dict)
    """Networks, for people by the built-in estimator."""

    def fps_of(self, video: NamedVideo) -> float | None:
        return None if is_video(video.path) else self.fps_hz

    def has_people(self, video: NamedVideo) -> bool:
        """Whether people are asked for."""
        return self.has_own(video) or video.poses_path is not None

    def has_own(self, video: NamedVideo) -> bool:
        """Whether the built-in estimator looks for them."""
        return self.own_poses != "no" and video.poses_path is None

    def inputs(self, video: NamedVideo) -> dict[str, Path]:
        found = {"video": video.path, **self.files}
        if video.poses_path is not None:
            found["poses"] = video.poses_path
        if self.has_people(video):
            found |= self.body_files
        if self.has_own(video):
            found |= self.own_files
        return found

    def recipe(self, video: NamedVideo) -> "_EntryRecipe":
        masks = None if self.config.masks is None else without_files(self.config.masks)
        return _EntryRecipe(
            solve=self.config.model_copy(update={"masks": masks}),
            part=self.part,
            focal_px=None if self.lens is None else self.lens.focal_px,
            fov_deg=None if self.lens is None else self.lens.fov_deg,
            fps_hz=self.fps_of(video),
            body=Path(self.body).name if self.has_people(video) else None,
            own_poses=self.own_poses if self.has_own(video) else "no",
        )


class _EntryRecipe(Config):
    """What decides the result beside the files that are read."""

    solve: VideoSolveConfig
    part: VideoConfig
    focal_px: float | None
    fov_deg: float | None
    fps_hz: float | None
    body: str | None
    own_poses: OwnPoses


def video_dir(out_dir: Path, name: str) -> Path:
    """Where a video of a batch has its own folder, as if it had been solved alone."""
    return out_dir / VIDEOS / name


def make_entry(
    video: NamedVideo,
    out_dir: Path,
    each: EachVideo,
    solve: Callable[[], VideoVerdict],
    run: Run,
) -> VideoEntry:
    """Stage: `entries/<name>`, once `solve` has filled the video's folder; gives its line.

    A video whose folder has lost a part since is solved again, which makes what is missing.
    """
    folder, entry_dir = video_dir(out_dir, video.name), out_dir / ENTRIES / video.name
    if (entry_dir / STAGE_FILE).is_file() and not _is_whole(entry_dir, folder, each):
        if run.only_look:
            raise NotMade(entry_dir)
        shutil.rmtree(entry_dir)

    def work(partial: Path) -> None:
        entry = _entry(video.name, folder, solve())
        there = tuple(sorted(name for name in PARTS if (folder / name).exists()))
        EntryRecord(video=entry, parts=there).write(partial / ENTRY_FILE)

    run_stage("video", entry_dir, each.recipe(video), each.inputs(video), work, run=run)
    return EntryRecord.read(entry_dir / ENTRY_FILE).video


def _is_whole(entry_dir: Path, folder: Path, each: EachVideo) -> bool:
    """Whether a video's folder still holds what its line was written of, and what is asked now."""
    try:
        record = EntryRecord.read(entry_dir / ENTRY_FILE)
    except (MissingInput, BadRecord):
        return False
    asked = (*record.parts, PAGE) if each.page else record.parts
    return all((folder / name).exists() for name in asked)


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


def solve_videos(
    videos: Sequence[NamedVideo],
    out_dir: Path,
    each: EachVideo,
    call: Callable[..., VideoEntry],
    run: Run,
) -> Path:
    """Solve videos as independent jobs, and write `videos.json`; gives its path.

    A video that fails leaves its reason in `failed/<name>.txt`, and the others go on.  Where
    nothing is left to make, no worker starts.

    Args:
        call: A module-level function of `video`, `out_dir`, `each` and `run` that ends in
            `make_entry`.

    Raises:
        StageFailed: some videos failed; the record lists them.
        OthersLeft: this shard is done, and others are not.
    """
    out_dir = out_dir.resolve()
    failures_dir = out_dir / FAILED
    for folder in (out_dir, failures_dir):
        remove_orphans(folder)
    common = {"out_dir": out_dir, "each": each, "run": run}
    jobs = [
        Job(video.name, call, common | {"video": video}, weight=max(1, video.size_bytes))
        for video in videos
    ]
    results, reasons = _run(jobs, failures_dir, run)
    entries = [*results.values(), *(_failed(name, why) for name, why in reasons.items())]
    entries.sort(key=lambda entry: entry.name)
    Videos(videos=tuple(entries)).write(out_dir / RECORD_FILE)
    raise_failures(SOLVING, reasons, len(jobs), failures_dir)
    return out_dir / RECORD_FILE


def _run(jobs: Sequence[Job], failures_dir: Path, run: Run) -> Outcome:
    """One worker process for each core, or this process where one is asked for."""
    workers = run.workers or min(len(jobs), os.cpu_count() or 1)
    if run.shard is None and run.scheduler is None and workers == 1:
        return try_here(SOLVING, jobs, failures_dir)
    with worker_pool(run, workers) as pool:
        return try_jobs(SOLVING, jobs, pool, failures_dir)
