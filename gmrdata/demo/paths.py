"""Where the demo keeps what: the only place that knows these names."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata.people import person_file


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
