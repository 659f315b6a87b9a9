"""Cameras and a network together, as an HTML page: places over time, with error bars."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gmrdata.gmr.fused_motion import (
    RECORD_FILE,
    RESULT_HEADINGS,
    FusedPerson,
    FusionRecord,
    load_sigma,
    result_rows,
    sigma_file,
)
from gmrdata.motion.resample import valid_runs
from gmrdata.pages.html import Table, render
from gmrdata.pages.plots import COLOURS, quiet, svg
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.files import remove_orphans, write_text
from gmrdata.values.people import person_file

SIZE_IN = (7.4, 5.2)
EXPLANATIONS = (
    "The error bars are standard deviations: of 100 errors along an axis, about 95 are within two.",
    "They hold for people and motions like those that the network’s errors were measured on.",
    "They are relative to the cameras’ world: its own place, heading and tilt are not in them.",
)


def write_fusion_page(folder: Path) -> Path:
    """Write `fusion.html` beside `fusion.json`; the path of the page."""
    remove_orphans(folder)
    record = FusionRecord.read(folder / RECORD_FILE)
    people = []
    for number, person in enumerate(record.people):
        clip = load_clip(folder / person_file(number))
        sigma = load_sigma(folder / sigma_file(number))
        name = f"person-{number}"
        plot = svg(lambda plot, c=clip, s=sigma: plot_place(plot, c, s), *SIZE_IN, name)  # type: ignore[misc]
        statements = _statements(person)
        people.append({"anchor": name, "id": person.id, "plot": plot, "statements": statements})
    table = Table(RESULT_HEADINGS, result_rows(record), "Medians over the frames, and the largest.")
    page = folder / "fusion.html"
    lead = f"Camera poses and the motions of GMR {record.network}, put together frame by frame."
    shown = {"title": "Cameras and network together", "lead": lead, "table": table}
    write_text(page, render("fusion", people=people, explanations=EXPLANATIONS, **shown))
    return page


def plot_place(plot: Figure, clip: Clip, sigma: dict[str, np.ndarray]) -> None:
    """The pelvis along x, y and z over time, with two standard deviations to either side."""
    times_s = np.arange(clip.motion.n_frames) / clip.motion.fps_hz
    for number, (axes, name) in enumerate(zip(plot.subplots(3, sharex=True), "xyz", strict=True)):
        place_m = clip.motion.pelvis_m[:, number]
        reach_m = 2 * sigma["place_sigma_m"][:, number]
        for start, stop in valid_runs(~sigma["has_camera"]):
            axes.axvspan(times_s[start], times_s[stop - 1], color=COLOURS["rule"], linewidth=0)
        colour = COLOURS["gmr"]
        band = place_m - reach_m, place_m + reach_m
        axes.fill_between(times_s, *band, color=colour, alpha=0.25, linewidth=0)
        axes.plot(times_s, place_m, color=colour, linewidth=1.4)
        axes.set_ylabel(f"{name} [m]")
        quiet(axes)
    axes.set_xlabel("time [s]")
    axes.set_xlim(0, max(times_s[-1], 1e-3))


def _statements(person: FusedPerson) -> list[str]:
    said = [
        f"no camera for {gap.seconds:.2f} s from {gap.start / person.fps_hz:.2f} s on: up to"
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
