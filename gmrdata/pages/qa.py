"""One sequence's page: what was decided of it, and what there is to see.

The set at a glance: every sequence with its verdict, and a link to its page.

Write the pages of a regenerated set: one for each sequence, and the index of all.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from gmrdata.pages.document import document, image, pairs, table, text
from gmrdata.pages.qa_data import Found, gather
from gmrdata.pages.qa_frames import THUMBNAIL_WIDTH_PX, counts_of, jpeg, kinds_of
from gmrdata.pages.qa_sections import (
    QA_STYLE,
    Frames,
    class_section,
    frames_section,
    paths_section,
    read_frames,
    scale_section,
    small,
    time_section,
    verdict_section,
)
from gmrdata.pages.report import GEOMETRY_WORDS
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.read.threedpw_layout import SEQUENCE_NAME, SequenceFiles
from gmrdata.stage.progress import track
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import choose
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import read_json, remove_orphans, write_text

HEADINGS = ("sequence", "split", "camera", "frames", "kept", "scale", "first reason")


@dataclass(frozen=True)
class Listed:
    """One sequence of the index."""

    row: Mapping[str, Any]
    """Its row of `verdicts.json`."""
    page: str
    """Path of its page, below the index."""
    n_frames: int
    """Number of its frames; 0 if unknown."""
    note: str
    """The first reason, or most of what was dropped."""
    thumbnail: bytes
    """JPEG of one frame; empty if there is none."""
    thumbnail_size_px: tuple[int, int]
    """(width, height) of it [px]."""


def index_page(title: str, listed: Sequence[Listed], has_manifest: bool) -> str:
    """The index as HTML: rejected sequences apart from accepted ones, each list sortable.

    Args:
        title: Name and version of the set.
        listed: The sequences in order.
        has_manifest: Whether there is a manifest to link to.
    """
    groups = {
        "Accepted": [one for one in listed if one.row["accepted"]],
        "Rejected": [one for one in listed if not one.row["accepted"]],
    }
    manifest = '<a href="pseudo_gt.yaml">Manifest</a>' if has_manifest else ""
    header = (
        f'<h1>{text(title)}</h1><p class="lead">World-frame pseudo ground truth: what was decided '
        "of each sequence. Click on a heading to sort.</p>"
        f'<nav aria-label="Files">{manifest}<a href="verdicts.json">Verdicts as JSON</a></nav>'
    )
    counts = [(name, str(len(group))) for name, group in groups.items()]
    frames = sum(one.n_frames for one in listed)
    sections = [f"<section>{pairs([*counts, ('Frames', str(frames))])}</section>"]
    sections += [_group(name, group) for name, group in groups.items() if group]
    script = resources.files("gmrdata.pages").joinpath("sort.js").read_text("utf-8")
    return document(title, header, [*sections, f"<script>\n{script}</script>"], QA_STYLE)


def _group(name: str, group: Sequence[Listed]) -> str:
    headings = [f'<button type="button">{heading}</button>' for heading in HEADINGS]
    caption = "Kept: share of the frames of all people. Scale: metres per unit, ± standard error."
    listed = table(headings, [_row(one) for one in group], caption)
    return f"<section><h2>{name}</h2>{listed}</section>"


def _row(one: Listed) -> tuple[str, ...]:
    row = one.row
    name, scale = str(row["sequence"]), NO_FIGURE
    sortable = -1.0
    if row["scale"] is not None and row["scale_sigma"] is not None:
        sortable = row["scale_sigma"] / row["scale"]
        scale = f"{row['scale']:.4g} ± {100 * sortable:.1f} %"
    width_px, height_px = one.thumbnail_size_px
    picture = image(one.thumbnail, "jpeg", "", width_px, height_px) if one.thumbnail else "<i></i>"
    link = f'<a href="{text(quote(one.page))}">{text(name)}</a>'
    return (
        f'<span class="thumbnail" data-sort="{text(name)}">{picture}{link}</span>',
        text(row["split"]),
        text(str(row["class"]).replace("_", " + ")),
        str(one.n_frames or NO_FIGURE),
        f'<span data-sort="{row["kept_share"]}">{row["kept_share"]:.1%}</span>',
        f'<span data-sort="{sortable}">{text(scale)}</span>',
        f'<span class="words-cell">{text(one.note)}</span>',
    )


STAGE_FILES = {
    "people": ("people.json", "doubts.json"),
    "masks": ("masks.json",),
    "sfm": ("quality.json",),
    "pseudo_gt": ("quality.json",),
}
"""What the stages leave for people to read, beside their records."""


def sequence_page(found: Found, frames: Frames, recipe: ThreedpwRecipe, paths: SetPaths) -> str:
    """The page as HTML; the same sequence gives the same bytes.

    Args:
        found: The sequence.
        frames: Some of its frames.
        recipe: The set's recipe.
        paths: Where the set keeps what; the page stands in `paths.pages_dir`.
    """
    header = (
        f'<h1>{text(found.name)}</h1><p class="lead">{text(_lead(found))}</p>'
        '<nav aria-label="Pages"><a href="../index.html">All sequences</a></nav>'
    )
    makers: list[Callable[[], str]] = [lambda: verdict_section(found, recipe)]
    makers += [lambda: time_section(found, recipe)] if found.reasons else []
    if found.is_solved:
        makers += [
            lambda: paths_section(found),
            lambda: scale_section(found.record),
            lambda: class_section(found, recipe),
            lambda: reconstruction_section(found),
        ]
    makers += [lambda: frames_section(frames), lambda: files_section(found, paths)]
    return document(found.name, header, [_made(maker) for maker in makers], QA_STYLE)


def _made(make: Callable[[], str]) -> str:
    """A section, or why there is none: what is missing must not cost the others."""
    try:
        return make()
    except (GmrdataError, OSError) as error:
        return f'<section><p class="bad">can’t be drawn: {text(error)}</p></section>'


def _lead(found: Found) -> str:
    parts = [found.row["split"] or "not read"]
    if found.n_frames:
        n_people = len(found.reasons)
        parts.append(f"{found.n_frames} frames")
        parts.append("one person" if n_people == 1 else f"{n_people} people")
    if found.is_solved:
        parts.append(f"{found.row['class'].replace('_', ' + ')} camera")
    return ", ".join(parts)


def reconstruction_section(found: Found) -> str:
    """HTML: geometry, mapper, models, and the figures of the reconstruction."""
    record = found.record
    models = record["models"]
    geometry = str(record["geometry"])
    rows = [
        ("Geometry", GEOMETRY_WORDS.get(geometry, geometry)),
        ("Mapper", record.get("mapper")),
        ("Models", len(models)),
        ("Frames with a camera", f"{record['frames_with_camera']} of {record['frames']}"),
        ("Keyframes", len(record.get("keyframes", ()))),
        ("Frames placed against the finished map", record.get("resected_frames")),
        ("Interpolated frames", len(record.get("interpolated", ()))),
        ("Cuts", len(record.get("cuts_after_frames", ()))),
        ("Points", record.get("points")),
        ("Median frames per point", record.get("median_track_length")),
        ("Median reprojection error [px]", record.get("median_reprojection_px")),
        ("Focal length that the background asks for, over the given one", _focal(record)),
    ]
    listed = small((name, str(value)) for name, value in rows if value is not None)
    joined = "".join(
        f"<li>{model['frames']} frames, {'kept' if model['kept'] else 'dropped'}: "
        f"{text(model['reason'])}</li>"
        for model in models
    )
    joined = f"<h3>Models</h3><ul>{joined}</ul>" if joined else ""
    reason = text(record.get("evidence", {}).get("reason", "not recorded"))
    return (
        f"<section><h2>Reconstruction</h2>{listed}"
        f"<p>Why this geometry: {reason}.</p>{joined}</section>"
    )


def _focal(record: dict[str, float | None]) -> str | None:
    factor, sigma = record.get("focal_factor"), record.get("focal_sigma")
    if factor is None:
        return None
    return f"{factor:.4g}" if sigma is None else f"{factor:.4g} ± {sigma:.2g}"


def files_section(found: Found, paths: SetPaths) -> str:
    """HTML: links to the records of the stages, and what can't be read."""
    links = []
    if found.files is not None:
        for stage, names in STAGE_FILES.items():
            folder = paths.sequence_dir(found.files.name) / stage
            there = [name for name in ("stage.json", *names) if (folder / name).is_file()]
            where = f"../{folder.relative_to(paths.root).as_posix()}"
            linked = ", ".join(
                f'<a href="{text(quote(f"{where}/{name}"))}">{name}</a>' for name in there
            )
            links.append(f"<li>{stage}: {linked or 'not made'}</li>")
        failure = paths.failures_dir / f"{found.files.name}.txt"
        if failure.is_file():
            where = text(quote(f"../{failure.relative_to(paths.root).as_posix()}"))
            links.append(f'<li><a href="{where}">the whole message of the failure</a></li>')
    missing = "".join(f'<li class="bad">{text(problem)}</li>' for problem in found.missing)
    missing = f"<h3>Can’t be read</h3><ul>{missing}</ul>" if missing else ""
    nothing = "<li>No stage was run.</li>"
    return f"<section><h2>Stage records</h2><ul>{''.join(links) or nothing}</ul>{missing}</section>"


def write_set_pages(recipe: ThreedpwRecipe, root: Path, out_dir: Path) -> None:
    """Write the pages of a regenerated set; see `write_pages`.

    Args:
        recipe: The set's recipe.
        root: 3DPW's folder.
        out_dir: Where the set is; nothing is written where it holds no verdicts.
    """
    paths = SetPaths(out_dir.resolve())
    if not paths.verdicts.is_file():
        return
    chosen, reasons = choose(root, recipe.sequences)
    for files in chosen:
        failure = paths.failures_dir / f"{files.name}.txt"
        if failure.is_file():
            reasons[files.name] = failure.read_text(encoding="utf-8")
    write_pages(read_json(paths.verdicts), chosen, reasons, recipe, paths)


def write_pages(
    rows: Sequence[Mapping[str, Any]],
    chosen: Sequence[SequenceFiles],
    reasons: Mapping[str, str],
    recipe: ThreedpwRecipe,
    paths: SetPaths,
) -> Path:
    """Write `qa/<sequence>.html` for every row of the verdicts, and `index.html`.

    A file that is missing, or broken since it was made, costs a picture and not the page.

    Args:
        rows: The rows of `verdicts.json`, in the order of the index.
        chosen: The sequences that were tried; others are not opened.
        reasons: The whole message of each sequence that could not be regenerated, by name.
        recipe: The set's recipe.
        paths: Where the set keeps what.

    Returns:
        Path of the index.
    """
    for folder in (paths.root, paths.pages_dir):
        remove_orphans(folder)
    files_of = {files.name: files for files in chosen}
    listed = []
    for row in track(rows, "drawing a page for each sequence", total=len(rows)):
        name = str(row["sequence"])
        found = gather(row, reasons.get(name, ""), files_of.get(name), paths)
        listed.append(_write_page(found, recipe, paths))
    title = f"{recipe.name} {recipe.version}"
    _write(paths.index_page, index_page(title, listed, paths.manifest.is_file()))
    return paths.index_page


def page_name(sequence: str) -> str:
    """File name of a sequence's page; a name that is no plain one is not used as such.

    The mark before its hash is none that a plain name begins with.
    """
    if SEQUENCE_NAME.fullmatch(sequence):
        return f"{sequence}.html"
    digest = hashlib.sha256(sequence.encode(errors="surrogateescape")).hexdigest()
    return f"~{digest[:16]}.html"


def _write(path: Path, page: str) -> None:
    """Write a page; bytes of file names that are no text stand in it as escapes."""
    write_text(path, page.encode("utf-8", "backslashreplace").decode("utf-8"))


def _write_page(found: Found, recipe: ThreedpwRecipe, paths: SetPaths) -> Listed:
    # Without a name that can be trusted there is nothing to show, and the folder isn't asked for.
    name = "" if found.files is None else found.files.name
    frames = read_frames(found, paths.masks_dir(name))
    page = paths.pages_dir / page_name(found.name)
    _write(page, sequence_page(found, frames, recipe, paths))
    pictures = [tile.picture for tile in frames.tiles if tile.picture is not None]
    thumbnail, size_px = b"", (0, 0)
    if pictures:
        middle = pictures[len(pictures) // 2]
        height_px = round(THUMBNAIL_WIDTH_PX * middle.shape[0] / middle.shape[1])
        thumbnail, size_px = jpeg(middle, THUMBNAIL_WIDTH_PX), (THUMBNAIL_WIDTH_PX, height_px)
    return Listed(
        row=found.row,
        page=page.relative_to(paths.root).as_posix(),
        n_frames=found.n_frames,
        note=_note(found),
        thumbnail=thumbnail,
        thumbnail_size_px=size_px,
    )


def _note(found: Found) -> str:
    """Why the sequence is rejected or, if it isn't, most of what was dropped of it."""
    if found.row["reasons"]:
        return str(found.row["reasons"][0])
    counts = counts_of(found.reasons, kinds_of(found.reasons))
    if not counts:
        return ""
    kind, n = next(iter(counts.items()))
    return f"{sum(counts.values())} frames dropped, {n} of them: {kind.words}"
