"""Lay the pseudo ground truth's own error beside scores, and say which scores are below it."""

from pathlib import Path
from typing import Any

from gmrdata.manifest.read import read_manifest
from gmrdata.twins.floor_record import Floor, FloorGroup, read_floor
from gmrdata.values.errors import BadManifest, BadRecord

UNITS = {"ome_deg": ("OME", "°", 3), "tme_mm": ("TME", " mm", 2), "vme_mm": ("VME", " mm", 2)}
"""Name, unit and digits of each metric in a sentence."""


def read_fitting_floor(path: Path, manifest_path: Path, fps_hz: float) -> Floor:
    """A floor for the scores of a manifest.

    Args:
        path: A `floor.json`.
        manifest_path: The manifest that is scored.
        fps_hz: Rate of the scored motions [Hz].

    Raises:
        BadManifest: the manifest is no pseudo ground truth.
        BadRecord: no floor, one of another rate, or one without an accepted sequence.
    """
    floor, kind = read_floor(path), read_manifest(manifest_path).kind
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
    if _errors_of(floor.overall) is None:
        raise BadRecord(f"{path}: no sequence was accepted. Measure a floor on more sequences")
    return floor


def beside_floor(scores: dict[str, Any], floor: Floor) -> dict[str, Any]:
    """Scores with a floor in each row, and a sentence for each row with a score below it.

    A row's floor is that of its class of camera motion; where the floor has none, that of all.

    Args:
        scores: What `gmrdata.score.summary.summarise` gave.
        floor: What `read_fitting_floor` gave.

    Returns:
        The scores, in which each clip and group has `floor` (OME, TME, VME, and `of`, the class it
        is of) and `below_floor`, the metrics in which the score is smaller; and
        `statements`.
    """
    clips = [clip | _beside(clip, clip["camera_motion"], floor) for clip in scores["clips"]]
    classes = {
        name: group | _beside(group["pooled_over_motions"], name, floor)
        for name, group in scores["camera_motion"].items()
    }
    overall = scores["overall"]
    overall = overall | _beside(overall["pooled_over_motions"], "all", floor)
    rows = [(clip["id"], clip, clip) for clip in clips]
    rows += [(f"all {name}", g, g["pooled_over_motions"]) for name, g in classes.items()]
    rows.append(("all", overall, overall["pooled_over_motions"]))
    return scores | {
        "clips": clips,
        "camera_motion": classes,
        "overall": overall,
        "statements": [_statement(*row) for row in rows if row[1]["below_floor"]],
    }


def _beside(errors: dict[str, Any], camera_motion: str, floor: Floor) -> dict[str, Any]:
    group = floor.classes.get(camera_motion)
    own = None if group is None else _errors_of(group)
    used = own or _errors_of(floor.overall) or {}
    below = [metric for metric, value in used.items() if errors["predicted"][metric] < value]
    return {"floor": {"of": "all" if own is None else camera_motion, **used}, "below_floor": below}


def _errors_of(group: FloorGroup) -> dict[str, float] | None:
    """OME, TME and VME of a group; None where no sequence was accepted."""
    errors = {metric: getattr(group, metric) for metric in UNITS}
    return None if None in errors.values() else errors


def _statement(name: str, row: dict[str, Any], errors: dict[str, Any]) -> str:
    parts = []
    for metric in row["below_floor"]:
        title, unit, digits = UNITS[metric]
        score, own = errors["predicted"][metric], row["floor"][metric]
        parts.append(f"{title} {score:.{digits}f}{unit} is below {own:.{digits}f}{unit}")
    return (
        f"{name}: {', '.join(parts)}: not distinguishable from the pseudo ground truth's own error"
    )
