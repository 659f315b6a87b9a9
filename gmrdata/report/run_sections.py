"""The page's sections about the whole run: summary, GMR, how it was made, what the numbers mean."""

from matplotlib.figure import Figure

from gmrdata.report.bars import BARS, figure_texts, score_texts, verdicts
from gmrdata.report.curves import learning_curve, scale_panel
from gmrdata.report.data import ClipReport, ManifestScore, ReportData, RunReport
from gmrdata.report.markup import figure, key, mark, pairs, table, text
from gmrdata.report.style import svg
from gmrdata.report.topview import motion_top_view
from gmrdata.report.words import LIMITS, MEANINGS


def summary_section(report: ReportData) -> str:
    """HTML: whether the bars are met, every clip's figures, and the scales with their sigmas."""
    plot = ""
    if any(clip.figures.scale_error_percent is not None for clip in report.clips):
        height_in = 0.75 + 0.38 * len(report.clips)
        picture = svg(lambda fig: scale_panel(fig, report.clips), 7.4, height_in, "scales")
        caption = (
            "Metric scale against the truth. The bar of each point is the estimate’s own standard "
            f"deviation; the band is what counts as good, ± {BARS['scale_error_percent']:g} %."
        )
        plot = figure(picture, caption, "narrow")
    return (
        '<section id="summary"><h2>Pseudo ground truth against the truth</h2>'
        f"{_verdict(report)}{_clip_table(report)}{plot}</section>"
    )


def _verdict(report: ReportData) -> str:
    good = sum(all(verdicts(clip.figures).values()) for clip in report.clips)
    n = len(report.clips)
    if n == 0:
        return '<p class="verdict">No clip was recovered.</p>'
    name = "good" if good == n else "bad"
    which = "The clip meets" if n == 1 == good else f"{good} of {n} clips meet"
    sign = f'<span class="{name}">{"✓" if good == n else "✗"}</span>'
    return (
        f'<p class="verdict {name}">{sign}<span>{which} every bar: a camera for every frame, '
        f"orientation motion error at most {BARS['ome_deg']:g}°, translation motion error at most "
        f"{BARS['tme_mm']:g} mm, and, where the camera translates, a scale within "
        f"{BARS['scale_error_percent']:g} %.</span></p>"
    )


def _heading(name: str, unit: str) -> str:
    return f'{name}<span class="unit">[{unit}]</span>'


def _clip_table(report: ReportData) -> str:
    headings = (
        "clip", "camera", "frames with<br>a camera", _heading("OME", "°"),
        _heading("TME", "mm"), _heading("camera rotation", "°"), _heading("scale", "%"),
    )  # fmt: skip
    foot = (
        "bar", "", "all", f"≤ {BARS['ome_deg']:g}", f"≤ {BARS['tme_mm']:g}", "",
        f"≤ {BARS['scale_error_percent']:g}",
    )  # fmt: skip
    rows = [_clip_row(i, clip) for i, clip in enumerate(report.clips)]
    caption = (
        "Mean errors of the recovered world motion per frame-to-frame motion (OME, TME), of the "
        "camera’s rotation per frame, and of the metric scale."
    )
    return table(headings, rows, caption, foot)


def _clip_row(index: int, clip: ClipReport) -> tuple[str, ...]:
    texts, met = figure_texts(clip.figures), verdicts(clip.figures)
    return (
        f'<a href="#clip-{index}">{text(clip.id)}</a>',
        text(clip.camera_motion),
        mark(texts["cameras"], met["frames_with_camera"]),
        mark(texts["ome_deg"], met["ome_deg"]),
        mark(texts["tme_mm"], met["tme_mm"]),
        texts["camera_rotation_deg"],
        mark(texts["scale_error_percent"], met.get("scale_error_percent")),
    )


def gmr_section(report: ReportData) -> str:
    """HTML: GMR's scores beside no motion at all, its paths from above, the training loss."""
    parts = [
        '<section id="gmr"><h2>GMR</h2><p>The global motion regressor sees only the local pose, '
        "and predicts how the body turns and moves in the world from frame to frame.</p>"
    ]
    if report.scores:
        parts.append(_score_table(report.scores))
    paths = [_predicted_path(i, clip) for i, clip in enumerate(report.clips) if clip.predicted]
    if paths:
        parts.append(f'<h3>Paths from above</h3><div class="plots even">{"".join(paths)}</div>')
    if report.learning_curve:
        picture = svg(
            lambda fig: learning_curve(fig, report.learning_curve), 7.4, 2.8, "learning-curve"
        )
        caption = "Training loss (eq. 5, no unit) by step: each value, and their running median."
        parts.append(f"<h3>Training</h3>{figure(picture, caption, 'narrow')}")
    return "".join([*parts, "</section>"])


def _score_table(scores: tuple[ManifestScore, ...]) -> str:
    rows = [_score_row(score) for score in scores]
    headings = ["manifest"]
    for name, unit in (("OME", "°"), ("TME", "mm"), ("VME", "mm")):
        headings += [_heading(name, unit), _heading("zero motion", unit)]
    caption = (
        "Mean errors per frame-to-frame motion. In grey, the same for zero motion, that is for a "
        "body that neither turns nor moves: a model that learned something stays below it."
    )
    return table(headings, rows, caption)


def _score_row(score: ManifestScore) -> tuple[str, ...]:
    ours, zero = score_texts(score.gmr), score_texts(score.zero_motion)
    cells = [text(score.name)]
    for metric in ours:
        cells += [ours[metric], f'<span class="beside">{zero[metric]}</span>']
    return tuple(cells)


def _predicted_path(index: int, clip: ClipReport) -> str:
    true, predicted = clip.true.motion, clip.predicted
    if predicted is None:
        return ""

    def draw(fig: Figure) -> None:
        motion_top_view(fig.subplots(), true, predicted)

    picture = svg(draw, 4.2, 4.0, f"gmr-{index}")
    caption = (
        f"{text(clip.id)}: path of the pelvis in the world [m], z up, {key('person-pale')} true "
        f"and {key('gmr', thin=True)} predicted, accumulated from the true first frame (dot) "
        "without any later correction."
    )
    return figure(picture, caption)


def making_section(run: RunReport) -> str:
    """HTML: seconds per stage, versions, the recipe."""
    parts = [f'<section id="making"><h2>How it was made</h2><p>{text(run.data_source)}</p>']
    if run.seconds:
        rows = [(text(stage), f"{seconds:.1f} s") for stage, seconds in run.seconds.items()]
        rows.append(("All stages", f"{sum(run.seconds.values()):.1f} s"))
        parts.append(f"<h3>Wall time</h3>{_small(rows)}")
    if run.versions:
        versions = [(text(name), text(version)) for name, version in run.versions.items()]
        parts.append(f"<h3>Versions</h3>{_small(versions)}")
    if run.recipe:
        parts.append(
            "<details open><summary>The whole recipe</summary>"
            f"<pre>{text(run.recipe)}</pre></details>"
        )
    return "".join([*parts, "</section>"])


def _small(rows: list[tuple[str, str]]) -> str:
    return pairs(rows).replace("<dl>", '<dl class="small">', 1)


def meaning_section(run: RunReport) -> str:
    """HTML: the metrics in words and symbols, and what they do not say."""
    meanings = "".join(
        f'<div><h3>{name}</h3><p>{words}</p><p class="equation">{equation}</p></div>'
        for name, words, equation in MEANINGS
    )
    limits = "".join(f"<li>{words}</li>" for words in (*LIMITS, *map(text, run.limits)))
    return (
        '<section id="meaning"><h2>What the numbers mean</h2>'
        f'<div class="words">{meanings}</div><h3>Limits</h3><ul>{limits}</ul></section>'
    )
