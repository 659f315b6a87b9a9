"""The page of a solved video, with the files beside it: the verb page, and what others call."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer
from gmrdata.values.errors import GmrdataError


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
            name; their own `frames` when left out.
        body: "anny", or the file of a body model; the one that lies beside the clips when left out.
        files: Write BVH, GLB, AMASS, COLMAP and TUM files of people who were accepted.
    """
    from gmrdata.cli import options as flags
    from gmrdata.export.export import images_of

    flags.need(folders, "a folder of a solved video")
    for folder in folders:
        own, alone = images, len(folders) == 1
        if images is not None:
            own = images_of(images, folder.resolve().name, alone=alone)
        answer(write_page(folder, images=own, body=body, files=files))


def write_page(
    out_dir: Path, *, images: Path | None = None, body: str | None = None, files: bool = True
) -> Path:
    """The page of one solved video, and its files; errors as of `make_video_page`."""
    from gmrdata.pages.solved_page import make_video_page

    left_out = write_files(out_dir, images=images, body=body) if files else ()
    return make_video_page(out_dir, images_dir=images, body=body, left_out=left_out)


def _has_cameras_alone(out_dir: Path) -> bool:
    """Whether the files are of a video that was accepted for its cameras; the verb writes them."""
    from gmrdata.solve.video_verdict import VERDICT_FILE, VideoVerdict

    path = out_dir / VERDICT_FILE
    return path.is_file() and VideoVerdict.read(path).accepted


def write_files(
    out_dir: Path, *, images: Path | None = None, body: str | None = None
) -> Sequence[tuple[str, str]]:
    """Files for other programs of the people who were accepted, by `fused/` where it is there; what
    could not be written, and why.  Of cameras alone they are there, or were not wanted."""
    from gmrdata.cli.video import FILES, TAKEN_ALONG
    from gmrdata.export.export import export
    from gmrdata.export.sources import list_clips, world_people_dir
    from gmrdata.values.people import PSEUDO_GT
    from gmrdata.world.quality import load_record

    pseudo_gt_dir = out_dir / PSEUDO_GT
    if not pseudo_gt_dir.is_dir():
        return ()
    try:
        people = load_record(pseudo_gt_dir).people
        people_dir = world_people_dir(out_dir)
        clips = list_clips(people_dir)
        ids = [files.id for files, one in zip(clips, people, strict=True) if one.accepted]
        if not ids and _has_cameras_alone(out_dir):
            return ()
        for name in TAKEN_ALONG:  # of another verdict or body; what else lies there is left alone
            shutil.rmtree(out_dir / FILES / name, ignore_errors=True)
        if not ids:
            return ()
        results = export(
            people_dir, TAKEN_ALONG, out_dir / FILES, clips=ids, body=body, images=images, redo=True
        )
    except (GmrdataError, ValueError) as error:
        return [("all formats", str(error))]
    return [
        (f"{one.unit.format} of {one.unit.name}", one.left_out) for one in results if one.left_out
    ]
