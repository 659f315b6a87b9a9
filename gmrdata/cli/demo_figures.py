"""The demo's figures: summary.json, the report, and the last lines on the terminal."""

from pathlib import Path

from pydantic import FiniteFloat, TypeAdapter, ValidationError
from rich.markup import escape

from gmrdata.cli.demo_recipe import FPS_HZ, DemoClip, DemoPaths, DemoRecipe, MotionsConfig
from gmrdata.gmr.predict import TrainedGmr, load_gmr, predict_world_motion
from gmrdata.gmr.runs import split_manifests
from gmrdata.pages import report_data
from gmrdata.pages.report import summary_table, write_overview, write_report
from gmrdata.pages.report_data import ClipReport
from gmrdata.pages.view3d import view_of_clip, write_view
from gmrdata.people.sources import masks_seconds
from gmrdata.read.body_file import read_body
from gmrdata.score.records import Scores
from gmrdata.stage.progress import answers
from gmrdata.stage.store import StageRecord, stage_seconds
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json_lines
from gmrdata.world.judge import load_record


def _curve(path: Path) -> tuple[tuple[int, float], ...]:
    """Steps and losses of a run."""
    points = [(row.get("step"), row["loss"]) for row in read_json_lines(path) if "loss" in row]
    try:
        return TypeAdapter(tuple[tuple[int, FiniteFloat], ...]).validate_python(points)
    except ValidationError as error:
        why = error.errors()[0]["msg"]
        raise BadRecord(f"{path}: `step` or `loss` is wrong ({why}); train again") from None


def show(paths: DemoPaths, recipe: DemoRecipe) -> Path:
    """Write summary.json, overview.png, view3d/ and report.html, whose path it gives; print the
    figures."""
    body, gmr = read_body(paths.body), load_gmr(paths.gmr_dir)
    rows = _curve(paths.gmr_dir / "metrics.jsonl")
    record = StageRecord.of(paths.gmr_dir)
    report = report_data.ReportData(
        title="gmrdata demo",
        data_source=_data_source(paths, recipe),
        seconds=_seconds(paths, recipe),
        versions={"gmrdata": record.gmrdata, "python": record.python, **record.packages},
        recipe=paths.recipe.read_text(encoding="utf-8"),
        clips=tuple(_clip_report(paths, clip, body, gmr) for clip in recipe.clips),
        scores={name: _manifest_score(paths, name) for name in ("synthetic", "pseudo_gt")},
        learning_curve=rows,
    )
    figures = report_data.summary(report)
    figures.write(paths.summary)
    write_overview(paths.overview, report)
    write_report(paths.report, report)
    for clip in report.clips:
        write_view(paths.views_dir / f"{clip.id}.html", view_of_clip(clip))
    answers.print(summary_table(figures))
    report_path, views_dir = escape(str(paths.report)), escape(str(paths.views_dir))
    answers.print(f"\n[bold]{report_path}[/bold], and in 3D {views_dir}", soft_wrap=True)
    return paths.report


def _data_source(paths: DemoPaths, recipe: DemoRecipe) -> str:
    filmed = MotionsConfig.of_plain(StageRecord.of(paths.motions_dir).config).filmed
    if not filmed:
        return "Embedded gait generator: made by a program, not motion capture."
    split = split_manifests([paths.training_manifest], recipe.gmr.data)
    n_files = sum(file.entry.source.dataset != "gmrdata" for file in split.training)
    return (
        f"Motion files {', '.join(filmed)}; GMR trained on {n_files} other files and on the "
        "embedded gait."
    )


def _seconds(paths: DemoPaths, recipe: DemoRecipe) -> dict[str, float]:
    """Wall time per stage [s]; the clips run side by side, so theirs is the longest."""
    clips = [paths.clip(clip.id) for clip in recipe.clips]
    return {
        "body": stage_seconds(paths.body_dir),
        "motions": stage_seconds(paths.motions_dir),
        "render": max(stage_seconds(clip.render_dir) for clip in clips),
        "masks": max(masks_seconds(clip.masks_dir) for clip in clips),
        "cameras": max(stage_seconds(clip.sfm_dir) for clip in clips),
        "world motion": max(stage_seconds(clip.pseudo_gt_dir) for clip in clips),
        "train": stage_seconds(paths.gmr_dir),
        "score": sum(stage_seconds(paths.scores_dir(n)) for n in ("synthetic", "pseudo_gt")),
    }


def _clip_report(paths: DemoPaths, clip: DemoClip, body: BodyModel, gmr: TrainedGmr) -> ClipReport:
    files = paths.clip(clip.id)
    quality = load_record(files.pseudo_gt_dir)
    if quality.cameras is None:
        what = "says of no reconstruction, so there is none to draw"
        raise BadRecord(f"{files.pseudo_gt_dir}: {what}")
    true, pseudo = load_clip(files.true), load_clip(files.pseudo)
    error = compare_clips(pseudo, true, fps_hz=FPS_HZ)
    predicted = predict_world_motion(
        gmr,
        true.motion,
        first_root_rotmat=true.motion.root_rotmats[0],
        first_pelvis_m=true.motion.pelvis_m[0],
    )
    return ClipReport(
        id=clip.id,
        camera_motion=clip.programme.kind,
        true=true,
        pseudo=pseudo,
        true_from_pseudo=error.true_from_pseudo,
        images_dir=files.frames_dir,
        masks_dir=files.masks_dir,
        body=body,
        figures=report_data.ClipAccuracy.of(error, true.motion.n_frames),
        quality=quality,
        cameras=quality.cameras,
        figures_fps_hz=FPS_HZ,
        predicted=predicted,
    )


def _manifest_score(paths: DemoPaths, name: str) -> report_data.GmrSummary:
    pooled = Scores.read(paths.scores_dir(name) / "scores.json").overall.pooled_over_motions
    return report_data.GmrSummary(**pooled.predicted.by_metric(), zero_motion=pooled.zero)
