"""Verbs for the network: train, evaluate, compare and infer."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, answer_json, answer_state, print_table
from gmrdata.gmr.config import BUNDLED, Which
from gmrdata.score import Deviation, ProtocolName, SeenAs
from gmrdata.stage.recipes import read_recipe
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe

if TYPE_CHECKING:
    from gmrdata.gmr.config import TrainConfig
    from gmrdata.gmr.infer import InferRecord
    from gmrdata.score.score import Scored

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
    device: flags.Device = None,
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Train GMR on the clips of manifests.  A run that was stopped goes on where it was.

    Args:
        out: Run folder.
        held_out: Manifests to score now and then while training.
    """
    from gmrdata.gmr.train import GmrRecipe
    from gmrdata.gmr.train import train as train_gmr

    flags.need(manifests, "a manifest file")
    given = read_recipe(recipe, GmrRecipe)
    if given.training or given.scored or given.body:
        said = f"{recipe}: names manifests or a body, which `gmrdata train` takes as flags"
        raise BadRecipe(f"{said}. Leave them out, or use `gmrdata run {recipe}`")
    config = flags.on_device(given.train, device)
    path = flags.body_path(body)
    trained = partial(train_gmr, manifests, out, config, body_path=path, held_out_paths=held_out)
    if dry_run:
        _show_training(manifests, held_out, config)
        answer_state(out, trained, redo)
    else:
        answer(trained(run=Run(redo=redo)))


def _show_training(
    manifests: tuple[Path, ...], held_out: tuple[Path, ...], config: "TrainConfig"
) -> None:
    """What would be trained on, and about how long it takes."""
    from gmrdata.gmr.runs import scored_files, split_manifests
    from gmrdata.manifest.show import kept_frames
    from gmrdata.paper.plan import probe_training

    split = split_manifests(manifests, config.data)
    scored, not_scored = scored_files(held_out, split)
    rows = [
        (what, str(len(files)), str(sum(kept_frames(file.entry) for file in files)))
        for what, files in (("trained on", split.training), ("scored", scored))
    ]
    print_table(("clips", "number", "frames"), rows)
    n_parameters, step_s, basis = probe_training(config)
    time = "" if step_s is None else f", about {config.steps * step_s / 60:.1f} minutes"
    time += f" (by {basis})" if basis else ""
    size = f"{n_parameters:,} weights, {config.steps} steps{time}"
    for line in filter(None, (split.statement, not_scored, size)):
        answer(line)


@dataclass(frozen=True)
class Protocols:
    """Metrics besides OME, TME and VME."""

    protocol: ProtocolName | None = None
    """Metrics of another evaluator, as it defines them."""
    original: tuple[Deviation | Literal["all"], ...] = ()
    """Deviations from the protocol's released code that are switched back."""
    joint_regressor: Path | None = None
    """A .npy of (joints, vertices) that takes a protocol's joints from meshes."""


@dataclass(frozen=True)
class Results:
    """How motions that something else predicted are laid beside the truth."""

    predictions_body: Path | None = None
    """Body model of the predictions, with the same mesh; the clips' when left out."""
    person: tuple[str, ...] = ()
    """Which person of a result a clip is: NAME, CLIP=NAME or SYSTEM/CLIP=NAME."""
    camera: SeenAs = "ignored"
    """The camera of VIBE's motions in the world: at rest (ignored), or the manifest's (true)."""
    first_image: int | None = None
    """Number of the image that the systems' frame 0 is; the manifest's first one when left out."""
    fps_hz: float = 10.0
    """Rate of OME, TME and VME of predictions; a network is scored at its own."""
    missing: Literal["error", "drop"] = "error"
    """Whether a clip or frame without a prediction is an error, or dropped and counted."""


def evaluate(
    predictor: Positional[Path],
    manifest: flags.Manifest,
    out: Path,
    body: flags.Body = "anny",
    floor: Path | None = None,
    which: Weights = "latest",
    all_phases: bool = False,
    seed: flags.BootstrapSeed = 0,
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
    as_json: flags.AsJson = False,
    *,
    protocols: Annotated[Protocols, OmitArgPrefixes],
    results: Annotated[Results, OmitArgPrefixes],
) -> None:
    """Score a trained GMR, or any predictions, on a manifest: OME [deg], TME [mm], VME [mm].

    `gmrdata evaluate RUN MANIFEST` scores a network, `gmrdata evaluate bundled MANIFEST` the one in
    the package, `gmrdata evaluate FOLDER MANIFEST` motions that anything predicted: WHAM, GVHMR,
    TRAM, SLAHMR, VIBE, AMASS-like npz and clips of gmrdata. Several systems in one folder are
    compared. Zero motion is scored beside.

    Args:
        predictor: Run folder of `gmrdata train`, or the word bundled. Or results as the systems
            write them: a file, or a folder of them, named by the clip's id or sequence
            (docs/scores.md has the rules).
        out: Output folder: scores.json, scores.csv, scores.md, scores.html, over_time.png; with
            several systems a folder of these for each, and comparison/.
        floor: The floor.json of `gmrdata floor`, to see which scores are not distinguishable from
            the pseudo ground truth's own error.
        all_phases: Score a clip of a higher frame rate in all its phases, not in the first alone.
    """
    from gmrdata.score import score as stage
    from gmrdata.score.predictors import ScoreConfig

    flags.as_text(dry_run, as_json)
    remedy = "give NAME, CLIP=NAME or SYSTEM/CLIP=NAME, each once"
    people = flags.by_key("--person", results.person, remedy)
    with flags.flags_named():
        config = ScoreConfig(
            which=which, all_phases=all_phases, seed=seed, protocol=protocols.protocol,
            original=protocols.original, person=people, camera=results.camera,
            first_image=results.first_image, fps_hz=results.fps_hz, missing=results.missing,
        )  # fmt: skip
    scored = partial(
        stage.score, predictor, manifest, out, config, body_path=flags.body_path(body),
        predictions_body_path=results.predictions_body, floor_path=floor,
        joint_regressor_path=protocols.joint_regressor,
    )  # fmt: skip
    if dry_run:
        print_table(stage.PLAN_HEADINGS, stage.plan_scores(predictor, manifest, config))
        answer_state(out, scored, redo)
        return
    made = scored(run=Run(redo=redo))
    answer_json(_scored(made)) if as_json else _show_scored(made)


def _show_scored(made: "Scored") -> None:
    """Print tables, and write their pages."""
    for path in made.scores:
        show_scores(path)
    if made.comparison is not None:
        _show_comparison(made.comparison, made.scores)


def _scored(made: "Scored") -> dict[str, object]:
    """What `--json` says: each `scores.json` by its path, and the comparison; pages are written."""
    from gmrdata.pages.scores import write_comparison_page, write_scores_page
    from gmrdata.score.compare import Comparison
    from gmrdata.score.records import Scores

    for path in made.scores:
        write_scores_page(path)
    compared = None
    if made.comparison is not None:
        write_comparison_page(made.comparison, made.scores)
        compared = Comparison.read(made.comparison).model_dump(mode="json")
    scores = {str(path): Scores.read(path).model_dump(mode="json") for path in made.scores}
    return {"scores": scores, "comparison": compared}


def show_scores(path: Path) -> None:
    """Print a `scores.json`, and write its page."""
    from gmrdata.pages.scores import write_scores_page
    from gmrdata.score.records import Scores
    from gmrdata.score.table import left_out, of_predictions, protocol_rows, score_rows

    scores = Scores.read(path)
    print_table(*score_rows(scores))
    if besides := protocol_rows(scores):
        print_table(*besides)
    for line in (*scores.statements, *of_predictions(scores), *left_out(scores)):
        answer(line)
    answer(write_scores_page(path))
    answer(path)


def _show_comparison(path: Path, scores: Sequence[Path]) -> None:
    """Print a `comparison.json`, and write its page."""
    from gmrdata.pages.scores import write_comparison_page
    from gmrdata.score import compare as stage

    comparison = stage.Comparison.read(path)
    print_table(stage.HEADINGS, stage.table_rows(comparison))
    for line in stage.comparison_remarks(comparison):
        answer(line)
    answer(write_comparison_page(path, scores))
    answer(path)


def infer(
    source: Positional[Path],
    out: Path,
    network: flags.Network = BUNDLED,
    body: flags.Body = "anny",
    fps_hz: flags.FpsHz = None,
    joint_map: flags.JointMap = None,
    bridge_frames: int = 0,
    which: Weights = "latest",
    level: Literal["standing_feet", "first_pose"] = "standing_feet",
    video: bool = True,
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Predict people's world motion from their local poses, and write it as npz, BVH, GLB, video.

    The package has a network trained on 17 people of CMU: docs/inference.md says how it scores.

    Args:
        source: Local poses: results of VIBE, WHAM, PHALP, 4D-Humans, GVHMR, GEM, PromptHMR,
            SAM 3D Body, TRAM or SLAHMR, an AMASS npz, a clip of gmrdata, BVH or ASF/AMC
            (docs/inference.md).
        out: Output folder: infer.json, and for each unbroken run of each person a folder with
            clip.npz, amass.npz, motion.bvh, body.glb, path.png, view3d.html and body.mp4. A run
            that was stopped goes on where it was.
        bridge_frames: Longest gap of a person's track that is filled [frames]; at longer ones a new
            motion begins, in a world of its own.
        level: Take up and the floor from the body, or begin upright at the origin, as the paper.
        video: Whether to draw body.mp4, which takes longest.
    """
    from gmrdata.gmr import infer as stage
    from gmrdata.pages.inference import draw_motion

    with flags.flags_named():
        config = stage.InferConfig(
            fps_hz=fps_hz, bridge_frames=bridge_frames, which=which, level=level, video=video
        )
    path = flags.body_path(body)
    inferred = partial(
        stage.infer, network, source, out, config,
        body_path=path, joint_map=joint_map, draw=draw_motion,
    )  # fmt: skip
    if dry_run:
        planned = stage.plan_infer(network, source, config, body_path=path, joint_map=joint_map)
        print_table(stage.PLAN_HEADINGS, planned)
        answer_state(out, inferred, redo)
        return
    made = inferred(run=Run(redo=redo))
    _show_inferred(stage.InferRecord.read(made / stage.RECORD_FILE))
    answer(made)


def _show_inferred(record: "InferRecord") -> None:
    rows = []
    for name, one in record.motions.items():
        span, rate, far = f"{one.first_frame}-{one.last_frame}", f"{one.fps_hz:g}", one.path_m
        rows.append((name, str(one.frames), span, str(one.filled_frames), rate, f"{far:.2f}"))
    print_table(("motion", "frames", "of the video", "filled", "rate [Hz]", "path [m]"), rows)
    answer(f"network: {record.model.run}, {record.model.step} steps of training")


def compare(
    scores: Positional[tuple[Path, ...]],
    out: Path,
    names: tuple[str, ...] = (),
    seed: flags.BootstrapSeed = 0,
    redo: flags.Redo = False,
) -> None:
    """Compare scored runs, clip by clip: differences to the first, intervals, and p-values.

    Args:
        scores: The scores.json of each run, or its folder; the others are compared with the first.
        out: Output folder: comparison.json, comparison.csv, comparison.md, comparison.html.
        names: Names for the runs, in their order; their own when left out.
    """
    from gmrdata.score import compare as stage

    flags.need(scores, "the scores.json of two runs or more")
    with flags.flags_named():
        config = stage.CompareConfig(names=names, seed=seed)
    paths = stage.scores_files(scores)
    _show_comparison(stage.compare(paths, out, config, run=Run(redo=redo)), paths)
