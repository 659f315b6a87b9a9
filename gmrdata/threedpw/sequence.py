"""Stage: what is left of a sequence without a reconstruction: its people, and the reason.

One sequence from its files to its world motions, or to the reason why there are none.

The manifest entries of one regenerated sequence: one clip for each person.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Source
from gmrdata.manifest.entry import clip_entry, stage_recipe
from gmrdata.read.bodies import read_body
from gmrdata.read.threedpw_layout import SequenceFiles, require_name
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import is_made, run_stage
from gmrdata.threedpw.people import SequencePeople, make_people
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.values.clip import Clip, load_clip, save_clip
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.files import read_json, write_json
from gmrdata.values.people import person_file
from gmrdata.world.quality import dropped_reasons, load_record, quality_record
from gmrdata.world.sequence import SequenceConfig, regenerate_sequence
from gmrdata.world.verdict import Verdict, dropped_ranges

STAGE = "unsolved"


def is_unsolved(out_dir: Path, config: SequenceConfig, inputs: Mapping[str, Path]) -> bool:
    """Whether the same recipe has found no reconstruction before."""
    return is_made(STAGE, out_dir, config, inputs)


def make_unsolved(
    given: SequencePeople,
    reason: str,
    out_dir: Path,
    config: SequenceConfig,
    inputs: Mapping[str, Path],
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Write the people in the camera's frame, every row dropped with its reason.

    Args:
        given: The sequence's people.
        reason: Why there is no reconstruction.
        out_dir: Folder to make: `person_<n>.npz` for each person, and `quality.json`.
        config: The recipe of the stages that were tried.
        inputs: What they were tried on.
    """

    def work(partial: Path) -> None:
        doubts = read_json(given.doubts_path)
        reasons = (*doubts["sequence"], reason)
        judged = []
        for number, person in enumerate(given.people):
            clip = load_clip(person.clip_path)
            nothing = np.zeros(clip.motion.n_frames, dtype=bool)
            unsolved = replace(clip, valid=nothing, camera=None)
            rest_pelvis_m = read_body(person.body_path).rest_pelvis_m(clip.motion.shape)
            save_clip(partial / person_file(number), unsolved, rest_pelvis_m)
            judged.append(_judged(clip, doubts["frames"][number], reasons))
        write_json(partial / QUALITY_FILE, {"camera_motion": "none", "people": judged})

    return run_stage(STAGE, out_dir, config, inputs, work, run=run)


def _judged(clip: Clip, doubts: list[str], reasons: tuple[str, ...]) -> dict[str, Any]:
    dropped = dropped_ranges([doubt or "there is no reconstruction" for doubt in doubts])
    return Verdict(False, reasons, tuple(dropped), len(doubts)).as_record(clip.id)


def regenerate_one(
    files: SequenceFiles,
    root: Path,
    recipe: ThreedpwRecipe,
    body_paths: tuple[Path, ...],
    run: Run,
) -> Path:
    """Run every stage of one sequence.

    A sequence without a reconstruction is no failure: its clips say so, row by row.

    Args:
        files: The sequence.
        root: The set's output folder.
        recipe: The recipe.
        body_paths: The recipe's bodies.

    Returns:
        The folder of the pseudo ground truth.

    Raises:
        GmrdataError: the sequence can't be read, or a mask can't be had.
    """
    require_name(files.name)
    paths = SetPaths(root)
    given = make_people(files, body_paths, paths.people_dir(files.name), recipe, run=run)
    out_dir = paths.pseudo_gt_dir(files.name)
    inputs = {"images": files.image_dir, "people": paths.people_dir(files.name)}
    config = recipe.of_sequence(files.name)
    if is_unsolved(out_dir, config, inputs):
        return out_dir
    try:
        return regenerate_sequence(
            files.image_dir,
            given.people,
            paths.sequence_dir(files.name),
            config,
            tracked_path=given.tracked_path,
            doubts_path=given.doubts_path,
            left_out=given.left_out,
            run=run,
        )
    except NoReconstruction as error:
        return make_unsolved(given, str(error), out_dir, config, inputs, run=run)


def sequence_entries(
    files: SequenceFiles, recipe: ThreedpwRecipe, paths: SetPaths
) -> list[ClipEntry]:
    """Entries of a finished sequence.  The images stay where they are, and are not listed.

    Args:
        files: The sequence.
        recipe: The recipe.
        paths: Where the set keeps what.
    """
    folder = paths.pseudo_gt_dir(files.name)
    record = load_record(folder)
    entries = []
    for number in range(len(record["people"])):
        clip_path = folder / person_file(number)
        has_camera = load_clip(clip_path).camera is not None
        entries.append(
            clip_entry(
                paths.root,
                clip_path=clip_path,
                camera_motion=record["camera_motion"] if has_camera else "none",
                licence=recipe.licence,
                source=Source(dataset="3DPW", sequence=files.name, person=str(number)),
                dropped_reason=dropped_reasons(record, number),
                quality=quality_record(record, number),
                recipe=stage_recipe(folder),
            )
        )
    return entries
