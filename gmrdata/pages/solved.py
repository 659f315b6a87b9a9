"""What the stages left of one solved sequence, as far as it can be read, for the pages to show.

A video, cameras alone and a sequence of 3DPW are one record: what was not made is empty.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.cameras.files import CamerasQuality, Distortion, SfmCameras
from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.cameras.match.tracks import Tracks, errors_px
from gmrdata.export.sources import ExportedClip
from gmrdata.read.threedpw_files import SequenceFiles
from gmrdata.threedpw.intrinsics_check import IntrinsicsCheckConfig
from gmrdata.threedpw.regenerate import SequenceVerdict
from gmrdata.threedpw.sequence import PeopleRecord
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, rows_of_numbers
from gmrdata.world.judge import PseudoGtQuality, window_differences
from gmrdata.world.recipe import PseudoGtConfig, Verdict

if TYPE_CHECKING:
    from gmrdata.pages.fusion import FusedPeople


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What structure from motion found: M images, in a unit and a world of its own."""

    cameras: SfmCameras
    quality: CamerasQuality | None  # None of what can't be read, or is of other frames
    points: np.ndarray  # (N, 3) of the background
    tracks: Tracks | None  # of the same frames and points; None likewise

    @property
    def errors_px(self) -> np.ndarray:
        """(M,) mean reprojection error of what each image sees [px]; NaN where nothing is known."""
        path, tracks = self.cameras.path, self.tracks
        mean_px = np.full(path.n_frames, np.nan)
        if tracks is None or self.quality is None:
            return mean_px
        lens, matrix = self.quality.lens, path.intrinsics_px
        each_px = errors_px(tracks, self.points, path.world_from_cam, matrix, lens)
        known = np.isfinite(each_px)
        n, rows = path.n_frames, tracks.rows[known]
        counts, sums = np.bincount(rows, minlength=n), np.bincount(rows, each_px[known], n)
        mean_px[counts > 0] = sums[counts > 0] / counts[counts > 0]
        return mean_px


@dataclass(frozen=True, eq=False)
class DatasetSays:
    """What 3DPW says of one of its sequences of T frames and P people, and what became of it."""

    verdict: SequenceVerdict
    message: str  # the whole message if it could not be regenerated; else empty
    files: SequenceFiles | None  # None where the name can't be trusted: nothing of it is opened
    people: PeopleRecord | None
    camera: np.ndarray | None  # (T, 4, 4) its own world_from_cam; NaN where unknown
    intrinsics: IntrinsicsCheckConfig  # what its keypoints may say of the focal length


@dataclass(frozen=True, eq=False, kw_only=True)
class SolvedSequence:
    """A sequence of T frames and P people.  What is empty or None was not made, or is gone."""

    name: str
    folder: Path | None = None  # None where nothing of it is opened
    record: PseudoGtQuality | None = None
    reasons: tuple[tuple[str, ...], ...] = ()
    """(P, T) why a frame is dropped; else empty.  Of cameras alone, one row for the camera."""
    doubts: tuple[tuple[str, ...], ...] = ()
    """(P, T) why the data set, or the video, does not vouch for a frame; else empty."""
    clips: Mapping[int, Clip] = field(default_factory=dict)  # world motions by person
    reconstruction: Reconstruction | None = None
    camera: CameraPath | None = None  # of the T frames, in the shown world
    camera_verdict: Verdict | None = None  # on the cameras by themselves; None where nothing tells
    intrinsics: Intrinsics | None = None  # where the lens comes from; None where nothing says
    config: PseudoGtConfig = field(default_factory=PseudoGtConfig)  # thresholds that were asked for
    fused: "FusedPeople | None" = None
    """Whose motions `clips` and `people` have, which go on in dropped frames; None for the
    cameras' own."""
    people: tuple[ExportedClip, ...] = ()  # with what it takes to draw and to export them
    images: tuple[Path | None, ...] = ()  # (T,)
    masks: tuple[Path | None, ...] = ()  # (T,)
    times_s: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (T,)
    notes: tuple[str, ...] = ()  # what one should know besides
    missing: tuple[str, ...] = ()  # what should be there and can't be read
    dataset: DatasetSays | None = None  # None for what is no sequence of 3DPW

    @property
    def n_frames(self) -> int:
        """T, or 0 if nothing of the sequence could be read."""
        return len(self.times_s) or (len(self.reasons[0]) if self.reasons else 0)

    @property
    def judged(self) -> tuple[Verdict, ...]:
        """The verdicts on the people; none without a record."""
        return () if self.record is None else self.record.people

    @property
    def is_alone(self) -> bool:
        """Whether cameras were sought, and nobody's motion."""
        return not self.judged and self.dataset is None

    @property
    def row_names(self) -> list[str]:
        """Who each row of `reasons` is about."""
        people = [f"person {person}" for person in range(len(self.reasons))]
        return ["camera"] if self.is_alone else people

    @property
    def accepted(self) -> list[bool]:
        """The verdict on each row of `reasons`; False where there is none."""
        if self.is_alone:
            return [self.camera_verdict is not None and self.camera_verdict.accepted]
        judged = [person.accepted for person in self.judged]
        return judged + [False] * (len(self.reasons) - len(judged))

    @property
    def unit(self) -> str:
        """Of lengths."""
        return "units of the reconstruction" if self.is_alone else "m"

    @property
    def cameras(self) -> CamerasQuality | None:
        if self.is_alone:
            return None if self.reconstruction is None else self.reconstruction.quality
        return None if self.record is None else self.record.cameras

    @property
    def lens(self) -> Distortion | None:
        """The distortion of the frames; None for hardly any."""
        if self.cameras is not None and self.cameras.lens is not None:
            return self.cameras.lens
        lens = None if self.intrinsics is None else self.intrinsics.lens
        return None if lens is None or lens.is_pinhole else Distortion(*lens.radial, 0.0)

    @property
    def is_solved(self) -> bool:
        return self.cameras is not None

    @property
    def world_from_cam(self) -> np.ndarray | None:
        """(T, 4, 4) the recovered cameras in the made world [m]; NaN where there is none."""
        return None if self.camera is None else self.camera.world_from_cam

    @property
    def dataset_camera(self) -> np.ndarray | None:
        """(T, 4, 4) world_from_cam; NaN where unknown."""
        return None if self.dataset is None else self.dataset.camera

    @property
    def sfm_rows(self) -> np.ndarray | None:
        """(T,) the reconstruction's row for each frame, -1 if it has none."""
        if self.reconstruction is None or not (self.clips or self.is_alone):
            return None
        if self.is_alone:
            return np.arange(self.n_frames)
        numbers = next(iter(self.clips.values())).image_numbers
        return rows_of_numbers(self.reconstruction.cameras.image_numbers, numbers)

    @property
    def world_points(self) -> np.ndarray | None:
        """(N, 3) points of the reconstruction in the shown world; None where they have no place."""
        solved, camera, sfm_rows = self.reconstruction, self.camera, self.sfm_rows
        if solved is None or camera is None or sfm_rows is None or not len(solved.points):
            return None
        scale = 1.0 if self.is_alone or self.record is None else self.record.scale
        ours = np.flatnonzero(camera.has_camera & (sfm_rows >= 0))
        sfm_from_cam = solved.cameras.path.world_from_cam[sfm_rows[ours]]
        known = np.flatnonzero(np.isfinite(sfm_from_cam).all(axis=(1, 2)))
        if scale is None or not len(known):
            return None
        first = known[0]
        grown = camera.world_from_cam[ours[first]] @ np.diag([scale, scale, scale, 1.0])
        return transforms.apply(grown @ transforms.invert(sfm_from_cam[first]), solved.points)

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames kept for somebody; where all are rejected, within the thresholds."""
        good = [of for of, accepted in zip(self.reasons, self.accepted, strict=True) if accepted]
        return np.any([[not reason for reason in of] for of in good or self.reasons], axis=0)

    @property
    def fps_hz(self) -> float:
        return next(iter(self.clips.values())).motion.fps_hz

    @property
    def scale_share(self) -> float | None:
        """Standard error of the metric scale, as a share of it; None where none is known."""
        return None if self.record is None else self.record.scale_share

    def window_differences(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Differences in turn [deg] and way [m] from the data set's camera; None without one."""
        if self.world_from_cam is None or self.dataset_camera is None:
            return None
        step = max(1, round(self.config.verdict.window_s * self.fps_hz))
        return window_differences(self.world_from_cam, self.dataset_camera, step)

    def frames_of(self, sfm_rows: Sequence[int]) -> np.ndarray:
        """Frames of some rows of the reconstruction, in order."""
        if self.sfm_rows is None:
            return np.zeros(0, dtype=int)
        return np.flatnonzero(np.isin(self.sfm_rows, sfm_rows) & (self.sfm_rows >= 0))

    def per_frame(self, of_sfm_rows: Sequence[float] | np.ndarray) -> np.ndarray:
        """(T,) figures of the rows of the reconstruction, by frame; NaN where there is none."""
        values = np.full(self.n_frames, np.nan)
        if self.sfm_rows is not None:
            known = self.sfm_rows >= 0
            values[known] = np.array(of_sfm_rows, dtype=float)[self.sfm_rows[known]]
        return values


@dataclass(frozen=True, eq=False)
class Aligned:
    """The data set's cameras, moved rigidly, and the root mean squares that are left."""

    world_from_cam: np.ndarray  # (T, 4, 4) in the made world [m]; NaN where unknown
    n_frames: int
    rms_m: float
    rms_deg: float


def align_dataset_camera(
    world_from_cam: np.ndarray, dataset_camera: np.ndarray, kept: np.ndarray
) -> Aligned | None:
    """Lay the data set's path over ours (T, 4, 4) [m], NaN where unknown; None without a frame.

    The rotation is the mean difference in orientation over the `kept` frames (T,), so it is fixed
    for a camera that stays in place too; then the paths' middles are laid on each other.  Both are
    metric, so nothing is scaled.
    """
    known = (np.isfinite(path).all(axis=(1, 2)) for path in (world_from_cam, dataset_camera))
    both = np.logical_and.reduce([kept, *known])
    if not both.any():
        return None
    ours, theirs = world_from_cam[both], dataset_camera[both]
    turns = ours[:, :3, :3] @ theirs[:, :3, :3].swapaxes(1, 2)
    rotmat = transforms.mean_rotation(turns)
    shift_m = (ours[:, :3, 3] - theirs[:, :3, 3] @ rotmat.T).mean(axis=0)
    moved = transforms.rigid(rotmat, shift_m) @ dataset_camera
    apart_m = np.linalg.norm(moved[both, :3, 3] - ours[:, :3, 3], axis=1)
    apart_rad = transforms.angles_rad(rotmat.T @ turns)
    rms_m, rms_rad = (float(np.sqrt(np.mean(apart**2))) for apart in (apart_m, apart_rad))
    return Aligned(moved, int(both.sum()), rms_m, float(np.rad2deg(rms_rad)))


KIND_COLOURS = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#c9b800", "#8a6d3b")
"""Colour-blind readers tell these apart (Okabe and Ito 2008), on white and on black."""
OTHER_COLOUR = "#8f979e"  # the colour of all further kinds


@dataclass(frozen=True)
class Kind:
    words: str  # the reason; "…" for the number in which several differ
    colour: str


def kinds_of(reasons: Sequence[Sequence[str]]) -> dict[str, Kind]:
    """The kind of each reason of (P, T) frames, in their order; empty where one is kept."""
    groups: dict[str, list[str]] = {}
    for reason in dict.fromkeys(reason for person in reasons for reason in person if reason):
        groups.setdefault(re.sub(r"[0-9]+", "…", reason), []).append(reason)
    kinds: dict[str, Kind] = {}
    colours = chain(KIND_COLOURS, repeat(OTHER_COLOUR))
    for (pattern, members), colour in zip(groups.items(), colours, strict=False):
        kind = Kind(members[0] if len(members) == 1 else pattern, colour)
        kinds |= dict.fromkeys(members, kind)
    return kinds


def counts_of(reasons: Sequence[Sequence[str]]) -> dict[Kind, int]:
    """How many frames of all people are dropped for each kind, the most frequent first."""
    kinds = kinds_of(reasons)
    counts = Counter(kinds[reason] for person in reasons for reason in person if reason)
    return dict(counts.most_common())


def example_frames(reasons: Sequence[Sequence[str]]) -> dict[Kind, int]:
    """For each kind the middle frame of those dropped for it, of whoever comes first."""
    kinds, frames = kinds_of(reasons), dict[Kind, list[int]]()
    for person in reasons:
        earlier = set(frames)
        for frame, reason in enumerate(person):
            if reason and kinds[reason] not in earlier:
                frames.setdefault(kinds[reason], []).append(frame)
    return {kind: of_kind[len(of_kind) // 2] for kind, of_kind in frames.items()}
