"""Pages of batches: the index of a regenerated 3DPW with its sequences, and that of videos."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from gmrdata import __version__
from gmrdata.pages.frames import jpeg_image, masked_tile, narrowed, spaced
from gmrdata.pages.gather import gather_sequence
from gmrdata.pages.html import Cell, Table, render, write_page
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.pages.solved import Kind, SolvedSequence, counts_of, example_frames
from gmrdata.pages.solved_page import solved_page
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import number_in_name, read_color, read_gray
from gmrdata.read.threedpw_files import SEQUENCE_NAME, SequenceFiles, require_inside
from gmrdata.solve.request import MASKS
from gmrdata.solve.verdict import PAGE
from gmrdata.solve.videos import FAILED, RECORD_FILE, VideoEntry, Videos, video_dir
from gmrdata.stage.progress import track
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts, choose
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import remove_orphans, write_text

HEADINGS = ("sequence", "split", "camera", "frames", "kept", "scale", "overlay", "first reason")
LEAD = (
    "World-frame pseudo ground truth: what was decided of each sequence. "
    "Click on a heading to sort."
)
N_TILES = 6
THUMBNAIL_WIDTH_PX = 88
TILE_WIDTH_PX = 260
JPEG_QUALITY = 80
VIDEO_HEADINGS = (
    "video", "frames", "camera to use", Cell("rate", unit="Hz"), Cell("focal length", unit="px"),
    "lens from", "people", "why",
)  # fmt: skip
LENS = {"given": "given", "metadata": "noted", "self_calibrated": "frames", "prior": "a guess"}
VIDEO_CAPTION = "Lens from: given, noted by the camera, found in the frames, or a guess."
VIDEO_LEAD = (
    "Cameras of each video and people’s motion: what was decided. Click on a heading to sort."
)


Row = Sequence[Cell | str]


def _write_index(
    path: Path, about: Mapping[str, object], groups: Mapping[str, Table], n_frames: int
) -> Path:
    """A table of links for each group, and how many are in it; `about` has the title, the lead and
    links to records."""
    counts = [(name, len(table.rows)) for name, table in groups.items()]
    page = render(
        "index",
        **about,
        counts=[*counts, ("Frames", n_frames)],
        groups=[(name, table) for name, table in groups.items() if table.rows],
    )
    return write_page(path, page)


def write_set_pages(recipe: ThreedpwRecipe, root: Path, out_dir: Path) -> None:
    """Write the pages of a set that was regenerated from 3DPW's folder `root`, see `write_pages`;
    nothing where `out_dir` holds no verdicts, or nothing changed since."""
    paths = SetPaths(out_dir.resolve())
    if not paths.verdicts.is_file():
        return
    verdicts, (sequences, reasons) = Verdicts.read(paths.verdicts).sequences, choose(root, ())
    names = {verdict.sequence for verdict in verdicts}
    chosen = [files for files in sequences if files.name in names]
    for files in chosen:
        failure = paths.failures_dir / f"{files.name}.txt"
        if failure.is_file():
            reasons[files.name] = failure.read_text(encoding="utf-8", errors="replace")
    said = f"{__version__} {recipe!r} {sorted(reasons.items())}"
    stamp, folders = paths.pages_dir / ".shown", [files.image_dir for files in chosen]
    if stamp.is_file() and stamp.read_bytes() == _shown(said, folders, paths).encode():
        return
    write_pages(verdicts, chosen, reasons, recipe, paths)
    write_text(stamp, _shown(said, folders, paths))


def _shown(said: str, folders: Sequence[Path], paths: SetPaths) -> str:
    """Stands for the pages and all that they show: names, sizes and times of files."""
    there = [path.is_file() for path in (paths.manifest, paths.index_page)]
    digest = hashlib.sha256(f"{said} {there}".encode("utf-8", "backslashreplace"))
    digest.update(paths.verdicts.read_bytes())
    for folder in (paths.pages_dir, paths.root / "sequences", *folders):
        for path in sorted(file for file in folder.rglob("[!.]*") if file.is_file()):
            state = path.stat()
            digest.update(f"{path} {state.st_size} {state.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def write_pages(
    verdicts: Sequence[SequenceVerdict],
    chosen: Sequence[SequenceFiles],
    reasons: Mapping[str, str],
    recipe: ThreedpwRecipe,
    paths: SetPaths,
) -> Path:
    """Write `qa/<sequence>.html` for each of the verdicts, and `index.html`; gives its path.

    A file that is missing, or broken since it was made, costs a picture and not the page.  Only
    `chosen` sequences are opened; `reasons` are the whole messages of those that failed, by name.
    """
    remove_orphans(paths.root)
    remove_orphans(paths.pages_dir)
    files_of = {files.name: files for files in chosen}
    rows: dict[str, list[Row]] = {"Accepted": [], "Rejected": []}
    n_frames = 0
    for verdict in track(verdicts, "drawing a page for each sequence", total=len(verdicts)):
        name, group = verdict.sequence, rows["Accepted" if verdict.accepted else "Rejected"]
        message = reasons.get(name, "")
        sequence = gather_sequence(verdict, message, files_of.get(name), recipe, paths)
        group.append(_write_page(sequence, paths))
        n_frames += sequence.n_frames
    links = [("pseudo_gt.yaml", "Manifest")] if paths.manifest.is_file() else []
    caption = "Kept: share of the frames of all people. Scale: metres per unit, ± standard error."
    about = {
        "title": f"{recipe.name} {recipe.version}",
        "lead": LEAD,
        "links": [*links, ("verdicts.json", "Verdicts as JSON")],
    }
    tables = {name: Table(HEADINGS, group, caption, sortable=True) for name, group in rows.items()}
    return _write_index(paths.index_page, about, tables, n_frames)


def page_name(sequence: str) -> str:
    """File name of a sequence's page: "~" (no plain name begins so) and a hash for others."""
    if SEQUENCE_NAME.fullmatch(sequence):
        return f"{sequence}.html"
    digest = hashlib.sha256(sequence.encode(errors="surrogateescape")).hexdigest()
    return f"~{digest[:16]}.html"


def _write_page(solved: SolvedSequence, paths: SetPaths) -> Row:
    """Write a sequence's page; gives its row in the index."""
    said = solved.dataset
    assert said is not None
    strips, overlay, failure = _read_frames(solved, said.files), "", ""
    page, links = paths.pages_dir / page_name(solved.name), [("../index.html", "All sequences")]
    # The page of a sequence that `gmrdata page` wrote.
    if solved.folder is not None and (solved.folder / PAGE).is_file():
        overlay = (solved.folder / PAGE).relative_to(paths.root).as_posix()
        links.append((quote(f"../{overlay}"), "Overlay and files"))
    if said.files is not None:
        message = paths.failures_dir / f"{said.files.name}.txt"
        if message.is_file():
            failure = quote(f"../{message.relative_to(paths.root).as_posix()}")
    shown = solved_page(solved, page, strips=strips, links=links, failure=failure)
    write_page(page, shown)
    verdict, share = said.verdict, said.verdict.scale_share
    href = quote(page.relative_to(paths.root).as_posix())
    return (
        Cell(
            solved.name, href=href, kind="thumbnail", sort=solved.name, picture=_thumbnail(strips)
        ),
        verdict.split,
        verdict.camera_motion.replace("_", " + "),
        str(solved.n_frames or NO_FIGURE),
        Cell(f"{verdict.kept_share:.1%}", sort=verdict.kept_share),
        Cell(verdict.scale_words or NO_FIGURE, sort=-1.0 if share is None else share),
        Cell("video", href=quote(overlay)) if overlay else "",
        Cell(_note(verdict, solved.reasons), kind="words-cell"),
    )


def _note(verdict: SequenceVerdict, reasons: Sequence[Sequence[str]]) -> str:
    """Why the sequence is rejected or, if it isn't, most of what was dropped of it."""
    if verdict.reasons:
        return verdict.reasons[0]
    counts = counts_of(reasons)
    if not counts:
        return ""
    kind, n = next(iter(counts.items()))
    return f"{sum(counts.values())} frames dropped, {n} of them: {kind.words}"


@dataclass(frozen=True, eq=False)
class Tile:
    image_number: int
    picture: np.ndarray | None  # (h, w, 3) BGR, the masked part tinted; None if it can't be read
    problem: str  # why there is no picture, or no mask on it; else empty

    @property
    def shown(self) -> Markup | None:
        name = f"frame {self.image_number}"
        return None if self.picture is None else jpeg_image(self.picture, name, JPEG_QUALITY)


Strips = list[list[tuple[Kind | None, Tile]]]
"""Two rows of frames, the second with the kinds of reason for which they are dropped."""


def _read_frames(solved: SolvedSequence, files: SequenceFiles | None) -> Strips:
    """Evenly spaced frames (of a sequence that can't be read: images), and one for each reason."""
    if files is None or solved.folder is None or not files.image_dir.is_dir():
        return [[], []]
    numbers = range(solved.n_frames) or image_numbers(files)
    examples = example_frames(solved.reasons) if solved.is_solved else {}
    wanted = [(None, numbers[row]) for row in spaced(len(numbers), N_TILES)]
    return [
        [(kind, read_tile(files, solved.folder / MASKS, number)) for kind, number in strip]
        for strip in (wanted, list(examples.items())[:N_TILES])
    ]


def _thumbnail(strips: Strips) -> Markup:
    pictures = [tile.picture for _, tile in strips[0] if tile.picture is not None]
    if not pictures:
        return Markup("<i></i>")
    small = narrowed(pictures[len(pictures) // 2], THUMBNAIL_WIDTH_PX)
    return jpeg_image(small, "", JPEG_QUALITY)


def image_numbers(files: SequenceFiles) -> list[int]:
    """Numbers of the images that lie in a sequence's folder, in order; none if it leads out."""
    try:
        require_inside(files.root, files.image_dir)
    except GmrdataError:
        return []
    numbers = [number_in_name(path.name) for path in files.image_dir.glob("image_*.jpg")]
    return sorted(number for number in numbers if number is not None)


def read_tile(files: SequenceFiles, masks_dir: Path, number: int) -> Tile:
    """One frame with its mask; a file that can't be read is named, and no error."""
    path = files.image_path(number)
    try:
        # A link could show a file from anywhere on the page.
        require_inside(files.root, path)
        image = read_color(path)
    except (GmrdataError, OSError) as error:
        return Tile(number, None, str(error))
    mask, problem = np.zeros(image.shape[:2], np.uint8), "no masks were made"
    if masks_dir.is_dir():
        try:
            mask = read_gray(find_mask(masks_dir, path), (image.shape[1], image.shape[0]))
            problem = ""
        except (GmrdataError, OSError) as error:
            problem = str(error)
    return Tile(number, masked_tile(image, mask, TILE_WIDTH_PX), problem)


def write_videos_page(out_dir: Path) -> Path:
    """Write `index.html` of a batch that has its `videos.json`; gives its path."""
    remove_orphans(out_dir)
    record = Videos.read(out_dir / RECORD_FILE)
    groups = {
        state.capitalize(): Table(
            VIDEO_HEADINGS,
            [_video_row(out_dir, entry) for entry in record.in_state(state)],
            VIDEO_CAPTION,
            sortable=True,
        )
        for state in ("accepted", "rejected", "failed")
    }
    about = {
        "title": f"{len(record.videos)} videos",
        "lead": VIDEO_LEAD,
        "links": [(RECORD_FILE, "Record as JSON")],
    }
    n_frames = sum(entry.frames for entry in record.videos)
    return _write_index(out_dir / PAGE, about, groups, n_frames)


def _video_row(out_dir: Path, entry: VideoEntry) -> Row:
    page = video_dir(out_dir, entry.name) / PAGE
    if entry.failed:
        page = out_dir / FAILED / f"{entry.name}.txt"
    href = quote(page.relative_to(out_dir).as_posix()) if page.is_file() else ""
    name = Cell(entry.name, href=href, sort=entry.name)
    why = Cell("; ".join(entry.reasons), kind="words-cell")
    if entry.fps_hz is None or entry.focal_px is None or entry.focal_from is None:
        return name, *(6 * (Cell(NO_FIGURE, sort=-1),)), why
    kept = entry.kept_frames / entry.frames
    focal = f"{entry.focal_px:.1f} ± {100 * (entry.focal_sigma or 0):.2g} %"
    people = f"{entry.accepted_people} of {entry.people}" if entry.people else "cameras alone"
    return (
        name,
        str(entry.frames),
        Cell(f"{kept:.1%}", sort=kept),
        f"{entry.fps_hz:g}",
        Cell(focal, sort=entry.focal_px),
        LENS[entry.focal_from],
        Cell(people, sort=entry.people),
        why,
    )
