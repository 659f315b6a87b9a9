"""The frames of a solved sequence with what was found drawn over them, as a small video.

Bodies are drawn where their poses put them, and fit whatever the camera is.  Paths on the floor and
marks stand still in the world: only a right camera keeps them in their places in the picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from gmrdata.cameras.files import Distortion, bent_points
from gmrdata.pages.frames import draw_mask_outline
from gmrdata.pages.solved import SolvedSequence
from gmrdata.read.frames import read_gray
from gmrdata.solve.plan import MOST_PICTURES
from gmrdata.stage.jobs import made_ahead
from gmrdata.stage.progress import track
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath, project_cam
from gmrdata.values.errors import BadFrames, MissingInput
from gmrdata.write.overlay import OVERLAY_BGR, draw_people, read_frame
from gmrdata.write.take import Performer
from gmrdata.write.video import write_video

LARGEST_SIDE_PX = 960
CRF = 26
MOST_BYTES = 6_000_000
MARK_PX = 3
BAR_PX = 6
BAR_BGR = {
    "kept": (75, 196, 95), "dropped": (130, 130, 140), "off": (46, 34, 196),
    "now": (255, 255, 255),
}  # fmt: skip
GRID_DEG = 10.0
MARKS_PER_FRAME = 150


@dataclass(frozen=True, eq=False)
class Marks:
    """Points that stand still in the world, and which of T frames shows which; each frame shows
    all of them where there are no sights."""

    world_m: np.ndarray  # (N, 3)
    rows: np.ndarray  # (M,) frame of each sight
    points: np.ndarray  # (M,) row in `world_m` of each

    def seen_m(self, row: int) -> np.ndarray:
        """(N', 3) those that a frame shows."""
        return self.world_m[self.points[self.rows == row]] if len(self.rows) else self.world_m


NO_MARKS = Marks(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Footage:
    """T frames, and all that is drawn over them."""

    images: Sequence[Path | None]  # (T,) None for none
    masks: Sequence[Path | None]  # (T,) 255 = dynamic
    times_s: np.ndarray  # (T,) ascending
    camera: CameraPath  # of the T frames
    lens: Distortion | None  # bends what is drawn as it bent the frames
    people: tuple[Performer, ...]
    marks: Marks
    dropped: np.ndarray  # (T,) bool
    off: np.ndarray  # (T,) bool: somebody's body does not lie on the person

    @property
    def fps_hz(self) -> float:
        """One over the median time between two frames."""
        steps_s = np.diff(self.times_s)
        return 1.0 / float(np.median(steps_s)) if len(steps_s) else 1.0


def shown_rows(times_s: np.ndarray, fps_hz: float) -> tuple[np.ndarray, float]:
    """Rows of T ascending times to show one after the other, and at which rate, so that they are
    shown for as long as they last; at most `MOST_PICTURES`."""
    n_frames = round((times_s[-1] - times_s[0]) * fps_hz) + 1
    step = -(-n_frames // MOST_PICTURES)
    wanted_s = times_s[0] + np.arange(0, n_frames, step) / fps_hz
    # Half a frame of slack: clocks of videos are rounded.
    rows = np.searchsorted(times_s, wanted_s + 0.5 / fps_hz, side="right") - 1
    rows[0] = 0  # also where the second frame comes at once
    return np.clip(rows, 0, len(times_s) - 1), fps_hz / step


def write_footage(path: Path, footage: Footage) -> int:
    """Write the mp4; gives the number of its pictures.  One frame at a time is in memory."""
    if not any(footage.images):
        raise BadFrames("there is no frame to draw over")
    rows, rate_hz = shown_rows(footage.times_s, footage.fps_hz)
    pictures = made_ahead(lambda row: footage_picture(footage, row)[..., ::-1], rows.tolist())
    shown = track(pictures, "drawing over frames", len(rows))
    # What is read while it plays, and what is there before, are together no more than the file.
    of_file = MOST_BYTES * 8 / 1000
    most_kbit = max(1, int(0.8 * of_file * rate_hz / len(rows))), int(0.2 * of_file)
    return write_video(shown, path, rate_hz, crf=CRF, quick=True, most_kbit=most_kbit)


def footage_picture(footage: Footage, row: int) -> np.ndarray:
    """One frame (H, W, 3) BGR, reduced to `LARGEST_SIDE_PX`, over a bar that says where it is in
    the video and which frames are dropped."""
    camera = reduced_camera(footage.camera)
    size_px = (camera.width_px, camera.height_px)
    frame = read_frame(footage.images[row], footage.camera)
    drawn = np.asarray(cv2.resize(frame, size_px, interpolation=cv2.INTER_AREA))
    if (mask_path := footage.masks[row]) is not None and footage.images[row] is not None:
        mask = read_gray(mask_path, (footage.camera.width_px, footage.camera.height_px))
        drawn = draw_mask_outline(drawn, cv2.resize(mask, size_px, interpolation=cv2.INTER_NEAREST))
    if camera.has_camera[row]:
        drawn = _with_world(drawn, footage, camera, row)
    return np.concatenate([drawn, _bar(footage, row, camera.width_px)])


def reduced_camera(camera: CameraPath) -> CameraPath:
    """The camera of frames that are no longer than `LARGEST_SIDE_PX`."""
    share = min(1.0, LARGEST_SIDE_PX / max(camera.width_px, camera.height_px))
    width_px, height_px = (max(1, round(share * n)) for n in (camera.width_px, camera.height_px))
    # Pixel (0, 0) is an outer corner, so the intrinsics scale with the frame.
    smaller = np.diag([width_px / camera.width_px, height_px / camera.height_px, 1.0])
    matrix = smaller @ camera.intrinsics_px
    return replace(camera, intrinsics_px=matrix, width_px=width_px, height_px=height_px)


def _with_world(drawn: np.ndarray, footage: Footage, camera: CameraPath, row: int) -> np.ndarray:
    """A frame with everybody and what stands still in the world."""

    def bend(points_cam: np.ndarray) -> np.ndarray:
        return bent_points(points_cam, footage.lens)

    cam_from_world = transforms.invert(camera.world_from_cam[row])
    marks_m = bend(transforms.apply(cam_from_world, footage.marks.seen_m(row)))
    drawn = _draw_marks(drawn, project_cam(marks_m, camera.intrinsics_px))
    return draw_people(drawn, footage.people, camera, row, round(footage.fps_hz), bend)


def _draw_marks(image: np.ndarray, marks_px: np.ndarray) -> np.ndarray:
    """A copy of a BGR image with dots; those beyond its border are left out."""
    out, (height, width) = image.copy(), image.shape[:2]
    inside = ((marks_px >= 0) & (marks_px <= [width, height])).all(axis=1)
    # OpenCV's pixel centres are whole numbers, and the drawing takes 4 fractional bits.
    for x, y in np.rint((marks_px[inside] - 0.5) * 16).astype(int).tolist():
        cv2.circle(out, (x, y), MARK_PX << 4, (30, 30, 30), -1, cv2.LINE_AA, 4)
        cv2.circle(out, (x, y), (MARK_PX << 4) - 10, OVERLAY_BGR["path"], -1, cv2.LINE_AA, 4)
    return out


def _bar(footage: Footage, row: int, width_px: int) -> np.ndarray:
    """(BAR_PX, width, 3) BGR: all frames in a row, and a light stroke at this one."""
    n = len(footage.dropped)
    rows = np.minimum((np.arange(width_px) + 0.5) / width_px * n, n - 1).astype(int)
    colours = np.where(footage.dropped[rows, None], BAR_BGR["dropped"], BAR_BGR["kept"])
    colours = np.where(footage.off[rows, None], BAR_BGR["off"], colours)
    bar = np.broadcast_to(colours.astype(np.uint8), (BAR_PX, width_px, 3)).copy()
    at = int((row + 0.5) / n * width_px)
    bar[:, max(0, at - 1) : at + 2] = BAR_BGR["now"]
    return bar


def direction_marks(camera: CameraPath) -> Marks:
    """For a camera that only turns: a grid of directions that stand still, far away round it."""
    known = np.flatnonzero(camera.has_camera)
    middle = camera.world_from_cam[known[len(known) // 2]]
    steps = np.deg2rad(np.arange(-180.0, 180.0, GRID_DEG))
    turns, rises = (grid.ravel() for grid in np.meshgrid(steps, steps[np.abs(steps) < 1.4]))
    flat = np.cos(rises)
    rays = np.stack([flat * np.sin(turns), -np.sin(rises), flat * np.cos(turns)], axis=1)
    return replace(NO_MARKS, world_m=middle[:3, 3] + rays @ middle[:3, :3].T)


def footage_of(solved: SolvedSequence) -> Footage:
    """What is drawn over the frames; MissingInput where there is nothing to draw or draw over."""
    if solved.camera is None:
        why = "no camera was found" if solved.is_alone else "no person's motion can be read"
        raise MissingInput(f"{why}, so nothing has a place in the frames")
    if not any(solved.images):
        raise MissingInput("the frames are not here: give their folder with --images")
    people = tuple(
        Performer(one.id, one.clip.motion, one.body, one.clip.valid) for one in solved.people
    )
    dropped = np.ones(solved.n_frames, dtype=bool) if not solved.reasons else ~solved.kept
    off = np.zeros(solved.n_frames, dtype=bool)
    for fit in () if solved.record is None else solved.record.picture_fits:
        off |= np.isin(np.arange(solved.n_frames), () if fit is None else fit.off_rows)
    return Footage(
        images=solved.images,
        masks=solved.masks,
        times_s=solved.times_s,
        camera=solved.camera,
        lens=solved.lens,
        people=people,
        marks=_marks(solved) if solved.is_alone else NO_MARKS,
        dropped=dropped,
        off=off,
    )


def _marks(found: SolvedSequence) -> Marks:
    """What stands still behind cameras alone: background points in the frames that show them, of a
    camera that turns a grid of directions."""
    solved, camera = found.reconstruction, found.camera
    if solved is None or camera is None or not camera.has_camera.any():
        return NO_MARKS
    if solved.cameras.geometry != "full":
        return direction_marks(camera)
    if solved.tracks is None or (world_m := found.world_points) is None:
        return NO_MARKS
    keep = _longest_seen(solved.tracks.rows, solved.tracks.points, len(world_m))
    return Marks(world_m, solved.tracks.rows[keep], solved.tracks.points[keep])


def _longest_seen(rows: np.ndarray, points: np.ndarray, n_points: int) -> np.ndarray:
    """Which observations (M,) to show: in each frame those of the points that most frames see."""
    lengths = np.bincount(points, minlength=n_points)
    order = np.lexsort((points, -lengths[points], rows))
    place = np.arange(len(order)) - np.searchsorted(rows[order], rows[order])
    return np.sort(order[place < MARKS_PER_FRAME])
