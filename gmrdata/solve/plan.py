"""What a dry run says: how many images there are, and about how long each stage takes."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
from gmrdata.cameras.lens.self_calibration import ENOUGH_FRAMES
from gmrdata.read.bodies import load_body
from gmrdata.read.gravity import read_gravity
from gmrdata.read.video import VideoConfig, as_frames, expected_frames, is_video
from gmrdata.read.video_files import NamedVideo, find_videos
from gmrdata.solve.request import (
    DEFAULT_CONFIG,
    SEEN,
    SolveConfig,
    SolveRequest,
    paths_of,
    people_of,
)
from gmrdata.solve.solve import chosen_body, require_of_frames
from gmrdata.solve.videos import VideoBatch, prepared
from gmrdata.stage.progress import track
from gmrdata.values.errors import GmrdataError
from gmrdata.values.frame_set import FrameSet

FRAME_S, MASK_S, QUICK_MASK_S, LENS_S, SFM_S = 0.012, 0.07, 0.05, 0.025, 0.12
BODY_S, OWN_POSE_S, SHOWN_S, QUICK_SHOWN_S = 0.025, 0.03, 0.04, 0.02
SFM_START_S, BODIES_S, INTRINSICS_S, PAGE_S = 5.0, 3.0, 8.0, 4.0
"""Seconds that one image of 1280x720 px takes on two cores, and that all need."""
SFM_IMAGES, SFM_GROWTH = 600, 0.1
"""Images of which cameras take that; each takes longer by a power of how many times as many there
are, whatever their size: small ones have as many features, which take as long."""
START_GB, FRAME_GB = 0.9, 0.00016
"""Memory of the process, and what each image adds; the size of the images adds little."""
JPEG_MB, MASKS_MB, PIXEL_MB = 0.21, 0.03, 1e-6
"""Files of one image of 1280x720 px, its masks, and a pixel of the grey ones that cameras are
sought in, which are made where images are larger and are gone in the end."""
MOST_PICTURES = 900  # of the page's video; a longer one is shown at every second, third, ... image
HEADINGS = ("stage", "about [s]")
BATCH_HEADINGS = ("video", "images", "size [px]", "poses", "about [s]")


class VideoPlan(NamedTuple):
    """What is to be done with one video."""

    n_images: int
    size_px: tuple[int, int]  # (width, height)
    seconds: Mapping[str, float]  # by stage, about; 0 for a stage that isn't asked for
    disk_gb: float = 0.0  # That its files take up at most, about

    @property
    def memory_gb(self) -> float:
        """Largest memory of the process, about."""
        return START_GB + self.n_images * FRAME_GB

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Rows of `HEADINGS`, and one for all."""
        stages = [(name, f"{s:.0f}") for name, s in self.seconds.items() if s]
        return [*stages, ("all", f"{sum(self.seconds.values()):.0f}")]

    def summary(self, source: Path) -> str:
        images = "{}: {} images of {}x{} px".format(source, self.n_images, *self.size_px)
        disk = f" and {self.disk_gb:.1f} GB of disk" if self.disk_gb >= 0.05 else ""
        return f"{images}, about {self.memory_gb:.1f} GB of memory{disk}"


def plan_video(request: SolveRequest, config: SolveConfig) -> VideoPlan:
    """By the file's own word, or by the images of a folder; errors as of `SolveRequest.check`, and
    of reading them."""
    estimated = request.check()
    people = request.people
    asked = {
        "frames": True,
        "masks": config.masks is not None,
        "intrinsics": config.intrinsics.look_in_frames,
        "sfm": True,
        "own poses": request.has_own_people,
        "bodies": people is not None,
        "page": True,
    }
    stages = [name for name, is_on in asked.items() if is_on]
    frames = planned_frames(request.source, request.part).with_rate(request.fps_hz)
    if request.part is not None and request.part.take_what_decodes:
        estimated = None  # nobody knows how many do
    require_of_frames(request, estimated, frames, config)
    if request.gravity_path is not None and people is not None:
        read_gravity(request.gravity_path, frames)
    planned = plan_stages(frames, stages, alone=people is None)
    n_pixels = planned.size_px[0] * planned.size_px[1]
    shrink = min(1.0, config.sfm.max_image_size_px / max(planned.size_px))
    image_mb = MASKS_MB * asked["masks"] + (PIXEL_MB * n_pixels * shrink**2 if shrink < 1 else 0.0)
    image_mb += JPEG_MB * n_pixels / (1280 * 720) if is_video(request.source) else 0.0
    return planned._replace(disk_gb=planned.n_images * image_mb / 1e3)


def planned_frames(source: Path, part: VideoConfig | None) -> FrameSet:
    """Those of a folder, or about those of a video; errors as of reading them."""
    if is_video(source):
        return expected_frames(source, part or VideoConfig())
    return as_frames(source, Path(), part)  # as they are: nothing is made of a folder


def plan_stages(frames: FrameSet, stages: Sequence[str], *, alone: bool = False) -> VideoPlan:
    """Some stages of `planned_frames`, for people or for cameras `alone`."""
    mask_s, shown_s = (QUICK_MASK_S, QUICK_SHOWN_S) if alone else (MASK_S, SHOWN_S)
    n_images, size_px = len(frames.numbers), frames.size_px
    share = size_px[0] * size_px[1] / (1280 * 720)
    seconds = {
        "frames": n_images * FRAME_S * share if frames.video_path else 0.0,
        "masks": n_images * mask_s * max(1.0, share),
        "intrinsics": INTRINSICS_S + min(n_images, ENOUGH_FRAMES) * LENS_S,
        "sfm": SFM_START_S + n_images * SFM_S * (n_images / SFM_IMAGES) ** SFM_GROWTH,
        "own poses": n_images * OWN_POSE_S,
        "bodies": BODIES_S + n_images * BODY_S,
        "page": PAGE_S + min(n_images, MOST_PICTURES) * shown_s,
    }
    return VideoPlan(n_images, size_px, {name: s * (name in stages) for name, s in seconds.items()})


class PlannedVideos(NamedTuple):
    """What is to be done with one video, or with each of a batch."""

    is_of_one: bool
    rows: Sequence[tuple[str, ...]]  # of `HEADINGS` or `BATCH_HEADINGS`, and one for all
    summary: str
    unreadable: Sequence[str] = ()  # why videos of a batch can't be read


def plan_videos(
    sources: str | Path | Iterable[str | Path],
    *,
    poses: str | Path | None = SEEN,
    body: str = "anny",
    lens: GivenIntrinsics | None = None,
    fps_hz: float | None = None,
    gravity: str | Path | None = None,
    part: VideoConfig | None = None,
    config: SolveConfig = DEFAULT_CONFIG,
) -> PlannedVideos:
    """The plan of `solve_video`, or for several of `solve_videos`, and about how long it takes on
    two cores; nothing is made.  Heights and gravity change neither.  Errors as there."""
    paths = paths_of(sources)
    people, results = people_of(poses, body, config, gravity)
    if people is not None or results is not None:
        load_body(chosen_body(body))
    felt = None if gravity is None else Path(gravity)
    request = SolveRequest(paths[0], people, lens, fps_hz, part, felt)
    videos = find_videos(paths)
    if videos is None:
        planned = plan_video(request.of(NamedVideo("", paths[0], results), body), config)
        return PlannedVideos(True, planned.rows, planned.summary(paths[0]))
    batch = VideoBatch(Path(), request, config, body)
    return plan_batch(prepared(videos, batch, results).videos, batch)


def plan_batch(videos: Sequence[NamedVideo], batch: VideoBatch) -> PlannedVideos:
    """Plan every video; those that can't be read are listed with the reason."""
    rows: list[tuple[str, ...]] = []
    bad, n_images, all_s, most_gb = [], 0, 0.0, 0.0
    for video in track(videos, "looking at videos"):
        request = batch.of(video)
        own = "" if request.people is None else "own"
        poses = own if video.poses_path is None else video.poses_path.name
        try:
            planned = plan_video(request, batch.config)
        except GmrdataError as error:
            rows.append((video.name, "-", "-", poses, "-"))
            bad.append(str(error))
            continue
        n, about_s = planned.n_images, sum(planned.seconds.values())
        n_images, all_s, most_gb = n_images + n, all_s + about_s, max(most_gb, planned.memory_gb)
        size = "{}x{}".format(*planned.size_px)
        rows.append((video.name, str(n), size, poses, f"{about_s:.0f}"))
    n_read = len(rows) - len(bad)
    rows.append(("all", str(n_images), "", "", f"{all_s:.0f}"))
    says = f"{n_read} videos, {n_images} images: about {all_s / 3600:.2g} h on two cores"
    says += f", up to {most_gb:.1f} GB of memory for each at work" if n_read else ""
    return PlannedVideos(False, rows, says, bad)
