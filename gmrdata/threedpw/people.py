"""Stage: a sequence of 3DPW as clips: people in the camera's frame, and the set's own path."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gmrdata.read.bodies import read_body
from gmrdata.read.threedpw import Sequence3DPW, ValidRule, read_found, unusable_reasons
from gmrdata.read.threedpw_layout import SequenceFiles
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.threedpw.camera_frame import camera_clip, world_clip
from gmrdata.threedpw.intrinsics_check import IntrinsicsConfig, estimate_focal, intrinsics_reason
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.values.clip import camera_of, save_clip
from gmrdata.values.files import read_json, write_json, write_npz
from gmrdata.values.people import PersonFiles, person_file
from gmrdata.values.records import Config

PEOPLE_FILE, TRACKED_FILE, DOUBTS_FILE = "people.json", "tracked.npz", "doubts.json"


class PeopleConfig(Config):
    """What decides the clips of a sequence."""

    name: str
    """The sequence."""
    split: str
    """Its split."""
    valid_rule: ValidRule
    """Which frames of a person the data set vouches for."""
    intrinsics: IntrinsicsConfig
    """How the intrinsics are checked."""


@dataclass(frozen=True)
class SequencePeople:
    """A sequence's people on disk, and what else its file says."""

    people: tuple[PersonFiles, ...]
    """Each person."""
    tracked_path: Path
    """The data set's own cameras."""
    doubts_path: Path
    """What speaks against the data set's own frames, and against the sequence as a whole."""
    left_out: tuple[int, ...]
    """Numbers of images that can't be used."""


def make_people(
    files: SequenceFiles,
    body_paths: tuple[Path, ...],
    out_dir: Path,
    recipe: ThreedpwRecipe,
    *,
    run: Run = DEFAULT_RUN,
) -> SequencePeople:
    """Read a sequence and write `person_<n>.npz`, `tracked.npz`, `doubts.json` and
    `people.json`.

    Args:
        files: The sequence.
        body_paths: Bodies to choose from.
        out_dir: Folder to make.
        recipe: Which frames count as valid, and how the intrinsics are checked.

    Raises:
        GmrdataError: as `read_sequence` says, or no body fits.
    """

    def work(partial: Path) -> None:
        _write(read_found(files), body_paths, recipe, partial)

    inputs = {"sequence": files.pickle_path}
    # The images decide which frames can be used; that there are none is the reader's to say.
    inputs |= {"images": files.image_dir} if files.image_dir.is_dir() else {}
    inputs |= {f"body_{number}": path for number, path in enumerate(body_paths)}
    config = PeopleConfig(
        name=files.name,
        split=files.split,
        valid_rule=recipe.valid_rule,
        intrinsics=recipe.intrinsics,
    )
    return load_people(run_stage("people", out_dir, config, inputs, work, run=run), body_paths)


def load_people(people_dir: Path, body_paths: tuple[Path, ...]) -> SequencePeople:
    """The files that `make_people` left."""
    record = read_json(people_dir / PEOPLE_FILE)
    people = tuple(
        PersonFiles(people_dir / person_file(number), body_paths[body])
        for number, body in enumerate(record["bodies"])
    )
    return SequencePeople(
        people,
        people_dir / TRACKED_FILE,
        people_dir / DOUBTS_FILE,
        tuple(record["left_out"]),
    )


def _write(
    sequence: Sequence3DPW, body_paths: tuple[Path, ...], recipe: ThreedpwRecipe, partial: Path
) -> None:
    rule = recipe.valid_rule
    bodies = [read_body(path) for path in body_paths]
    names = [body.name for body in bodies]
    chosen, reasons = [], []
    tracked = np.full((sequence.n_frames, 4, 4), np.nan)
    for number in range(len(sequence.arrays.people)):
        clip = camera_clip(sequence, number, bodies, rule)
        body = bodies[names.index(clip.motion.body)]
        save_clip(partial / person_file(number), clip, body.rest_pelvis_m(clip.motion.shape))
        chosen.append(names.index(body.name))
        reasons.append(unusable_reasons(sequence, number, rule))
        known = camera_of(world_clip(sequence, number, bodies, rule))
        tracked[known.has_camera] = known.world_from_cam[known.has_camera]
    write_npz(partial / TRACKED_FILE, {"world_from_cam": tracked})
    focal = estimate_focal(sequence, bodies, recipe.intrinsics, rule)
    wrong = intrinsics_reason(focal, recipe.intrinsics)
    doubts = {"frames": reasons, "sequence": [] if wrong is None else [wrong]}
    write_json(partial / DOUBTS_FILE, doubts)
    record = {
        "bodies": chosen,
        "genders": [person.gender for person in sequence.arrays.people],
        "left_out": [row for row, fault in enumerate(sequence.images.faults) if fault],
        "problems": list(sequence.problems),
        "focal": None if focal is None else asdict(focal),
    }
    write_json(partial / PEOPLE_FILE, record)
