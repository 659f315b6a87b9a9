"""Pages of a regenerated set: what was decided of each sequence, and the index of all."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from gmrdata import __version__
from gmrdata.pages import qa_data, thresholds
from gmrdata.pages import solved_sections as sections
from gmrdata.pages.frames import jpeg_image, narrowed, spaced
from gmrdata.pages.html import Cell, Table, render
from gmrdata.pages.qa_data import Found
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.pages.solved import Kind, counts_of, example_frames
from gmrdata.pages.video import PAGE_FILE
from gmrdata.read.threedpw_layout import SEQUENCE_NAME, SequenceFiles
from gmrdata.stage.progress import track
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts, choose
from gmrdata.values.files import remove_orphans, write_text

HEADINGS = ("sequence", "split", "camera", "frames", "kept", "scale", "overlay", "first reason")
LEAD = (
    "World-frame pseudo ground truth: what was decided of each sequence. "
    "Click on a heading to sort."
)
STAGE_FILES = {
    "people": ("people.json", "doubts.json"),
    "masks": ("masks.json",),
    "sfm": ("quality.json",),
    "pseudo_gt": ("quality.json",),
}
"""What the stages leave for people to read, beside their records."""
N_TILES = 6
THUMBNAIL_WIDTH_PX = 88


def write_set_pages(recipe: ThreedpwRecipe, root: Path, out_dir: Path) -> None:
    """Write the pages of a set that was regenerated from 3DPW's folder `root`, see `write_pages`;
    nothing where `out_dir` holds no verdicts, or nothing changed since."""
    paths = SetPaths(out_dir.resolve())
    if not paths.verdicts.is_file():
        return
    chosen, reasons = choose(root, recipe.sequences)
    for files in chosen:
        failure = paths.failures_dir / f"{files.name}.txt"
        if failure.is_file():
            reasons[files.name] = failure.read_text(encoding="utf-8")
    said = f"{__version__} {recipe!r} {sorted(reasons.items())}"
    stamp, folders = paths.pages_dir / ".shown", [files.image_dir for files in chosen]
    if stamp.is_file() and stamp.read_text() == _shown(said, folders, paths):
        return
    write_pages(Verdicts.read(paths.verdicts).sequences, chosen, reasons, recipe, paths)
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
    rows: dict[str, list[Sequence[Cell | str]]] = {"Accepted": [], "Rejected": []}
    n_frames = 0
    for verdict in track(verdicts, "drawing a page for each sequence", total=len(verdicts)):
        name, group = verdict.sequence, rows["Accepted" if verdict.accepted else "Rejected"]
        found = qa_data.gather(verdict, reasons.get(name, ""), files_of.get(name), paths)
        group.append(_write_page(found, recipe, paths))
        n_frames += found.n_frames
    links = [("pseudo_gt.yaml", "Manifest")] if paths.manifest.is_file() else []
    caption = "Kept: share of the frames of all people. Scale: metres per unit, ± standard error."
    tables = {name: Table(HEADINGS, group, caption, sortable=True) for name, group in rows.items()}
    page = render(
        "qa_index",
        title=f"{recipe.name} {recipe.version}",
        lead=LEAD,
        links=[*links, ("verdicts.json", "Verdicts as JSON")],
        counts=[*((name, len(group)) for name, group in rows.items()), ("Frames", n_frames)],
        groups=[(name, table) for name, table in tables.items() if table.rows],
    )
    _write(paths.index_page, page)
    return paths.index_page


def page_name(sequence: str) -> str:
    """File name of a sequence's page: "~" (no plain name begins so) and a hash for others."""
    if SEQUENCE_NAME.fullmatch(sequence):
        return f"{sequence}.html"
    digest = hashlib.sha256(sequence.encode(errors="surrogateescape")).hexdigest()
    return f"~{digest[:16]}.html"


def _write(path: Path, page: str) -> None:
    """Write a page; bytes of file names that are no text stand in it as escapes."""
    write_text(path, page.encode("utf-8", "backslashreplace").decode("utf-8"))


def _write_page(found: Found, recipe: ThreedpwRecipe, paths: SetPaths) -> tuple[Cell | str, ...]:
    """Write a sequence's page; gives its row in the index."""
    strips = _read_frames(found, paths)
    page = paths.pages_dir / page_name(found.name)
    _write(page, _sequence_page(found, strips, recipe, paths))
    verdict, scale, sort = found.verdict, NO_FIGURE, -1.0
    if verdict.scale is not None and verdict.scale_sigma is not None:
        sort = verdict.scale_sigma / verdict.scale
        scale = f"{verdict.scale:.4g} ± {100 * sort:.1f} %"
    href = quote(page.relative_to(paths.root).as_posix())
    return (
        Cell(found.name, href=href, kind="thumbnail", sort=found.name, picture=_thumbnail(strips)),
        verdict.split,
        verdict.camera_motion.replace("_", " + "),
        str(found.n_frames or NO_FIGURE),
        Cell(f"{verdict.kept_share:.1%}", sort=verdict.kept_share),
        Cell(scale, sort=sort),
        Cell("video", href=quote(overlay)) if (overlay := _overlay_page(found, paths)) else "",
        Cell(_note(found), kind="words-cell"),
    )


def _overlay_page(found: Found, paths: SetPaths) -> str:
    """The page of a sequence that `gmrdata page` wrote, from the set's folder; empty without."""
    if found.files is None:
        return ""
    page = paths.sequence_dir(found.files.name) / PAGE_FILE
    return page.relative_to(paths.root).as_posix() if page.is_file() else ""


def _note(found: Found) -> str:
    """Why the sequence is rejected or, if it isn't, most of what was dropped of it."""
    if found.verdict.reasons:
        return found.verdict.reasons[0]
    counts = counts_of(found.reasons)
    if not counts:
        return ""
    kind, n = next(iter(counts.items()))
    return f"{sum(counts.values())} frames dropped, {n} of them: {kind.words}"


Strips = list[list[tuple[Kind | None, qa_data.Tile]]]
"""Two rows of frames, the second with the kinds of reason for which they are dropped."""


def _read_frames(found: Found, paths: SetPaths) -> Strips:
    """Evenly spaced frames (of a sequence that can't be read: images), and one for each reason."""
    files = found.files
    if files is None or not files.image_dir.is_dir():
        return [[], []]
    numbers = range(found.n_frames) or qa_data.image_numbers(files)
    masks_dir = paths.sequence_dir(files.name) / "masks"
    examples = example_frames(found.reasons) if found.is_solved else {}
    wanted = [(None, numbers[row]) for row in spaced(len(numbers), N_TILES)]
    return [
        [(kind, qa_data.read_tile(files, masks_dir, number)) for kind, number in strip]
        for strip in (wanted, list(examples.items())[:N_TILES])
    ]


def _thumbnail(strips: Strips) -> Markup:
    pictures = [tile.picture for _, tile in strips[0] if tile.picture is not None]
    if not pictures:
        return Markup("<i></i>")
    small = narrowed(pictures[len(pictures) // 2], THUMBNAIL_WIDTH_PX)
    return jpeg_image(small, "", qa_data.JPEG_QUALITY)


def _sequence_page(found: Found, strips: Strips, recipe: ThreedpwRecipe, paths: SetPaths) -> str:
    """The page as HTML; the same sequence gives the same bytes."""
    config = recipe.of_sequence(found.name).pseudo_gt
    makers: dict[str, Callable[[], object]] = {"verdict": lambda: _judged_by(found, recipe)}
    if found.reasons:
        makers["over_time"] = lambda: sections.over_time(found, config.verdict)
    record, cameras = found.record, found.cameras
    if record is not None and cameras is not None:
        makers |= {
            "paths": lambda: sections.paths(found),
            "scale": lambda: sections.scale_cues(record),
            "camera_class": lambda: sections.camera_class(record, config.motion_class),
            "reconstruction": lambda: sections.reconstruction_rows(cameras),
        }
    makers |= {"frames": lambda: strips, "files": lambda: _files(found, paths)}
    shown = sections.made(makers)
    links = [("../index.html", "All sequences")]
    if overlay := _overlay_page(found, paths):
        links.append((quote(f"../{overlay}"), "Overlay and files"))
    return render("qa_sequence", found=found, lead=_lead(found), sections=shown, links=links)


def _lead(found: Found) -> str:
    parts = [found.verdict.split or "not read"]
    if found.n_frames:
        n_people = len(found.reasons)
        parts += [
            f"{found.n_frames} frames",
            f"{n_people} people" if n_people > 1 else "one person",
        ]
    if found.is_solved:
        parts.append(f"{found.verdict.camera_motion.replace('_', ' + ')} camera")
    return ", ".join(parts)


def _judged_by(found: Found, recipe: ThreedpwRecipe) -> list[Table]:
    if not found.is_solved:
        return []
    pseudo_gt = recipe.of_sequence(found.name).pseudo_gt
    focal = None if found.people is None else found.people.focal
    rows = thresholds.verdict_rows(found, pseudo_gt, found.doubts)
    rows.append(thresholds.focal_row(focal, recipe.intrinsics))
    frames = thresholds.frame_rows(found, pseudo_gt.verdict)
    whole = "What the sequence as a whole was judged by."
    worst = "The worst of all frames or steps between them; those beyond a threshold are dropped."
    tables = ((rows, whole), (frames, worst))
    return [thresholds.threshold_table(rows, "threshold", caption) for rows, caption in tables]


def _files(found: Found, paths: SetPaths) -> dict[str, object]:
    """Links to the records of the stages, and what can't be read."""
    stages, failure = [], ""
    if found.files is not None:
        for stage, names in STAGE_FILES.items():
            folder = paths.sequence_dir(found.files.name) / stage
            there = [name for name in ("stage.json", *names) if (folder / name).is_file()]
            where = f"../{folder.relative_to(paths.root).as_posix()}"
            stages.append((stage, [(quote(f"{where}/{name}"), name) for name in there]))
        message = paths.failures_dir / f"{found.files.name}.txt"
        if message.is_file():
            failure = quote(f"../{message.relative_to(paths.root).as_posix()}")
    return {"stages": stages, "failure": failure}
