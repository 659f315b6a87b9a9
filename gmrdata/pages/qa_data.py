"""What the stages of one sequence left on disk, as far as it can be read.

The data set's own camera path in the world that was made, and how far the two are apart.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gmrdata.cameras.files import load_cameras
from gmrdata.read.threedpw_layout import SequenceFiles
from gmrdata.threedpw.people import DOUBTS_FILE, PEOPLE_FILE, TRACKED_FILE
from gmrdata.threedpw.recipe import SetPaths
from gmrdata.values import transforms
from gmrdata.values.alignment import mean_rotation
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import read_json, read_npz
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.values.people import person_file
from gmrdata.world.quality import judged_reasons, load_record


@dataclass(frozen=True, eq=False)
class Aligned:
    """The data set's cameras, moved rigidly."""

    world_from_cam: np.ndarray
    """(T, 4, 4) in the made world [m]; NaN where unknown."""
    n_frames: int
    """Frames that they were laid over each other by."""
    rms_m: float
    """Root mean square distance between the two places, over these frames [m]."""
    rms_deg: float
    """The same of the orientations [degrees]."""


def align_tracked(
    world_from_cam: np.ndarray, tracked: np.ndarray, kept: np.ndarray
) -> Aligned | None:
    """Lay the data set's path over ours; None if no kept frame has both.

    The rotation is the mean difference in orientation over the kept frames, so it is fixed for a
    camera that stays in place too; then the paths' middles are laid on each other.  Both are
    metric, so nothing is scaled.

    Args:
        world_from_cam: (T, 4, 4) our cameras [m]; NaN where unknown.
        tracked: (T, 4, 4) the data set's [m]; NaN where unknown.
        kept: (T,) bool: frames to go by.
    """
    both = kept & np.isfinite(world_from_cam).all(axis=(1, 2)) & np.isfinite(tracked).all((1, 2))
    if not both.any():
        return None
    ours, theirs = world_from_cam[both], tracked[both]
    turns = ours[:, :3, :3] @ theirs[:, :3, :3].swapaxes(1, 2)
    rotmat = mean_rotation(turns)
    shift_m = (ours[:, :3, 3] - theirs[:, :3, 3] @ rotmat.T).mean(axis=0)
    moved = transforms.rigid(rotmat, shift_m) @ tracked
    apart_m = np.linalg.norm(moved[both, :3, 3] - ours[:, :3, 3], axis=1)
    apart_rad = angles_rad(rotmat.T @ turns)
    return Aligned(
        world_from_cam=moved,
        n_frames=int(both.sum()),
        rms_m=float(np.sqrt(np.mean(apart_m**2))),
        rms_deg=float(np.rad2deg(np.sqrt(np.mean(apart_rad**2)))),
    )


Read = TypeVar("Read")


@dataclass(frozen=True, eq=False)
class Found:
    """A sequence of T frames and P people.  What is empty or None was not made, or is gone."""

    row: Mapping[str, Any]
    """Its row of `verdicts.json`."""
    message: str
    """The whole message of a sequence that could not be regenerated; else empty."""
    files: SequenceFiles | None
    """Where it is; None for one whose name can't be trusted."""
    record: dict[str, Any]
    """`quality.json` of its pseudo ground truth."""
    people: dict[str, Any]
    """`people.json`: what the data set's file says."""
    doubts: tuple[tuple[str, ...], ...]
    """(P, T) why the data set itself doesn't vouch for a frame; empty where it does."""
    reasons: tuple[tuple[str, ...], ...]
    """(P, T) why each frame is dropped; empty where it is kept."""
    clips: Mapping[int, Clip]
    """The world motions by person; none without a reconstruction."""
    tracked: np.ndarray | None
    """(T, 4, 4) world_from_cam of the data set; NaN where unknown."""
    sfm_rows: np.ndarray | None
    """(T,) row of the reconstruction for each frame, -1 for a frame without."""
    missing: tuple[str, ...]
    """What should be there and can't be read."""

    @property
    def name(self) -> str:
        """The sequence's name, as it stands in the data set: any text."""
        return str(self.row["sequence"])

    @property
    def n_frames(self) -> int:
        """T, or 0 if nothing of the sequence could be read."""
        return len(self.reasons[0]) if self.reasons else 0

    @property
    def is_solved(self) -> bool:
        """Whether there is a reconstruction."""
        return "geometry" in self.record

    @property
    def world_from_cam(self) -> np.ndarray | None:
        """(T, 4, 4) the recovered cameras in the made world [m]; NaN where there is none."""
        cameras = [clip.camera for clip in self.clips.values() if clip.camera is not None]
        return cameras[0].world_from_cam if cameras else None

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames that are kept for somebody."""
        return np.any([[not reason for reason in person] for person in self.reasons], axis=0)

    def frames_of(self, sfm_rows: list[int]) -> np.ndarray:
        """Frames of some rows of the reconstruction, in order."""
        if self.sfm_rows is None:
            return np.zeros(0, dtype=int)
        return np.flatnonzero(np.isin(self.sfm_rows, sfm_rows) & (self.sfm_rows >= 0))


def gather(
    row: Mapping[str, Any], message: str, files: SequenceFiles | None, paths: SetPaths
) -> Found:
    """Read what there is of one sequence; what can't be read is named in `missing`.

    Args:
        row: Its row of `verdicts.json`.
        message: Why it could not be regenerated; empty for one that could.
        files: Where it is; None for one whose name can't be trusted: nothing is opened then.
        paths: Where the set keeps what.
    """
    missing: list[str] = []

    def read(call: Callable[[Path], Read], path: Path) -> Read | None:
        try:
            return call(path)
        except (GmrdataError, OSError) as error:
            missing.append(str(error))
            return None

    name = "" if files is None else files.name
    people_dir, pseudo_gt_dir = paths.people_dir(name), paths.pseudo_gt_dir(name)
    is_read = files is not None and people_dir.is_dir()
    people = read(read_json, people_dir / PEOPLE_FILE) if is_read else None
    doubts = read(read_json, people_dir / DOUBTS_FILE) if is_read else None
    # What an earlier run left of a sequence that now failed is not this run's answer.
    is_done = files is not None and not message
    record = (read(load_record, pseudo_gt_dir) if is_done else None) or {}
    by_set = tuple(tuple(reasons) for reasons in (doubts or {}).get("frames", ()))
    judged = record.get("people", ())
    clips: dict[int, Clip] = {}
    tracked, sfm_rows = None, None
    if "geometry" in record:
        for person in range(len(judged)):
            clip = read(load_clip, pseudo_gt_dir / person_file(person))
            clips |= {} if clip is None else {person: clip}
        arrays = read(read_npz, people_dir / TRACKED_FILE)
        tracked = None if arrays is None else arrays.get("world_from_cam")
        cameras = read(load_cameras, paths.sfm_dir(name))
        if cameras is not None and clips:
            numbers = next(iter(clips.values())).image_numbers
            sfm_rows = _rows_of(numbers, cameras.image_numbers)
    return Found(
        row=row,
        message=message,
        files=files,
        record=record,
        people=people or {},
        doubts=by_set,
        reasons=tuple(tuple(judged_reasons(person)) for person in judged) or by_set,
        clips=clips,
        tracked=tracked,
        sfm_rows=sfm_rows,
        missing=tuple(missing),
    )


def _rows_of(image_numbers: np.ndarray, sfm_numbers: np.ndarray) -> np.ndarray:
    row_of_number = {int(number): row for row, number in enumerate(sfm_numbers)}
    return np.array([row_of_number.get(int(number), -1) for number in image_numbers])
