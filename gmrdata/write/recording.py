"""People, cameras and frames as a recording for rerun's viewer (an `.rrd` file).

A take is what one source says, such as "result" or "truth".  Entities, by path:

    world                            z is up; metres
    world/<take>                     Transform3D: from the take's own world to the shown one
    world/<take>/camera              Transform3D world_from_cam; cleared where it is not known
    world/<take>/camera/image        Pinhole, the same; EncodedImage: the frame's file as it is
    world/<take>/camera/image/mask   SegmentationImage: 1 where something moves
    world/<take>/points              Points3D that the cameras were found with
    world/<take>/<person>/body       Mesh3D; cleared in frames without a pose
    world/<take>/<person>/bones      LineStrips3D, from each joint's parent to the joint
    world/<take>/<person>/joints     Points3D, 24 in SMPL's order
    world/<take>/<person>/path       LineStrips3D: where the pelvis goes, in all frames

Timelines are `frame`, the clip's row, and `time` from the first row on.  Frames and masks stand
with the first take.  Needs rerun-sdk: the extra `view`.
"""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.frames import check_images, exif_orientation, image_bytes, read_color, read_gray
from gmrdata.values.body import PARENTS
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import text_runs
from gmrdata.values.errors import BadFrames, BadMotionFile, MissingExtra
from gmrdata.values.files import atomic_path
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.take import Performer, Take, check_take

APPLICATION = "gmrdata"
COLOURS = ((141, 171, 212), (236, 150, 90), (120, 190, 120), (190, 130, 200))
"""Of the takes, in their order."""
POSED_AT_ONCE = 32
COPIED_AT_ONCE = 1 << 20  # bytes
MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


def write_recording(
    path: Path,
    takes: Sequence[Take],
    *,
    shown_from_world: Mapping[str, np.ndarray] | None = None,
    images: Sequence[Path | None] = (),
    masks: Sequence[Path | None] = (),
) -> None:
    """Write takes of the same T frames.

    Args:
        path: The .rrd file.
        takes: One or more, with different names.
        shown_from_world: Where a take's world lies in the shown one, (4, 4) by the take's name; at
            its origin when left out.
        images: The frame's .jpg or .png of each row, T of them; None for none.
        masks: The mask of each row, 255 where something moves; None for none.

    OSError where the file can't be written whole, as on a full disk; then there is none.
    """
    if not takes or len({take.name for take in takes}) < len(takes):
        raise BadMotionFile("a recording needs takes, each with a name of its own")
    for take in takes:
        check_take(take)
    _check_frames(takes, images, masks)
    with _recording(path) as recording:
        _log_takes(recording, takes, shown_from_world or {}, images, masks)


def _check_frames(
    takes: Sequence[Take], images: Sequence[Path | None], masks: Sequence[Path | None]
) -> None:
    lengths = {take.n_frames for take in takes} | {len(paths) for paths in (images, masks) if paths}
    if len(lengths) > 1 or len({take.fps_hz for take in takes}) > 1:
        raise BadFrames("takes, images and masks have other numbers or rates of frames")
    files = [image for image in images if image is not None]
    camera = takes[0].camera
    if not files or camera is None:
        return
    size_px, expected_px = check_images(files), (camera.width_px, camera.height_px)
    if size_px != expected_px:
        sizes = "{}x{} px, but the camera has {}x{} px".format(*size_px, *expected_px)
        raise BadFrames(f"{files[0].parent}: images of {sizes}")


@contextmanager
def _recording(path: Path) -> Iterator[Any]:
    """A stream of rerun's that is written to `path` when the block ends well.

    Rerun writes into a pipe, from which we fill the file: on a full disk its own end waits for
    ever, and its streams in memory can't be put together from pieces.
    """
    try:
        import rerun
    except ImportError as error:
        what = "pip install rerun-sdk"
        raise MissingExtra(f"recordings need rerun-sdk ({error}): {what}") from None
    with atomic_path(path) as temporary, ThreadPoolExecutor(1) as thread:
        source, end = os.pipe()
        copied = thread.submit(_copy, source, temporary)
        try:
            recording = rerun.RecordingStream(APPLICATION)
            recording.save(f"/dev/fd/{end}")  # opens an end of its own
        finally:
            os.close(end)
        try:
            yield recording
        finally:
            recording.flush()
            recording.disconnect()
        if failed := copied.result():
            raise OSError(failed.errno, failed.strerror, str(path))


def _copy(source: int, path: Path) -> OSError | None:
    """Write what comes out of a pipe; what kept it from that, after the pipe has ended."""
    with open(source, "rb", buffering=0) as pipe:
        try:
            with path.open("wb") as stream:
                shutil.copyfileobj(pipe, stream, COPIED_AT_ONCE)
        except OSError as error:
            while pipe.read(COPIED_AT_ONCE):  # else rerun would wait
                pass
            return error
    return None


def _log_takes(
    recording: Any,
    takes: Sequence[Take],
    shown_from_world: Mapping[str, np.ndarray],
    images: Sequence[Path | None],
    masks: Sequence[Path | None],
) -> None:
    import rerun

    recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for number, take in enumerate(takes):
        entity = f"world/{take.name}"
        placed = shown_from_world.get(take.name, np.eye(4))
        recording.log(entity, _transform(placed), static=True)
        if len(take.points_m):
            points = rerun.Points3D(take.points_m, colors=(150, 150, 150))
            recording.log(f"{entity}/points", points, static=True)
        for person in take.people:
            colour = COLOURS[number % len(COLOURS)]
            _log_person(recording, f"{entity}/{person.name}", person, colour)
        files = ((), ()) if number else (images, masks)
        _log_camera(recording, f"{entity}/camera", take, *files)


def _transform(a_from_b: np.ndarray) -> Any:
    import rerun

    return rerun.Transform3D(translation=a_from_b[:3, 3], mat3x3=a_from_b[:3, :3])


def _at(recording: Any, row: int, fps_hz: float) -> None:
    recording.set_time("frame", sequence=row)
    recording.set_time("time", duration=row / fps_hz)


def _clear(recording: Any, *entities: str) -> None:
    """What was logged last would stay.  Rerun's reader takes no notice of a recursive Clear."""
    import rerun

    for entity in entities:
        recording.log(entity, rerun.Clear(recursive=False))


def _log_person(
    recording: Any, entity: str, person: Performer, colour: tuple[int, int, int]
) -> None:
    import rerun

    motion, body, fps_hz = person.motion, person.body, person.motion.fps_hz
    joints_m, bones = motion_joints_m(body, motion), np.array(list(enumerate(PARENTS)))[1:]
    faces = rerun.Mesh3D.from_fields(triangle_indices=body.faces, albedo_factor=colour)
    recording.log(f"{entity}/body", faces, static=True)
    runs = text_runs("here" if here else "" for here in person.shown)
    path = rerun.LineStrips3D([motion.pelvis_m[a:b] for a, b, here in runs if here], colors=colour)
    recording.log(f"{entity}/path", path, static=True)
    for row in np.flatnonzero(~person.shown).tolist():
        _at(recording, row, fps_hz)
        _clear(recording, *(f"{entity}/{part}" for part in ("body", "joints", "bones")))
    rows = np.flatnonzero(person.shown)
    for start in range(0, len(rows), POSED_AT_ONCE):
        now = rows[start : start + POSED_AT_ONCE]
        posed_m = zip(now.tolist(), motion_vertices_m(body, motion.take(now)), strict=True)
        for row, vertices_m in posed_m:
            _at(recording, row, fps_hz)
            normals = _normals(vertices_m, body.faces)
            skin = rerun.Mesh3D.from_fields(vertex_positions=vertices_m, vertex_normals=normals)
            lines = rerun.LineStrips3D(joints_m[row][bones], colors=colour)
            recording.log(f"{entity}/body", skin)
            recording.log(f"{entity}/joints", rerun.Points3D(joints_m[row], colors=colour))
            recording.log(f"{entity}/bones", lines)


def _normals(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 3) sums of the neighbouring faces' normals by their area, of length 1."""
    a, b, c = (vertices_m[faces[:, corner]] for corner in range(3))
    of_faces = np.cross(b - a, c - a)
    sums = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(of_faces[:, axis], 3), len(vertices_m))
            for axis in range(3)
        ],
        axis=1,
    )
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)


def _log_camera(
    recording: Any,
    entity: str,
    take: Take,
    images: Sequence[Path | None],
    masks: Sequence[Path | None],
) -> None:
    """Frames and masks are shown without a camera, too."""
    import rerun

    camera = take.camera
    if camera is None and not images and not masks:
        return
    size_px = None if camera is None else (camera.width_px, camera.height_px)
    for row in range(take.n_frames):
        _at(recording, row, take.fps_hz)
        image, mask = images[row] if images else None, masks[row] if masks else None
        known = camera is not None and bool(camera.has_camera[row])
        if not known or (images and not image) or (masks and not mask):
            seen = [f"{entity}/image", *([f"{entity}/image/mask"] if masks else [])]
            _clear(recording, entity, *seen)
        if camera is not None and known:
            recording.log(entity, _transform(camera.world_from_cam[row]))
            recording.log(f"{entity}/image", _pinhole(camera))
        if image is not None:
            media_type = MEDIA_TYPES[image.suffix.lower()]
            frame = rerun.EncodedImage(contents=_upright(image), media_type=media_type)
            recording.log(f"{entity}/image", frame)
        if mask is not None:
            classes = (read_gray(mask, size_px) > 127).astype(np.uint8)
            recording.log(f"{entity}/image/mask", rerun.SegmentationImage(classes))


def _upright(image: Path) -> bytes:
    """An image's file as it is; anew where EXIF turns it, since viewers do not."""
    content = image.read_bytes()
    if exif_orientation(content) == 1:
        return content
    return image_bytes(image.suffix.lower(), read_color(image))


def _pinhole(camera: CameraPath) -> Any:
    import rerun

    return rerun.Pinhole(
        image_from_camera=camera.intrinsics_px,
        resolution=[camera.width_px, camera.height_px],
        camera_xyz=rerun.ViewCoordinates.RDF,
    )
