"""Flags that several verbs have, each described once, and what they stand for."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from tyro.conf import OmitArgPrefixes, Positional, arg

from gmrdata.cli.answers import answer, print_table
from gmrdata.stage.progress import remark
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe, MissingInput
from gmrdata.values.people import PersonFiles

if TYPE_CHECKING:
    from gmrdata.film.set_plan import SyntheticRecipe
    from gmrdata.read.source_motion import ReadConfig
    from gmrdata.values.records import Config

AnyRecipe = TypeVar("AnyRecipe", bound="Config")

Redo = Annotated[bool, arg(help="Throw away and make anew what other settings or inputs made.")]


def _run(
    redo: Redo = False,
    workers: Annotated[
        int | None, arg(help="Local worker processes; as many as the recipe says when left out.")
    ] = None,
    scheduler: Annotated[
        str | None,
        arg(help="Address of a Dask cluster (tcp://host:port); local processes when left out."),
    ] = None,
    shard: Annotated[
        str | None,
        arg(help="Do one share of the clips, like 2/4, beside the others in the same --out."),
    ] = None,
) -> Run:
    """How the stages run."""
    return Run(redo=redo, workers=workers, scheduler=scheduler, shard=shard)


RunFlags = Annotated[Run, OmitArgPrefixes, arg(constructor=_run)]
"""--redo, --workers, --scheduler and --shard, for verbs that run jobs; give it no default."""
DryRun = Annotated[bool, arg(help="Say what would be done and, where it is known, what it costs.")]
AsJson = Annotated[bool, arg(name="json", help="Print one JSON object, not text.")]
Probe = Annotated[
    bool, arg(help="For the estimate of a dry run, render two frames in a temporary folder.")
]
RecipeName = Annotated[
    str, arg(help="A recipe file of the kind that the verb takes, or the name of a carried one.")
]
Motions = Annotated[Path | None, arg(help="Folder of motion files: BVH, ASF/AMC or AMASS npz.")]
Body = Annotated[
    str,
    arg(
        help='"anny", or the path of an SMPL or SMPL+H model (.npz, .pkl) or of a gmrdata body '
        "(.npz). A folder of such bodies gives each person the one of its gender."
    ),
]
Manifest = Positional[Annotated[Path, arg(help="Manifest file.")]]
Manifests = Positional[Annotated[tuple[Path, ...], arg(help="Manifest files.")]]
FpsHz = Annotated[
    float | None, arg(help="True frame rate of the files [Hz], when theirs is wrong or missing.")
]
JointMap = Annotated[
    Path | None, arg(help="YAML or JSON file: joint name in a BVH or ASF -> joint of SMPL's tree.")
]
UnitM = Annotated[
    float | None,
    arg(
        help="Metres per unit of a BVH or ASF, found by the legs when left out; or of the path of "
        "an npz."
    ),
]
RestPoseOrFile = Annotated[
    str | None,
    arg(
        metavar="t|a|arms_down|arms_up|along_axes|first_frame|FILE",
        help="The pose of a BVH or ASF without rotations, or a BVH of the same skeleton that "
        "begins with the standing person; looked for when left out.",
    ),
]
Up = Annotated[
    Literal["y", "z", "x", "-y", "-z", "-x"] | None,
    arg(
        help="Axis of the files' world that is up; told from the zero pose and the motion when "
        "left out. For a negative one write --up=-y."
    ),
]
Frames = Positional[Annotated[Path, arg(help="Folder of numbered images, or a video file.")]]
Masks = Annotated[
    tuple[str, ...],
    arg(
        help="Sources of masks, which are united. person: people's outlines. onnx: boxes of a "
        "YOLOX detector. maskrcnn: torchvision's. silhouette: a given body. Or a folder of masks, "
        "or a recipe (.yaml) of kind `masks`."
    ),
]
Network = Annotated[
    str, arg(help="Run folder of `gmrdata train`, or the word bundled for the package's network.")
]
Device = Annotated[
    Literal["cpu", "cuda"] | None,
    arg(help="The device of a training; the recipe's when left out."),
]
Page = Annotated[
    bool, arg(help="Write index.html: verdict, overlay, paths, figures, files to take along.")
]


Detector = Annotated[
    Path | None,
    arg(help="ONNX file of the detector, YOLOX on COCO; from `gmrdata fetch models` if left out."),
]
LandmarkNetwork = Annotated[
    Path | None,
    arg(help="TFLite file of BlazePose GHUM; from `gmrdata fetch models` if left out."),
]


@dataclass(frozen=True)
class NetworkOptions:
    """The networks that make masks and see people, and what they shall mask."""

    detector: Detector = None
    landmark_network: LandmarkNetwork = None
    maskrcnn: Path | None = None
    """State dict of Mask R-CNN; torchvision fetches its own when left out."""
    classes: tuple[str, ...] = ()
    """COCO's names of what to mask; people, vehicles and animals when left out."""


NetworkFlags = Annotated[NetworkOptions, OmitArgPrefixes]
"""Flags of `NetworkOptions`, below the usual ones of a verb; give it no default."""


def _part(
    from_s: Annotated[
        float, arg(name="from", metavar="S", help="Leave out what is before this time [s].")
    ] = 0.0,
    to_s: Annotated[
        float | None, arg(name="to", metavar="S", help="Leave out what is after this time [s].")
    ] = None,
    every: Annotated[
        int, arg(help="Take every n-th frame; an image's number is its frame's over n.")
    ] = 1,
    take_what_decodes: Annotated[
        bool, arg(help="Go on where frames are lost or damaged; the verdict rejects the result.")
    ] = False,
) -> Any:  # a VideoConfig, which is loaded when it is needed
    """What is taken of a video file."""
    from gmrdata.read.video import VideoConfig

    given = {"from_s": from_s, "to_s": to_s, "every": every, "take_what_decodes": take_what_decodes}
    with flags_named():
        return VideoConfig.model_validate(given)


PartFlags = Annotated[Any, OmitArgPrefixes, arg(constructor=_part)]
"""--from, --to, --every and --take-what-decodes: a `VideoConfig`; give it no default."""
LENS_FLAGS = {"focal_px": "focal", "fov_deg": "fov", "file": "intrinsics"}
"""The flag of each key of a given lens."""
FLAGS = LENS_FLAGS | {
    "frames_per_row": "poses_every", "from_s": "from", "to_s": "to", "image_size_px": "image_size",
}  # fmt: skip
"""The flags that have other names than the keys of recipes that they fill."""


@dataclass(frozen=True)
class LensOptions:
    """The lens of all videos, as far as it is known; give one of the first three at most."""

    focal: float | None = None
    """Focal length of the images [px]."""
    fov: float | None = None
    """Horizontal field of view of the images [deg]."""
    intrinsics: Path | None = None
    """Calibration of the images: a file, as docs/lens.md lists them."""
    check_lens: bool = True
    """Find the lens in the frames too; else a given one is believed, an unknown one guessed."""


@dataclass(frozen=True)
class SolvingOptions:
    """How cameras and people are solved."""

    poses_every: int = 1
    """The poses were made from every n-th frame of the video."""
    height_m: tuple[str, ...] = ()
    """Height without shoes [m]: 1.78, or person_0=1.78. Else the scale is good to 7 %."""
    gravity: Path | None = None
    """The phone's gravity: record3d's metadata, Stray Scanner's odometry.csv, or frame,x,y,z."""
    check_again: bool = False
    """Solve the cameras in four other ways, and reject a path that these don't give."""
    seed: int = 0
    """Seed of the reconstruction."""


LensFlags = Annotated[LensOptions, OmitArgPrefixes]
SolvingFlags = Annotated[SolvingOptions, OmitArgPrefixes]
POSES = arg(help="Folder with <clip id>.npz: poses in the camera's frame, without translation.")
KEYPOINTS = arg(help="Folder with <clip id>/ of OpenPose's or STAF's JSON, one file per frame.")
FEATURES = arg(help="Folder with <clip id>.npz that hold image `features` (T, D), row by row.")
BootstrapSeed = Annotated[int, arg(help="Seed of the bootstrap intervals.")]


def on_device(config: AnyRecipe, device: str | None) -> AnyRecipe:
    """The settings of a training with --device, if it was given."""
    return config if device is None else config.model_copy(update={"device": device})


@contextmanager
def flags_named() -> Iterator[None]:
    """What a recipe refuses inside, as BadRecipe by the flag that said it."""
    from pydantic import ValidationError

    try:
        yield
    except ValidationError as error:
        wrong = error.errors()[0]
        what = wrong["msg"].removeprefix("Value error, ")
        if not wrong["loc"]:  # of several that don't go together
            raise BadRecipe(what) from None
        key = str(wrong["loc"][0])
        flag = FLAGS.get(key, key).replace("_", "-")
        raise BadRecipe(f"--{flag} {wrong['input']}: {what}") from None


def reading(**said: object) -> "ReadConfig":
    """What a person said of motion files; raises BadRecipe or MissingInput for what can't be."""
    from gmrdata.read.source_motion import ReadConfig

    with flags_named():
        config = ReadConfig.model_validate(said)
    config.require_rest_file()
    return config


def as_text(dry_run: bool, as_json: bool) -> None:
    """Refuse --json with --dry-run, which a script would take for JSON; raises BadRecipe."""
    if dry_run and as_json:
        raise BadRecipe("--json: a dry run is told as text. Leave one of the two out")


def need(values: tuple[Any, ...], what: str) -> None:
    """Refuse a flag or list that was left empty; raises MissingInput."""
    if not values:
        raise MissingInput(f"nothing given. Name {what}")


def by_key(flag: str, texts: Sequence[str], remedy: str) -> dict[str, str]:
    """Texts KEY=VALUE as a table, a VALUE alone by ""; BadRecipe for one that has no value, and for
    a key that has one already."""
    table: dict[str, str] = {}
    for text in texts:
        key, _, value = text.rpartition("=")
        if not value or key in table:
            raise BadRecipe(f"{flag} {text}: {remedy}")
        table[key] = value
    return table


def body_path(body: str) -> Path | None:
    """The file of `--body`; None for the default body."""
    return None if body == "anny" else Path(body)


def say_lost(frames_dir: Path) -> None:
    """Say how many frames of a video could not be decoded, if any."""
    from gmrdata.read.frames import video_record

    video = video_record(frames_dir)
    if video is not None and video.n_lost:
        what = f"{video.n_lost} of {video.n_expected} frames could not be decoded"
        remark(f"{frames_dir}: {what}")


def one_person(clip_path: Path, body: str) -> tuple[PersonFiles, ...]:
    """One person's clip, with the body of `--body`, or of its folder the person's own."""
    from gmrdata.read.bodies import body_file
    from gmrdata.values.clip import load_camera_clip

    own = load_camera_clip(clip_path).motion.body
    name = own if Path(body).expanduser().is_dir() else body
    return (PersonFiles(clip_path, body_file(body, name)),)


def show_dry_run(
    recipe: "SyntheticRecipe", out: Path, motions: Path | None, workers: int | None, probe: bool
) -> None:
    """Print what a set of clips would take: frames, time, disk."""
    from gmrdata.film import render_set as dry

    if workers is not None:
        recipe = recipe.model_copy(update={"workers": workers})
    planned = dry.dry_run(recipe, out, motions_dir=motions, probe=probe)
    print_table(dry.HEADINGS, planned.rows)
    for line in dry.summary_lines(planned):
        answer(line)
