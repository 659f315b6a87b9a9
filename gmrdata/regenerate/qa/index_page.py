"""The set at a glance: every sequence with its verdict, and a link to its page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any
from urllib.parse import quote

from gmrdata.regenerate.qa.style import QA_STYLE
from gmrdata.report.bars import NO_FIGURE
from gmrdata.report.document import document
from gmrdata.report.markup import image, pairs, table, text

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
    script = resources.files("gmrdata.regenerate.qa").joinpath("sort.js").read_text("utf-8")
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
