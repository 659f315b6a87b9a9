"""The recipe of a synthetic set, and its takes before they are rendered.

Every choice hangs on the set's seed and the clip's id, so that a clip stays as it is when others
come and go, and a clip's twin has the same person in the same place.
"""

import filecmp
import hashlib
from collections import Counter
from collections.abc import Container
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from gmrdata.film.character import Character, sample_person
from gmrdata.film.programmes import (
    Film,
    Programme,
    camera_programme,
    film_motion,
    plan_clip,
    static_twin,
)
from gmrdata.film.render import RenderConfig, RenderJob
from gmrdata.film.scene import Extras, SceneConfig
from gmrdata.manifest.current import CameraMotion, Semver, Source
from gmrdata.manifest.read import published_list
from gmrdata.motion.files import FileReading, find_motions, input_files, read_file, require_motion
from gmrdata.motion.gait import make_gait
from gmrdata.motion.ground import on_ground
from gmrdata.motion.library import READING_FILE, ReadingRecord, gait_source, motion_source
from gmrdata.motion.resample import hold_pose
from gmrdata.motion.rest_pose import LONGEST_LEG_M, SHORTEST_LEG_M
from gmrdata.read.body_file import read_body
from gmrdata.read.source_motion import DEFAULT_READING, ReadConfig
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values import limits
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadCharacter, BadMotionFile, BadRecipe, MissingInput, StageFailed
from gmrdata.values.files import require_file
from gmrdata.values.records import Config

PLANNED_FILE = "clip.npz"
GAIT_FPS_HZ = 30.0
PROGRAMMES = {
    kind: camera_programme(kind)
    for kind in ("circular", "linear", "linear_panning", "panning", "small")
}
"""What a published list's class of camera motion is rendered with."""


class SyntheticClip(Config):
    id: str = Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_-]*$", max_length=100)
    """Name of the clip and of its folders."""
    trial: str | None = None
    """Name of a motion file, without suffix."""
    gait: str | None = None
    """Or kind of embedded gait."""
    read: ReadConfig | None = None
    """What the motion file doesn't show of itself; the set's when left out."""
    programme: Programme
    duration_s: float | None = Field(default=None, gt=0, le=limits.LONGEST_S)
    """Length to film, from the motion's start [s]; the set's when left out."""
    hold_s: float | None = Field(default=None, ge=0, le=limits.LONGEST_S)
    """The person holds the pose that the motion has at this time [s], and the truth is no motion at
    all; None: the person moves.  `hold_s` of the scene's extras is for the others."""
    shape: Annotated[tuple[float, ...], Field(max_length=1000)] | None = None
    """Shape coefficients of the person, as many as the body has; `people` decides when left out."""
    scene: SceneConfig | None = None
    """Drawn from the set's `scenes`, or that of `render`, when left out."""
    character: Character | None = None
    """That of `render`, if any, when left out."""

    @model_validator(mode="after")
    def _one_motion(self) -> "SyntheticClip":
        if (self.trial is None) == (self.gait is None):
            raise ValueError("give either `trial` or `gait`")
        return self


class PeopleConfig(Config):
    vary: bool = False
    """Whether each clip has a person, skin, hair and clothes of its own; else a file's motion has
    the body's mean shape, a gait one of its own, and the scene's seed chooses the clothes."""
    spread: float = Field(default=1.0, ge=0, le=1.2)
    """How far shapes go from the mean; 1: as adults do in the body's own distribution."""


class SyntheticRecipe(Config):
    recipe: Literal["synthetic"]
    name: str = Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")
    version: Semver = "1.0.0"
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)
    """Of every random choice."""
    body: str = "anny"
    """Or the path of an SMPL model file."""
    workers: int = Field(default=2, ge=1, le=limits.MOST_WORKERS)
    """Processes, one thread each."""
    published_list: str | None = None
    """A published list whose trials are rendered, each under its programme."""
    clips: tuple[SyntheticClip, ...] = Field(default=(), max_length=limits.MOST_CLIPS)
    """Further clips."""
    camera_off: bool = False
    """Render each clip that is not static a second time, as `<id>_off`, under a static camera."""
    min_in_frame_share: float = Field(default=0.9, ge=0, le=1)
    """A clip that has the whole person in frame in a smaller share of its frames gets a warning."""
    people: PeopleConfig = PeopleConfig()
    scenes: tuple[SceneConfig, ...] = ()
    """Of these each clip draws one, and a seed if it has none; empty: that of `render`."""
    read: ReadConfig = ReadConfig()
    """What the motion files don't show of themselves: joint names, zero pose, unit, rate."""
    film: Film = Film()
    render: RenderConfig = RenderConfig()


def clip_rng(
    seed: int, clip_id: str, choice: Literal["motion", "person", "looks", "place", "faults"]
) -> np.random.Generator:
    """The generator of one kind of choice for one clip."""
    digest = hashlib.sha256(f"{clip_id}/{choice}".encode()).digest()
    return np.random.default_rng([seed, *np.frombuffer(digest[:16], dtype="<u4").tolist()])


def render_config(recipe: SyntheticRecipe, clip: SyntheticClip) -> RenderConfig:
    """How a clip, or its twin, is rendered: the set's recipe with the clip's place and looks."""
    config = recipe.render
    person = config.person
    if recipe.people.vary and person.seed is None:
        seed = int(clip_rng(recipe.seed, clip.id, "looks").integers(2**31))
        person = person.model_copy(update={"seed": seed})
    scene, character = clip.scene or _scene(recipe, clip.id), clip.character or config.character
    extras = scene.extras
    if extras.motions and extras.read is None and recipe.read != DEFAULT_READING:
        extras = extras.model_copy(update={"read": recipe.read})
        scene = scene.model_copy(update={"extras": extras})
    return config.model_copy(update={"scene": scene, "person": person, "character": character})


def _scene(recipe: SyntheticRecipe, clip_id: str) -> SceneConfig:
    if not recipe.scenes:
        return recipe.render.scene
    rng = clip_rng(recipe.seed, clip_id, "place")
    scene = recipe.scenes[int(rng.integers(len(recipe.scenes)))]
    own = {} if "seed" in scene.model_fields_set else {"seed": int(rng.integers(2**31))}
    return scene.model_copy(update=own)


class PlanConfig(Config):
    seed: int
    clip: SyntheticClip
    read: ReadConfig
    film: Film
    people: PeopleConfig


class CameraOffConfig(Config):
    id: str


def passing_dirs(extras: Extras, plans_dir: Path) -> dict[Path, Path]:
    """The stage folder of each motion file of passers-by, read as the scene says."""
    said = (extras.read or DEFAULT_READING).model_dump_json()
    digests = {path: hashlib.sha256(f"{path} {said}".encode()) for path in extras.motions}
    return {path: plans_dir / f"passing.{one.hexdigest()[:16]}" for path, one in digests.items()}


def read_passers_by(extras: Extras, body_path: Path, plans_dir: Path, run: Run) -> None:
    """Stages: what may be wrong with these files, in `reading.json`; BadMotionFile for one that
    can't be read, whether chance takes it or not."""
    read = extras.read or DEFAULT_READING
    for path, folder in passing_dirs(extras, plans_dir).items():

        def work(partial_dir: Path, path: Path = path) -> None:
            reading = read_file(path, read_body(body_path), read)
            ReadingRecord.of(reading).write(partial_dir / READING_FILE)

        inputs = {"body": body_path} | input_files(path) | read.inputs
        run_stage("passing", folder, read.recorded, inputs, work, run=run)


def make_plan(
    clip: SyntheticClip,
    recipe: SyntheticRecipe,
    motion_path: Path | None,
    body_path: Path,
    out_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: the planned clip, of a motion file or (None) an embedded gait; gives its path.  Beside
    that of a file is `reading.json`."""

    def work(partial_dir: Path) -> None:
        body = read_body(body_path)
        planned, reading = planned_clip(clip, recipe, motion_path, body)
        save_clip(partial_dir / PLANNED_FILE, planned, body.rest_pelvis_m(planned.motion.shape))
        if reading is not None:
            ReadingRecord.of(reading).write(partial_dir / READING_FILE)

    # The place doesn't matter to the plan: another one must not make it stale.
    anywhere = clip.model_copy(update={"scene": None, "read": None})
    read = ReadConfig() if motion_path is None else clip.read or recipe.read
    config = PlanConfig(
        seed=recipe.seed,
        clip=anywhere,
        read=read.recorded,
        film=_film(clip, recipe),
        people=recipe.people,
    )
    inputs = {"body": body_path} | ({} if motion_path is None else input_files(motion_path))
    inputs |= read.inputs
    return run_stage("plan", out_dir, config, inputs, work, run=run) / PLANNED_FILE


def make_twin(
    twin_id: str, planned_path: Path, body_path: Path, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> Path:
    """Stage: a planned clip once more, with the motion of its camera off; gives its path."""

    def work(partial_dir: Path) -> None:
        clip = load_clip(planned_path)
        camera = static_twin(camera_of(clip), clip.motion.pelvis_m)
        twin = replace(clip, id=twin_id, camera=camera)
        rest_pelvis_m = read_body(body_path).rest_pelvis_m(clip.motion.shape)
        save_clip(partial_dir / PLANNED_FILE, twin, rest_pelvis_m)

    inputs = {"clip": planned_path, "body": body_path}
    config = CameraOffConfig(id=twin_id)
    return run_stage("twin", out_dir, config, inputs, work, run=run) / PLANNED_FILE


def planned_clip(
    clip: SyntheticClip, recipe: SyntheticRecipe, motion_path: Path | None, body: BodyModel
) -> tuple[Clip, FileReading | None]:
    """A clip's motion and camera, and how its file was read, if it has one."""
    film = _film(clip, recipe)
    shape = None if clip.shape is None else np.array(clip.shape)  # None: as the motion has it
    if shape is not None and len(shape) == body.n_shape:  # another number is refused below
        leg_m = leg_length_m(body.rest_joints_m(shape))
        if not SHORTEST_LEG_M <= leg_m <= LONGEST_LEG_M:
            what = f"clip {clip.id}: shape: its legs are {leg_m:.4g} m long, which nobody's are"
            raise BadRecipe(f"{what}; give coefficients of -3 to 3, or none for the mean")
    if shape is None and recipe.people.vary:
        person_rng = clip_rng(recipe.seed, clip.id, "person")
        shape = sample_person(body, person_rng, recipe.people.spread)
    rng = clip_rng(recipe.seed, clip.id, "motion")
    reading: FileReading | None = None
    if motion_path is not None:
        reading = read_file(motion_path, body, clip.read or recipe.read, shape=shape)
        motion = on_ground(body, reading.motion)
        first_s, last_s = (clip.hold_s,) * 2 if clip.hold_s is not None else (0, film.duration_s)
        require_motion(reading, motion_path, first_s, last_s)
    else:
        rate_hz = max(GAIT_FPS_HZ, film.fps_hz or 0.0)
        lasts_s = max(film.duration_s, (round((clip.hold_s or 0.0) * rate_hz) + 1) / rate_hz)
        motion = make_gait(clip.gait or "", lasts_s, rate_hz, body, rng, shape=shape)
    if clip.hold_s is not None:
        motion = hold_pose(motion, clip.hold_s, max(1, round(film.duration_s * motion.fps_hz)))
    return plan_clip(clip.id, film_motion(motion, film), clip.programme, film, rng), reading


def _film(clip: SyntheticClip, recipe: SyntheticRecipe) -> Film:
    duration_s = clip.duration_s or recipe.film.duration_s
    return recipe.film.model_copy(update={"duration_s": duration_s})


@dataclass(frozen=True)
class PlannedClip:
    """A clip of the recipe, or its twin with the camera's motion off (Table 6)."""

    id: str
    clip: SyntheticClip
    camera_off: bool = False

    @property
    def camera_motion(self) -> CameraMotion:
        return "static" if self.camera_off else self.clip.programme.kind


@dataclass(frozen=True)
class Selection:
    """The clips of a recipe that can be rendered, and those whose motion is not there."""

    recipe: SyntheticRecipe
    takes: tuple[PlannedClip, ...]  # a clip's twin follows it
    motions_dir: Path | None
    files: dict[str, Path]  # motions in it by their trial's name
    missing: tuple[str, ...]

    def source(self, clip: SyntheticClip) -> Source:
        """Where a clip's motion is from, as `gmrdata motions` says it of the same folder."""
        if clip.trial is None or self.motions_dir is None:
            return gait_source(clip.gait or "")
        path = self.files[clip.trial]
        return motion_source(path, path.relative_to(self.motions_dir))


def select(recipe: SyntheticRecipe, motions_dir: Path | None) -> Selection:
    """Find the motion files of a recipe's clips; BadRecipe where a name says not which is meant."""
    wanted = (*_listed(recipe.published_list), *recipe.clips)
    if not wanted:
        raise BadRecipe(f"recipe {recipe.name}: no clips; give `clips` or `published_list`")
    files = {} if motions_dir is None else _by_trial(motions_dir, {clip.trial for clip in wanted})
    takes = []
    for clip in wanted:
        if clip.trial is None or clip.trial in files:
            takes.append(PlannedClip(clip.id, clip))
            if recipe.camera_off and clip.programme.kind != "static":
                takes.append(PlannedClip(f"{clip.id}_off", clip, camera_off=True))
    if repeated := sorted(id for id, n in Counter(take.id for take in takes).items() if n > 1):
        what = f"clip ids must be unique, but these are repeated: {', '.join(repeated)}"
        raise BadRecipe(f"{what}; rename clips (camera_off adds _off to each)")
    missing = tuple(clip.trial for clip in wanted if clip.trial and clip.trial not in files)
    return Selection(recipe, tuple(takes), motions_dir, files, missing)


def _by_trial(motions_dir: Path, wanted: Container[str | None]) -> dict[str, Path]:
    """Motion files by name; BadRecipe where a wanted one may be either of two motions."""
    files: dict[str, Path] = {}
    for path in find_motions(motions_dir):
        other = files.setdefault(path.stem, path)
        if path.stem in wanted and not filecmp.cmp(other, path, shallow=False):
            remedy = "Rename one, or give the folder of one with --motions"
            raise BadRecipe(f"trial {path.stem}: {other} and {path} both have this name. {remedy}")
    return files


def _listed(name: str | None) -> list[SyntheticClip]:
    if name is None:
        return []
    return [
        SyntheticClip(
            id=row.id,
            trial=row.source.sequence,
            programme=PROGRAMMES[row.programme],
            duration_s=row.frames.stop / row.fps_hz,
        )
        for row in published_list(name)
        if row.programme in PROGRAMMES
    ]


def plan_takes(
    selection: Selection, body_path: Path, plans_dir: Path, clips_dir: Path, run: Run = DEFAULT_RUN
) -> tuple[dict[str, RenderJob], dict[str, str]]:
    """Plan every take in a stage folder of its own below `plans_dir`.

    Gives, by the take's id, what renders it to `clips_dir`, or why it can't be filmed.  A clip and
    its twin share one place, which is laid out for the paths of both (Table 6).
    """
    recipe = selection.recipe
    paths, of_clip = dict[str, Path](), dict[str, list[Path]]()
    reasons: dict[str, str] = {}
    for take in selection.takes:
        clip, out_dir = take.clip, plans_dir / take.clip.id
        motion_path = selection.files.get(clip.trial or "")
        try:
            path = make_plan(clip, recipe, motion_path, body_path, out_dir, run=run)
            if take.camera_off:
                path = make_twin(take.id, path, body_path, plans_dir / take.id, run=run)
            paths[take.id] = path
            of_clip.setdefault(clip.id, []).append(path)
        except (BadMotionFile, BadRecipe, MissingInput, StageFailed) as error:
            reasons[take.id] = str(error)
    jobs = {}
    for take in [take for take in selection.takes if take.id in paths]:
        shared = tuple(of_clip[take.clip.id])
        job = RenderJob(
            clip_path=paths[take.id], body_path=body_path, out_dir=clips_dir / take.id,
            config=render_config(recipe, take.clip), layout_paths=shared if len(shared) > 1 else (),
        )  # fmt: skip
        try:
            for path in job.inputs.values():
                require_file(path)
            read_passers_by(job.config.scene.extras, body_path, plans_dir, run)
            jobs[take.id] = job
        except (BadCharacter, BadMotionFile, MissingInput) as error:
            reasons[take.id] = str(error)
    return jobs, reasons
