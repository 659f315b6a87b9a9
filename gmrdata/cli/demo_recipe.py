"""Where the demo keeps what: the only place that knows these names.

What the demo's recipe may say.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from gmrdata.film.programmes import Programme
from gmrdata.film.render import RenderConfig
from gmrdata.film.shots import Film
from gmrdata.gmr.config import TrainConfig
from gmrdata.values.people import person_file
from gmrdata.values.records import Config
from gmrdata.world.sequence import SequenceConfig


class DemoClip(Config):
    """One clip: who moves, and how the camera moves."""

    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    """Name of the clip and of its folders."""
    gait: str
    """Kind of embedded gait that is filmed when no motion files are given."""
    programme: Programme
    """Camera programme."""


class Training(Config):
    """The motions that GMR is trained on."""

    gait_count: int = Field(default=60, ge=1)
    """Embedded gait motions."""
    gait_duration_s: float = Field(default=12.0, gt=0)
    """Length of each [s]."""
    fps_hz: float = 30.0
    """Frame rate of each [Hz]; all phases at the network's rate are used."""
    max_files: int = Field(default=60, ge=0)
    """At most this many of the motion files that are given, besides those filmed."""


class DemoRecipe(Config):
    """Three clips rendered, regenerated from their frames, and a GMR trained and scored."""

    recipe: Literal["demo"]
    """Kind of recipe."""
    seed: int = Field(default=0, ge=0)
    """Seed of every random choice."""
    body: str = "anny"
    """Body model: "anny", or the path of an SMPL model file."""
    workers: int = Field(default=3, ge=1)
    """Worker processes for the clips, one thread each for rendering."""
    clips: tuple[DemoClip, ...] = Field(min_length=1)
    """The clips, in the order of the report."""
    film: Film = Film()
    """What the clips share."""
    training: Training = Training()
    """The training motions."""
    render: RenderConfig = RenderConfig()
    """The Blender stage."""
    sequence: SequenceConfig = SequenceConfig()
    """Masks, cameras, scale and world motion."""
    gmr: TrainConfig = TrainConfig()
    """The network and its training."""

    @model_validator(mode="after")
    def _masks_fit_the_body(self) -> "DemoRecipe":
        if self.render.character is not None:
            raise ValueError(
                "render.character: the demo draws its masks from the body; "
                "use a synthetic recipe for rigged characters"
            )
        return self

    @model_validator(mode="after")
    def _ids_are_unique(self) -> "DemoRecipe":
        ids = [clip.id for clip in self.clips]
        if len(ids) != len(set(ids)):
            raise ValueError(f"clip ids must be unique, these are not: {', '.join(ids)}")
        return self


@dataclass(frozen=True)
class DemoPaths:
    """The demo's output folder."""

    root: Path
    """The folder; manifests stand in it and point below it."""

    @property
    def recipe(self) -> Path:
        """The recipe that made what is here; written when all stages are done."""
        return self.root / "recipe.yaml"

    @property
    def body_dir(self) -> Path:
        """Stage folder of the body model."""
        return self.root / "body"

    @property
    def body(self) -> Path:
        """The body model that all clips use."""
        return self.body_dir / "body.npz"

    @property
    def motions_dir(self) -> Path:
        """Stage folder of the motions: `clips/` to render, `training/` to train on."""
        return self.root / "motions"

    def planned_clip(self, clip_id: str) -> Path:
        """A motion and the camera that is to film it."""
        return self.motions_dir / "clips" / f"{clip_id}.npz"

    @property
    def training_dir(self) -> Path:
        """The training motions, one clip file each."""
        return self.motions_dir / "training"

    @property
    def all_renders_dir(self) -> Path:
        """The stage folders of all rendered clips."""
        return self.root / "render"

    def render_dir(self, clip_id: str) -> Path:
        """Stage folder of a rendered clip: frames, person masks, and the truth."""
        return self.all_renders_dir / clip_id

    def true_clip(self, clip_id: str) -> Path:
        """The motion and the camera as they were rendered."""
        return self.render_dir(clip_id) / "clip.npz"

    def frames_dir(self, clip_id: str) -> Path:
        """The rendered frames."""
        return self.render_dir(clip_id) / "frames"

    def regenerated_dir(self, clip_id: str) -> Path:
        """What is made of the frames, the intrinsics and the camera-frame body alone."""
        return self.root / "regenerated" / clip_id

    def sequence_dir(self, clip_id: str) -> Path:
        """Stage folder of what a data set like 3DPW would give: the camera-frame body."""
        return self.regenerated_dir(clip_id) / "sequence"

    def camera_clip(self, clip_id: str) -> Path:
        """The camera-frame body and the intrinsics."""
        return self.sequence_dir(clip_id) / "clip.npz"

    def masks_dir(self, clip_id: str) -> Path:
        """Stage folder of the dynamic-object masks."""
        return self.regenerated_dir(clip_id) / "masks"

    def sfm_dir(self, clip_id: str) -> Path:
        """Stage folder of the recovered cameras."""
        return self.regenerated_dir(clip_id) / "sfm"

    def pseudo_gt_dir(self, clip_id: str) -> Path:
        """Stage folder of the regenerated world motion."""
        return self.regenerated_dir(clip_id) / "pseudo_gt"

    def pseudo_clip(self, clip_id: str) -> Path:
        """The regenerated world motion and the metric camera."""
        return self.pseudo_gt_dir(clip_id) / person_file(0)

    @property
    def training_manifest(self) -> Path:
        """Manifest of the training motions."""
        return self.root / "training.yaml"

    @property
    def synthetic_manifest(self) -> Path:
        """Manifest of the rendered clips with exact truth."""
        return self.root / "synthetic.yaml"

    @property
    def pseudo_gt_manifest(self) -> Path:
        """Manifest of the same clips with regenerated world motions."""
        return self.root / "pseudo_gt.yaml"

    @property
    def gmr_dir(self) -> Path:
        """Run folder of the trained network."""
        return self.root / "gmr"

    def scores_dir(self, manifest_name: str) -> Path:
        """Stage folder of the network's scores on one manifest."""
        return self.root / "scores" / manifest_name

    @property
    def failures_dir(self) -> Path:
        """One text file for each clip that failed."""
        return self.root / "failed"

    @property
    def summary(self) -> Path:
        """The figures, for a program."""
        return self.root / "summary.json"

    @property
    def report(self) -> Path:
        """The figures and pictures, for a person."""
        return self.root / "report.html"

    @property
    def overview(self) -> Path:
        """One picture of it all."""
        return self.root / "overview.png"
