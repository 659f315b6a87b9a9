"""A recovered sequence against its truth: one row of figures."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import NothingToCompare
from gmrdata.evaluate.pseudo_gt_error import PseudoGtError, compare_clips

FPS_HZ = 10.0
"""Rate of the scores; clips have three times as much, so all three phases count."""
OF_PERSON = ("ome_deg", "tme_mm", "vme_mm", "camera_rotation_deg", "camera_path_mm")


def sequence_row(
    name: str,
    class_true: str,
    clips: Sequence[Clip],
    truth: Sequence[Clip],
    *,
    accepted: bool,
    seconds: float,
    body: BodyModel | None = None,
    class_measured: str | None = None,
    scale: float | None = None,
    scale_sigma: float | None = None,
) -> dict[str, Any]:
    """Figures of one sequence as JSON values; None for what is not known.

    Motion and camera errors are those of the person who fares worst; `people` has each one's.

    Args:
        name: The sequence.
        class_true: What its camera does.
        clips: The people as they were recovered, in the order of `truth`; none where nothing was.
        truth: The exact people.
        accepted: Whether the sequence may be used.
        seconds: Wall time [s].
        body: The exact people's body, for VME.
        class_measured: Class of the recovered path.
        scale: Metres per unit of the recovered path.
        scale_sigma: Its stated standard error, same unit.

    Raises:
        StageFailed: the clips and their truth don't belong together.
    """
    n_frames = truth[0].motion.n_frames
    recovered = [*clips, *[None] * (len(truth) - len(clips))]
    people = [_person(clip, true, body) for clip, true in zip(recovered, truth, strict=True)]
    scale_error = next((p["scale_error_percent"] for p in people if _is_known(p)), None)
    kept_frames = sum(person["kept_frames"] for person in people)
    return {
        "id": name,
        "class_true": class_true,
        "class_measured": class_measured,
        "accepted": accepted,
        "frames": n_frames,
        "kept_share": _figure(kept_frames / (n_frames * len(truth))),
        **{key: _largest([person[key] for person in people]) for key in OF_PERSON},
        "scale_error_percent": scale_error,
        "scale_within_2sigma": within_2sigma(scale_error, scale, scale_sigma),
        "seconds": round(seconds, 2),
        "people": people,
    }


def error_of(clip: Clip | None, true: Clip, body: BodyModel | None = None) -> PseudoGtError | None:
    """Errors of one person at 10 fps over the kept frames; None where no two follow each other."""
    if clip is None or clip.motion.frame != "world" or not clip.valid.any():
        return None
    try:
        return compare_clips(clip, true, fps_hz=FPS_HZ, body=body)
    except NothingToCompare:
        return None


def within_2sigma(
    scale_error_percent: float | None, scale: float | None, sigma: float | None
) -> bool | None:
    """Whether the true scale is inside the stated error bar; None where there is none."""
    if scale_error_percent is None or scale is None or sigma is None:
        return None
    true_scale = scale / (1 + scale_error_percent / 100)
    return bool(abs(scale - true_scale) <= 2 * sigma)


def _person(clip: Clip | None, true: Clip, body: BodyModel | None) -> dict[str, Any]:
    error = error_of(clip, true, body)
    figures = {key: None if error is None else getattr(error, key) for key in OF_PERSON}
    return {
        "id": true.id,
        "kept_frames": 0 if clip is None else int(clip.valid.sum()),
        "n_motions": 0 if error is None else error.n_motions,
        **{key: _figure(value) for key, value in figures.items()},
        "scale_error_percent": _figure(None if error is None else error.scale_error_percent),
    }


def _is_known(person: dict[str, Any]) -> bool:
    return person["scale_error_percent"] is not None


def _largest(values: Sequence[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _figure(value: float | None) -> float | None:
    """Six digits; None for what isn't finite, which JSON has no word for."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")
