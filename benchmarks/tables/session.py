"""What the measurements of Tables 5, 6 and 10 share: clips, what the estimator sees, the record."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gmr.cmu_data import part_of
from networks import networks_in
from record import OUT_DIR, Record, machine
from tables.clips import scored_set, training_set

from gmrdata.gmr.config import BUNDLED, network_dir
from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.paper.comparison import TableRecord
from gmrdata.paper.make import make_table
from gmrdata.paper.own_poses import (
    ESTIMATOR,
    FEATURES_FOLDER,
    KEYPOINTS_FOLDER,
    POSES_FOLDER,
    RECORD,
    OwnPosesRecord,
    own_poses,
)
from gmrdata.paper.plan import Given, TableRecipe, load_table
from gmrdata.stage.run import Run
from gmrdata.twins.twin_set import SET_FOLDER

HELD_OUT = ("02", "08")
"""Subjects of whom nothing was trained on."""
WALKING_TWINS = ("street_walk_00", "park_curve_00", "courtyard_turn_00", "street_navigate_00")
SEEDS, JOINT_STEPS = (0,), 120
"""One training of the non-sequential model.  So many steps see each of a few short clips a hundred
times; the recipe's 600 would take an hour beside much else."""
ANEW = Run(redo=True, workers=1)
"""What is there of the same input stays; what another network made is made again."""


@dataclass
class TablesSession:
    """One run; clips are rendered once, and the rest is kept until what it hangs on changes."""

    small: bool
    twins_given: Path | None
    """Twins that are there, to train the non-sequential model on."""
    network_given: Path | None
    cmu_dir: Callable[[], Path]
    models_dir: Callable[[], Path]

    @cached_property
    def record(self) -> Record:
        return Record(OUT_DIR / "tables.json", self.small, self._settings)

    @property
    def _ending(self) -> str:
        return "_small" if self.small else ""

    @property
    def work_dir(self) -> Path:
        return (OUT_DIR / f"tables{self._ending}").resolve()

    @property
    def clips_dir(self) -> Path:
        return (OUT_DIR / f"table_clips{self._ending}").resolve()

    @cached_property
    def network(self) -> Path:
        return network_dir(BUNDLED) if self.network_given is None else self.network_given.resolve()

    @cached_property
    def scored(self) -> Path:
        """Each trial with the camera's motion on and off."""
        return scored_set(self.clips_dir / "scored", self.cmu_dir(), small=self.small)

    @cached_property
    def moving(self) -> Path:
        """Those whose camera moves."""
        clips = read_clips(self.scored)
        return some_of(self.scored, [one for one in clips if one.camera_motion != "static"])

    @cached_property
    def training(self) -> Path:
        """Videos of people who are not scored, as far as the estimator sees their person."""
        if self.twins_given is None:
            every = training_set(self.clips_dir / "training", self.cmu_dir(), small=self.small)
        else:
            every = (self.twins_given / SET_FOLDER / "synthetic.yaml").resolve()
        clips = [one for one in read_clips(every) if is_trained_on(one, self.twins_given)]
        allowed = some_of(every, clips)
        return as_far_as_seen(allowed, self.seen(allowed, "training"))

    def seen(self, manifest: Path, name: str) -> Path:
        """What the estimator sees of a manifest's clips."""
        networks = networks_in(self.models_dir())
        return own_poses(manifest, self.work_dir / f"own_{name}", networks=networks, run=ANEW)

    def features(self) -> Path:
        """The features of what is trained on and of what is scored, in one folder."""
        folder = self.work_dir / "features"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for made in (self.work_dir / "own_training", self.seen(self.scored, "scored")):
            for path in (made / FEATURES_FOLDER).glob("*.npz"):
                shutil.copy(path, folder / path.name)
        return folder

    def table(
        self, number: str, scored: Path, seen: Path, *, name: str | None = None, **given: Any
    ) -> TableRecord:
        """A table of the paper on these clips, with the estimator in VIBE's place."""
        wanted = Given(
            manifests=(),
            scored=scored,
            poses=seen / POSES_FOLDER,
            keypoints=seen / KEYPOINTS_FOLDER,
            network=self.network,
            estimator=ESTIMATOR,
            **given,
        )
        folder = self.work_dir / (name or f"table{number}")
        recipe = with_steps(load_table(number), 2 if self.small else JOINT_STEPS)
        made = make_table(recipe, "small", wanted, folder, seeds=SEEDS, run=ANEW)
        return TableRecord.read(made)

    def _settings(self) -> dict[str, Any]:
        twins = "none" if self.twins_given is None else "given"
        return machine() | {"twins": twins, "network": self.network.name}


def read_clips(manifest: Path) -> list[Any]:
    """A set's clips."""
    found = read_manifest(manifest)
    assert isinstance(found, Manifest)
    return list(found.clips)


def is_trained_on(clip: Any, twins: Path | None) -> bool:
    """Nobody who is scored, and of the twins those who walk, since the scored people walk."""
    walks = twins is None or clip.id in WALKING_TWINS
    return walks and str(clip.source.sequence)[:2] not in HELD_OUT


def some_of(manifest: Path, clips: Sequence[Any]) -> Path:
    """A manifest of some clips beside that of all, named by how many they are."""
    name = f"{read_manifest(manifest).name}_{len(clips)}"
    return part_of(manifest, name, {one.id for one in clips})


def as_far_as_seen(manifest: Path, seen_dir: Path) -> Path:
    """A manifest of the clips whose person the estimator follows; the others have no poses."""
    seen, clips = OwnPosesRecord.read(seen_dir / RECORD).clips, read_clips(manifest)
    kept = [one for one in clips if one.id in seen]
    return manifest if len(kept) == len(clips) else some_of(manifest, kept)


def with_steps(recipe: TableRecipe, steps: int) -> TableRecipe:
    """A recipe whose small non-sequential model has other steps."""
    scale = recipe.scales["small"]
    shorter = scale.model_copy(update={"joint": scale.joint | {"steps": steps}})
    return recipe.model_copy(update={"scales": recipe.scales | {"small": shorter}})


def figures(table: TableRecord) -> list[dict[str, Any]]:
    """A table's rows: the paper's figures and ours."""
    rows = []
    for row in table.rows:
        ours = {} if row.ours is None else row.ours.model_dump()
        cells: dict[str, Any] = {"row": row.name}
        for metric, paper in row.paper.model_dump().items():
            cells[f"paper {metric}"] = "-" if paper is None else paper
            cells[metric] = round(ours[metric]["mean"], 2) if ours else "not made"
            spread = ours[metric]["spread"] if ours else None
            cells[f"{metric} spread"] = "-" if spread is None else round(spread, 2)
        rows.append(cells)
    return rows
