"""`fusion.json` and the error bars beside a fused clip."""

from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.values.records import ArrayShapes, Config, Figure, Record, read_arrays

RECORD_FILE = "fusion.json"
SIGMA_FORMAT = "gmrdata-fusion-sigma/2"
FAR_LOOP = 3  # standard deviations between a loop's ends, beyond which something is wrong
_SIGMA_SHAPES: ArrayShapes = {  # NaN in frames beyond the person's time
    "place_sigma_m": ("f", ("T", 3)),  # standard deviation of the pelvis, world axes [m]
    "camera_sigma_m": ("f", ("T", 3)),  # and seen from the camera, its axes; NaN without one [m]
    "turn_sigma_deg": ("f", ("T", 3)),  # and of the root about its own axes [degrees]
    "has_camera": ("b", ("T",)),  # frames whose pose a camera gave, too
}


class Gap(Config):
    """Frames in a row without a camera, in the person's time: from a second before the first frame
    that tells of the person to one after the last."""

    start: int
    """First row."""
    stop: int
    seconds: Figure
    place_sigma_m: Figure
    """Largest standard deviation in it, as the root mean square of the three axes."""
    turn_sigma_deg: Figure


class LoopFound(Config):
    """A loop, and how far apart its ends are."""

    time_s: Figure
    other_time_s: Figure
    apart_m: Figure
    """Seen from above, after all was put together."""
    network_apart_m: Figure
    """By the network's motions alone."""


class FusedPerson(Config):
    """What was made of one person."""

    id: str
    frames: int
    fps_hz: float
    frames_with_camera: int
    noise_along_m: Figure
    """Of the camera's poses from frame to frame, along its ray; as it was taken."""
    noise_across_m: Figure
    noise_turn_deg: Figure
    place_sigma_m: Figure
    """Median, over the person's time, of the root mean square of the three axes."""
    turn_sigma_deg: Figure
    largest_place_sigma_m: Figure
    largest_turn_sigma_deg: Figure
    gaps: tuple[Gap, ...]
    loops: tuple[LoopFound, ...]


class FusionRecord(Record):
    """`fusion.json`."""

    format: Literal["gmrdata-fusion/1"] = "gmrdata-fusion/1"
    network: str
    step: int
    measured_on: tuple[str, ...]
    """People on whom the network's errors were measured."""
    people: tuple[FusedPerson, ...]


def loop_remarks(record: FusionRecord, sigma_m: float) -> list[str]:
    """What to say of loops whose ends stay further apart than a standard deviation explains."""
    return [
        f"{one.id}: at {loop.time_s:.2f} s and {loop.other_time_s:.2f} s it is {loop.apart_m:.2f} m"
        f" apart, over {FAR_LOOP} times --loop-sigma-m {sigma_m:g}: hardly one spot. Look at the"
        " times"
        for one in record.people
        for loop in one.loops
        if loop.apart_m > FAR_LOOP * sigma_m
    ]


def sigma_file(number: int) -> str:
    """Name of the error bars of a person's frames; people are counted from 0."""
    return f"sigma_{number}.npz"


def load_sigma(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an error-bar file, as `_SIGMA_SHAPES` has them; BadRecord for another file."""
    return read_arrays(path, SIGMA_FORMAT, _SIGMA_SHAPES)


def overall_sigma(sigmas: np.ndarray) -> np.ndarray:
    """(T,) root mean square over the three axes."""
    return np.asarray(np.sqrt((sigmas**2).mean(axis=1)))


RESULT_HEADINGS = (
    "person", "frames", "with camera", "longest gap [s]", "place, 1 sigma [mm]", "at most [mm]",
    "turn, 1 sigma [deg]", "at most [deg]",
)  # fmt: skip


def result_rows(record: FusionRecord) -> list[tuple[str, ...]]:
    """A row of `RESULT_HEADINGS` for each person."""
    return [
        (
            one.id,
            str(one.frames),
            str(one.frames_with_camera),
            f"{max((gap.seconds for gap in one.gaps), default=0.0):.2f}",
            f"{1000 * one.place_sigma_m:.0f}",
            f"{1000 * one.largest_place_sigma_m:.0f}",
            f"{one.turn_sigma_deg:.2f}",
            f"{one.largest_turn_sigma_deg:.2f}",
        )
        for one in record.people
    ]
