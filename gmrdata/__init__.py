"""gmrdata: world-frame human motion data and the Global Motion Regressor (GMR).

docs/api.md says what each public name is for.  Each is imported when it is first used.
"""

import os
import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gmrdata.cameras.lens.intrinsics import GivenIntrinsics as GivenIntrinsics
    from gmrdata.export.export import export as export
    from gmrdata.film.programmes import camera_path as camera_path
    from gmrdata.film.programmes import camera_programme as camera_programme
    from gmrdata.film.render import RenderConfig as RenderConfig
    from gmrdata.film.render import render_clip as render_clip
    from gmrdata.film.render_set import render_set as render_set
    from gmrdata.fusion.fuse import FuseConfig as FuseConfig
    from gmrdata.fusion.fuse import fuse as fuse
    from gmrdata.gmr.config import TrainConfig as TrainConfig
    from gmrdata.gmr.infer import InferConfig as InferConfig
    from gmrdata.gmr.infer import infer as infer
    from gmrdata.gmr.predict import load_gmr as load_gmr
    from gmrdata.gmr.predict import predict_world_motion as predict_world_motion
    from gmrdata.gmr.train import train as train
    from gmrdata.manifest.read import load_clips as load_clips
    from gmrdata.manifest.read import read_manifest as read_manifest
    from gmrdata.motion.files import read_motion as read_motion
    from gmrdata.motion.gait import make_gait as make_gait
    from gmrdata.motion.library import make_library as make_library
    from gmrdata.people.sources import MasksConfig as MasksConfig
    from gmrdata.read.bodies import load_body as load_body
    from gmrdata.read.body_file import save_body as save_body
    from gmrdata.read.models import fetch_models as fetch_models
    from gmrdata.read.video import VideoConfig as VideoConfig
    from gmrdata.score.compare import CompareConfig as CompareConfig
    from gmrdata.score.compare import compare as compare
    from gmrdata.score.predictors import ScoreConfig as ScoreConfig
    from gmrdata.score.records import Scores as Scores
    from gmrdata.score.score import Scored as Scored
    from gmrdata.score.score import score as score
    from gmrdata.solve.plan import plan_videos as plan_videos
    from gmrdata.solve.request import SequenceConfig as SequenceConfig
    from gmrdata.solve.request import SolveConfig as SolveConfig
    from gmrdata.solve.solve import make_masks as make_masks
    from gmrdata.solve.solve import solve_sequence as solve_sequence
    from gmrdata.solve.verdict import VideoVerdict as VideoVerdict
    from gmrdata.solve.videos import solve_video as solve_video
    from gmrdata.solve.videos import solve_videos as solve_videos
    from gmrdata.stage.run import Run as Run
    from gmrdata.threedpw.regenerate import regenerate_threedpw as regenerate_threedpw
    from gmrdata.twins.floor import measure_floor as measure_floor
    from gmrdata.values.body import BodyModel as BodyModel
    from gmrdata.values.camera import CameraPath as CameraPath
    from gmrdata.values.clip import Clip as Clip
    from gmrdata.values.clip import load_clip as load_clip
    from gmrdata.values.clip import save_clip as save_clip
    from gmrdata.values.errors import GmrdataError as GmrdataError
    from gmrdata.values.motion import Motion as Motion
    from gmrdata.values.people import PersonFiles as PersonFiles
    from gmrdata.world.compose import motion_in_camera as motion_in_camera

__version__ = "0.3.0"

_NAMES = {
    "export.export": ("export",),
    "film.programmes": ("camera_path", "camera_programme"),
    "film.render": ("RenderConfig", "render_clip"),
    "fusion.fuse": ("FuseConfig", "fuse"),
    "gmr.config": ("TrainConfig",),
    "gmr.infer": ("InferConfig", "infer"),
    "gmr.predict": ("load_gmr", "predict_world_motion"),
    "gmr.train": ("train",),
    "manifest.read": ("load_clips", "read_manifest"),
    "motion.files": ("read_motion",),
    "motion.gait": ("make_gait",),
    "motion.library": ("make_library",),
    "read.bodies": ("load_body",),
    "read.body_file": ("save_body",),
    "score.compare": ("CompareConfig", "compare"),
    "score.predictors": ("ScoreConfig",),
    "score.records": ("Scores",),
    "score.score": ("Scored", "score"),
    "stage.run": ("Run",),
    "values.body": ("BodyModel",),
    "values.camera": ("CameraPath",),
    "values.clip": ("Clip", "load_clip", "save_clip"),
    "values.errors": ("GmrdataError",),
    "values.motion": ("Motion",),
    "values.people": ("PersonFiles",),
    "film.render_set": ("render_set",),
    "read.models": ("fetch_models",),
    "threedpw.regenerate": ("regenerate_threedpw",),
    "twins.floor": ("measure_floor",),
    "world.compose": ("motion_in_camera",),
    "cameras.lens.intrinsics": ("GivenIntrinsics",),
    "people.sources": ("MasksConfig",),
    "read.video": ("VideoConfig",),
    "solve.plan": ("plan_videos",),
    "solve.request": ("SequenceConfig", "SolveConfig"),
    "solve.solve": ("make_masks", "solve_sequence"),
    "solve.verdict": ("VideoVerdict",),
    "solve.videos": ("solve_video", "solve_videos"),
}
# OpenCV alone looks elsewhere for the number of threads that a run is given.
if os.environ.get("OMP_NUM_THREADS", "").isdecimal():
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", os.environ["OMP_NUM_THREADS"])

_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(_HOME)


if not TYPE_CHECKING:  # for which any name would be one of the package's

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module 'gmrdata' has no attribute {name!r}")
        globals()[name] = getattr(import_module(f"gmrdata.{_HOME[name]}"), name)
        return globals()[name]


class _Package(ModuleType):
    """A job's name stands for the job, whether or not the folder of that name was imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __dir__() -> list[str]:
    return [*globals(), *__all__]
