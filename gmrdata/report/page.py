"""The report: one HTML file that needs nothing beside it."""

from importlib import resources
from pathlib import Path

from gmrdata.report import clip_section, run_sections
from gmrdata.report.data import ReportData
from gmrdata.report.markup import text
from gmrdata.store import write_text


def write_report(path: Path, report: ReportData) -> Path:
    """Write the report as one self-contained HTML file; the same input gives the same bytes.

    Args:
        path: The file to write, as a whole or not at all.
        report: Everything on the page.

    Returns:
        `path`.

    Raises:
        BadFrames: a clip's image or mask is missing or can't be read.
    """
    write_text(path, page(report))
    return path


def page(report: ReportData) -> str:
    """The whole page as HTML."""
    style = resources.files("gmrdata.report").joinpath("report.css").read_text(encoding="utf-8")
    sections = [run_sections.summary_section(report)]
    sections += [clip_section.clip_section(i, clip) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        sections.append(run_sections.gmr_section(report))
    sections += [run_sections.making_section(report.run), run_sections.meaning_section(report.run)]
    return (
        "<!doctype html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(report.run.title)}</title>\n<style>\n{style}</style></head>\n<body>\n"
        f"{_header(report)}\n<main>\n" + "\n".join(sections) + "\n</main>\n</body></html>\n"
    )


def _header(report: ReportData) -> str:
    links = [("summary", "Summary")]
    links += [(f"clip-{i}", clip.id) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        links.append(("gmr", "GMR"))
    links += [("making", "How it was made"), ("meaning", "What the numbers mean")]
    anchors = "".join(f'<a href="#{target}">{text(name)}</a>' for target, name in links)
    return (
        f"<header><h1>{text(report.run.title)}</h1>"
        f'<p class="lead">{text(report.run.data_source)}</p>'
        f'<nav aria-label="Sections">{anchors}</nav></header>'
    )
