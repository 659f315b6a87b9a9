"""Scores in words: what was scored, what was left out, and what the figures mean."""

from typing import Any

from gmrdata.evaluate.metric_words import METRIC_WORDS
from gmrdata.evaluate.table import metrics_of


def lead(scores: dict[str, Any]) -> str:
    """What was scored, in a sentence or two."""
    overall, model = scores["overall"], scores["model"]
    what = (
        f"read from files ({model['predictions']})"
        if "predictions" in model
        else f"predicted by network {model['run']} (step {model['step']})"
    )
    text = (
        f"{overall['n_motions']} motions of {overall['n_clips']} clips at {scores['fps_hz']:g} "
        f"fps, {what}; body {scores['body']}."
    )
    if scores["protocol"]:
        text += f" Protocol {scores['protocol']['name']}."
    return text


def explanations(scores: dict[str, Any]) -> list[str]:
    """What a reader of the figures must know, as sentences."""
    lines = [
        f"{METRIC_WORDS[metric].title}: {METRIC_WORDS[metric].meaning}"
        for metric in metrics_of(scores)
    ]
    lines += [
        "Figures are means over all motions, or over all samples of a protocol, of the clips of a "
        "row. In brackets: 95 % bootstrap intervals, for which "
        f"{scores['bootstrap']['resamples']} times clips were drawn with replacement; a single "
        "clip has none.",
        "Zero motion is a body that neither turns nor moves.",
        "No difference between frames is taken over a gap.",
    ]
    lines += _of_protocol(scores)
    if scores["dropped_frames"]:
        lines.append(f"{scores['dropped_frames']} valid frames had no prediction and are left out.")
    return lines + [f"Left out: {id}: {why}" for id, why in sorted(scores["skipped"].items())]


def _of_protocol(scores: dict[str, Any]) -> list[str]:
    protocol = scores["protocol"]
    if not protocol:
        return []
    lines = [f"Protocol {protocol['name']} follows {protocol['source']}.", *protocol["notes"]]
    rates = sorted({clip["protocol_fps_hz"] for clip in scores["clips"]})
    if protocol["metrics"] and rates != [protocol["fps_hz"]]:
        lines.append(
            f"Its published figures are of video at {protocol['fps_hz']:g} fps, these are at "
            f"{' and '.join(f'{rate:g}' for rate in rates)} fps: segments of "
            f"{protocol['segment_frames']} frames last longer or shorter than there, and figures "
            "per frame, jitter and sliding can't be compared with published ones."
        )
    return lines
