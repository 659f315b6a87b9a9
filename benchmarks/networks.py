"""The networks that measurements run, from a folder that has them by their published names."""

from pathlib import Path

from gmrdata.people.following import Networks
from gmrdata.people.sources import MasksConfig, PersonSource
from gmrdata.read.models import POSE_LANDMARKS, QUICK_LANDMARKS, YOLOX_NANO
from gmrdata.solve.request import SolveConfig


def networks_in(models_dir: Path, *, quick: bool = False) -> Networks:
    """The detector and BlazePose GHUM heavy; lite where it shall be `quick`."""
    landmarks = QUICK_LANDMARKS if quick else POSE_LANDMARKS
    return Networks(models_dir / YOLOX_NANO.name, models_dir / landmarks.name)


def own_people(networks: Networks) -> SolveConfig:
    """The recipe of a video whose people these find."""
    masks = PersonSource(model=networks.detector, landmarks=networks.landmarks)
    return SolveConfig(masks=MasksConfig(sources=(masks,)))
