"""Manifest format `gmrdata/1`: what a data set holds, file by file.  FORMAT.md explains it.

This module never changes once released; another format gets another module.
"""

from collections import Counter
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    model_validator,
)

from gmrdata.values.files import safe_relative

__all__ = [
    "FORMAT", "AnyManifest", "CameraMotion", "ClipEntry", "CreatedBy", "DroppedRange", "Extra",
    "FileRecord", "FolderRecord", "FrameRange", "ListedClip", "ListManifest", "Manifest", "Quality",
    "Recipe", "Semver", "Source",
]  # fmt: skip
FORMAT = "gmrdata/1"

Text = Annotated[str, StringConstraints(min_length=1)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Semver = Annotated[
    str,
    StringConstraints(
        pattern=r"^(0|[1-9][0-9]*)\.(0|[1-9][0-9]*)\.(0|[1-9][0-9]*)(-[0-9A-Za-z.-]+)?$"
    ),
]
ClipId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=200)]
RelativePath = Annotated[Text, AfterValidator(safe_relative)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
CameraMotion = Literal["static", "small", "panning", "linear", "linear_panning", "circular", "none"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class FileRecord(_Part):
    """One file and the proof that it is the right one."""

    path: RelativePath
    """Path relative to the manifest's folder, with forward slashes."""
    size_bytes: Count
    """Size [bytes]."""
    sha256: Sha256
    """SHA-256 of the bytes, 64 lower-case hexadecimal digits."""


class FolderRecord(_Part):
    """A folder of many files, whose hashes stand in a listing beside it."""

    folder: RelativePath
    """Path relative to the manifest's folder."""
    count: Count
    """Number of files."""
    size_bytes: Count
    """Sum of the files' sizes [bytes]."""
    listing: FileRecord
    """Text file with a line `sha256 <tab> size in bytes <tab> path in the folder` per file."""


class FrameRange(_Part):
    """Rows start, start + 1, ..., stop - 1."""

    start: Count
    """First row, counted from 0."""
    stop: Count
    """One past the last row."""

    @model_validator(mode="after")
    def _holds_a_row(self) -> Self:
        if self.stop <= self.start:
            raise ValueError(
                f"range {self.start}..{self.stop} is empty; stop is one past the last row"
            )
        return self


class DroppedRange(FrameRange):
    """Rows that must not be used, and why."""

    reason: Text
    """Why, for a reader."""


class Source(_Part):
    """Where a clip's motion came from."""

    dataset: Text
    """Name of the data set, or "gmrdata" for generated gaits."""
    sequence: Text
    """Sequence or trial in that data set."""
    person: Text | None = None
    """Which person of the sequence, where there are several."""


class Recipe(_Part):
    """What made one clip: the stage, its configuration and the hashes of its inputs."""

    stage: Text
    """Name of the stage."""
    config: dict[str, Any]
    """The stage's whole configuration, defaults included."""
    inputs: dict[str, Sha256]
    """SHA-256 of each input file or folder, by its role."""
    sha256: Sha256
    """SHA-256 of the three above, as JSON with sorted keys and no spaces."""


class Quality(_Part):
    """How far a clip can be trusted; a number that was not measured is left out."""

    geometry: Literal["exact", "full", "rotation_only", "static"] | None = None
    """Camera known exactly, reconstructed, reconstructed but for its position, or not moving."""
    verdict: Literal["accepted", "rejected"] | None = None
    """Whether the stage that made the clip vouches for it."""
    reasons: tuple[Text, ...] = ()
    """Why, if rejected; and of either verdict, what a person decided of it."""
    scale: Number | None = None
    """Metres per unit of the reconstruction."""
    scale_sigma: Number | None = None
    """Standard deviation of `scale`, in its unit."""
    registered_share: Annotated[Number, Field(ge=0, le=1)] | None = None
    """Share of the images with a camera, 0 to 1."""
    reprojection_error_px: Annotated[Number, Field(ge=0)] | None = None
    """Mean reprojection error of the reconstruction [px]."""
    inliers: Annotated[Number, Field(ge=0)] | None = None
    """Mean number of observations that agree with the reconstruction, per image."""
    figures: dict[str, Number] = {}
    """Further numbers by name; a unit stands in the name."""


class Extra(_Part):
    """Someone or something that moves through a clip beside its person."""

    instance: Annotated[int, Field(ge=2, le=255)]
    """Its number in `instances`."""
    arrays: FileRecord
    """Its .npz: a clip's for a person (`company_1`, `passer_by_1`), transforms for a `car_1`."""


class ClipEntry(_Part):
    """One person in one take."""

    id: ClipId
    """Unique within the manifest; the same as in the clip's file."""
    source: Source
    """Where the motion came from."""
    licence: Text
    """Terms under which this clip may be passed on."""
    body: Text
    """Body model that `betas` belongs to: "anny-2", "smpl-neutral", ..."""
    fps_hz: Annotated[Number, Field(gt=0)]
    """Frame rate [Hz]."""
    n_frames: Annotated[int, Field(gt=0)]
    """Number of rows T in the clip's file."""
    frame: Literal["world", "camera"]
    """Frame of the motion: z-up world, or the OpenCV frame of the camera at each row."""
    translation_of: Literal["smpl_transl"]
    """What `trans` in the clip's file is: SMPL's transl, so that pelvis = trans + rest_pelvis_m."""
    camera_motion: CameraMotion
    """Class of the camera's motion; "none" for a clip without a camera."""
    kept: tuple[FrameRange, ...]
    """Rows to use, in ascending order."""
    dropped: tuple[DroppedRange, ...] = ()
    """All other rows, in ascending order, with the reason."""
    arrays: FileRecord
    """The clip's .npz."""
    images: FolderRecord | None = None
    """The images."""
    masks: FolderRecord | None = None
    """One mask per image, `<image stem>.png`, 8 bit: 255 = dynamic object, 0 = background."""
    depth: FolderRecord | None = None
    """Depth per image, `<image stem>.png`, 16 bit: millimetres along the optical axis, 0 = none."""
    normals: FolderRecord | None = None
    """Surface normals per image in the camera's axes, `<image stem>.png`, 16 bit a channel."""
    flow: FolderRecord | None = None
    """Flow to the next image per image but the last, `<image stem>.png`, KITTI's 16-bit form."""
    instances: FolderRecord | None = None
    """Who is seen per image, `<image stem>.png`, 8 bit: 0 background, 1 the person, 2... extras."""
    extras: tuple[Extra, ...] = ()
    """Who and what moves besides, with the truth of each."""
    joints: FileRecord | None = None
    """The 24 joints in the world, the camera and the image, with visibility: an .npz."""
    video: FileRecord | None = None
    """The images as a video."""
    character: FileRecord | None = None
    """The joints of the rigged character that is seen in place of the body, and how far they are
    from the body's: an .npz."""
    quality: Quality | None = None
    """How far the clip can be trusted."""
    recipe: Recipe | None = None
    """What made the clip."""

    @model_validator(mode="after")
    def _ranges_tile_the_clip(self) -> Self:
        for name, ranges in (("kept", self.kept), ("dropped", self.dropped)):
            starts = [part.start for part in ranges]
            if starts != sorted(starts):
                raise ValueError(f"{name} ranges are not in ascending order")
        end = 0
        for part in sorted((*self.kept, *self.dropped), key=lambda part: part.start):
            if part.start < end:
                raise ValueError(f"row {part.start} is in two of the kept and dropped ranges")
            if part.start > end:
                raise ValueError(f"rows {end}..{part.start - 1} are neither kept nor dropped")
            end = part.stop
        if end != self.n_frames:
            raise ValueError(
                f"kept and dropped ranges end at {end}, but n_frames is {self.n_frames}"
            )
        return self


class ListedClip(_Part):
    """A clip that is only named: part of a published list, with no file behind it."""

    id: ClipId
    """Unique within the manifest."""
    source: Source
    """The sequence that is meant."""
    frames: FrameRange
    """Rows of the sequence: image numbers for a video, frames of the capture for a trial."""
    fps_hz: Annotated[Number, Field(gt=0)]
    """Rate at which `frames` counts [Hz]."""
    label: Text | None = None
    """What the person does, in the words of the list."""
    camera_motion: CameraMotion
    """Class of the camera's motion, as published."""
    programme: (
        Literal["static", "small", "panning", "linear", "linear_panning", "circular"] | None
    ) = None
    """Camera programme (its defaults) that gmrdata renders the clip with; none for a real video."""
    note: Text | None = None
    """What a reader must know about this row."""


class CreatedBy(_Part):
    """The software and the recipe that made a manifest.  Holds no times, so that bytes repeat."""

    gmrdata: Text
    """Version of gmrdata."""
    recipe: dict[str, Any] = {}
    """The whole recipe, defaults included; absolute paths are cut to their last part."""
    seeds: dict[str, int] = {}
    """Seeds by their use."""
    packages: dict[str, str] = {}
    """Versions of the packages that decide the bytes."""


def _unique_ids(clips: tuple[Any, ...]) -> tuple[Any, ...]:
    repeated = sorted(name for name, n in Counter(clip.id for clip in clips).items() if n > 1)
    if repeated:
        raise ValueError(f"clip ids must be unique, but these are repeated: {', '.join(repeated)}")
    return clips


class _Head(_Part):
    format: Literal["gmrdata/1"]
    """This format."""
    name: ClipId
    """Name of the data set."""
    version: Semver
    """Version of the data set: major.minor.patch.  The content of a version never changes."""
    description: Text
    """What this is, for a reader."""
    licence: Text
    """Terms of the data set as a whole; each clip has its own."""
    created_by: CreatedBy
    """What made it."""


class Manifest(_Head):
    """A data set whose files lie below the manifest's folder."""

    kind: Literal["synthetic", "pseudo_gt", "motions"]
    """Rendered videos with exact cameras, real videos with reconstructed ones, or motions alone."""
    clips: Annotated[tuple[ClipEntry, ...], AfterValidator(_unique_ids)]
    """The clips."""


class ListManifest(_Head):
    """A published list of clips without files."""

    kind: Literal["list"]
    """A list."""
    clips: Annotated[tuple[ListedClip, ...], AfterValidator(_unique_ids)]
    """The rows."""


AnyManifest = Annotated[Manifest | ListManifest, Field(discriminator="kind")]
