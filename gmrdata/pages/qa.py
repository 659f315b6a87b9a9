"""Pages of a regenerated set: what was decided of each sequence, and the index of all."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup
from matplotlib.figure import Figure

from gmrdata import __version__
from gmrdata.cameras.files import CamerasQuality
from gmrdata.pages import qa_data, qa_plots, qa_thresholds
from gmrdata.pages.frames import jpeg_image, narrowed, spaced
from gmrdata.pages.html import Cell, Table, render
from gmrdata.pages.plots import svg
from gmrdata.pages.qa_data import Found, counts_of
from gmrdata.pages.report import GEOMETRY_WORDS
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.read.threedpw_layout import SEQUENCE_NAME, SequenceFiles
from gmrdata.stage.progress import track
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts, choose
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import remove_orphans, write_text
from gmrdata.values.rows import text_runs
from gmrdata.world.quality import PseudoGtQuality
from gmrdata.world.recipe import VerdictConfig

HEADINGS = ("sequence", "split", "camera", "frames", "kept", "scale", "first reason")
STAGE_FILES = {
    "people": ("people.json", "doubts.json"),
    "masks": ("masks.json",),
    "sfm": ("quality.json",),
    "pseudo_gt": ("quality.json",),
}
"""What the stages leave for people to read, beside their records."""
OPEN_RANGES = 12  # a longer list of dropped ranges is folded
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
        Cell(_note(found), kind="words-cell"),
    )


def _note(found: Found) -> str:
    """Why the sequence is rejected or, if it isn't, most of what was dropped of it."""
    if found.verdict.reasons:
        return found.verdict.reasons[0]
    counts = counts_of(found.reasons)
    if not counts:
        return ""
    kind, n = next(iter(counts.items()))
    return f"{sum(counts.values())} frames dropped, {n} of them: {kind.words}"


Strips = list[list[tuple[qa_data.Kind | None, qa_data.Tile]]]
"""Two rows of frames, the second with the kinds of reason for which they are dropped."""


def _read_frames(found: Found, paths: SetPaths) -> Strips:
    """Evenly spaced frames (of a sequence that can't be read: images), and one for each reason."""
    files = found.files
    if files is None or not files.image_dir.is_dir():
        return [[], []]
    numbers = range(found.n_frames) or qa_data.image_numbers(files)
    masks_dir = paths.sequence_dir(files.name) / "masks"
    examples = qa_data.example_frames(found.reasons) if found.is_solved else {}
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
        makers["over_time"] = lambda: _over_time(found, config.verdict)
    record, cameras = found.record, found.cameras
    if record is not None and cameras is not None:
        makers |= {
            "from_above": lambda: _from_above(found),
            "scale": lambda: _scale(record),
            "camera_class": lambda: _camera_class(record, config.motion_class),
            "reconstruction": lambda: _reconstruction(cameras),
        }
    makers |= {"frames": lambda: strips, "files": lambda: _files(found, paths)}
    sections: list[tuple[str, object, str]] = []
    for kind, make in makers.items():
        try:
            sections.append((kind, make(), ""))
        except (GmrdataError, OSError) as error:  # What is missing must not cost the others.
            sections.append((kind, None, str(error)))
    return render("qa_sequence", found=found, lead=_lead(found), sections=sections)


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
    frames = qa_thresholds.frame_rows(found, recipe.of_sequence(found.name).pseudo_gt.verdict)
    whole = "What the sequence as a whole was judged by."
    worst = "The worst of all frames or steps between them; those beyond a threshold are dropped."
    tables = ((qa_thresholds.verdict_rows(found, recipe), whole), (frames, worst))
    return [qa_thresholds.threshold_table(rows, "threshold", caption) for rows, caption in tables]


def _over_time(found: Found, config: VerdictConfig) -> dict[str, object]:
    headings = ("person", "frames", "number", "reason")
    ranges, height_in = list(_ranges(found)), qa_plots.height_in(found)
    return {
        "plot": svg(lambda plot: qa_plots.plot_time(plot, found, config), 11.0, height_in, "time"),
        "legend": list(_legend(found)),
        "ranges": Table(headings, ranges, "Dropped ranges, as counted from 0 in the sequence."),
        "open": len(ranges) <= OPEN_RANGES,
    }


def _legend(found: Found) -> Iterator[tuple[str, str]]:
    accepted = [person.accepted for person in found.judged]
    with_kept = [i for i, reasons in enumerate(found.reasons) if "" in reasons]
    if not found.is_solved and with_kept:
        yield "var(--rule)", "the data set vouches for it"
    if found.is_solved and any(accepted[i] for i in with_kept):
        yield "var(--good)", "kept"
    if found.is_solved and not all(accepted[i] for i in with_kept):
        yield "var(--rule)", "within the thresholds, but rejected"
    for kind, n in counts_of(found.reasons).items():
        yield kind.colour, f"{kind.words} ({n})"


def _ranges(found: Found) -> Iterator[tuple[Cell | str, ...]]:
    for person, reasons in enumerate(found.reasons):
        for start, stop, reason in text_runs(reasons):
            if reason:
                span = f"{start} to {stop - 1}" if stop - start > 1 else f"{start}"
                words = Cell(reason, kind="words-cell")
                yield f"person {person}", span, str(stop - start), words


def _from_above(found: Found) -> dict[str, object]:
    world_from_cam = found.world_from_cam
    if world_from_cam is None:
        return {"plot": None}
    aligned = None
    if found.dataset_camera is not None:
        aligned = qa_data.align_dataset_camera(world_from_cam, found.dataset_camera, found.kept)
    return {
        "plot": svg(lambda plot: qa_plots.plot_paths(plot, found, aligned), 7.4, 6.2, "paths"),
        "people": [(qa_plots.person_role(n), f"person {n}") for n in found.clips],
        "aligned": aligned,
    }


def _scale(record: PseudoGtQuality) -> dict[str, object]:
    scale, sigma, cues = record.scale, record.scale_sigma, record.scale_cues
    if scale is None or sigma is None or not cues:
        return {"plot": None}
    rows = [
        (qa_plots.cue_words(cue), f"{cue.scale:.5g}", f"{100 * cue.sigma / cue.scale:.2f}",
         f"{100 * (cue.scale / scale - 1):+.2f}", str(cue.support), f"{1000 * cue.residual_m:.1f}")
        for cue in cues
    ]  # fmt: skip
    foot = ("fused", f"{scale:.5g}", f"{100 * sigma / scale:.2f}", "", "", "")
    headings = (
        "cue", "scale [m per unit]", "standard error [%]", "from the fused [%]",
        "stances, points or windows", "residual [mm]",
    )  # fmt: skip

    def draw(plot: Figure) -> None:
        qa_plots.plot_scale_cues(plot, scale, sigma, cues)

    return {
        "plot": svg(draw, 7.4, 1.0 + 0.32 * (len(cues) + 1), "scale"),
        "table": Table(headings, rows, "The metric scale, cue by cue.", foot),
    }


def _camera_class(record: PseudoGtQuality, config: MotionClassConfig) -> Table:
    figures = record.camera_motion_figures
    rows = [] if figures is None else qa_thresholds.class_rows(figures, config)
    caption = Markup(
        "Of the recovered camera in the frames that have one and a body; see "
        "<code>gmrdata.values.camera_motion</code>."
    )
    return qa_thresholds.threshold_table(rows, "borders of the classes", caption)


def _reconstruction(cameras: CamerasQuality) -> list[tuple[str, object]]:
    rows = [
        ("Geometry", GEOMETRY_WORDS[cameras.geometry]),
        ("Mapper", cameras.mapper),
        ("Models", len(cameras.models)),
        ("Frames with a camera", f"{cameras.frames_with_camera} of {cameras.frames}"),
        ("Keyframes", len(cameras.keyframes)),
        ("Frames placed against the finished map", cameras.resected_frames),
        ("Interpolated frames", len(cameras.interpolated)),
        ("Cuts", len(cameras.cuts_after_frames)),
        ("Points", cameras.points),
        ("Median frames per point", cameras.median_track_length),
        ("Median reprojection error [px]", cameras.median_reprojection_px),
        *cameras.lens_in_words,
    ]
    return [(name, value) for name, value in rows if value is not None]


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
