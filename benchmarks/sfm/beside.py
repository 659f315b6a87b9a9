"""Ours and the plain recipe on the same sequences: rows of both, and the table that compares."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfm.ours import Regenerated
from sfm.plain import plain_cameras, plain_pseudo_gt
from sfm.score import true_clips
from sfm.twins import Twins

from gmrdata.read.threedpw_files import read_sequence_file
from gmrdata.stage.store import stage_seconds
from gmrdata.twins.pseudo_gt_error import RecoveredSequence, sequence_errors
from gmrdata.values.clip import load_clip
from gmrdata.values.people import person_file


@dataclass(frozen=True)
class Beside:
    """One sequence, solved twice."""

    ours: dict[str, Any]
    """Our row."""
    plain: dict[str, Any]
    """The plain recipe's row."""

    @property
    def speedup(self) -> float:
        """The plain recipe's wall time over ours."""
        return round(self.plain["seconds"] / self.ours["seconds"], 2)


def measure_beside(twins: Twins, name: str, made: Regenerated, out_dir: Path) -> Beside:
    """Run the plain recipe on a sequence that ours has done, and score both.

    Both times hold the masks and the camera-frame people, which both recipes need.

    Args:
        twins: Sequences with truth.
        name: One of them.
        made: What ours left.
        out_dir: Folder to make for the plain recipe.
    """
    return Beside(measure_ours(twins, name, made), _plain(twins, name, made, out_dir))


def measure_ours(twins: Twins, name: str, made: Regenerated) -> dict[str, Any]:
    """Score what ours left of a sequence."""
    verdict = made.verdicts[name]
    recovered = RecoveredSequence(
        name,
        twins.classes[name],
        accepted=verdict.accepted,
        seconds=made.given_seconds(name) + made.own_seconds(name),
        class_measured=verdict.camera_motion,
        scale=verdict.scale,
        scale_sigma=verdict.scale_sigma,
        reasons=verdict.reasons,
    )
    errors = sequence_errors(recovered, made.clips(name), true_clips(twins.truth_dir, name))
    return errors.model_dump() | {"own_seconds": round(made.own_seconds(name), 2)}


def _plain(twins: Twins, name: str, made: Regenerated, out_dir: Path) -> dict[str, Any]:
    files = twins.files(name)
    sfm_dir = plain_cameras(
        files.image_dir,
        made.folder(name, "masks"),
        read_sequence_file(files.pickle_path).intrinsics_px,
        out_dir / "sfm",
    )
    given = made.camera_clips(name)
    motions_dir = plain_pseudo_gt(sfm_dir, files.pickle_path, given, out_dir / "pseudo_gt")
    paths = [motions_dir / person_file(number) for number in range(len(given))]
    clips = [load_clip(path) for path in paths if path.is_file()]
    own_s = stage_seconds(sfm_dir) + stage_seconds(motions_dir)
    recovered = RecoveredSequence(
        name,
        twins.classes[name],
        # It has no verdict: what has cameras is used.
        accepted=bool(clips),
        seconds=made.given_seconds(name) + own_s,
    )
    errors = sequence_errors(recovered, clips, true_clips(twins.truth_dir, name))
    return errors.model_dump() | {"own_seconds": round(own_s, 2)}


def table_row(pair: Beside) -> dict[str, Any]:
    """A row of the table; "ours / plain" where there are two figures."""
    ours, plain = pair.ours, pair.plain
    both = {
        title: f"{_cell(ours[key])} / {_cell(plain[key])}"
        for title, key in (
            ("OME [deg]", "ome_deg"),
            ("TME [mm]", "tme_mm"),
            ("scale error [%]", "scale_error_percent"),
            ("kept", "kept_share"),
            ("seconds", "seconds"),
        )
    }
    return {
        "sequence": ours["id"],
        "class": ours["class_true"],
        "measured": ours["class_measured"],
        "accepted": _cell(ours["accepted"]),
        **both,
        "in 2 sigma": _cell(ours["scale_within_2sigma"]),
        "faster": f"{pair.speedup:.1f}x",
    }


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3g}"
