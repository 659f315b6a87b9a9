"""The verbs of data sets: fetch and render motions, check and compare manifests."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import OmitSubcommandPrefixes, Positional, arg, subcommand

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, answer_json, print_table, then
from gmrdata.cli.options import Manifest, Manifests, need
from gmrdata.stage.progress import answers
from gmrdata.stage.recipes import read_recipe
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, GmrdataError

if TYPE_CHECKING:
    from gmrdata.motion.library import MotionTable
    from gmrdata.read.source_motion import ReadConfig


def fetch(
    source: Positional[Literal["cmu", "models"]],
    trials: Positional[tuple[str, ...]] = (),
    out: Path | None = None,
    published_list: Annotated[str | None, arg(name="list")] = None,
    base_url: str | None = None,
    timeout_s: float = 30.0,
    redo: bool = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Get motions (ASF/AMC) of the CMU motion capture database, or the networks that make masks.

    Args:
        source: cmu, or models: YOLOX-nano, BlazePose GHUM heavy and lite (Apache-2.0, 34 MB).
        trials: Names of CMU's trials, like 02_03.
        out: Folder for the files; what is there is kept.  ./cmu, with SHA256SUMS and fetched.json,
            when left out; for models the cache folder in which every verb looks for them.
        published_list: Every trial of a list that gmrdata publishes, e.g. paper_table8.
        base_url: A mirror of http://mocap.cs.cmu.edu/subjects, or a folder with the models' files.
        timeout_s: Longest silence of the server [s].
        redo: Fetch again files that are there and are not as recorded.
    """
    import numpy as np

    from gmrdata.motion.cmu import fetch_trials, listed_trials, wanted_trials
    from gmrdata.read.download import FetchConfig, fetch_plan
    from gmrdata.read.models import fetch_models, models_dir, wanted_models

    with flags.flags_named():
        config = FetchConfig(base_url=base_url, timeout_s=timeout_s)
    rng = np.random.default_rng()
    wanted = (*trials, *(listed_trials(published_list) if published_list is not None else ()))
    if source == "models":
        if wanted:
            raise BadRecipe("trials and --list are for fetch cmu; fetch models gets all of them")
        folder = out or models_dir()
        if dry_run:
            print_table(*fetch_plan(wanted_models(folder, config)))
        else:
            answer("\n".join(map(str, fetch_models(folder, config, rng, redo=redo))))
        return
    flags.need(wanted, "trials like 02_03, or --list paper_table8")
    out = out or Path("cmu")
    if dry_run:
        print_table(*fetch_plan(wanted_trials(wanted, out, config)))
        return
    answer(fetch_trials(wanted, out, config, rng, redo=redo))


def motions(
    sources: Positional[tuple[Path, ...]],
    out: Path | None = None,
    body: flags.Body = "anny",
    layout: Literal["files", "human36m", "emdb"] = "files",
    fps_hz: flags.FpsHz = None,
    unit_m: flags.UnitM = None,
    joint_map: flags.JointMap = None,
    rest_pose: flags.RestPoseOrFile = None,
    up: flags.Up = None,
    dry_run: flags.DryRun = False,
    *,
    run: flags.RunFlags,
) -> None:
    """Read motion files, retarget them to the 24-joint tree, and list them or write a manifest.

    A run that was stopped goes on where it was.  Files that can't be read are named at the end, and
    the exit code is 1; the manifest then lists the others.

    Args:
        sources: Files or folders: BVH, ASF/AMC, AMASS npz; or the folder of a data set.
        out: Folder for one clip file per motion and `motions.yaml`; only a table when left out.
        layout: The kind of the sources. With human36m, annotation JSON files of Human3.6M, to
            train.yaml and test.yaml. With emdb, the folder of P0 to P9, to emdb.yaml, emdb1.yaml
            and emdb2.yaml; --body is then a folder with SMPL's models of the genders.
    """
    from gmrdata.motion import library
    from gmrdata.motion.emdb import make_emdb
    from gmrdata.motion.human36m import make_human36m

    said = {"fps_hz": fps_hz, "unit_m": unit_m, "joint_map": joint_map, "rest_pose": rest_pose}
    config = flags.reading(up=up, **said)
    if layout != "files" and (given := config.model_dump(exclude_defaults=True)):
        flag = next(iter(given)).replace("_", "-")
        raise BadRecipe(f"--{flag}: --layout {layout} is read as its format has it. Leave it out")
    if (run.shard or run.workers or run.scheduler) and (out is None or layout != "files"):
        what = "--workers, --scheduler and --shard are for motion files with --out"
        raise BadRecipe(f"{what}. Leave them out")
    if dry_run and layout != "files":
        raise BadRecipe(f"--dry-run: not with --layout {layout}, which reads all at once")
    if dry_run:
        _show_files(sources, out, config)
    elif layout != "files":
        if len(sources) != 1 or out is None:
            raise BadRecipe(f"--layout {layout} needs the data set's folder and --out")
        make = make_human36m if layout == "human36m" else make_emdb
        for path in make(sources[0], body, out, run=run):
            answer(path)
    elif out is None:
        _show_motions(library.motion_table(sources, body, config))
    else:
        answer(library.make_library(sources, body, out, **dict(config), run=run))


def _show_motions(table: "MotionTable") -> None:
    """What each file holds; BadMotionFile names those that can't be read."""
    if table.rows:
        print_table(table.headings, table.rows)
    for warning in table.warnings:
        answer(warning)
    if table.bad:
        raise BadMotionFile(table.bad)


def _show_files(sources: tuple[Path, ...], out: Path | None, config: "ReadConfig") -> None:
    """The motion files that would be read, and which are."""
    from gmrdata.motion.library import PLAN_HEADINGS, TO_DO, plan_library

    planned = plan_library(sources, out, config)
    print_table(PLAN_HEADINGS, planned)
    answer(f"{len(planned)} files, {sum(row[2] == TO_DO for row in planned)} to do")


def render(
    recipe: Positional[flags.RecipeName],
    out: Path,
    motions: flags.Motions = None,
    *,
    run: flags.RunFlags,
    dry_run: flags.DryRun = False,
    probe: flags.Probe = True,
    preview: bool = False,
) -> None:
    """Render synthetic clips with exact cameras and masks, and write their manifest.

    Args:
        out: Output folder; a run that was stopped goes on at the next missing frame.
        preview: Only draw a few small frames and the paths of each clip, to OUT/preview/index.html.
    """
    from gmrdata.film.render_set import render_set
    from gmrdata.film.set_plan import SyntheticRecipe
    from gmrdata.pages.sets import preview_set, write_set_pages

    if preview and (dry_run or run.shard):
        raise BadRecipe("--preview: draws all clips at once. Leave --dry-run and --shard out")
    loaded = read_recipe(recipe, SyntheticRecipe)
    if dry_run:
        flags.show_dry_run(loaded, out, motions, run.workers, probe)
    elif preview:
        answer(preview_set(loaded, out, motions_dir=motions, run=run))
    else:
        with then(lambda: write_set_pages(loaded, out)):
            made = render_set(loaded, out, motions_dir=motions, run=run)
        answer(made)


def manifest_check(
    paths: Manifests, hashes: bool = True, files: bool = True, as_json: flags.AsJson = False
) -> None:
    """Check manifests: schema, files, hashes, sizes, finite values, proper rotations, paths.

    Args:
        hashes: Read every byte; sizes alone without.
        files: Look at the files; without, only at what the manifests say, for data sets that are
            not here.
    """
    from gmrdata.manifest.check import check_manifest

    need(paths, "a manifest file")
    problems: list[str | None] = []
    for path in paths:
        try:
            check_manifest(path, hashes=hashes, files=files)
        except GmrdataError as error:
            problems.append(str(error))
            continue
        problems.append(None)
        if not as_json:
            answer(f"{path}: good")
    if not as_json and any(problems):
        raise BadManifest("\n".join(filter(None, problems)))
    if as_json:
        checked = zip(map(str, paths), problems, strict=True)
        rows = [{"path": path, "good": why is None, "problem": why} for path, why in checked]
        answer_json({"good": not any(problems), "manifests": rows})
        if any(problems):
            sys.exit(1)


def manifest_show(path: Manifest) -> None:
    """Show a manifest as a table."""
    from gmrdata.manifest.show import manifest_table

    answers.print(manifest_table(path))


def manifest_diff(a: Manifest, b: Manifest) -> None:
    """Say what differs between two manifests; exit code 1 if anything does."""
    from gmrdata.manifest.show import diff_manifests

    differences = diff_manifests(a, b)
    for line in differences:
        answer(line)
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
