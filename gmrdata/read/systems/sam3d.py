"""SAM 3D Body's rows: the dicts of `process_one_image`, as people save them.

Its demo (facebookresearch/sam-3d-body) writes pictures alone.  Read are an .npz of one person, with
arrays of one picture, as facebookresearch/MHR has in tools/mhr_smpl_conversion, or of T pictures,
and a pickle of a list with the dict, or the list of dicts, of each picture, or a dict of these by
the number of the picture or the name of its file:

`pred_global_rots` (127, 3, 3)   of the MHR body's joints, y up and z to the viewer
`pred_joint_coords` (127, 3)     where they are, y down and z away [m]
`pred_cam_t` (3,)                what is added to that before the camera [m]
`pred_keypoints_3d`, `_2d`       (70, 3) [m] and (70, 2) [px]: they show the camera, a pinhole
`person_id` or `track_id`        who it is, where somebody followed people; it does not itself

MHR's joints turn otherwise than SMPL's: each row of `_JOINTS` has the joint that stands for one of
SMPL's tree, and joint_from_smpl in a T-pose, by the rest skeleton of MHR's own FBX.  Thighs, shins
and both parts of the arms then point as the file's joints do, to 0.1 deg on its four published
people, and feet to 12 deg: trunk and shoulder girdle have other joints, and keep their turns, not
their places.  The pelvis is put over the hips' middle as in the body that is shipped.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.frames import number_in_name
from gmrdata.read.systems.entries import Entry, person_name, whole_number
from gmrdata.values.body import JOINT, PARENTS
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import EstimatedPeople, EstimatedPerson, InCamera, Pinhole

KEYS = frozenset({"pred_global_rots", "pred_joint_coords"})
"""What a row of these files has, which tells them from others."""
N_MHR, N_KEYPOINTS = 127, 70
CAM_FROM_FILE = np.diag([1.0, -1.0, -1.0])  # of rotations; places are turned already
PELVIS_OVER_HIPS_M = np.array([0.0, 0.045, 0.008])  # of Anny's mean, rest frame
HIPS, KNEES = (2, 18), (3, 19)
# Along the thigh in the hip's axes, left and right: its rotations and places go together so.
_THIGHS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
LARGEST_THIGH_DEG = 15.0
LARGEST_REPROJECTION_PX = 2.0  # rms; the file's own are below 1e-4
# MHR's joint and joint_from_smpl, axis-angle [rad], of each joint of SMPL's tree.
_JOINTS = (
    (1, 0.0, 0.0, 0.0), (2, 1.2119, -1.2345, 1.1851), (18, -1.2061, -1.184, -1.2334),
    (35, -1.1798, -1.2278, -1.1798), (3, 1.228, -1.228, 1.197), (19, -1.1904, -1.1904, -1.2212),
    (36, -1.1798, -1.2278, -1.1798), (7, 0.1367, -1.5776, 0.1352), (23, -2.1187, -0.1836, -2.1425),
    (37, -1.1798, -1.2278, -1.1798), (8, -0.0157, -1.8023, 0.0125), (24, 1.9414, 0.0169, 2.4524),
    (110, -1.4213, -1.0564, -1.4213), (74, -1.5489, -0.5115, 0.3928), (38, 1.4963, 0.39, 0.5078),
    (113, -1.2092, -1.2092, -1.2092), (75, -1.0832, 0.001, -0.0016), (39, 2.0584, -0.0019, -0.0011),
    (76, -0.8462, 0.0, 0.0), (40, 2.2954, 0.0, 0.0), (78, -2.8328, 0.127, -0.0584),
    (42, 0.3055, -0.0409, -0.0889), (78, -2.8328, 0.127, -0.0584), (42, 0.3055, -0.0409, -0.0889),
)  # fmt: skip
_CAMERA_KEYS = ("pred_cam_t", "pred_keypoints_3d", "pred_keypoints_2d")


def read_sam3d(content: Any, path: Path) -> EstimatedPeople:
    """From arrays of one person, or from rows by picture."""
    if isinstance(content, Mapping) and content.keys() >= KEYS:
        person = _person(Entry(dict(content), "person_0", path))
        return EstimatedPeople("sam-3d-body", (path,), (person,), len(person.frame_numbers))
    pictures = _in_order(content, path)
    rows: dict[str, dict[int, Mapping[str, Any]]] = defaultdict(dict)
    for number, picture in enumerate(pictures):
        seen = [picture] if isinstance(picture, Mapping) else picture
        if not isinstance(seen, list | tuple) or not all(isinstance(row, Mapping) for row in seen):
            raise BadMotionFile(f"{path}: picture {number} holds no dicts. Save what it returned")
        for name, row in _named(seen, number, path):
            if number in rows[name]:
                raise BadMotionFile(
                    f"{path}: {name} is twice in picture {number}. Name people once"
                )
            rows[name][number] = row
    people = (_person(_stacked(name, own, path), sorted(own)) for name, own in rows.items())
    return EstimatedPeople("sam-3d-body", (path,), tuple(people), len(pictures))


def _in_order(content: Any, path: Path) -> list[Any]:
    """The pictures as the video has them: in a list's order, or by the numbers of a dict's keys.

    Where no key of a dict has a number, its own order is kept.
    """
    if not isinstance(content, Mapping):
        return list(content)
    numbered = {_picture_number(key): picture for key, picture in content.items()}
    numbers = sorted(number for number in map(_picture_number, content) if number is not None)
    if not numbers:
        return list(content.values())
    if len(numbers) < len(content):
        what = f"{len(content) - len(numbers)} of its {len(content)} pictures have no number"
        raise BadMotionFile(f"{path}: {what}. Number all of them, as in 00012.jpg")
    # Whole numbers count the video's pictures, from 0 or 1; names of files may begin anywhere.
    first = numbers[0] if all(isinstance(key, str) for key in content) else min(numbers[0], 1)
    for before, after in pairwise([first - 1, *numbers]):
        if after != before + 1:
            what = f"picture {after} follows on picture {before}"
            remedy = "Give an empty list for a picture without anybody"
            raise BadMotionFile(f"{path}: {what}. {remedy}, and each number once")
    return [numbered[number] for number in numbers]


def _picture_number(key: Any) -> int | None:
    """By the picture's key, which may be the name of its file; None without one."""
    return number_in_name(key) if isinstance(key, str) else whole_number(key)


def are_rows(content: Any) -> bool:
    """Whether a pickle holds rows by picture, or one person's arrays."""
    if isinstance(content, Mapping) and content.keys() >= KEYS:
        return True
    pictures: Iterable[Any] = content.values() if isinstance(content, Mapping) else content
    if not isinstance(content, Mapping | list | tuple):
        return False
    first = next((one for one in pictures if not isinstance(one, list | tuple) or one), None)
    row = first[0] if isinstance(first, list | tuple) else first
    return isinstance(row, Mapping) and row.keys() >= KEYS


def _named(
    seen: Sequence[Mapping[str, Any]], number: int, path: Path
) -> Iterable[tuple[str, Mapping[str, Any]]]:
    for row in seen:
        key = next((row[key] for key in ("person_id", "track_id") if key in row), None)
        if key is None and len(seen) > 1:
            what = f"picture {number} has {len(seen)} people, and nothing tells who is who"
            remedy = "give each row a person_id, or save one person alone"
            raise BadMotionFile(f"{path}: {what} (SAM 3D Body follows nobody): {remedy}")
        yield person_name(0 if key is None else key, path), row


def _stacked(name: str, rows: Mapping[int, Mapping[str, Any]], path: Path) -> Entry:
    """One entry of arrays by row, with the keys that every row has."""
    entries = [Entry(rows[number], f"{name} in picture {number}", path) for number in sorted(rows)]
    keys = [key for key in (*KEYS, *_CAMERA_KEYS) if all(one.has(key) for one in entries)]
    arrays = {key: np.stack([one.array(key, *_SHAPES[key]) for one in entries]) for key in keys}
    return Entry(arrays, name, path)


_SHAPES: Mapping[str, tuple[int, ...]] = {
    "pred_global_rots": (N_MHR, 3, 3),
    "pred_joint_coords": (N_MHR, 3),
    "pred_cam_t": (3,),
    "pred_keypoints_3d": (N_KEYPOINTS, 3),
    "pred_keypoints_2d": (N_KEYPOINTS, 2),
}


def _person(entry: Entry, numbers: list[int] | None = None) -> EstimatedPerson:
    values = {key: entry.values[key] for key in _SHAPES if entry.has(key)}
    if entry.finite("pred_joint_coords").ndim == len(_SHAPES["pred_joint_coords"]):
        values = {key: entry.array(key, *_SHAPES[key])[None] for key in values}
    entry = Entry(values, entry.name, entry.path)
    places_m = entry.array("pred_joint_coords", None, N_MHR, 3)
    n_rows = len(places_m)
    rotmats = entry.rotations("pred_global_rots", n_rows, N_MHR)
    _check_together(entry, rotmats, places_m)
    joints = [int(row[0]) for row in _JOINTS]
    joint_from_smpl = Rotation.from_rotvec([row[1:] for row in _JOINTS]).as_matrix()
    ours = CAM_FROM_FILE @ rotmats[:, joints] @ joint_from_smpl
    local = np.swapaxes(ours[:, list(PARENTS[1:])], -1, -2) @ ours[:, 1:]
    lacks, in_camera = entry.lacking(*_CAMERA_KEYS), None
    if not lacks:
        shift_m = entry.array("pred_cam_t", n_rows, 3)
        pelvis_m = places_m[:, HIPS].mean(axis=1) + ours[:, JOINT["pelvis"]] @ PELVIS_OVER_HIPS_M
        in_camera = InCamera(ours[:, 0], pelvis_m + shift_m, *_camera(entry, n_rows, shift_m))
    return EstimatedPerson(
        name=entry.name,
        frame_numbers=np.arange(n_rows) if numbers is None else np.array(numbers),
        local_rotmats=local,
        in_camera=in_camera,
        rest_pelvis_m=np.zeros(3),
        lacks={"camera": lacks, "world": lacks or "a motion before the camera alone"},
    )


def _check_together(entry: Entry, rotmats: np.ndarray, places_m: np.ndarray) -> None:
    """Refuse rotations and places of other axes: somebody turned one of them."""
    thighs_m = places_m[:, KNEES] - places_m[:, HIPS]
    along = np.swapaxes(rotmats[:, HIPS], -1, -2) @ (thighs_m @ CAM_FROM_FILE)[..., None]
    cosines = (along[..., 0] * _THIGHS).sum(axis=-1) / np.linalg.norm(thighs_m, axis=-1)
    if not np.median(cosines) > np.cos(np.deg2rad(LARGEST_THIGH_DEG)):
        what = f"pred_global_rots and pred_joint_coords of {entry.name} are not of the same axes"
        raise entry.fault(f"{what}: one of them was turned after SAM 3D Body wrote it")


def _camera(
    entry: Entry, n_rows: int, shift_m: np.ndarray
) -> tuple[Pinhole, tuple[float, float] | None]:
    """The pinhole that takes the keypoints to the picture, and its size by the centre."""
    points_m = entry.array("pred_keypoints_3d", n_rows, N_KEYPOINTS, 3) + shift_m[:, None]
    places_px = entry.array("pred_keypoints_2d", n_rows, N_KEYPOINTS, 2)
    entry.positive("the depth", points_m[..., 2].min(axis=1))
    rays = points_m[..., :2] / points_m[..., 2:]
    off_rays, off_px = (each - each.mean(axis=1, keepdims=True) for each in (rays, places_px))
    focal_px = (off_rays * off_px).sum(axis=(1, 2)) / (off_rays**2).sum(axis=(1, 2))
    entry.positive("the focal length in the keypoints", focal_px)
    centre_px = places_px.mean(axis=1) - focal_px[:, None] * rays.mean(axis=1)
    left_px = off_px - focal_px[:, None, None] * off_rays
    if np.sqrt((left_px**2).sum(axis=-1).mean()) > LARGEST_REPROJECTION_PX:
        raise entry.fault(f"pred_keypoints_2d and _3d of {entry.name} are not of one camera")
    width_px, height_px = np.round(2.0 * np.median(centre_px, axis=0))
    return Pinhole(focal_px, centre_px), (float(width_px), float(height_px))
