"""Twins: rendered frames and exact clips as faulty sequences of 3DPW, the truth beside them."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, PositiveInt, model_validator
from pydantic.dataclasses import dataclass as part

from gmrdata.film.programmes import Programme
from gmrdata.film.render import EXTRAS_FOLDER
from gmrdata.film.render_set import render_dir, render_selected
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe, clip_rng, render_config, select
from gmrdata.read.body_file import read_body
from gmrdata.read.frames import check_images, read_frames
from gmrdata.read.threedpw_files import (
    FPS_HZ,
    IMAGES_DIR,
    SEQUENCES_DIR,
    SPLITS,
    SequenceFiles,
    require_name,
)
from gmrdata.stage.progress import remark, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import is_made, run_stage
from gmrdata.threedpw.clips import sequence_arrays
from gmrdata.twins.faults import (
    UNCHANGED,
    ExposureConfig,
    FaultConfig,
    KeypointConfig,
    dataset_side,
    detected_keypoints,
    exposed_jpeg,
    exposure_gains,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadFrames, BadSequence, MissingInput, NothingMade, StageFailed
from gmrdata.values.files import STAGE_FILE, atomic_path, remove_orphans, write_npz
from gmrdata.values.records import PART, Config, Record
from gmrdata.write.threedpw import write_sequence


class TwinConfig(Config):
    """How a twin's dataset side differs from the truth."""

    faults: FaultConfig = FaultConfig()
    """Errors of world, cameras and bodies."""
    keypoints: KeypointConfig = KeypointConfig()
    exposure: ExposureConfig = ExposureConfig()


@dataclass(frozen=True, eq=False)
class FilmedPeople:
    """Annotated people of a rendered sequence."""

    clips: Sequence[Clip]
    """Exact world-frame clips at 30 Hz, one per person, with the camera that was rendered."""
    frames: Sequence[Path]
    genders: Sequence[str]
    """"female" or "male" per person; letters in the file, without effect on the body."""
    body: BodyModel


def write_twin(
    files: SequenceFiles,
    filmed: FilmedPeople,
    truth_dir: Path,
    config: TwinConfig,
    rng: np.random.Generator,
    image_dir: Path | None = None,
) -> SequenceFiles:
    """Write one twin.  The sequence file comes last, so one that exists has all that belongs to it.

    `truth_dir` gets the exact clips as `<name>.p<person>.npz`, and the exposure's `gains` (N,) as
    `<name>.exposure.npz`.

    Args:
        files: Where it goes.
        image_dir: Where to write the images; the sequence's own folder when left out.
    """
    from gmrdata.values.skinning import motion_joints_m

    require_name(files.name)
    name, clips, body, frames = files.name, filmed.clips, filmed.body, filmed.frames
    # Of the exact people: detectors look at the image, which has no drift.
    joints_m = [motion_joints_m(body, clip.motion) for clip in clips]
    keypoints_px = [
        detected_keypoints(of_person, camera_of(clip), config.keypoints, rng)
        for of_person, clip in zip(joints_m, clips, strict=True)
    ]
    faulty = dataset_side(clips, config.faults, rng)
    arrays = sequence_arrays(name, faulty, [body] * len(faulty), filmed.genders, keypoints_px)
    _require_frames(name, clips[0], frames)
    gains = exposure_gains(len(frames), clips[0].motion.fps_hz, config.exposure, rng)
    write_npz(truth_dir / f"{name}.exposure.npz", {"gains": gains})
    for row, frame in enumerate(frames):
        with atomic_path((image_dir or files.image_dir) / files.image_path(row).name) as temporary:
            content = frame.read_bytes()
            if config.exposure.gain != UNCHANGED:
                content = exposed_jpeg(content, float(gains[row]), config.exposure.jpeg_quality)
            temporary.write_bytes(content)
    for person, clip in enumerate(clips):
        truth = replace(clip, id=f"{name}.p{person}", image_numbers=np.arange(len(frames)))
        rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
        save_clip(truth_dir / f"{truth.id}.npz", truth, rest_pelvis_m)
    return write_sequence(files.root, files.split, arrays)


def _require_frames(name: str, clip: Clip, frames: Sequence[Path]) -> None:
    camera = camera_of(clip)
    if len(frames) != camera.n_frames:
        raise BadFrames(f"{name}: {len(frames)} images for {camera.n_frames} frames of {clip.id}")
    for frame in frames:
        if frame.suffix.lower() != ".jpg":
            raise BadFrames(f"{frame}: 3DPW's images are .jpg; render the twin as JPEG")
    width_px, height_px = check_images(list(frames))
    if (width_px, height_px) != (camera.width_px, camera.height_px):
        own = f"the camera of {clip.id} has {camera.width_px}x{camera.height_px} px"
        what = f"{width_px}x{height_px} px, {own}; give the frames that it rendered"
        raise BadFrames(f"{frames[0]}: {what}")


Split = Literal["train", "validation", "test"]

SET_FOLDER, DATASET_FOLDER, TRUTH_FOLDER = "render_set", "3DPW", "truth"
TWINS_FILE = "twins.json"
GENDERS = ("female", "male")


class TwinRecipe(Config):
    """A rendered set, written in 3DPW's layout with 3DPW's faults."""

    recipe: Literal["threedpw_twin"]
    set: SyntheticRecipe
    """What is rendered: a recipe of kind `synthetic`, at 30 fps, as JPEG.  The id of each clip is
    the sequence's name.  `company` of its place are further annotated people; passers-by and cars
    are not annotated, as in 3DPW."""
    twin: TwinConfig = TwinConfig()
    """How the dataset's side differs from the truth, drawn by the set's seed and the name."""
    split: Split = "test"
    splits: Mapping[str, Split] = Field(default_factory=dict)
    """Another split for some, by name."""

    @model_validator(mode="after")
    def _set_fits_the_layout(self) -> "TwinRecipe":
        if self.set.film.fps_hz != FPS_HZ:
            raise ValueError(f"set.film.fps_hz: 3DPW has {FPS_HZ:g} frames a second; say so")
        if self.set.render.image_format != "jpg":
            raise ValueError("set.render.image_format: 3DPW's images are jpg")
        if self.set.camera_off or self.set.published_list:
            raise ValueError("set: name each sequence in `clips`, without camera_off or a list")
        names = [clip.id for clip in self.set.clips]
        try:
            for name in names:
                require_name(name)
        except BadSequence as error:
            raise ValueError(f"set.clips: {error}") from None
        if unknown := sorted(self.splits.keys() - set(names)):
            raise ValueError(f"splits: no clips {', '.join(unknown)}")
        return self


@part(frozen=True, config=PART)
class TwinSequence:
    """What a sequence is."""

    name: str
    class_true: str
    """What its camera does."""
    trial: str
    people: PositiveInt
    """Annotated people."""
    scene: SceneConfig
    programme: Programme


class TwinsRecord(Record):
    """`truth/twins.json`."""

    format: Literal["gmrdata-twins/1"] = "gmrdata-twins/1"
    sequences: tuple[TwinSequence, ...]


@dataclass(frozen=True)
class TwinTruth:
    """A folder that `gmrdata threedpw twin` made."""

    folder: Path
    sequences: dict[str, TwinSequence]  # by name

    @property
    def classes(self) -> dict[str, str]:
        """What the camera does, by sequence."""
        return {name: sequence.class_true for name, sequence in self.sequences.items()}

    @property
    def root(self) -> Path:
        """The dataset, in 3DPW's layout."""
        return self.folder / DATASET_FOLDER

    def people(self, name: str) -> list[Clip]:
        """The exact people of a sequence; MissingInput where one of them is missing."""
        if name not in self.sequences:
            known = ", ".join(self.sequences)
            raise MissingInput(f"{self.folder}: no twin {name!r}; there are {known}")
        folder = self.folder / TRUTH_FOLDER
        paths = [folder / f"{name}.p{n}.npz" for n in range(self.sequences[name].people)]
        if missing := [path.name for path in paths if not path.is_file()]:
            raise MissingInput(f"{folder}: no {missing[0]}; make the twins again")
        return [load_clip(path) for path in paths]


def read_truth(folder: Path) -> TwinTruth:
    """Read `truth/twins.json` of a twin set; BadSequence where a name in it is no sequence's."""
    path = folder / TRUTH_FOLDER / TWINS_FILE
    if not path.is_file():
        raise MissingInput(f"{path}: no such file; give a folder that `gmrdata threedpw twin` made")
    sequences = TwinsRecord.read(path).sequences
    for sequence in sequences:
        require_name(sequence.name)
    return TwinTruth(folder, {sequence.name: sequence for sequence in sequences})


class SequenceTwinConfig(Config):
    """What decides one sequence beside what was rendered."""

    name: str
    split: Split
    seed: int
    """The set's; faults hang on it and on the name."""
    people: tuple[str, ...]
    """The clips of the annotated people, below the rendered clip's folder."""
    twin: TwinConfig


def make_twins(
    recipe: TwinRecipe, out_dir: Path, *, motions_dir: Path | None = None, run: Run = DEFAULT_RUN
) -> Path:
    """Render a twin set to `out_dir/render_set`, and write it to `out_dir/3DPW`.

    The truth is kept in `out_dir/truth`: `<name>.p<person>.npz`, the exact clip of each annotated
    person, `<name>.exposure.npz`, and `twins.json`, which says of each sequence what it is.  A run
    that was stopped goes on where it was; the same recipe again does nothing.  Twins that another
    recipe left there, and those of clips that fail now, are removed: the set has what is listed.

    Raises:
        StageFailed: some clips failed; the sequences of the others are written.
        NothingMade: all of them failed; nothing is written.
    """
    out_dir, selection = out_dir.resolve(), select(recipe.set, motions_dir)
    failed: StageFailed | None = None
    try:
        render_selected(selection, out_dir / SET_FOLDER, run)
    except StageFailed as error:
        failed = error
    failures_dir = out_dir / SET_FOLDER / "failed"
    clips = [
        take.clip
        for take in selection.takes
        if render_dir(out_dir / SET_FOLDER, take.id).is_dir()
        and not (failures_dir / f"{take.id}.txt").exists()
    ]
    if failed is not None and not clips:
        raise NothingMade(str(failed)) from failed
    for folder in (out_dir / TRUTH_FOLDER, *(out_dir / DATASET_FOLDER).glob("*/*/")):
        remove_orphans(folder)
    for clip in track(clips, "writing sequences"):
        write_sequence_twin(recipe, clip, out_dir, run=run)
    names = {clip.id for clip in clips}
    # What no stage made stays: the folder may hold 3DPW itself.
    for made in sorted((out_dir / DATASET_FOLDER / IMAGES_DIR).glob(f"*/{STAGE_FILE}")):
        if made.parent.name not in names:
            remark(f"{made.parent.name}: removed, as this run has no such twin")
            _remove_sequence(made.parent.name, out_dir)
    about = []
    for clip in clips:
        scene = render_config(recipe.set, clip).scene
        people, trial = 1 + scene.extras.company, clip.trial or f"gait {clip.gait}"
        kind = clip.programme.kind
        about.append(TwinSequence(clip.id, kind, trial, people, scene, clip.programme))
    TwinsRecord(sequences=tuple(about)).write(out_dir / TRUTH_FOLDER / TWINS_FILE)
    if failed is not None:
        raise failed
    return out_dir / DATASET_FOLDER


def _remove_sequence(name: str, out_dir: Path) -> None:
    """Remove what a recipe made of a sequence.  The images go first: whoever is stopped here must
    find nothing that looks made."""
    root, truth_dir = out_dir / DATASET_FOLDER, out_dir / TRUTH_FOLDER
    shutil.rmtree(root / IMAGES_DIR / name, ignore_errors=True)
    stale = [root / SEQUENCES_DIR / split / f"{name}.pkl" for split in SPLITS]
    stale += [truth_dir / f"{name}.exposure.npz", *truth_dir.glob(f"{name}.p[0-9].npz")]
    for path in stale:
        path.unlink(missing_ok=True)


def write_sequence_twin(
    recipe: TwinRecipe, clip: SyntheticClip, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> Path:
    """Stage: one sequence of the twin set `out_dir`, as its folder of images, which comes last, so
    that one that exists is complete; one whose other files were lost is made again."""
    rendered = render_dir(out_dir / SET_FOLDER, clip.id)
    root, truth_dir = out_dir / DATASET_FOLDER, out_dir / TRUTH_FOLDER
    body_path = out_dir / SET_FOLDER / "body" / "body.npz"
    extras = render_config(recipe.set, clip).scene.extras
    company = (f"{EXTRAS_FOLDER}/{name}.npz" for name in extras.names[: extras.company])
    config = SequenceTwinConfig(
        name=clip.id,
        split=recipe.splits.get(clip.id, recipe.split),
        seed=recipe.set.seed,
        people=("clip.npz", *company),
        twin=recipe.twin,
    )
    paths = [rendered / file for file in config.people]
    files = SequenceFiles(root, clip.id, config.split)

    def work(partial_dir: Path) -> None:
        # Of another recipe, which had more people or another split.
        _remove_sequence(clip.id, out_dir)
        rng = clip_rng(recipe.set.seed, clip.id, "faults")
        genders = [GENDERS[int(rng.integers(2))] for _ in paths]
        people = [load_clip(path) for path in paths]
        frames = read_frames(rendered / "frames").paths
        filmed = FilmedPeople(people, frames, genders, read_body(body_path))
        write_twin(files, filmed, truth_dir, config.twin, rng, partial_dir)

    inputs = {"frames": rendered / "frames", "body": body_path}
    inputs |= {f"person{number}": path for number, path in enumerate(paths)}
    kinds = ("exposure", *(f"p{number}" for number in range(len(paths))))
    outside = [files.pickle_path, *(truth_dir / f"{clip.id}.{kind}.npz" for kind in kinds)]
    is_lost = not all(path.is_file() for path in outside)
    if is_lost and is_made("twin", files.image_dir, config, inputs, run):
        _remove_sequence(clip.id, out_dir)
    return run_stage("twin", files.image_dir, config, inputs, work, run=run)
