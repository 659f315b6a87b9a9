"""What a recipe may say of masks: where they come from, one source or several united."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self, TypeGuard, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from gmrdata.people.folder import (
    FolderMaskConfig,
    UnionConfig,
    check_masks,
    folder_masks,
    unite_masks,
)
from gmrdata.people.following import (
    FOLLOWED_FILE,
    SIGHTINGS_FILE,
    FollowConfig,
    FollowedRecord,
    Networks,
    Sightings,
    follow_people,
    is_among,
    outline_path,
)
from gmrdata.people.linking import best_pairs, box_iou, detections_from_json, fill_boxes
from gmrdata.people.maskrcnn import MaskRcnnConfig, maskrcnn_masks
from gmrdata.people.onnx import OnnxConfig, onnx_masks
from gmrdata.people.silhouette import SilhouetteConfig, dilate, silhouette_masks
from gmrdata.read.frames import read_gray, write_gray
from gmrdata.read.models import YOLOX_NANO, find_model
from gmrdata.stage.jobs import in_threads
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage, stage_seconds
from gmrdata.values.errors import BadRecipe, MissingInput
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.people import PersonFiles
from gmrdata.values.records import Config

Settings = TypeVar("Settings", bound=Config)
USED_BY = {  # Which sources read an option of the command line
    "--detector": ("onnx", "person"),
    "--landmark-network": ("person",),
    "--maskrcnn": ("maskrcnn",),
    "--classes": ("onnx", "maskrcnn"),
}


class SilhouetteSource(SilhouetteConfig):
    """The projected body of the sequence; needs no network."""

    kind: Literal["silhouette"] = "silhouette"


class FolderSource(FolderMaskConfig):
    """A folder of masks that another tool made."""

    kind: Literal["folder"] = "folder"
    path: Path
    """The folder; one mask for each frame, `<image stem>.png` or `<image file name>.png`."""


class OnnxSource(OnnxConfig):
    """A YOLOX detector in an ONNX file, run by OpenCV."""

    kind: Literal["onnx"] = "onnx"
    model: Path | None = None
    """A relative path counts from where the command runs; the one of `fetch models` if left out."""


class PersonMaskConfig(FollowConfig):
    """How people are followed, and how their outlines become masks."""

    min_filled: float = Field(default=0.3, ge=0, le=1)
    """A box of which outlines fill less is filled itself, if none of them has the same box."""
    dilate_px: int = Field(default=8, ge=0, le=1000)
    """Radius by which outlines and boxes are widened [px]."""


class PersonSource(PersonMaskConfig):
    """People's outlines by BlazePose, run by LiteRT, started by a YOLOX detector, by OpenCV."""

    kind: Literal["person"] = "person"
    model: Path | None = None
    """The detector's ONNX file; the one of `gmrdata fetch models` if left out."""
    landmarks: Path | None = None
    """BlazePose's TFLite file; the one of `gmrdata fetch models` if left out."""
    quick: bool = False
    """Take the lite network if none is given.  Its outlines overlap heavy's by 0.96, less where the
    picture's edge cuts people, and cameras come out the same."""

    @property
    def networks(self) -> Networks:
        """Their files; MissingInput where they were not fetched."""
        return Networks.find(self.model, self.landmarks, quick=self.quick)

    def follow(self, frames: FrameSet, out_dir: Path, run: Run) -> Path:
        """The stage from which its masks are made, and local poses."""
        config = _settings(self, FollowConfig)
        return follow_people(frames, out_dir, config, self.networks, run=run)


class MaskRcnnSource(MaskRcnnConfig):
    """torchvision's Mask R-CNN; needs the extra `maskrcnn`."""

    kind: Literal["maskrcnn"] = "maskrcnn"
    weights: Path | None = None
    """File of the network's state dict; torchvision fetches its own when left out."""


MaskSource = Annotated[
    SilhouetteSource | FolderSource | OnnxSource | PersonSource | MaskRcnnSource,
    Field(discriminator="kind"),
]


def shows_people(source: MaskSource) -> TypeGuard[OnnxSource | PersonSource | MaskRcnnSource]:
    """Whether it looks for people in the pictures, without the bodies of the sequence: a detector
    may be asked for cars alone."""
    if isinstance(source, OnnxSource | MaskRcnnSource):
        return "person" in source.classes
    return isinstance(source, PersonSource)


class MasksConfig(UnionConfig):
    """Masks of one sequence."""

    sources: tuple[MaskSource, ...] = Field(default=(SilhouetteSource(),), min_length=1)
    """Where masks come from; a pixel is masked if any source says so."""

    @property
    def named(self) -> list[tuple[str, MaskSource]]:
        """Each source beside its name: the kind, numbered where it occurs more than once."""
        kinds = [source.kind for source in self.sources]
        return [
            (f"{kind}_{kinds[: place + 1].count(kind)}" if kinds.count(kind) > 1 else kind, source)
            for place, (kind, source) in enumerate(zip(kinds, self.sources, strict=True))
        ]

    @property
    def show_people(self) -> bool:
        """Whether some tell where people are, as bodies that are right lie on them."""
        return any(shows_people(source) for source in self.sources)

    @property
    def for_cameras_alone(self) -> Self:
        """The same where nobody's pose is wanted: people by the lite network."""
        sources = tuple(
            one.model_copy(update={"quick": True}) if isinstance(one, PersonSource) else one
            for one in self.sources
        )
        return self.model_copy(update={"sources": sources})


class MasksRecipe(MasksConfig):
    """Masks of any frames, as a file for `gmrdata masks --masks` and `gmrdata sfm --masks`."""

    recipe: Literal["masks"]


def make_masks(
    frames: FrameSet,
    out_dir: Path,
    config: MasksConfig,
    *,
    people: tuple[PersonFiles, ...] = (),
    followed_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make each source's masks in `<out_dir>_by/<name>`, and their union in `out_dir`.

    Silhouettes need people: camera-frame clips and their bodies.  People are followed in
    `followed_dir`, or beside the masks of their outlines.

    Raises:
        MissingInput: silhouettes without people, or a file that is not there; for a network that
            was not fetched the message names the command.
        BadFrames: a frame or mask is missing, unreadable or of another size.
        BadMotionFile: a clip is not in the camera frame, or has no intrinsics.
        BadDetector: not a file of such a network, truncated, or one of another layout.
        MissingExtra: torchvision is not installed, or doesn't fit torch.
        FetchFailed: torchvision could not fetch its weights.
    """
    check_folders(config, frames)
    given = _MaskInputs(frames, people, followed_dir, run)
    made = {name: _make(one, given, sources_dir(out_dir) / name) for name, one in config.named}
    return unite_masks(made, frames, out_dir, _settings(config, UnionConfig), run=run)


def masks_named(
    names: Sequence[str],
    *,
    detector: Path | None = None,
    landmark_network: Path | None = None,
    maskrcnn: Path | None = None,
    classes: tuple[str, ...] = (),
) -> MasksConfig:
    """The sources that a command line names; the options are those of the detectors.

    A name is "silhouette", "onnx", "person", "maskrcnn", a folder of masks, or a recipe file
    (.yaml) of kind `masks`, whose sources all count and whose other settings hold.

    Raises:
        MissingInput: a name that is neither of these nor a folder.
        BadRecipe: a class that COCO lacks, a broken recipe, or an option that nothing uses.
    """
    chosen: dict[str, object] = {"classes": classes} if classes else {}
    sources: list[MaskSource] = []
    settings: dict[str, object] = {}
    try:
        for name in names:
            if name == "silhouette":
                sources.append(SilhouetteSource())
            elif name == "onnx":
                sources.append(OnnxSource.model_validate({"model": detector} | chosen))
            elif name == "person":
                sources.append(PersonSource(model=detector, landmarks=landmark_network))
            elif name == "maskrcnn":
                sources.append(MaskRcnnSource.model_validate({"weights": maskrcnn} | chosen))
            elif name.endswith(".yaml"):
                recipe = load_recipe(find_recipe(name), MasksRecipe)
                sources += recipe.sources
                said = UnionConfig.model_fields.keys() & recipe.model_fields_set
                settings |= {key: getattr(recipe, key) for key in said}
            elif Path(name).is_dir():
                sources.append(FolderSource(path=Path(name)))
            else:
                known = "silhouette, onnx, person, maskrcnn, a folder of masks or a recipe (.yaml)"
                raise MissingInput(f"{name}: no such folder of masks; name {known}")
    except ValidationError as error:
        raise BadRecipe("; ".join(problem["msg"] for problem in error.errors())) from None
    given = (detector, landmark_network, maskrcnn, classes)
    _require_used(names, dict(zip(USED_BY, given, strict=True)))
    return MasksConfig.model_validate({"sources": tuple(sources)} | settings)


def _require_used(names: Sequence[str], options: dict[str, object]) -> None:
    """An option that no source reads is a mistake, not a default."""
    for option, value in options.items():
        if value and not set(USED_BY[option]) & set(names):
            raise BadRecipe(f"{option} is for {' and '.join(USED_BY[option])}, which is not named")


def network_files(config: MasksConfig) -> dict[str, Path]:
    """The networks' files that `make_masks` would read, by role; what it would raise for files that
    are not there, this raises before any work."""
    files = {}
    for name, source in config.named:
        if isinstance(source, OnnxSource):
            files[f"{name} detector"] = find_model(YOLOX_NANO, source.model)
        if isinstance(source, PersonSource):
            networks = source.networks
            files |= {f"{name} {role}": path for role, path in networks._asdict().items()}
        if isinstance(source, MaskRcnnSource) and source.weights is not None:
            files[f"{name} weights"] = source.weights
    return files


def mask_folders(config: MasksConfig) -> dict[str, Path]:
    """The folders of masks that other tools made, by role."""
    return {
        f"{name} masks": one.path for name, one in config.named if isinstance(one, FolderSource)
    }


def check_folders(config: MasksConfig, frames: FrameSet) -> None:
    """Refuse those folders, as far as these frames tell; errors as of `make_masks`."""
    for masks_dir in mask_folders(config).values():
        check_masks(masks_dir, frames)


def without_files(config: MasksConfig) -> MasksConfig:
    """The recipe without its networks' files, whose hashes stand in the record instead."""
    files = {"model", "landmarks", "weights"}
    sources = tuple(
        source.model_copy(update=dict.fromkeys(files & type(source).model_fields.keys()))
        for source in config.sources
    )
    return config.model_copy(update={"sources": sources})


def sources_dir(masks_dir: Path) -> Path:
    """The folder with each source's own masks."""
    return masks_dir.with_name(f"{masks_dir.name}_by")


def masks_seconds(masks_dir: Path) -> float:
    """Wall time that masks took, their sources included [s]."""
    stages = [path.parent for path in sorted(sources_dir(masks_dir).glob(f"*/{STAGE_FILE}"))]
    return sum(stage_seconds(folder) for folder in (masks_dir, *stages))


@dataclass(frozen=True)
class _MaskInputs:
    """What a source's masks are made of."""

    frames: FrameSet
    people: tuple[PersonFiles, ...]
    followed_dir: Path | None
    run: Run


def _make(source: MaskSource, given: _MaskInputs, out_dir: Path) -> Path:
    frames, run = given.frames, given.run
    match source:
        case SilhouetteSource():
            body, people = _settings(source, SilhouetteConfig), given.people
            return silhouette_masks(people, frames, out_dir, body, run=run)
        case FolderSource():
            made = _settings(source, FolderMaskConfig)
            return folder_masks(source.path, frames, out_dir, made, run=run)
        case OnnxSource():
            onnx, model = _settings(source, OnnxConfig), find_model(YOLOX_NANO, source.model)
            return onnx_masks(model, frames, out_dir, onnx, run=run)
        case PersonSource():
            person = _settings(source, PersonMaskConfig)
            followed_dir = out_dir.with_name(f"{out_dir.name}_followed")
            if given.followed_dir is not None and out_dir.name in ("person", "person_1"):
                followed_dir = given.followed_dir
            source.follow(frames, followed_dir, run)
            return person_masks(followed_dir, frames, out_dir, person, run)
        case MaskRcnnSource():
            net = _settings(source, MaskRcnnConfig)
            return maskrcnn_masks(source.weights, frames, out_dir, net, run=run)


def person_masks(
    followed_dir: Path,
    frames: FrameSet,
    out_dir: Path,
    config: PersonMaskConfig,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: `<image stem>.png` per image, 255 on people: the outlines of all who are followed, in
    however few frames.  Whom the landmark network does not see gets the detector's box."""

    def work(partial: Path) -> None:
        record = FollowedRecord.read(followed_dir / FOLLOWED_FILE)
        sightings = Sightings.read(followed_dir / SIGHTINGS_FILE)
        detections = dict(zip(record.images, record.detections, strict=True))
        # By number they stand in order, so those of a frame are found without looking at all.
        starts, stops = (
            np.searchsorted(sightings.image_numbers, frames.numbers, side)
            for side in ("left", "right")
        )

        def make(row: int) -> None:
            image, seen = frames.paths[row], sightings.take(slice(starts[row], stops[row]))
            outlines = np.zeros(frames.size_px[::-1], np.uint8)
            for piece in seen.pieces.tolist():
                outlines |= read_gray(outline_path(followed_dir, image, piece))
            boxes_px = detections_from_json(detections[int(frames.numbers[row])]).boxes_px
            filled = _boxes_without(outlines, boxes_px, seen.boxes_px, config)
            write_gray(partial / f"{image.stem}.png", dilate(outlines | filled, config.dilate_px))

        in_threads(make, range(len(frames.paths)))

    inputs = {"followed": followed_dir} | frames.inputs
    return run_stage("person_masks", out_dir, config, inputs, work, run=run)


def _boxes_without(
    outlines: np.ndarray, boxes_px: np.ndarray, seen_px: np.ndarray, config: PersonMaskConfig
) -> np.ndarray:
    """The detector's boxes in which there is no outline of a person, filled; of one that only
    overlaps another's outline, what lies beside those whose people are seen."""
    size_px = (outlines.shape[1], outlines.shape[0])
    met = [row for row, _ in best_pairs(box_iou(boxes_px, seen_px), config.same_iou)]
    beside = ~fill_boxes(boxes_px[met], size_px)
    filled = np.zeros_like(outlines)
    for box_px in np.delete(boxes_px, met, axis=0):
        box = fill_boxes(box_px[None], size_px)
        if is_among(box_px, seen_px, config.same_iou):
            box &= beside
        share = np.count_nonzero(outlines & box) / max(1, int(np.count_nonzero(box)))
        if share < config.min_filled:
            filled |= box
    return filled


def _settings(source: Config, model: type[Settings]) -> Settings:
    """A source's settings without its files, whose hashes stand in the record instead."""
    return model(**{name: getattr(source, name) for name in model.model_fields})
