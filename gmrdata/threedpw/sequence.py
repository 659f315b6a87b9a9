"""One sequence of 3DPW: its people as clips, and its world motions, or why there are none."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import NonNegativeInt

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.manifest.current import ClipEntry, Source
from gmrdata.manifest.write import ClipAbout, ClipFiles, clip_entry, stage_recipe
from gmrdata.people.sources import mask_folders, network_files, without_files
from gmrdata.read.body_file import read_body
from gmrdata.read.threedpw import Sequence3DPW, ValidRule, read_found, unusable_reasons
from gmrdata.read.threedpw_files import SequenceFiles, require_name
from gmrdata.solve.request import GivenPeople, SolveRequest
from gmrdata.solve.solve import solve_given
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import is_made, run_stage
from gmrdata.threedpw import intrinsics_check
from gmrdata.threedpw.clips import camera_clip, world_clip
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.values.clip import camera_of, load_clip, save_clip
from gmrdata.values.errors import BadRecord, NoReconstruction
from gmrdata.values.people import DOUBTS_FILE, PersonFiles, person_file
from gmrdata.values.records import MAKE_AGAIN, Config, Record
from gmrdata.world.judge import load_record, quality_record, unsolved_quality
from gmrdata.world.recipe import Doubts, Override, overridden, save_dataset_camera, verdict_of

PEOPLE_FILE = "people.json"
DATASET_CAMERA_FILE = "dataset_camera.npz"


class SequencePeopleConfig(Config):
    """What decides the clips of a sequence: parts of `ThreedpwRecipe`."""

    version: int = 2  # of the files; 1 had a text in `doubts.json` for each frame
    name: str
    split: str
    valid_rule: ValidRule
    intrinsics: intrinsics_check.IntrinsicsCheckConfig


class PeopleRecord(Record):
    """`people.json`: what the sequence's file says besides its people's motions."""

    format: Literal["gmrdata-people/1"] = "gmrdata-people/1"
    bodies: tuple[NonNegativeInt, ...]
    """Each person's body, by its number in the recipe."""
    genders: tuple[str, ...]
    left_out: tuple[int, ...]
    """Numbers of images that can't be used."""
    problems: tuple[str, ...]
    """What is odd about the file."""
    focal: intrinsics_check.FocalEstimate | None
    """What the keypoints say of the intrinsics; null where they say nothing."""


def make_people(
    files: SequenceFiles,
    body_paths: tuple[Path, ...],
    out_dir: Path,
    recipe: ThreedpwRecipe,
    *,
    run: Run = DEFAULT_RUN,
) -> GivenPeople:
    """Stage: `person_<n>.npz`, `dataset_camera.npz`, `doubts.json` and `people.json`."""

    def work(partial: Path) -> None:
        _write(read_found(files), body_paths, recipe, partial)

    inputs = {"sequence": files.pickle_path}
    # The images decide which frames can be used; that there are none is the reader's to say.
    inputs |= {"images": files.image_dir} if files.image_dir.is_dir() else {}
    inputs |= {f"body_{number}": path for number, path in enumerate(body_paths)}
    rule, intrinsics = recipe.valid_rule, recipe.intrinsics
    config = SequencePeopleConfig(
        name=files.name, split=files.split, valid_rule=rule, intrinsics=intrinsics
    )
    run_stage("people", out_dir, config, inputs, work, run=run)
    record = PeopleRecord.read(out_dir / PEOPLE_FILE)
    if any(body >= len(body_paths) for body in record.bodies):
        raise BadRecord(f"{out_dir / PEOPLE_FILE}: `bodies` names one too many; {MAKE_AGAIN}")
    people = tuple(
        PersonFiles(out_dir / person_file(number), body_paths[body])
        for number, body in enumerate(record.bodies)
    )
    cameras_path, doubts_path = out_dir / DATASET_CAMERA_FILE, out_dir / DOUBTS_FILE
    return GivenPeople(people, cameras_path, doubts_path, record.left_out)


def _write(
    sequence: Sequence3DPW, body_paths: tuple[Path, ...], recipe: ThreedpwRecipe, partial: Path
) -> None:
    rule = recipe.valid_rule
    bodies = [read_body(path) for path in body_paths]
    names = [body.name for body in bodies]
    chosen = []
    dataset_camera = np.full((sequence.n_frames, 4, 4), np.nan)
    people = range(len(sequence.arrays.people))
    for number in people:
        clip = camera_clip(sequence, number, bodies, rule)
        chosen.append(names.index(clip.motion.body))
        rest_pelvis_m = bodies[chosen[-1]].rest_pelvis_m(clip.motion.shape)
        save_clip(partial / person_file(number), clip, rest_pelvis_m)
        known = camera_of(world_clip(sequence, number, bodies, rule))
        dataset_camera[known.has_camera] = known.world_from_cam[known.has_camera]
    save_dataset_camera(partial / DATASET_CAMERA_FILE, dataset_camera)
    focal = intrinsics_check.estimate_focal(sequence, bodies, recipe.intrinsics, rule)
    wrong = intrinsics_check.intrinsics_reason(focal, recipe.intrinsics)
    Doubts(
        frames=tuple(tuple(unusable_reasons(sequence, number, rule)) for number in people),
        sequence=() if wrong is None else (wrong,),
    ).write(partial / DOUBTS_FILE)
    faulty = (row for row, fault in enumerate(sequence.images.faults) if fault)
    PeopleRecord(
        bodies=tuple(chosen),
        genders=tuple(person.gender for person in sequence.arrays.people),
        left_out=(*faulty, *sequence.images.spare),
        problems=sequence.problems,
        focal=focal,
    ).write(partial / PEOPLE_FILE)


UNSOLVED = "unsolved"  # the stage's name where there is no reconstruction


def regenerate_one(
    files: SequenceFiles, root: Path, recipe: ThreedpwRecipe, body_paths: tuple[Path, ...], run: Run
) -> Path:
    """Run every stage of one sequence; without a reconstruction its clips say so, row by row."""
    require_name(files.name)
    paths = SetPaths(root)
    people_dir, out_dir = paths.sequence_dir(files.name) / "people", paths.pseudo_gt_dir(files.name)
    given = make_people(files, body_paths, people_dir, recipe, run=run)
    inputs = {"images": files.image_dir, "people": people_dir}
    config = recipe.of_sequence(files.name)
    # Other masks may show what these hide.
    if config.masks is not None:
        inputs |= network_files(config.masks) | mask_folders(config.masks)
    made_by = config.model_copy(
        update={"masks": None if config.masks is None else without_files(config.masks)}
    )
    if is_made(UNSOLVED, out_dir, made_by, inputs, run):
        return out_dir
    try:
        request = SolveRequest(files.image_dir, given)
        return solve_given(request, paths.sequence_dir(files.name), config, run)
    except NoReconstruction as error:
        # Without the folder of this machine, for the manifest has it.
        doubts_path, override = people_dir / DOUBTS_FILE, config.pseudo_gt.override
        work = partial(_write_unsolved, given.files, doubts_path, error.why, override)
        return run_stage(UNSOLVED, out_dir, made_by, inputs, work, run=run)


def _write_unsolved(
    people: Sequence[PersonFiles],
    doubts_path: Path,
    reason: str,
    override: Override | None,
    out_dir: Path,
) -> None:
    """The people in the camera's frame, every row dropped with its reason, and `quality.json`,
    where a person's decision stands too, though nobody can keep a row."""
    doubts = Doubts.read(doubts_path)
    reasons = (*doubts.sequence, reason)
    judged = []
    for number, person in enumerate(people):
        clip = load_clip(person.clip_path)
        nothing = np.zeros(clip.motion.n_frames, dtype=bool)
        unsolved = replace(clip, valid=nothing, camera=None)
        rest_pelvis_m = read_body(person.body_path).rest_pelvis_m(clip.motion.shape)
        save_clip(out_dir / person_file(number), unsolved, rest_pelvis_m)
        texts = [doubt or "there is no reconstruction" for doubt in doubts.frames[number]]
        verdict = verdict_of(clip.id, False, reasons, texts)
        if override is not None:
            verdict = overridden(verdict, override, ~unsolved.valid)
        judged.append(verdict)
    unsolved_quality(judged).write(out_dir / QUALITY_FILE)


def sequence_entries(
    files: SequenceFiles, recipe: ThreedpwRecipe, paths: SetPaths
) -> list[ClipEntry]:
    """Manifest entries of a finished sequence, one for each person.  Images are not listed."""
    folder = paths.pseudo_gt_dir(files.name)
    record = load_record(folder)
    return [
        clip_entry(
            paths.root,
            ClipFiles(folder / person_file(number)),
            ClipAbout(
                camera_motion=record.camera_motion,
                licence=recipe.licence,
                source=Source(dataset="3DPW", sequence=files.name, person=str(number)),
                dropped_reason=judged.row_reasons,
                quality=quality_record(record, number),
                recipe=stage_recipe(folder),
            ),
        )
        for number, judged in enumerate(record.people)
    ]
