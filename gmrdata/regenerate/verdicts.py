"""A row for each sequence: accepted or not, why, and the camera's class."""

from typing import Any

from gmrdata.pseudogt.entry import load_record
from gmrdata.regenerate.paths import SetPaths
from gmrdata.threedpw.layout import SequenceFiles

HEADINGS = ("sequence", "split", "verdict", "camera", "kept", "scale", "reasons")


def verdict_row(files: SequenceFiles, paths: SetPaths) -> dict[str, Any]:
    """The verdict of a sequence whose stages are done: accepted if one of its people is."""
    record = load_record(paths.pseudo_gt_dir(files.name))
    people = record["people"]
    reasons = [reason for person in people for reason in person["reasons"]]
    frames = sum(person["frames"] for person in people)
    kept = sum(person["kept_frames"] for person in people if person["accepted"])
    return {
        "sequence": files.name,
        "split": files.split,
        "accepted": any(person["accepted"] for person in people),
        "reasons": list(dict.fromkeys(reasons)),
        "class": record["camera_motion"],
        "kept_share": float(f"{kept / frames:.6g}"),
        "scale": record.get("scale"),
        "scale_sigma": record.get("scale_sigma"),
    }


def failed_row(name: str, split: str, reason: str) -> dict[str, Any]:
    """The verdict of a sequence that could not be read."""
    return {
        "sequence": name,
        "split": split,
        "accepted": False,
        "reasons": [reason.splitlines()[0]],
        "class": "none",
        "kept_share": 0.0,
        "scale": None,
        "scale_sigma": None,
    }


def table_row(row: dict[str, Any]) -> tuple[str, ...]:
    """A row for `HEADINGS`."""
    scale = "-"
    if row["scale"] is not None:
        scale = f"{row['scale']:.4g} ± {100 * row['scale_sigma'] / row['scale']:.1f} %"
    return (
        row["sequence"],
        row["split"],
        "accepted" if row["accepted"] else "rejected",
        row["class"],
        f"{100 * row['kept_share']:.1f} %",
        scale,
        "; ".join(row["reasons"]),
    )
