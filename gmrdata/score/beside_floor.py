"""Lay the pseudo ground truth's own error beside scores, and say which scores are below it."""

from pathlib import Path
from typing import TypeVar

from gmrdata.score import METRICS, Metric
from gmrdata.score.records import Row, RowFloor, Summary
from gmrdata.twins.floor_record import Floor, FloorGroup
from gmrdata.values.errors import BadManifest, BadRecord

BELOW: dict[Metric, str] = {
    "ome_deg": "OME {:.3f}° is below {:.3f}°",
    "tme_mm": "TME {:.2f} mm is below {:.2f} mm",
    "vme_mm": "VME {:.2f} mm is below {:.2f} mm",
}
R = TypeVar("R", bound=Row)


def read_fitting_floor(path: Path, manifest_path: Path, kind: str, fps_hz: float) -> Floor:
    """A floor for the scores of a manifest, whose motions were scored at `fps_hz`."""
    floor = Floor.read(path)
    if kind != "pseudo_gt":
        raise BadManifest(
            f"{manifest_path}: of kind {kind}, but {path} is the error of a pseudo ground truth. "
            "Leave out --floor"
        )
    if floor.fps_hz != fps_hz:
        raise BadRecord(
            f"{path}: of motions at {floor.fps_hz:g} fps, but the scores are at {fps_hz:g} fps. "
            "Leave out --floor"
        )
    if _errors_of(floor.overall, "all") is None:
        raise BadRecord(f"{path}: no sequence was accepted. Measure a floor on more sequences")
    return floor


def beside_floor(scores: Summary, floor: Floor) -> Summary:
    """Scores with a floor in each row, and a sentence for each row with a score below it.

    A row's floor is that of its class of camera motion; where the floor has none, that of all.
    Types of motion have none: the floor does not know them.
    """
    clips = tuple(_beside(clip, clip.camera_motion, floor) for clip in scores.clips)
    classes = {name: _beside(row, name, floor) for name, row in scores.camera_motion.items()}
    overall = _beside(scores.overall, "all", floor)
    rows: list[tuple[str, Row]] = [(clip.id, clip) for clip in clips]
    rows += [*((f"all {name}", row) for name, row in classes.items()), ("all", overall)]
    statements = tuple(_statement(name, row) for name, row in rows if row.below_floor)
    changes = {"clips": clips, "camera_motion": classes, "overall": overall}
    return scores.model_copy(update=changes | {"statements": statements})


def _beside(row: R, camera_motion: str, floor: Floor) -> R:
    group = floor.classes.get(camera_motion)
    found = None if group is None else _errors_of(group, camera_motion)
    used = found or _errors_of(floor.overall, "all")
    assert used is not None
    score = row.paper().predicted
    below = tuple(metric for metric in METRICS if score.get(metric) < used.get(metric))
    return row.model_copy(update={"floor": used, "below_floor": below})


def _errors_of(group: FloorGroup, of: str) -> RowFloor | None:
    """None where no sequence was accepted."""
    if group.ome_deg is None or group.tme_mm is None or group.vme_mm is None:
        return None
    return RowFloor(of=of, ome_deg=group.ome_deg, tme_mm=group.tme_mm, vme_mm=group.vme_mm)


def _statement(name: str, row: Row) -> str:
    assert row.floor is not None
    score, own = row.paper().predicted, row.floor
    parts = ", ".join(BELOW[one].format(score.get(one), own.get(one)) for one in row.below_floor)
    return f"{name}: {parts}: not distinguishable from the pseudo ground truth's own error"
