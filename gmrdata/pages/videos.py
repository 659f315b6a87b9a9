"""The index page of a batch of videos: what became of each, with a link to its own page."""

from pathlib import Path
from urllib.parse import quote

from gmrdata.pages.html import Cell, Table, render
from gmrdata.solve.videos import FAILED, PAGE, RECORD_FILE, VideoEntry, Videos, video_dir
from gmrdata.values.files import remove_orphans, write_text

HEADINGS = (
    "video", "frames", "with a camera", Cell("rate", unit="Hz"), Cell("focal length", unit="px"),
    "lens from", "people", "why",
)  # fmt: skip
LENS = {"given": "given", "metadata": "noted", "self_calibrated": "frames", "prior": "a guess"}
CAPTION = "Lens from: given, noted by the camera, found in the frames, or a guess."
LEAD = "Cameras of each video and people’s motion: what was decided. Click on a heading to sort."
NO_FIGURE = "–"


def write_videos_page(out_dir: Path) -> Path:
    """Write `index.html` of a batch that has its `videos.json`; gives its path."""
    remove_orphans(out_dir)
    record, groups = Videos.read(out_dir / RECORD_FILE), []
    counts: list[tuple[str, int]] = []
    for state in ("accepted", "rejected", "failed"):
        rows = [_row(out_dir, entry) for entry in record.in_state(state)]
        counts.append((state.capitalize(), len(rows)))
        if rows:
            groups.append((state.capitalize(), Table(HEADINGS, rows, CAPTION, sortable=True)))
    page = render(
        "qa_index",
        title=f"{len(record.videos)} videos",
        lead=LEAD,
        links=[(RECORD_FILE, "Record as JSON")],
        counts=[*counts, ("Frames", sum(entry.frames for entry in record.videos))],
        groups=groups,
    )
    write_text(out_dir / PAGE, page)
    return out_dir / PAGE


def _row(out_dir: Path, entry: VideoEntry) -> tuple[Cell | str, ...]:
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
