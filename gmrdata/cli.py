"""The command line: one verb per capability.  Each verb imports its stage only when it runs."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import tyro
from tyro.conf import OmitSubcommandPrefixes, Positional, subcommand

from gmrdata.errors import BadRecipe, GmrdataError, MissingInput
from gmrdata.people import PersonFiles
from gmrdata.progress import answers, console

if TYPE_CHECKING:
    from gmrdata.config import Config
    from gmrdata.synthetic.recipe import SyntheticRecipe

Verb = Callable[..., None]
Recipe = TypeVar("Recipe", bound="Config")


def demo(
    out: Path = Path("out/demo"),
    motions: Path | None = None,
    trials: tuple[str, ...] = (),
    recipe: str = "demo",
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """Everything once: film, regenerate the world poses from the frames, train GMR, score, report.

    Args:
        out: Output folder. A run that was stopped goes on where it was.
        motions: Folder of BVH, ASF/AMC or AMASS files to film and to train on; the embedded gait
            when left out.
        trials: Names of the files to film, without suffix, one for each clip of the recipe; the
            first that fit when left out.
        recipe: A recipe file, or the name of one that travels with gmrdata.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: Say what would be done, and do nothing.
    """
    from gmrdata.demo.recipe import DemoRecipe
    from gmrdata.demo.run import plan, run_demo
    from gmrdata.recipes import find_recipe, load_recipe

    loaded = load_recipe(find_recipe(recipe), DemoRecipe)
    loaded = _with_workers(loaded, workers)
    if dry_run:
        _print_table(("stage", "state"), plan(loaded, out))
        return
    run_demo(loaded, out, motions_dir=motions, trials=trials, scheduler=scheduler, redo=redo)


def fetch(
    source: Positional[Literal["cmu"]],
    trials: Positional[tuple[str, ...]] = (),
    out: Path = Path("cmu"),
    published_list: Annotated[str | None, tyro.conf.arg(name="list")] = None,
    base_url: str | None = None,
    timeout_s: float = 30.0,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """Get motions (ASF/AMC) of the CMU motion capture database from CMU's site or a mirror.

    Args:
        source: Whose motions; there is cmu.
        trials: Names of trials, like 02_03.
        out: Folder for the files, their SHA256SUMS and fetched.json; what is there is kept.
        published_list: Every trial of a list that gmrdata publishes, e.g. paper_table8.
        base_url: A mirror of http://mocap.cs.cmu.edu/subjects.
        timeout_s: Longest silence of the server [s].
        redo: Fetch again files that are there and are not as recorded.
        dry_run: List files and addresses, and do nothing.
    """
    import numpy as np

    from gmrdata.fetch.cmu import fetch_trials, plan
    from gmrdata.fetch.config import FetchConfig
    from gmrdata.fetch.trials import CMU_URL, listed_trials

    wanted = (*trials, *(listed_trials(published_list) if published_list is not None else ()))
    _need(wanted, "trials like 02_03, or --list paper_table8")
    if not timeout_s > 0:
        raise BadRecipe(f"--timeout-s {timeout_s:g}: must be more than 0")
    config = FetchConfig(base_url=base_url or CMU_URL, timeout_s=timeout_s)
    if dry_run:
        headings, rows = plan(wanted, out, config)
        _print_table(headings, rows)
        return
    _answer(fetch_trials(wanted, out, config, np.random.default_rng(), redo=redo))


def motions(
    sources: Positional[tuple[Path, ...]],
    out: Path | None = None,
    body: str = "anny",
    fps_hz: float | None = None,
    joint_map: Path | None = None,
    redo: bool = False,
) -> None:
    """Read motion files, retarget them to the 24-joint tree, and list them or write a manifest.

    Args:
        sources: Files or folders: BVH, ASF/AMC, AMASS npz.
        out: Folder for one clip file per motion and `motions.yaml`; only a table when left out.
        body: "anny", or the path of an SMPL model (.npz or .pkl) or of a gmrdata body (.npz).
        fps_hz: True frame rate of the files [Hz], when theirs is wrong.
        joint_map: YAML or JSON file: joint name in the file -> joint of the SMPL tree.
        redo: Make anew what other settings made.
    """
    from gmrdata.library import make_library, motion_table

    if out is None:
        headings, rows = motion_table(sources, body, fps_hz=fps_hz, joint_map=joint_map)
        _print_table(headings, rows)
        return
    _answer(make_library(sources, body, out, fps_hz=fps_hz, joint_map=joint_map, redo=redo))


def render(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
    probe: bool = True,
    preview: bool = False,
) -> None:
    """Render synthetic clips with exact cameras and masks, and write their manifest.

    Args:
        recipe: A recipe file of kind `synthetic`, or the name of one that travels with gmrdata.
        out: Output folder; a run that was stopped goes on at the next missing frame.
        motions: Folder of motion files that the recipe's clips name; the embedded gait needs none.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: List clips and frames with an estimate of time and disk, and make nothing.
        probe: For the estimate of a dry run, render two frames in a temporary folder.
        preview: Only draw a few small frames and the paths of each clip, to OUT/preview/index.html.
    """
    from gmrdata.recipes import find_recipe, load_recipe
    from gmrdata.synthetic.recipe import SyntheticRecipe

    loaded = load_recipe(find_recipe(recipe), SyntheticRecipe)
    loaded = _with_workers(loaded, workers)
    if dry_run:
        _dry_run(loaded, out, motions, probe)
        return
    if preview:
        from gmrdata.synthetic.preview import preview_set

        _answer(preview_set(loaded, out, motions_dir=motions, scheduler=scheduler))
        return
    from gmrdata.synthetic.render_set import render_set

    _answer(render_set(loaded, out, motions_dir=motions, scheduler=scheduler, redo=redo))


def masks(
    frames: Positional[Path],
    out: Path,
    sources: tuple[str, ...] = ("onnx",),
    model: Path | None = None,
    weights: Path | None = None,
    classes: tuple[str, ...] = (),
    camera_body: Path | None = None,
    body: str = "anny",
    redo: bool = False,
) -> None:
    """Mask what moves in frames or a video: people, vehicles, animals, or a known body.

    Args:
        frames: Folder of numbered images, or a video file.
        out: Output folder: masks/ (`<image stem>.png`, 255 = dynamic), masks_by/ with each
            source's own, sheet/contact.jpg to look at, and frames/ of a video. A run that was
            stopped goes on at the next missing frame.
        sources: Where masks come from; several are united: onnx (a YOLOX detector), maskrcnn
            (torchvision's, extra `maskrcnn`), silhouette (the projected body), a folder of masks,
            or a recipe (.yaml) of kind `masks`.
        model: ONNX file of the detector: YOLOX on COCO, raw output.
        weights: State dict of Mask R-CNN; torchvision fetches its own when left out.
        classes: COCO's names of what to mask; people, vehicles and animals when left out.
        camera_body: Clip file (.npz) in the camera's frame, for the silhouette.
        body: "anny", or the path of the body model of that clip.
        redo: Make anew what other settings made.
    """
    from gmrdata.masks.of_frames import masks_of_frames
    from gmrdata.masks.sources import masks_named

    _need(sources, "a source of masks: --sources onnx")
    config = masks_named(sources, model=model, weights=weights, classes=classes)
    people = () if camera_body is None else _one_person(camera_body, body)
    for made in masks_of_frames(frames, out, config, people=people, redo=redo):
        _answer(made)


def sfm(
    frames: Path,
    camera_body: Path,
    out: Path,
    masks: tuple[str, ...] = ("silhouette",),
    model: Path | None = None,
    weights: Path | None = None,
    classes: tuple[str, ...] = (),
    body: str = "anny",
    seed: int = 0,
    redo: bool = False,
) -> None:
    """World motion of one person from a moving-camera video and the person's camera-frame body.

    Args:
        frames: Folder of numbered images, or a video file.
        camera_body: Clip file (.npz) whose motion is in the camera's frame; its intrinsics are
            used as they are.
        out: Output folder: masks/, masks_by/, sfm/, pseudo_gt/.
        masks: Where masks of what moves come from; several are united: silhouette (the projected
            body), onnx (a YOLOX detector), maskrcnn (torchvision's, extra `maskrcnn`), a folder of
            masks `<image stem>.png` with 255 = dynamic, or a recipe (.yaml) of kind `masks`.
        model: ONNX file of the detector: YOLOX on COCO, raw output.
        weights: State dict of Mask R-CNN; torchvision fetches its own when left out.
        classes: COCO's names of what to mask; people, vehicles and animals when left out.
        body: "anny", or the path of the body model of the clip.
        seed: Seed of the reconstruction.
        redo: Make anew what other settings made.
    """
    from gmrdata.masks.sources import masks_named
    from gmrdata.sequence import SequenceConfig, regenerate_sequence
    from gmrdata.sfm.config import SfmConfig

    _need(masks, "a source of masks: --masks silhouette")
    config = masks_named(masks, model=model, weights=weights, classes=classes)
    made = regenerate_sequence(
        frames,
        _one_person(camera_body, body),
        out,
        SequenceConfig(masks=config, sfm=SfmConfig(seed=seed)),
        redo=redo,
    )
    _answer(made)


def manifest_check(paths: Positional[tuple[Path, ...]], hashes: bool = True) -> None:
    """Check manifests: schema, files, hashes, sizes, finite values, proper rotations, paths.

    Args:
        paths: Manifest files.
        hashes: Read every byte; sizes alone without.
    """
    from gmrdata.manifest.check import check_manifest

    _need(paths, "a manifest file")
    for path in paths:
        check_manifest(path, hashes=hashes)
        _answer(f"{path}: good")


def manifest_show(path: Positional[Path]) -> None:
    """Show a manifest as a table.

    Args:
        path: Manifest file.
    """
    from gmrdata.manifest.show import show_manifest

    show_manifest(path)


def manifest_diff(a: Positional[Path], b: Positional[Path]) -> None:
    """Say what differs between two manifests; exit code 1 if anything does.

    Args:
        a: Manifest file.
        b: Manifest file.
    """
    from gmrdata.manifest.show import diff_manifests

    differences = diff_manifests(a, b)
    for line in differences:
        _answer(line)
    if differences:
        sys.exit(1)


def manifest(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("check", constructor=manifest_check)]
        | Annotated[Any, subcommand("show", constructor=manifest_show)]
        | Annotated[Any, subcommand("diff", constructor=manifest_diff)]
    ],
) -> None:
    """Check, show or compare manifests."""


def threedpw_regenerate(
    root: Path,
    out: Path,
    recipe: str = "threedpw",
    sequences: tuple[str, ...] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """World-frame pseudo ground truth of a 3DPW folder, a verdict for each sequence, a manifest.

    Args:
        root: The folder that holds imageFiles and sequenceFiles.
        out: Output folder: pseudo_gt.yaml, verdicts.json, sequences/. A run that was stopped goes
            on where it was.
        recipe: A recipe file of kind `threedpw`, or the name of one that travels with gmrdata.
        sequences: Names of sequences; all when left out.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the sequences.
        redo: Make anew what another recipe made.
        dry_run: Say what would be done, and do nothing.
    """
    from gmrdata.recipes import find_recipe, load_recipe
    from gmrdata.regenerate import regenerate_set as stage
    from gmrdata.regenerate.recipe import ThreedpwRecipe
    from gmrdata.regenerate.verdicts import HEADINGS, table_row
    from gmrdata.store import read_json

    loaded = load_recipe(find_recipe(recipe), ThreedpwRecipe)
    loaded = _with_workers(loaded, workers)
    if sequences:
        loaded = loaded.model_copy(update={"sequences": sequences})
    if dry_run:
        _print_table(stage.HEADINGS, stage.plan(loaded, root, out))
        return
    made = stage.regenerate_set(loaded, root, out, scheduler=scheduler, redo=redo)
    rows = read_json(made.with_name("verdicts.json"))
    _print_table(HEADINGS, [table_row(row) for row in rows])
    _answer(made.with_name("index.html"))
    _answer(made)


def threedpw_list(root: Path, rule: str = "campose_valid") -> None:
    """List the sequences of a 3DPW folder: people, frames, image size, usable share, problems.

    A sequence that can't be read is listed with the reason; then the exit code is 1.

    Args:
        root: The folder that holds imageFiles and sequenceFiles.
        rule: Which frames count as valid: campose_valid, 3dpw_eval, glamr, vibe or slahmr.
    """
    from gmrdata.threedpw.listing import HEADINGS, bad_summary, sequence_rows

    rows, n_bad = sequence_rows(root, rule)
    _print_table(HEADINGS, rows)
    if n_bad:
        raise bad_summary(root, n_bad, len(rows))


def threedpw_show(sequence: Positional[str], root: Path, rule: str = "campose_valid") -> None:
    """Show one sequence of 3DPW: its people, and which frames of each can't be used and why.

    Args:
        sequence: Name of the sequence, like courtyard_arguing_00.
        root: The folder that holds imageFiles and sequenceFiles.
        rule: Which frames count as valid: campose_valid, 3dpw_eval, glamr, vibe or slahmr.
    """
    from gmrdata.threedpw.listing import RANGE_HEADINGS, range_rows

    rows, problems = range_rows(root, sequence, rule)
    _print_table(RANGE_HEADINGS, rows)
    for problem in problems:
        _answer(problem)


def threedpw_compare(manifest: Positional[Path], out: Path | None = None) -> None:
    """Lay a pseudo ground truth of 3DPW beside Table 7 of the GMR paper, row by row.

    Args:
        manifest: A manifest of kind pseudo_gt, or the folder that holds one.
        out: CSV file for the rows, besides the table.
    """
    from gmrdata.threedpw.compare import compare_with_table7
    from gmrdata.threedpw.compare_table import HEADINGS, summary, table_rows, write_csv

    rows = compare_with_table7(manifest)
    _print_table(HEADINGS, table_rows(rows))
    _answer(summary(rows))
    if out is not None:
        _answer(write_csv(out, rows))


def threedpw_twin(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
    probe: bool = True,
) -> None:
    """Render sequences with 3DPW's layout and faults, and keep the truth aside.

    Args:
        recipe: A recipe file of kind `threedpw_twin`, or the name of one that travels with gmrdata.
        out: Output folder: 3DPW/ (the dataset), truth/ (exact clips, twins.json), render_set/. A
            run that was stopped goes on at the next missing frame.
        motions: Folder of motion files that the recipe's clips name.
        workers: Worker processes; the recipe's number when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
        dry_run: List clips and frames with an estimate of time and disk, and make nothing.
        probe: For the estimate of a dry run, render two frames in a temporary folder.
    """
    from gmrdata.recipes import find_recipe, load_recipe
    from gmrdata.threedpw.twin_recipe import TwinRecipe
    from gmrdata.threedpw.twin_set import SET_FOLDER, make_twins

    loaded = load_recipe(find_recipe(recipe), TwinRecipe)
    if workers is not None:
        loaded = loaded.model_copy(update={"set": _with_workers(loaded.set, workers)})
    if dry_run:
        _dry_run(loaded.set, out / SET_FOLDER, motions, probe)
        return
    _answer(make_twins(loaded, out, motions_dir=motions, scheduler=scheduler, redo=redo))


def threedpw(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("regenerate", constructor=threedpw_regenerate)]
        | Annotated[Any, subcommand("list", constructor=threedpw_list)]
        | Annotated[Any, subcommand("show", constructor=threedpw_show)]
        | Annotated[Any, subcommand("compare", constructor=threedpw_compare)]
        | Annotated[Any, subcommand("twin", constructor=threedpw_twin)]
    ],
) -> None:
    """World-frame pseudo ground truth of a 3DPW folder, a look into it, or a twin of it.

    `gmrdata threedpw --root 3DPW --out OUT` is short for `gmrdata threedpw regenerate ...`.
    """


def floor(
    out: Path,
    sequences: int = 6,
    seed: int = 0,
    motions: Path | None = None,
    twins: Path | None = None,
    recipe: str = "threedpw",
    size: str = "small",
    frames: int = 150,
    workers: int | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> None:
    """How wrong the pseudo ground truth itself is: regenerate twins of 3DPW, and measure them.

    Args:
        out: Output folder: floor.json, twins/, regenerated/. A run that was stopped goes on where
            it was.
        sequences: Twins to draw; with 6 or more every class of camera motion is among them.
        seed: Chooses their motions, cameras, places, people and faults.
        motions: Folder of motion files to draw from.
        twins: Output folder of `gmrdata threedpw twin`, in place of drawn ones.
        recipe: A recipe file of kind `threedpw`, or the name of one that travels with gmrdata.
        size: Images of drawn twins: small (540x960), full (1080x1920), or like 180x320 [px].
        frames: Frames of each drawn twin, at 30 fps; at least 60.
        workers: Worker processes; the recipes' numbers when left out.
        scheduler: Address of a Dask cluster (tcp://host:port) for the sequences.
        redo: Make anew what another recipe made.
    """
    from gmrdata.evaluate.floor_record import read_floor
    from gmrdata.floor.draw import draw_twins, film_of
    from gmrdata.floor.make import drawn_floor, floor_of_twins
    from gmrdata.floor.table import HEADINGS, floor_rows, notes
    from gmrdata.recipes import find_recipe, load_recipe
    from gmrdata.regenerate.recipe import ThreedpwRecipe

    loaded = load_recipe(find_recipe(recipe), ThreedpwRecipe)
    loaded = _with_workers(loaded, workers)
    if twins is not None:
        made = floor_of_twins(twins, loaded, out, scheduler=scheduler, redo=redo)
    elif motions is not None:
        drawn = draw_twins(sequences, seed, motions, film_of(size, frames), workers)
        made = drawn_floor(drawn, motions, loaded, out, scheduler=scheduler, redo=redo)
    else:
        raise MissingInput("nothing to measure on. Name --motions to draw twins, or --twins")
    measured = read_floor(made.path)
    _print_table(HEADINGS, floor_rows(measured))
    for line in notes(measured):
        _answer(line)
    _answer(made.path)
    if made.failed is not None:
        raise made.failed


def train(
    manifests: Positional[tuple[Path, ...]],
    out: Path,
    recipe: str = "gmr",
    body: str = "anny",
    held_out: tuple[Path, ...] = (),
    redo: bool = False,
) -> None:
    """Train GMR on the clips of manifests.  A run that was stopped goes on where it was.

    Args:
        manifests: Manifest files with clips to train on.
        out: Run folder.
        recipe: A recipe file of kind `gmr`, or the name of one that travels with gmrdata.
        body: "anny", or the path of the clips' body model.
        held_out: Manifests to score now and then while training.
        redo: Throw away a run of another recipe.
    """
    from gmrdata.gmr.recipe import GmrRecipe
    from gmrdata.gmr.train import train as train_gmr
    from gmrdata.recipes import find_recipe, load_recipe

    _need(manifests, "a manifest file")
    config = load_recipe(find_recipe(recipe), GmrRecipe).train
    _answer(
        train_gmr(
            manifests, out, config, body_path=_body_path(body), held_out_paths=held_out, redo=redo
        )
    )


def evaluate(
    run: Positional[Path],
    manifest: Positional[Path],
    out: Path,
    body: str = "anny",
    floor: Path | None = None,
    redo: bool = False,
) -> None:
    """Score a trained GMR on a manifest: OME [deg], TME [mm], VME [mm], zero motion beside it.

    Args:
        run: Run folder of `gmrdata train`.
        manifest: Manifest file.
        out: Output folder for scores.json.
        body: "anny", or the path of the clips' body model.
        floor: The floor.json of `gmrdata floor`, to see which scores are not distinguishable from
            the pseudo ground truth's own error.
        redo: Throw away a result of other settings.
    """
    from gmrdata.evaluate.score import score_manifest
    from gmrdata.evaluate.table import score_rows
    from gmrdata.store import read_json

    path = score_manifest(run, manifest, _body_path(body), out, floor_path=floor, redo=redo)
    scores = read_json(path)
    headings, rows = score_rows(scores)
    _print_table(headings, rows)
    for statement in scores.get("statements", ()):
        _answer(statement)
    _answer(path)


def report(demo_out: Positional[Path]) -> None:
    """Write the report of a finished demo again.

    Args:
        demo_out: Output folder of `gmrdata demo`.
    """
    from gmrdata.demo.paths import DemoPaths
    from gmrdata.demo.recipe import DemoRecipe
    from gmrdata.demo.show import show
    from gmrdata.recipes import load_recipe

    paths = DemoPaths(demo_out.resolve())
    show(paths, load_recipe(paths.recipe, DemoRecipe))


def run(
    recipe: Positional[str],
    out: Path,
    motions: Path | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> None:
    """Run a recipe of any kind.

    Args:
        recipe: A recipe file, or the name of one that travels with gmrdata.
        out: Output folder.
        motions: Folder of motion files, for recipes that use some.
        scheduler: Address of a Dask cluster (tcp://host:port) for the clips.
        redo: Make anew what another recipe made.
    """
    from gmrdata.run import run_recipe

    _answer(run_recipe(recipe, out, motions_dir=motions, scheduler=scheduler, redo=redo))


VERBS: dict[str, Verb] = {
    "demo": demo,
    "fetch": fetch,
    "motions": motions,
    "render": render,
    "masks": masks,
    "sfm": sfm,
    "manifest": manifest,
    "threedpw": threedpw,
    "floor": floor,
    "train": train,
    "evaluate": evaluate,
    "report": report,
    "run": run,
}


def main(arguments: list[str] | None = None) -> None:
    """Entry point: 0 when done, 1 for an error in input or work, 2 for wrong flags."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["threedpw"] and given[1:2] and given[1] in ("--root", "--out"):
        given.insert(1, "regenerate")
    try:
        tyro.extras.subcommand_cli_from_dict(
            VERBS, prog="gmrdata", description="World-frame human motion data.", args=given
        )
    except GmrdataError as error:
        _fail(str(error))
    except OSError as error:
        _fail(_explain(error))
    except KeyboardInterrupt:
        _fail("stopped. The same command goes on where it was", code=130)


def _explain(error: OSError) -> str:
    """A system error with the file and what can be done."""
    import errno

    remedies = {
        errno.ENOSPC: "the disk is full. Free some space and run the same command again",
        errno.EDQUOT: "your disk quota is used up. Free some space and run the same command again",
        errno.EFBIG: "the file grew beyond the limit for files. Raise it (ulimit -f) and run again",
        errno.EACCES: "no permission. Choose another --out, or change the folder's permissions",
        errno.EROFS: "a read-only file system. Choose another --out",
    }
    remedy = remedies.get(error.errno or 0, error.strerror or str(error))
    return f"{error.filename or 'writing'}: {remedy}"


def _answer(value: object) -> None:
    answers.print(str(value), markup=False, soft_wrap=True)


def _fail(message: str, code: int = 1) -> None:
    console.print(f"gmrdata: {message}", style="bold red", markup=False, soft_wrap=True)
    sys.exit(code)


def _with_workers(recipe: Recipe, workers: int | None) -> Recipe:
    """The recipe with as many worker processes as the command line asks for, if it does."""
    if workers is None:
        return recipe
    if workers < 1:
        raise BadRecipe(f"--workers {workers}: at least one process has to do the work")
    return recipe.model_copy(update={"workers": workers})


def _need(values: tuple[Any, ...], what: str) -> None:
    if not values:
        raise MissingInput(f"nothing given. Name {what}")


def _one_person(clip_path: Path, body: str) -> tuple[PersonFiles, ...]:
    from gmrdata.body.load import anny_file

    return (PersonFiles(clip_path, _body_path(body) or anny_file()),)


def _body_path(body: str) -> Path | None:
    return None if body == "anny" else Path(body)


def _dry_run(recipe: "SyntheticRecipe", out: Path, motions: Path | None, probe: bool) -> None:
    from gmrdata.synthetic import dry_run as dry

    planned = dry.dry_run(recipe, out, motions_dir=motions, probe=probe)
    _print_table(dry.HEADINGS, planned.rows)
    for line in dry.summary_lines(planned):
        _answer(line)


def _print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.markup import escape
    from rich.table import Table

    # Without this "[s]" in a heading is the sign for crossed-out text, and is not shown.
    table = Table(*map(escape, headings), box=None)
    for row in rows:
        table.add_row(*map(escape, row))
    answers.print(table)
