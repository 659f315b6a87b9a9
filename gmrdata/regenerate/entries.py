"""The manifest entries of one regenerated sequence: one clip for each person."""

from gmrdata.clip import load_clip
from gmrdata.manifest.current import Clip, Source
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import stage_recipe
from gmrdata.people import person_file
from gmrdata.pseudogt.entry import dropped_reasons, load_record, quality_record
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.threedpw.layout import SequenceFiles


def sequence_entries(files: SequenceFiles, recipe: ThreedpwRecipe, paths: SetPaths) -> list[Clip]:
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
