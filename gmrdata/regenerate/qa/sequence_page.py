"""One sequence's page: what was decided of it, and what there is to see."""

from collections.abc import Callable
from urllib.parse import quote

from gmrdata.errors import GmrdataError
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.qa.frames_section import Frames, frames_section
from gmrdata.regenerate.qa.gather import Found
from gmrdata.regenerate.qa.plots_sections import paths_section, scale_section, time_section
from gmrdata.regenerate.qa.style import QA_STYLE, small
from gmrdata.regenerate.qa.verdict_section import class_section, verdict_section
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.report.clip_section import GEOMETRY_WORDS
from gmrdata.report.document import document
from gmrdata.report.markup import text

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
