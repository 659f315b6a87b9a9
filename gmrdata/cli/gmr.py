"""Verbs for the network: train, evaluate, compare and infer."""

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table
from gmrdata.gmr.config import Which
from gmrdata.score import ProtocolName
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe, MissingInput

Weights = Annotated[
    Which,
    arg(
        help="Use a network's weights after its last step, or those that scored best on the clips "
        "held out from its training."
    ),
]


def train(
    manifests: flags.Manifests,
    out: Path,
    recipe: flags.RecipeName = "gmr",
    body: flags.Body = "anny",
    held_out: tuple[Path, ...] = (),
    redo: flags.Redo = False,
) -> None:
    """Train GMR on the clips of manifests.  A run that was stopped goes on where it was.

    Args:
        out: Run folder.
        held_out: Manifests to score now and then while training.
    """
    from gmrdata.gmr.train import GmrRecipe
    from gmrdata.gmr.train import train as train_gmr

    flags.need(manifests, "a manifest file")
    config = flags.read_recipe(recipe, GmrRecipe).train
    path, run = flags.body_path(body), Run(redo=redo)
    answer(train_gmr(manifests, out, config, body_path=path, held_out_paths=held_out, run=run))


def evaluate(
    run_and_manifest: Positional[tuple[Path, ...]],
    out: Path,
    predictions: Path | None = None,
    protocol: ProtocolName | None = None,
    body: flags.Body = "anny",
    predictions_body: Path | None = None,
    fps_hz: float = 10.0,
    missing: Literal["error", "drop"] = "error",
    floor: Path | None = None,
    which: Weights = "latest",
    all_phases: bool = False,
    seed: flags.BootstrapSeed = 0,
    redo: flags.Redo = False,
) -> None:
    """Score a trained GMR, or any predictions, on a manifest: OME [deg], TME [mm], VME [mm].

    `gmrdata evaluate RUN MANIFEST` scores a network, `gmrdata evaluate MANIFEST --predictions
    FOLDER` world motions that anything predicted. Zero motion is scored beside.

    Args:
        run_and_manifest: Run folder of `gmrdata train` and manifest file; the manifest alone with
            --predictions.
        out: Output folder: scores.json, scores.csv, scores.md, scores.html, over_time.png.
        predictions: Folder with one clip file (.npz) for each clip, named by the clip's id, in the
            world frame.
        protocol: What to measure besides: gmr, wham, tram, gvhmr, slahmr or emdb, for W-MPJPE,
            WA-MPJPE, RTE, ROE, ERVE, jitter and foot sliding as each of them defines them.
        predictions_body: Body model of the predictions, with the same mesh; the clips' when left
            out.
        fps_hz: Rate of OME, TME and VME of predictions; a network is scored at its own.
        missing: Whether a clip or frame without a prediction is an error, or dropped and counted.
        floor: The floor.json of `gmrdata floor`, to see which scores are not distinguishable from
            the pseudo ground truth's own error.
        all_phases: Score a clip of a higher frame rate in all its phases, not in the first alone.
    """
    from gmrdata.score.score import ScoreConfig, score_manifest, score_predictions

    if not fps_hz > 0:
        raise BadRecipe(f"--fps-hz {fps_hz:g}: must be more than 0")
    config = ScoreConfig(
        which=which, all_phases=all_phases, protocol=protocol,
        fps_hz=fps_hz, missing=missing, seed=seed,
    )  # fmt: skip
    clips_body, run = flags.body_path(body), Run(redo=redo)
    if predictions is None:
        if len(run_and_manifest) != 2:
            raise MissingInput("give a run folder and a manifest, or a manifest and --predictions")
        path = score_manifest(*run_and_manifest, clips_body, out, config, floor_path=floor, run=run)
    else:
        if len(run_and_manifest) != 1:
            raise MissingInput("with --predictions, give the manifest alone")
        path = score_predictions(
            predictions, *run_and_manifest, clips_body, out, config,
            predictions_body_path=predictions_body, floor_path=floor, run=run,
        )  # fmt: skip
    show_scores(path)


def show_scores(path: Path) -> None:
    """Print a `scores.json`, and write its page."""
    from gmrdata.pages.scores import write_scores_page
    from gmrdata.score.records import Scores
    from gmrdata.score.table import protocol_rows, score_rows

    scores = Scores.read(path)
    print_table(*score_rows(scores))
    if besides := protocol_rows(scores):
        print_table(*besides)
    skipped = (f"{id}: left out: {why}" for id, why in sorted(scores.skipped.items()))
    for line in (*scores.statements, *skipped):
        answer(line)
    if scores.dropped_frames:
        answer(f"{scores.dropped_frames} valid frames had no prediction and are left out")
    answer(write_scores_page(path))
    answer(path)


def infer(
    run: Positional[Path],
    source: Positional[Path],
    out: Path,
    body: flags.Body = "anny",
    fps_hz: flags.FpsHz = None,
    joint_map: flags.JointMap = None,
    bridge_frames: int = 0,
    which: Weights = "latest",
    level: Literal["standing_feet", "first_pose"] = "standing_feet",
    video: bool = True,
    redo: flags.Redo = False,
) -> None:
    """Predict people's world motion from their local poses, and write it as npz, BVH, GLB, video.

    Args:
        run: Run folder of `gmrdata train`.
        source: Local poses: VIBE's vibe_output.pkl, WHAM's wham_output.pkl, PHALP's and 4D-Humans'
            results, GVHMR's hmr4d_results.pt, an AMASS npz, a clip of gmrdata, BVH or ASF/AMC.
        out: Output folder: infer.json, and for each unbroken run of each person a folder with
            clip.npz, amass.npz, motion.bvh, body.glb, path.png and body.mp4. A run that was stopped
            goes on where it was.
        bridge_frames: Longest gap of a person's track that is filled [frames]; at longer ones a new
            motion begins, in a world of its own.
        level: Take up and the floor from feet that stand, or begin as the paper does, with the
            first pelvis upright at the origin.
        video: Whether to draw body.mp4, which takes longest.
    """
    from gmrdata.gmr.infer import RECORD_FILE, InferConfig, InferRecord, infer_world_motion
    from gmrdata.pages.inference import draw_motion

    if fps_hz is not None and not 0 < fps_hz < float("inf"):
        raise BadRecipe(f"--fps-hz {fps_hz:g}: must be more than 0")
    if bridge_frames < 0:
        raise BadRecipe(f"--bridge-frames {bridge_frames}: give 0 or more")
    config = InferConfig(
        fps_hz=fps_hz, bridge_frames=bridge_frames, which=which, level=level, video=video
    )
    path = flags.body_path(body)
    made = infer_world_motion(
        run, source, "anny" if path is None else str(path), out, config,
        draw=draw_motion, joint_map=joint_map, run=Run(redo=redo),
    )  # fmt: skip
    motions = InferRecord.read(made / RECORD_FILE).motions
    rows = []
    for name, one in motions.items():
        span, rate, far = f"{one.first_frame}-{one.last_frame}", f"{one.fps_hz:g}", one.path_m
        rows.append((name, str(one.frames), span, str(one.filled_frames), rate, f"{far:.2f}"))
    print_table(("motion", "frames", "of the video", "filled", "rate [Hz]", "path [m]"), rows)
    answer(made)


def compare(
    scores: Positional[tuple[Path, ...]],
    out: Path,
    names: tuple[str, ...] = (),
    seed: flags.BootstrapSeed = 0,
    redo: flags.Redo = False,
) -> None:
    """Compare scored runs, clip by clip: differences to the first, intervals, and p-values.

    Args:
        scores: The scores.json of each run; the first is what the others are compared with.
        out: Output folder: comparison.json, comparison.csv, comparison.md, comparison.html.
        names: What to call the runs, in their order; their own names when left out.
    """
    from gmrdata.pages.scores import write_comparison_page
    from gmrdata.score import compare as stage

    flags.need(scores, "the scores.json of two runs or more")
    config = stage.CompareConfig(names=names, seed=seed)
    path = stage.compare_scores(scores, out, config, run=Run(redo=redo))
    print_table(stage.HEADINGS, stage.table_rows(stage.Comparison.read(path)))
    answer(write_comparison_page(path, scores))
    answer(path)
