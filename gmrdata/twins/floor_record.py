"""`floor.json`: how wrong the pseudo ground truth itself is, by class of camera motion."""

from typing import Literal

from pydantic import ConfigDict, JsonValue, NonNegativeInt

from gmrdata.values.camera_motion import MotionClass
from gmrdata.values.records import Config, Figure, Record

CameraMotion = MotionClass | Literal["none"]


class _Errors(Config):
    """Errors at 10 fps over the kept frames; null for what is not known."""

    model_config = ConfigDict(allow_inf_nan=False)

    ome_deg: Figure | None
    """Orientation motion error, mean of the motions; the next two are of translation, vertices."""
    tme_mm: Figure | None
    vme_mm: Figure | None
    """Null without a body."""
    camera_rotation_deg: Figure | None
    camera_path_mm: Figure | None


class PersonErrors(_Errors):
    """Errors of one recovered person."""

    id: str
    """The exact clip's."""
    kept_frames: NonNegativeInt
    n_motions: NonNegativeInt
    """Motions, in all phases."""
    scale_error_percent: Figure | None
    """By how much the recovered path is too large."""


class SequenceErrors(_Errors):
    """A recovered sequence against its truth; errors are those of the person who fares worst."""

    id: str
    class_true: str
    """What its camera does."""
    class_measured: CameraMotion | None
    """Class of the recovered path."""
    accepted: bool
    frames: NonNegativeInt
    kept_share: Figure
    """Of all people's frames, 0 to 1."""
    scale_error_percent: Figure | None
    scale_within_2sigma: bool | None
    """Whether the true scale is within two of the stated standard errors."""
    seconds: float
    people: tuple[PersonErrors, ...]
    reasons: tuple[str, ...]
    """Why it was rejected."""


class FloorGroup(_Errors):
    """Figures of some sequences, of which `accepted` may be used.

    Errors are of the accepted ones; null where there are none.  OME, TME and VME are means over all
    people's motions, errors of cameras over the sequences.
    """

    sequences: int
    accepted: int
    class_right: int
    """Those whose camera was given its true class."""
    n_motions: int
    """All people's motions, in all phases."""
    abs_scale_error_percent: Figure | None
    """Size of the scale error, mean of the sequences in which scale enters [%]."""
    scale_stated: int
    """Sequences in which scale enters."""
    scale_within_2sigma: int
    """Those of them whose true scale is within two of the stated standard errors."""
    kept_share: Figure
    """Share of all people's frames that may be used, rejected sequences included, 0 to 1."""
    seconds_per_frame: Figure
    """Wall time of all stages per image."""


class Floor(Record):
    """`floor.json`."""

    format: Literal["gmrdata-floor/1"] = "gmrdata-floor/1"
    fps_hz: float
    """Rate of the motions."""
    seed: int | None
    """What the twins were sampled by; null for given ones."""
    recipe: dict[str, JsonValue]
    """Recipe of the pseudo ground truth."""
    sequences: tuple[SequenceErrors, ...]
    classes: dict[str, FloorGroup]
    """Groups by the camera's true class."""
    overall: FloorGroup
    """All sequences."""


HEADINGS = (
    "sequence", "class", "measured", "accepted", "OME [deg]", "TME [mm]", "VME [mm]",
    "camera [deg]", "camera [mm]", "scale [%]", "2 sigma", "kept", "s/frame",
)  # fmt: skip
ANSWERS = {None: "-", True: "yes", False: "no"}


def floor_rows(floor: Floor) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`: each sequence, each class, all."""
    rows = [_sequence(row) for row in floor.sequences]
    rows += [_group(f"all {name}", name, group) for name, group in floor.classes.items()]
    return [*rows, _group("all", "", floor.overall)]


def notes(floor: Floor) -> list[str]:
    """How the table is read, and why sequences were rejected."""
    lines = [
        f"Motions at {floor.fps_hz:g} fps in all phases, between kept frames; of several people "
        "a sequence shows the one who fares worst. `all`, of what was accepted: OME, TME, VME over "
        "everyone's motions, camera errors and sizes of scale errors over the sequences."
    ]
    rejected = [one for one in floor.sequences if not one.accepted]
    return lines + [f"{one.id}: rejected: {'; '.join(one.reasons)}" for one in rejected]


def _sequence(errors: SequenceErrors) -> tuple[str, ...]:
    scale = errors.scale_error_percent
    return (
        errors.id,
        errors.class_true,
        errors.class_measured or "-",
        ANSWERS[errors.accepted],
        *_errors(errors),
        "-" if scale is None else f"{scale:+.2f}",
        ANSWERS[errors.scale_within_2sigma],
        f"{100 * errors.kept_share:.1f}%",
        f"{errors.seconds / errors.frames:.2f}",
    )


def _group(title: str, class_true: str, group: FloorGroup) -> tuple[str, ...]:
    return (
        title,
        class_true,
        f"{group.class_right}/{group.sequences} right",
        f"{group.accepted}/{group.sequences}",
        *_errors(group),
        _text(group.abs_scale_error_percent, 2),
        f"{group.scale_within_2sigma}/{group.scale_stated}" if group.scale_stated else "-",
        f"{100 * group.kept_share:.1f}%",
        f"{group.seconds_per_frame:.2f}",
    )


def _errors(of: SequenceErrors | FloorGroup) -> tuple[str, ...]:
    values = (of.ome_deg, of.tme_mm, of.vme_mm, of.camera_rotation_deg, of.camera_path_mm)
    return tuple(map(_text, values, (3, 2, 2, 3, 1)))


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
