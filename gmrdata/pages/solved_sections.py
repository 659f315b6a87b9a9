"""Sections that the pages of solved sequences share: values for `solved.html.j2`."""

from collections.abc import Callable, Iterator, Mapping

from markupsafe import Markup
from matplotlib.figure import Figure

from gmrdata.cameras.files import CamerasQuality
from gmrdata.pages import solved_plots, thresholds
from gmrdata.pages.html import Cell, Table
from gmrdata.pages.plots import svg
from gmrdata.pages.report import GEOMETRY_WORDS
from gmrdata.pages.solved import Solved, align_dataset_camera, counts_of
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.values.errors import GmrdataError
from gmrdata.values.rows import text_runs
from gmrdata.world.quality import PseudoGtQuality
from gmrdata.world.recipe import VerdictConfig

OPEN_RANGES = 12  # a longer list of dropped ranges is folded


Sections = list[tuple[str, object, str]]
"""The kind of each, what its part of the template takes, and why it can't be drawn, if so."""


def made(makers: Mapping[str, Callable[[], object]]) -> Sections:
    """The sections that can be made, in order; what can't must not cost the others."""
    sections: Sections = []
    for kind, make in makers.items():
        try:
            sections.append((kind, make(), ""))
        except (GmrdataError, OSError) as error:
            sections.append((kind, None, str(error)))
    return sections


def over_time(found: Solved, config: VerdictConfig) -> dict[str, object]:
    headings = ("of", "frames", "number", "reason")
    ranges, height_in = list(_ranges(found)), solved_plots.height_in(found)
    return {
        "plot": svg(
            lambda plot: solved_plots.plot_time(plot, found, config), 11.0, height_in, "time"
        ),
        "legend": list(_legend(found)),
        "ranges": Table(headings, ranges, "Dropped ranges, as counted from 0 in the sequence."),
        "open": len(ranges) <= OPEN_RANGES,
    }


def _legend(found: Solved) -> Iterator[tuple[str, str]]:
    accepted = found.accepted
    with_kept = [i for i, reasons in enumerate(found.reasons) if "" in reasons]
    if not found.is_solved and with_kept:
        yield "var(--rule)", "the data set vouches for it"
    if found.is_solved and any(accepted[i] for i in with_kept):
        yield "var(--good)", "kept"
    if found.is_solved and not all(accepted[i] for i in with_kept):
        yield "var(--rule)", "within the thresholds, but rejected"
    for kind, n in counts_of(found.reasons).items():
        yield kind.colour, f"{kind.words} ({n})"


def _ranges(found: Solved) -> Iterator[tuple[Cell | str, ...]]:
    for person, reasons in enumerate(found.reasons):
        for start, stop, reason in text_runs(reasons):
            if reason:
                span = f"{start} to {stop - 1}" if stop - start > 1 else f"{start}"
                words = Cell(reason, kind="words-cell")
                yield found.row_names[person], span, str(stop - start), words


def paths(found: Solved) -> dict[str, object]:
    world_from_cam = found.world_from_cam
    if world_from_cam is None:
        return {"above": None}
    aligned = None
    if found.dataset_camera is not None:
        aligned = align_dataset_camera(world_from_cam, found.dataset_camera, found.kept)
    return {
        "above": svg(lambda plot: solved_plots.plot_paths(plot, found, aligned), 7.4, 6.2, "paths"),
        "side": svg(lambda plot: solved_plots.plot_side_view(plot, found), 7.4, 6.2, "side"),
        "people": [(solved_plots.person_role(n), f"person {n}") for n in found.clips],
        "aligned": aligned,
    }


def scale_cues(record: PseudoGtQuality) -> dict[str, object]:
    scale, sigma, cues = record.scale, record.scale_sigma, record.scale_cues
    if scale is None or sigma is None or not cues:
        return {"plot": None}
    rows = [
        (solved_plots.cue_words(cue), f"{cue.scale:.5g}", f"{100 * cue.sigma / cue.scale:.2f}",
         f"{100 * (cue.scale / scale - 1):+.2f}", str(cue.support), f"{1000 * cue.residual_m:.1f}")
        for cue in cues
    ]  # fmt: skip
    foot = ("fused", f"{scale:.5g}", f"{100 * sigma / scale:.2f}", "", "", "")
    headings = (
        "cue", "scale [m per unit]", "standard error [%]", "from the fused [%]",
        "stances, points or windows", "residual [mm]",
    )  # fmt: skip

    def draw(plot: Figure) -> None:
        solved_plots.plot_scale_cues(plot, scale, sigma, cues)

    return {
        "plot": svg(draw, 7.4, 1.0 + 0.32 * (len(cues) + 1), "scale"),
        "table": Table(headings, rows, "The metric scale, cue by cue.", foot),
    }


def camera_class(record: PseudoGtQuality, config: MotionClassConfig) -> Table:
    figures = record.camera_motion_figures
    rows = [] if figures is None else thresholds.class_rows(figures, config)
    caption = Markup(
        "Of the recovered camera in the frames that have one and a body; see "
        "<code>gmrdata.values.camera_motion</code>."
    )
    return thresholds.threshold_table(rows, "borders of the classes", caption)


def reconstruction_rows(
    cameras: CamerasQuality, *, with_lens: bool = True
) -> list[tuple[str, object]]:
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
        *(cameras.lens_in_words if with_lens else ()),
    ]
    return [(name, value) for name, value in rows if value is not None]
