"""The report: one HTML file that needs nothing beside it."""

from pathlib import Path

from gmrdata.report import clip_section, run_sections
from gmrdata.report.data import ReportData
from gmrdata.report.document import document
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
    sections = [run_sections.summary_section(report)]
    sections += [clip_section.clip_section(i, clip) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        sections.append(run_sections.gmr_section(report))
    sections += [run_sections.making_section(report.run), run_sections.meaning_section(report.run)]
    return document(report.run.title, _header(report), sections)


def _header(report: ReportData) -> str:
    links = [("summary", "Summary")]
    links += [(f"clip-{i}", clip.id) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        links.append(("gmr", "GMR"))
    links += [("making", "How it was made"), ("meaning", "What the numbers mean")]
    anchors = "".join(f'<a href="#{target}">{text(name)}</a>' for target, name in links)
    return (
        f"<h1>{text(report.run.title)}</h1>"
        f'<p class="lead">{text(report.run.data_source)}</p>'
        f'<nav aria-label="Sections">{anchors}</nav>'
    )
