"""What is asked of one sequence: its frames, what is known of them, and its stages' recipe."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics, Intrinsics, IntrinsicsConfig
from gmrdata.cameras.lens.vanishing_points import LinesConfig
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.people.local_poses import LocalPosesConfig
from gmrdata.people.sources import MasksConfig, PersonSource, SilhouetteSource
from gmrdata.read.systems.result import read_system
from gmrdata.read.video import VideoConfig, has_times
from gmrdata.read.video_files import NamedVideo
from gmrdata.stage.progress import remark
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.clip import load_camera_clip
from gmrdata.values.errors import BadRecipe, MissingInput, NoReconstruction
from gmrdata.values.files import as_paths
from gmrdata.values.frame_set import FrameSet, require_rate
from gmrdata.values.people import EstimatedPeople, PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.bodies import BodiesConfig
from gmrdata.world.recipe import PseudoGtConfig
from gmrdata.world.size import heights_of

FRAMES, MASKS, INTRINSICS, SFM = "frames", "masks", "intrinsics", "sfm"
FOLLOWED, AGAIN, OWN_POSES, BODY, LINES = "followed", "again", "own_poses", "body", "lines"
"""The folders of a sequence but for those of people."""

QUICK_SFM = SfmConfig(max_image_size_px=960, max_features=1200, max_orientations=1)
"""What any video is solved by: 107 keyframes of 1280x720 px take 0.6 of the camera stage's own
processor time, and on the dancer's windows the cameras are as exact."""


class SequenceConfig(Config):
    """The stages of a sequence whose lens and bodies before the camera are given."""

    masks: MasksConfig | None = MasksConfig()
    """Masks of what moves; the body's silhouette unless other sources are named, None for a
    sequence in which nothing moves."""
    sfm: SfmConfig = SfmConfig()
    lines: LinesConfig = LinesConfig()
    pseudo_gt: PseudoGtConfig = PseudoGtConfig()


class SolveConfig(SequenceConfig):
    """The stages of any video."""

    masks: MasksConfig | None = MasksConfig(sources=(PersonSource(),))
    sfm: SfmConfig = QUICK_SFM
    intrinsics: IntrinsicsConfig = IntrinsicsConfig()
    check_again: bool = False
    """Solve the cameras four more times, backward, by every second frame and by other seeds, and
    reject a path that these don't give."""
    own_poses: LocalPosesConfig = LocalPosesConfig()
    """Of people whom the built-in estimator sees."""
    bodies: BodiesConfig = BodiesConfig()

    def with_heights(self, height_m: float | Mapping[str, float] | None) -> Self:
        """The same, with how tall people are; BadRecipe for heights that nobody has."""
        if height_m is None:
            return self
        bodies = self.bodies.model_copy(update={"heights": heights_of(height_m)})
        return self.model_copy(update={"bodies": bodies})

    @property
    def for_cameras_alone(self) -> Self:
        """The same where nobody's pose is wanted: masks by the lite network."""
        if self.masks is None:
            return self
        return self.model_copy(update={"masks": self.masks.for_cameras_alone})

    @property
    def person_source(self) -> PersonSource:
        """How people are followed: as for masks of them, or as by default."""
        sources = () if self.masks is None else self.masks.sources
        return next((one for one in sources if isinstance(one, PersonSource)), PersonSource())

    @property
    def networks(self) -> dict[str, Path]:
        """What the built-in estimator reads, by role; MissingInput where they were not fetched."""
        return self.person_source.networks._asdict()


DEFAULT_CONFIG = SolveConfig()


@dataclass(frozen=True)
class GivenPeople:
    """People whose bodies before the camera are known, and with them the camera's lens."""

    files: tuple[PersonFiles, ...]
    dataset_camera_path: Path | None = None  # of the data set, by `save_dataset_camera`
    doubts_path: Path | None = None  # a `Doubts` record; else what the frames' video says
    left_out: Collection[int] = ()  # numbers of images that are known to be unusable


@dataclass(frozen=True)
class PeopleBySystem:
    """People as a system sees them."""

    results_path: Path | None = None
    """Another system's file or folder, as `read_system` takes it; None for whom the
    built-in estimator sees."""
    body: str = "anny"  # as `keep_body` takes it
    asked: bool = True  # whether the video is rejected where none of them can be used


@dataclass(frozen=True)
class SolveRequest:
    """One sequence."""

    source: Path  # a video file, of which `part` says what is taken; or a folder of images
    people: GivenPeople | PeopleBySystem | None = None  # None for cameras alone
    lens: GivenIntrinsics | None = None  # what is known of it; None for nothing
    fps_hz: float | None = None  # of a folder of images; a video has times
    part: VideoConfig | None = None
    gravity_path: Path | None = None  # what the phone felt, as `read_gravity` takes it

    def check(self) -> EstimatedPeople | None:
        """Refuse what can't be right before anything is made; gives people of another system.

        Raises:
            MissingInput: the source is not there.
            BadRecipe: as `require_rate`, but for people who are given: these have times.
            BadMotionFile: people are not before a camera; and what else `read_system` raises.
        """
        for person in self.given.files:
            load_camera_clip(person.clip_path)
        if not isinstance(self.people, GivenPeople):
            if not self.source.exists():
                raise MissingInput(f"{self.source}: no such video, or folder of images")
            require_rate(self.source, self.fps_hz, has_times=has_times(self.source))
        if isinstance(self.people, PeopleBySystem) and self.people.results_path is not None:
            return read_system(self.people.results_path, "camera")
        return None

    @property
    def given(self) -> GivenPeople:
        """People whose bodies are given; nobody where others are asked for."""
        return self.people if isinstance(self.people, GivenPeople) else GivenPeople(())

    @property
    def has_own_people(self) -> bool:
        """Whether the built-in estimator looks for people."""
        return isinstance(self.people, PeopleBySystem) and self.people.results_path is None

    def of(self, video: NamedVideo, body: str) -> "SolveRequest":
        """The same of another video, by a system's results where it has some."""
        people = self.people
        if video.poses_path is not None:
            people = PeopleBySystem(video.poses_path, body)
        return replace(self, source=video.path, people=people)


@dataclass(frozen=True)
class Solved:
    """What is asked of a sequence, and what its stages have left so far."""

    request: SolveRequest
    out_dir: Path
    config: SolveConfig
    frames: FrameSet  # with times unless bodies are given, which have theirs
    run: Run = DEFAULT_RUN
    body_path: Path | None = None  # of people whom a system sees
    followed_dir: Path | None = None  # who is in the picture, where somebody wants to know
    masks_dir: Path | None = None
    lens: Intrinsics | None = None  # None where bodies came with theirs
    sfm_dir: Path | None = None
    again_dir: Path | None = None
    gravity_path: Path | None = None  # by `save_gravity`
    bodies: tuple[PersonFiles, ...] = ()  # people before the camera
    remarks: tuple[str, ...] = ()  # what one should know of them
    world_dir: Path | None = None
    unsolved: NoReconstruction | None = None  # why there are no cameras, or no world


def paths_of(sources: str | Path | Iterable[str | Path]) -> list[Path]:
    """One or several sources; BadRecipe for none, as a pattern that fits no file gives."""
    paths = as_paths(sources)
    if not paths:
        raise BadRecipe("nothing given. Name a video, or a folder of numbered images or of videos")
    return paths


SEEN, OWN, NOBODY = None, "own", "none"
"""Words for people instead of a system's results: whom the built-in estimator sees; the same, one
of whom must be accepted; and cameras alone."""


def people_of(
    poses: str | Path | None,
    body: str,
    config: SolveConfig,
    gravity: str | Path | None = None,
) -> tuple[PeopleBySystem | None, Path | None]:
    """Who is sought in pictures, and the file or folder of another system's results.

    Without the networks of the built-in estimator, where nobody asked for its people, that is said.
    BadRecipe for masks of bodies, which aren't known yet, for rows of every n-th frame, which only
    a system's file has, and for what is said of people where cameras alone are asked for.
    """
    masks = () if config.masks is None else config.masks.sources
    if any(isinstance(source, SilhouetteSource) for source in masks):
        what = "silhouette needs a body before any camera is known. Use person"
        raise BadRecipe(f"--masks: {what}")
    if poses is not SEEN and str(poses) not in (OWN, NOBODY):
        return None, Path(poses)
    if config.bodies.frames_per_row > 1:
        what = "--poses-every is of another system's file, with --poses"
        raise BadRecipe(f"{what}. Leave it out; --every takes every n-th frame of a video")
    if str(poses) == NOBODY:
        for flag, said in (("--height-m", config.bodies.heights), ("--gravity", gravity)):
            if said:
                raise BadRecipe(f"{flag} is for people; leave it out for cameras alone")
        return None, None
    try:
        _ = config.networks
    except MissingInput as error:
        if poses is not SEEN:
            raise
        remark(f"cameras alone, without people: {error}")
        return None, None
    return PeopleBySystem(body=body, asked=poses is not SEEN), None
