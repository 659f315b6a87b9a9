"""Write the pages of a regenerated set: one for each sequence, and the index of all."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.progress import track
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.qa.frames_section import read_frames
from gmrdata.regenerate.qa.gather import Found, gather
from gmrdata.regenerate.qa.index_page import Listed, index_page
from gmrdata.regenerate.qa.kinds import counts_of, kinds_of
from gmrdata.regenerate.qa.sequence_page import sequence_page
from gmrdata.regenerate.qa.tiles import THUMBNAIL_WIDTH_PX, jpeg
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.store import remove_orphans, write_text
from gmrdata.threedpw.layout import SEQUENCE_NAME, SequenceFiles


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
