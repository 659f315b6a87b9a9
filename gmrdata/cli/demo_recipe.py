"""What the demo's recipe may say, and where the demo keeps what."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from gmrdata.film.programmes import Film, Programme
from gmrdata.film.render import RenderConfig
from gmrdata.gmr.config import TrainConfig
from gmrdata.solve.request import SequenceConfig
from gmrdata.values import limits
from gmrdata.values.motion import whole_ratio
from gmrdata.values.people import person_file
from gmrdata.values.records import Config

FPS_HZ = 10.0  # rate at which all errors are measured [Hz]: the paper's


class DemoClip(Config):
    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    """Name of the clip and of its folders."""
    gait: str
    """Kind of embedded gait that is filmed when no motion files are given."""
    programme: Programme


class Training(Config):
    gait_count: int = Field(default=60, ge=1, le=limits.MOST_CLIPS)
    gait_duration_s: float = Field(default=12.0, ge=1, le=limits.LONGEST_S)
    """Length of each [s]."""
    fps_hz: float = Field(default=30.0, ge=1, le=1000)
    """Frame rate of each [Hz]; all phases at the network's rate are used."""
    max_files: int = Field(default=60, ge=0)
    """At most this many of the motion files that are given, besides those filmed."""


class DemoRecipe(Config):
    """Three clips rendered, regenerated from their frames, and a GMR trained and scored."""

    recipe: Literal["demo"]
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)
    body: str = "anny"
    """Body model: "anny", or the path of an SMPL model file."""
    workers: int = Field(default=3, ge=1, le=limits.MOST_WORKERS)
    """Worker processes for the clips, one thread each for rendering."""
    clips: tuple[DemoClip, ...] = Field(min_length=1, max_length=limits.MOST_CLIPS)
    """In the order of the report."""
    film: Film = Film()
    training: Training = Training()
    render: RenderConfig = RenderConfig()
    sequence: SequenceConfig = SequenceConfig()
    """Masks, cameras, scale and world motion."""
    gmr: TrainConfig = TrainConfig()

    @model_validator(mode="after")
    def _can_be_made(self) -> Self:
        if self.render.character is not None:
            remedy = "use a synthetic recipe for rigged characters"
            raise ValueError(f"render.character: the demo draws its masks from the body; {remedy}")
        ids = [clip.id for clip in self.clips]
        if len(ids) != len(set(ids)):
            raise ValueError(f"clip ids must be unique, these are not: {', '.join(ids)}")
        if self.film.fps_hz is not None and whole_ratio(self.film.fps_hz, FPS_HZ) is None:
            what = f"errors are measured at {FPS_HZ:g} fps, and {self.film.fps_hz:g} is no multiple"
            raise ValueError(f"film.fps_hz: {what}. Film at 10, 20 or 30")
        return self


class MotionsConfig(Config):
    """The settings that decide the motions: parts of the recipe, and the files to film."""

    seed: int
    clips: tuple[DemoClip, ...]
    film: Film
    training: Training
    filmed: tuple[str, ...]
    """Names of the files, one for each clip; empty for the embedded gait."""


class DemoPaths:
    """The demo's output folder: the only place that knows its names."""

    def __init__(self, root: Path) -> None:
        self.root = root
        """The folder; manifests stand in it and point below it."""
        self.body_dir = root / "body"
        self.body = self.body_dir / "body.npz"
        self.motions_dir = root / "motions"
        """Stage: the motions, `clips/` to render and `training/` to train on."""
        self.training_dir = self.motions_dir / "training"
        self.all_renders_dir = root / "render"
        self.failures_dir = root / "failed"
        self.training_manifest = root / "training.yaml"
        self.synthetic_manifest = root / "synthetic.yaml"
        self.pseudo_gt_manifest = root / "pseudo_gt.yaml"
        """The same clips with regenerated world motions."""
        self.gmr_dir = root / "gmr"
        self.recipe = root / "recipe.yaml"
        """The recipe that made what is here; written when all stages are done."""
        self.summary = root / "summary.json"
        self.report = root / "report.html"
        self.views_dir = root / "view3d"
        self.overview = root / "overview.png"

    def clip(self, clip_id: str) -> "ClipPaths":
        return ClipPaths(self, clip_id)

    def scores_dir(self, manifest_name: str) -> Path:
        return self.root / "scores" / manifest_name


class ClipPaths:
    """The files of one clip of the demo."""

    def __init__(self, demo: DemoPaths, clip_id: str) -> None:
        self.planned = demo.motions_dir / "clips" / f"{clip_id}.npz"
        """A motion and the camera that is to film it."""
        self.render_dir = demo.all_renders_dir / clip_id
        """Stage: frames, person masks, and the truth."""
        self.true = self.render_dir / "clip.npz"
        self.frames_dir = self.render_dir / "frames"
        self.regenerated_dir = demo.root / "regenerated" / clip_id
        """What is made of the frames, the intrinsics and the camera-frame body alone."""
        self.sequence_dir = self.regenerated_dir / "sequence"
        """Stage: what a data set like 3DPW would give."""
        self.seen = self.sequence_dir / "clip.npz"
        """The camera-frame body and the intrinsics."""
        self.masks_dir = self.regenerated_dir / "masks"
        self.sfm_dir = self.regenerated_dir / "sfm"
        self.pseudo_gt_dir = self.regenerated_dir / "pseudo_gt"
        self.pseudo = self.pseudo_gt_dir / person_file(0)
