"""What the stages of one sequence left, as far as it can be read, and what a page makes of it."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import TypeVar

import numpy as np
from markupsafe import Markup

from gmrdata.cameras.files import CamerasQuality, load_cameras
from gmrdata.masks.folder import find_mask
from gmrdata.pages.frames import jpeg_image, masked_tile
from gmrdata.read.frames import number_in_name, read_color, read_gray
from gmrdata.read.threedpw_layout import SequenceFiles, require_inside
from gmrdata.threedpw.people import DATASET_CAMERA_FILE, DOUBTS_FILE, PEOPLE_FILE, PeopleRecord
from gmrdata.threedpw.recipe import SetPaths
from gmrdata.threedpw.regenerate import SequenceVerdict
from gmrdata.values import transforms
from gmrdata.values.clip import Clip, load_clip, rows_of_numbers
from gmrdata.values.errors import GmrdataError
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.values.people import person_file
from gmrdata.world.judge import window_differences
from gmrdata.world.quality import PseudoGtQuality, load_record
from gmrdata.world.recipe import VerdictConfig
from gmrdata.world.verdict import Doubts, Verdict, load_dataset_camera


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
    apart_rad = angles_rad(rotmat.T @ turns)
    rms_m, rms_rad = (float(np.sqrt(np.mean(apart**2))) for apart in (apart_m, apart_rad))
    return Aligned(moved, int(both.sum()), rms_m, float(np.rad2deg(rms_rad)))


Read = TypeVar("Read")


@dataclass(frozen=True, eq=False)
class Found:
    """A sequence of T frames and P people.  What is empty or None was not made, or is gone."""

    verdict: SequenceVerdict
    message: str  # the whole message if it could not be regenerated; else empty
    files: SequenceFiles | None  # None where the name can't be trusted: nothing of it is opened
    record: PseudoGtQuality | None
    people: PeopleRecord | None
    doubts: tuple[tuple[str, ...], ...]  # (P, T) why the data set doubts a frame; else empty
    reasons: tuple[tuple[str, ...], ...]  # (P, T) why a frame is dropped; else empty
    clips: Mapping[int, Clip]  # world motions by person; none without a reconstruction
    dataset_camera: np.ndarray | None  # (T, 4, 4) world_from_cam; NaN where unknown
    sfm_rows: np.ndarray | None  # (T,) the reconstruction's row for each frame, -1 if it has none
    missing: tuple[str, ...]  # what should be there and can't be read

    @property
    def name(self) -> str:
        """As it stands in the data set: any text."""
        return self.verdict.sequence

    @property
    def n_frames(self) -> int:
        """T, or 0 if nothing of the sequence could be read."""
        return len(self.reasons[0]) if self.reasons else 0

    @property
    def cameras(self) -> CamerasQuality | None:
        return None if self.record is None else self.record.cameras

    @property
    def judged(self) -> tuple[Verdict, ...]:
        return () if self.record is None else self.record.people

    @property
    def is_solved(self) -> bool:
        return self.cameras is not None

    @property
    def world_from_cam(self) -> np.ndarray | None:
        """(T, 4, 4) the recovered cameras in the made world [m]; NaN where there is none."""
        cameras = [clip.camera for clip in self.clips.values() if clip.camera is not None]
        return cameras[0].world_from_cam if cameras else None

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames that are kept for somebody."""
        return np.any([[not reason for reason in person] for person in self.reasons], axis=0)

    @property
    def fps_hz(self) -> float:
        return next(iter(self.clips.values())).motion.fps_hz

    def window_differences(self, config: VerdictConfig) -> tuple[np.ndarray, np.ndarray] | None:
        """Differences in turn [deg] and way [m] from the data set's camera; None without one."""
        if self.world_from_cam is None or self.dataset_camera is None:
            return None
        step = max(1, round(config.window_s * self.fps_hz))
        return window_differences(self.world_from_cam, self.dataset_camera, step)

    def frames_of(self, sfm_rows: Sequence[int]) -> np.ndarray:
        """Frames of some rows of the reconstruction, in order."""
        if self.sfm_rows is None:
            return np.zeros(0, dtype=int)
        return np.flatnonzero(np.isin(self.sfm_rows, sfm_rows) & (self.sfm_rows >= 0))


def gather(
    verdict: SequenceVerdict, message: str, files: SequenceFiles | None, paths: SetPaths
) -> Found:
    """Read what there is of one sequence; what can't be read is named in `missing`."""
    missing: list[str] = []

    def read(call: Callable[[Path], Read], path: Path) -> Read | None:
        try:
            return call(path)
        except (GmrdataError, OSError) as error:
            missing.append(str(error))
            return None

    name = "" if files is None else files.name
    people_dir, pseudo_gt_dir = paths.sequence_dir(name) / "people", paths.pseudo_gt_dir(name)
    is_read = files is not None and people_dir.is_dir()
    people = read(PeopleRecord.read, people_dir / PEOPLE_FILE) if is_read else None
    doubts = read(Doubts.read, people_dir / DOUBTS_FILE) if is_read else None
    # What an earlier run left of a sequence that now failed is not this run's answer.
    is_done = files is not None and not message
    record = read(load_record, pseudo_gt_dir) if is_done else None
    by_set = () if doubts is None else doubts.frames
    judged = () if record is None else record.people
    clips: dict[int, Clip] = {}
    dataset_camera, sfm_rows = None, None
    if record is not None and record.cameras is not None:
        for person in range(len(judged)):
            clip = read(load_clip, pseudo_gt_dir / person_file(person))
            clips |= {} if clip is None else {person: clip}
        dataset_camera = read(load_dataset_camera, people_dir / DATASET_CAMERA_FILE)
        cameras = read(load_cameras, paths.sequence_dir(name) / "sfm")
        if cameras is not None and clips:
            numbers = next(iter(clips.values())).image_numbers
            sfm_rows = rows_of_numbers(cameras.image_numbers, numbers)
    reasons = tuple(tuple(person.frame_reasons) for person in judged) or by_set
    return Found(
        verdict, message, files, record, people, by_set, reasons, clips, dataset_camera, sfm_rows,
        tuple(missing),
    )  # fmt: skip


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


TILE_WIDTH_PX = 260
JPEG_QUALITY = 80


@dataclass(frozen=True, eq=False)
class Tile:
    image_number: int
    picture: np.ndarray | None  # (h, w, 3) BGR, the masked part tinted; None if it can't be read
    problem: str  # why there is no picture, or no mask on it; else empty

    @property
    def shown(self) -> Markup | None:
        name = f"frame {self.image_number}"
        return None if self.picture is None else jpeg_image(self.picture, name, JPEG_QUALITY)


def image_numbers(files: SequenceFiles) -> list[int]:
    """Numbers of the images that lie in a sequence's folder, in order; none if it leads out."""
    try:
        require_inside(files.root, files.image_dir)
    except GmrdataError:
        return []
    found = [number_in_name(path.name) for path in files.image_dir.glob("image_*.jpg")]
    return sorted(number for number in found if number is not None)


def read_tile(files: SequenceFiles, masks_dir: Path, number: int) -> Tile:
    """One frame with its mask; a file that can't be read is named, and no error."""
    path = files.image_path(number)
    try:
        # A link could show a file from anywhere on the page.
        require_inside(files.root, path)
        image = read_color(path)
    except (GmrdataError, OSError) as error:
        return Tile(number, None, str(error))
    mask, problem = np.zeros(image.shape[:2], np.uint8), "no masks were made"
    if masks_dir.is_dir():
        try:
            mask = read_gray(find_mask(masks_dir, path), (image.shape[1], image.shape[0]))
            problem = ""
        except (GmrdataError, OSError) as error:
            problem = str(error)
    return Tile(number, masked_tile(image, mask, TILE_WIDTH_PX), problem)
