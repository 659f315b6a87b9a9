"""Many videos by one command: what the verb video does with a batch."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gmrdata.cli.answers import answer, fail, print_table, then
from gmrdata.cli.video import chosen_body, leave_page, plan, solve_one
from gmrdata.stage.progress import remark, track
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadFrames, BadRecipe, GmrdataError

if TYPE_CHECKING:
    from gmrdata.read.video_files import FoundVideos, NamedVideo
    from gmrdata.solve.videos import EachVideo, VideoEntry

HEADINGS = ("video", "state", "frames", "people", "reasons")
PLAN_HEADINGS = ("video", "images", "size [px]", "poses", "about [s]")


def prepare(found: "FoundVideos", each: "EachVideo", poses: Path | None) -> "FoundVideos":
    """The videos with their poses.

    Raises:
        BadRecipe: what is asked can only be of one video, or of folders of images.
        MissingInput: there are no such poses.
    """
    from gmrdata.people.sources import FolderSource
    from gmrdata.read.video import is_video
    from gmrdata.read.video_files import with_poses

    sources = () if each.config.masks is None else each.config.masks.sources
    if any(isinstance(source, FolderSource) for source in sources):
        raise BadRecipe("--masks: a folder of masks is of one video. Solve that one alone")
    folders = [video.path for video in found.videos if not is_video(video.path)]
    if folders and each.fps_hz is None:
        raise BadRecipe(f"{folders[0]}: a folder of images has no frame rate. Give it with --fps")
    if each.fps_hz is not None and not folders:
        raise BadRecipe("--fps: videos have their own times. Leave it out")
    found = found if poses is None else with_poses(found, poses)
    for line in found.remarks:
        remark(line)
    return found


def solve(found: "FoundVideos", out: Path, each: "EachVideo", run: Run, strict: bool) -> None:
    """Solve the videos of a batch, say which were rejected, and write the index."""
    from gmrdata.solve.videos import Videos, solve_videos

    with then(lambda: _show(out)):
        record = solve_videos(found.videos, out, _with_files(found, each), solve_listed, run)
    n_rejected = len(Videos.read(record).in_state("rejected"))
    if strict and n_rejected:
        fail(f"{out}: {n_rejected} of {len(found.videos)} videos were rejected")


def solve_listed(video: "NamedVideo", out_dir: Path, each: "EachVideo", run: Run) -> "VideoEntry":
    """A job: one video in its own folder, with page and files, as if it were alone."""
    from gmrdata.solve.video_verdict import VideoVerdict
    from gmrdata.solve.videos import make_entry, video_dir

    folder = video_dir(out_dir, video.name)

    def work() -> VideoVerdict:
        verdict = solve_one(video, folder, replace(each, fps_hz=each.fps_of(video)), run)
        leave_page(folder, verdict, page=each.page)
        return verdict

    return make_entry(video, out_dir, each, work, run)


def _with_files(found: "FoundVideos", each: "EachVideo") -> "EachVideo":
    """With all files that the videos have in common, found once."""
    from gmrdata.people.sources import network_files
    from gmrdata.read.bodies import ANNY_FILE
    from gmrdata.solve.video import own_networks

    files = {} if each.config.masks is None else network_files(each.config.masks)
    lens = each.lens
    if lens is not None and lens.file is not None:
        files |= {"intrinsics": lens.file.absolute()}
        lens = lens.model_copy(update={"file": lens.file.absolute()})
    each = replace(each, files=files, lens=lens)
    if not any(each.has_people(video) for video in found.videos):
        return each
    if each.own_poses != "no":
        each = replace(each, own_files=own_networks(each.config))
    if (body := chosen_body(each.body)) == "anny":
        return replace(each, body_files={"body": ANNY_FILE})
    path = Path(body).expanduser().absolute()
    return replace(each, body=str(path), body_files={"body": path})


def _show(out: Path) -> None:
    """Write the index, and say which videos were rejected or failed and how many of each."""
    from gmrdata.pages.batches import write_videos_page
    from gmrdata.solve.videos import RECORD_FILE, Videos

    record = Videos.read(out / RECORD_FILE)
    counts = {state: record.in_state(state) for state in ("accepted", "rejected", "failed")}
    rows = [
        (one.name, state, str(one.frames), str(one.people), "; ".join(one.reasons))
        for state in ("rejected", "failed")
        for one in counts[state]
    ]
    if rows:
        print_table(HEADINGS, rows)
    answer(", ".join(f"{len(found)} {state}" for state, found in counts.items()))
    answer(write_videos_page(out))
    answer(out / RECORD_FILE)


def show_plan(found: "FoundVideos", each: "EachVideo") -> None:
    """What would be done with each video, and about how long it takes; BadFrames if some can't."""
    rows, bad, n_images, all_s = [], [], 0, 0.0
    for video in track(found.videos, "looking at videos"):
        own = "own" if each.has_own(video) else ""
        poses = own if video.poses_path is None else video.poses_path.name
        try:
            n, size_px, seconds = plan(video, each)
        except GmrdataError as error:
            rows.append((video.name, "-", "-", poses, "-"))
            bad.append(str(error))
            continue
        about_s = sum(seconds.values())
        n_images, all_s = n_images + n, all_s + about_s
        rows.append((video.name, str(n), "{}x{}".format(*size_px), poses, f"{about_s:.0f}"))
    print_table(PLAN_HEADINGS, [*rows, ("all", str(n_images), "", "", f"{all_s:.0f}")])
    n_read = len(rows) - len(bad)
    answer(f"{n_read} videos, {n_images} images: about {all_s / 3600:.2g} h on two cores")
    if bad:
        listed = "".join(f"\n  {reason}" for reason in bad)
        raise BadFrames(f"{len(bad)} of {len(rows)} videos can't be read:{listed}")
