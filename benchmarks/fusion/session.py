"""What the measurements of the pose graph share: twins, their pseudo ground truth, and a network
that was trained on none of their people, with its errors."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from gmr.cmu_data import every_motion
from record import OUT_DIR, Record, machine
from sfm.ours import Regenerated, regenerate
from sfm.score import true_clips
from sfm.twins import Twins, the_twins

from gmrdata.fusion.camera_evidence import WorldErrors
from gmrdata.fusion.fuse import world_errors
from gmrdata.fusion.network_errors import (
    HeldOut,
    MeasureConfig,
    delta_errors,
    held_out_motions,
)
from gmrdata.fusion.network_evidence import DeltaErrors
from gmrdata.gmr.config import DataConfig, TrainConfig
from gmrdata.gmr.predict import TrainedGmr, load_gmr
from gmrdata.gmr.train import GmrRecipe, train
from gmrdata.read.bodies import load_body
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.stage.store import StageRecord
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, clip_on_body, load_clip
from gmrdata.values.people import person_file
from gmrdata.world.judge import PseudoGtQuality

MEASURE = MeasureConfig()


@dataclass(frozen=True, eq=False)
class Person:
    """One person of a twin."""

    name: str
    pseudo: Clip  # in the recovered world
    true: Clip  # the truth, where it lies best on that world
    errors: WorldErrors  # as the pseudo ground truth states them
    trial: str
    """CMU's trial that the person moves by; empty for the embedded gait."""


def in_world_of(pseudo: Clip, true: Clip) -> Clip:
    """A truth moved rigidly to where it lies best on a pseudo ground truth."""
    pseudo_from_true = transforms.invert(compare_clips(pseudo, true).true_from_pseudo)
    motion = true.motion
    poses = pseudo_from_true @ transforms.rigid(motion.root_rotmats, motion.pelvis_m)
    moved = replace(motion, root_rotmats=poses[:, :3, :3], pelvis_m=poses[:, :3, 3])
    return replace(true, motion=moved, camera=None)


@dataclass
class FusionSession:
    """One run of the measurements."""

    small: bool
    """Whether to only try every part, without bars."""
    twins_given: Path | None
    pseudo_gt_given: Path | None
    """What `gmrdata threedpw regenerate` left of them."""
    run_given: Path | None
    """A network's run that held all people of the twins out."""
    motions_given: Path | None
    """Manifest of the CMU motions at hand."""
    cmu_dir: Callable[[], Path]
    errors: dict[str, DeltaErrors] = field(default_factory=dict)
    """By the person who is left out."""

    @cached_property
    def record(self) -> Record:
        """What was measured so far."""
        return Record(OUT_DIR / "fusion.json", self.small, self._settings)

    @cached_property
    def body(self) -> BodyModel:
        """The body of twins and motions."""
        return load_body("anny")

    @cached_property
    def twins(self) -> Twins:
        """Those of the measurements of the COLMAP stage."""
        return the_twins(self.twins_given, self.small, self.cmu_dir)

    @cached_property
    def made(self) -> Regenerated:
        """Their real pseudo ground truth."""
        if self.pseudo_gt_given is not None:
            return Regenerated(self.pseudo_gt_given.resolve())
        return regenerate(self.twins.root, (OUT_DIR / "fusion" / "pseudo_gt").resolve())

    @cached_property
    def people(self) -> list[Person]:
        """Everybody whose cameras were recovered."""
        found = []
        for name in sorted(self.twins.classes):
            folder = self.made.folder(name, "pseudo_gt")
            for number, true in enumerate(true_clips(self.twins.truth_dir, name)):
                path = folder / person_file(number)
                if not path.is_file():
                    continue
                clip = clip_on_body(load_clip(path), self.body)
                share = world_errors(PseudoGtQuality.read(folder / "quality.json"), number)
                trial = re.match(r"(\d\d_\d\d)", true.motion.source)
                moved = in_world_of(clip, true)
                found.append(Person(true.id, clip, moved, share, trial[1] if trial else ""))
        return found

    @cached_property
    def every(self) -> Path:
        """Manifest of the CMU motions at hand, made if none is given."""
        if self.motions_given is not None:
            return self.motions_given.resolve()
        return every_motion(self.cmu_dir(), small=self.small)

    @cached_property
    def subjects(self) -> tuple[int, ...]:
        """CMU's subjects who move the twins' people; nobody of them is trained on."""
        if self.small:
            return 2, 5
        return tuple(sorted({int(one.trial[:2]) for one in self.people if one.trial}))

    @cached_property
    def run_dir(self) -> Path:
        """The network's run, by recipe `gmr_bundled` without these subjects if none is given."""
        if self.run_given is not None:
            run_dir = self.run_given.resolve()
        else:
            folder = "gmr_small" if self.small else "gmr"
            run_dir = (OUT_DIR / "fusion" / folder).resolve()
            train([self.every], run_dir, self._recipe())
        said = DataConfig.model_validate(StageRecord.of(run_dir).config["data"])
        trained_on = set(self.subjects) - set(said.held_out_subjects)
        assert not trained_on, f"{run_dir}: was trained on subjects {sorted(trained_on)}"
        return run_dir

    def _recipe(self) -> TrainConfig:
        config = load_recipe(find_recipe("gmr_bundled"), GmrRecipe).train
        data = config.data.model_copy(update={"held_out_subjects": self.subjects})
        changes: dict[str, Any] = {"data": data}
        if self.small:
            model = config.model.model_copy(update={"layers": 1, "hidden": 16})
            changes |= {"model": model, "steps": 20, "batch_size": 4, "eval_every": 10}
        return config.model_copy(update=changes)

    @cached_property
    def gmr(self) -> TrainedGmr:
        """The network."""
        return load_gmr(self.run_dir)

    @cached_property
    def held_out(self) -> list[HeldOut]:
        """What it sees in the motions of the people whom it was not trained on."""
        return held_out_motions(self.run_dir, [self.every], MEASURE)

    def errors_without(self, trial: str) -> DeltaErrors:
        """How wrong the network is, measured on all held-out people but the trial's own: a person
        tells nothing of their own error bars."""
        own = f"CMU/{trial[:2]}"
        if own not in self.errors:
            others = [one for one in self.held_out if self.small or one.person != own]
            self.errors[own] = delta_errors([self.gmr], others, MEASURE)
        return self.errors[own]

    def _settings(self) -> dict[str, Any]:
        return machine() | {
            "scale": "small" if self.small else "full",
            "twins": "given" if self.twins_given else "rendered by the recipe",
            "pseudo_gt": "given" if self.pseudo_gt_given else "by the recipe threedpw",
            "network": StageRecord.of(self.run_dir).config,
        }
