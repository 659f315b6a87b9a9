"""One sequence from its files to its world motions, or to the reason why there are none."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Source
from gmrdata.manifest.entry import ClipAbout, ClipFiles, clip_entry, stage_recipe
from gmrdata.read.body_file import read_body
from gmrdata.read.threedpw_layout import SequenceFiles, require_name
from gmrdata.solve.sequence import solve_sequence
from gmrdata.stage.run import Run
from gmrdata.stage.store import is_made, run_stage
from gmrdata.threedpw.people import SequencePeople, make_people
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.values.clip import load_clip, save_clip
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.people import person_file
from gmrdata.world.quality import load_record, quality_record, unsolved_quality
from gmrdata.world.verdict import Doubts, verdict_of

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
    if is_made(UNSOLVED, out_dir, config, inputs, run):
        return out_dir
    try:
        return solve_sequence(
            files.image_dir,
            given.people,
            paths.sequence_dir(files.name),
            config,
            dataset_camera_path=given.dataset_camera_path,
            doubts_path=given.doubts_path,
            left_out=given.left_out,
            run=run,
        )
    except NoReconstruction as error:
        work = partial(_write_unsolved, given, str(error))
        return run_stage(UNSOLVED, out_dir, config, inputs, work, run=run)


def _write_unsolved(given: SequencePeople, reason: str, out_dir: Path) -> None:
    """The people in the camera's frame, every row dropped with its reason, and `quality.json`."""
    doubts = Doubts.read(given.doubts_path)
    reasons = (*doubts.sequence, reason)
    judged = []
    for number, person in enumerate(given.people):
        clip = load_clip(person.clip_path)
        nothing = np.zeros(clip.motion.n_frames, dtype=bool)
        unsolved = replace(clip, valid=nothing, camera=None)
        rest_pelvis_m = read_body(person.body_path).rest_pelvis_m(clip.motion.shape)
        save_clip(out_dir / person_file(number), unsolved, rest_pelvis_m)
        texts = [doubt or "there is no reconstruction" for doubt in doubts.frames[number]]
        judged.append(verdict_of(clip.id, False, reasons, texts))
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
