"""Cameras and a network together: each person's places over time with error bars, as a page of
their own, and as a section of the page of a solved video."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gmrdata.fusion.record import (
    RECORD_FILE,
    RESULT_HEADINGS,
    FusedPerson,
    FusionRecord,
    load_sigma,
    overall_sigma,
    result_rows,
    sigma_file,
)
from gmrdata.manifest.check import require_sound
from gmrdata.motion.resample import valid_runs
from gmrdata.pages.html import Table, render, write_page
from gmrdata.pages.plots import COLOURS, quiet, svg
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import remove_orphans
from gmrdata.values.people import person_file
from gmrdata.values.records import MAKE_AGAIN

SIZE_IN = (7.4, 6.8)
PLACE_IN, SIGMA_IN = 3.0, 2.0  # heights of plots, as parts of the whole
EXPLANATIONS = (
    "The error bars are standard deviations: of 100 errors along an axis, about 95 are within two.",
    "They hold for people and motions like those that the network’s errors were measured on.",
    "They are relative to the cameras’ world: its own place, heading and tilt are not in them.",
)


@dataclass(frozen=True, eq=False)
class FusedPeople:
    """What `fuse_people` left: of each person a clip of T frames, and their error bars."""

    record: FusionRecord
    clips: Mapping[int, Clip]
    sigmas: Mapping[int, dict[str, np.ndarray]]  # as `load_sigma` has them


def read_fused(folder: Path) -> FusedPeople:
    """All of a folder; MissingInput, BadRecord or BadMotionFile for what is lost or broken."""
    record = FusionRecord.read(folder / RECORD_FILE)
    people = range(len(record.people))
    paths = [folder / person_file(person) for person in people]
    clips = {person: require_sound(path, load_clip(path)) for person, path in enumerate(paths)}
    sigmas = {person: load_sigma(folder / sigma_file(person)) for person in people}
    for person, clip in clips.items():
        if len(sigmas[person]["has_camera"]) != clip.motion.n_frames:
            raise BadRecord(f"{folder / sigma_file(person)}: is of other frames; {MAKE_AGAIN}")
    return FusedPeople(record, clips, sigmas)


def write_fusion_page(folder: Path) -> Path:
    """Write `fusion.html` beside `fusion.json`; the path of the page."""
    remove_orphans(folder)
    fused = read_fused(folder)
    lead = (
        f"Camera poses and the motions of GMR {fused.record.network}, put together frame by frame."
    )
    shown = {"title": "Cameras and network together", "lead": lead, "fused": fused_shown(fused)}
    return write_page(folder / "fusion.html", render("fusion", **shown))


def fused_shown(fused: FusedPeople) -> dict[str, object]:
    """The values of the parts of `fused.html.j2`."""
    rows = result_rows(fused.record)
    people = []
    for number, person in enumerate(fused.record.people):
        clip, sigma = fused.clips[number], fused.sigmas[number]
        anchor = f"person-{number}"
        plot = svg(lambda plot, c=clip, s=sigma: plot_person(plot, c, s), *SIZE_IN, anchor)  # type: ignore[misc]
        statements = _statements(person)
        people.append({"anchor": anchor, "id": person.id, "plot": plot, "statements": statements})
    table = Table(RESULT_HEADINGS, rows, "Medians over the person’s time, and the largest.")
    return {"people": people, "table": table, "explanations": EXPLANATIONS}


def plot_person(plot: Figure, clip: Clip, sigma: dict[str, np.ndarray]) -> None:
    """The pelvis along x, y and z over time, with two standard deviations to either side; below,
    one of place and one of turn, over the three axes together."""
    times_s = np.arange(clip.motion.n_frames) / clip.motion.fps_hz
    heights = [PLACE_IN] * 3 + [SIGMA_IN] * 2
    column, colour = plot.subplots(5, sharex=True, height_ratios=heights), COLOURS["gmr"]
    for number, (axes, name) in enumerate(zip(column[:3], "xyz", strict=True)):
        reach_m = 2 * sigma["place_sigma_m"][:, number]
        place_m = np.where(np.isfinite(reach_m), clip.motion.pelvis_m[:, number], np.nan)
        band = place_m - reach_m, place_m + reach_m
        axes.fill_between(times_s, *band, color=colour, alpha=0.25, linewidth=0)
        axes.plot(times_s, place_m, color=colour, linewidth=1.4)
        axes.set_ylabel(f"{name} [m]")
    for axes, key, name in (
        (column[3], "place_sigma_m", "place σ [m]"),
        (column[4], "turn_sigma_deg", "turn σ [°]"),
    ):
        axes.plot(times_s, overall_sigma(sigma[key]), color=colour, linewidth=1.4)
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(name)
    half_s = 0.5 / clip.motion.fps_hz
    for axes in column:
        for start, stop in valid_runs(~sigma["has_camera"]):
            span_s = times_s[start] - half_s, times_s[stop - 1] + half_s
            axes.axvspan(*span_s, color=COLOURS["rule"], linewidth=0, zorder=0)
        quiet(axes)
    plot.align_ylabels(column)
    column[-1].set_xlabel("time [s]")
    told_s = times_s[np.isfinite(sigma["place_sigma_m"]).all(axis=1)]
    column[-1].set_xlim(told_s[0] - half_s, told_s[-1] + half_s)


def _statements(person: FusedPerson) -> list[str]:
    said = [
        f"no camera pose for {gap.seconds:.2f} s from {gap.start / person.fps_hz:.2f} s on: up to"
        f" {1000 * gap.place_sigma_m:.0f} mm and {gap.turn_sigma_deg:.1f}°"
        for gap in person.gaps
    ]
    if person.frames_with_camera:
        said.append(
            f"noise of the camera’s poses: {1000 * person.noise_along_m:.1f} mm along the ray,"
            f" {1000 * person.noise_across_m:.1f} mm across, {person.noise_turn_deg:.2f}°"
        )
    said += [
        f"at {loop.time_s:.2f} s and {loop.other_time_s:.2f} s on one spot: {loop.apart_m:.2f} m"
        f" apart, {loop.network_apart_m:.2f} m by the network alone"
        for loop in person.loops
    ]
    return said
