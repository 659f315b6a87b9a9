"""One sequence of 3DPW: its arrays, its images, what is odd about them, and which frames serve."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from gmrdata.read.frames import check_images, number_in_name
from gmrdata.read.numbers import rigid_rows, usable_rows
from gmrdata.read.threedpw_files import (
    SequenceArrays,
    SequenceFiles,
    ThreedpwPerson,
    find_sequence,
    read_sequence_file,
    require_inside,
    require_name,
)
from gmrdata.values.clip import first_reasons
from gmrdata.values.errors import BadFrames, BadRecipe, BadSequence, MissingInput

CENTRE_TOLERANCE = 0.05
"""Share of the width or height by which 3DPW's principal point may be off the image's middle."""
SAME_POSE_RAD = 1e-3
"""Largest difference between a 30 Hz pose and the 60 Hz row that it was taken from [rad]."""
CONFIDENT = 0.3  # confidence above which GLAMR and VIBE count a keypoint
ValidRule = Literal["campose_valid", "3dpw_eval", "glamr", "vibe", "slahmr"]
"""Users of 3DPW score four different sets of frames; each rule says which ones it keeps.

- `campose_valid`: the dataset aligned the camera to the person.
- `3dpw_eval`: that, and any 2D keypoint (the official evaluation, `evaluate.py`).
- `glamr`: that, and at least 6 keypoints of confidence above 0.3 (`preprocess_3dpw.py`).
- `vibe`: more than 6 keypoints of confidence above 0.3; `campose_valid` is not asked
  (`threedpw_utils.py`).
- `slahmr`: `campose_valid`, and any keypoint of confidence above 0 (`run_eval.py`).
"""
_RULE_REASONS: dict[ValidRule, str] = {
    "campose_valid": "campose_valid is 0",
    "3dpw_eval": "campose_valid is 0, or poses2d is all 0",
    "glamr": f"campose_valid is 0, or fewer than 6 keypoints above {CONFIDENT}",
    "vibe": f"not more than 6 keypoints above {CONFIDENT}",
    "slahmr": "campose_valid is 0, or no keypoint above 0",
}


@dataclass(frozen=True, eq=False)
class SequenceImages:
    """The images of N rows."""

    paths: tuple[Path, ...]  # (N,) `image_{row:05d}.jpg`, there or not
    width_px: int  # of the images, upright, as is `height_px` [px]
    height_px: int
    faults: tuple[str, ...]  # (N,) why a row's image can't be used; empty where it can
    spare: tuple[int, ...]  # numbers of images in the folder that no row belongs to


@dataclass(frozen=True, eq=False)
class Sequence3DPW:
    """A sequence: row t of the arrays belongs to image t."""

    files: SequenceFiles
    arrays: SequenceArrays
    images: SequenceImages
    problems: tuple[str, ...]
    """What is odd and doesn't keep the sequence from being used, for a person to read."""

    @property
    def name(self) -> str:
        return self.files.name

    @property
    def n_frames(self) -> int:
        return self.arrays.n_frames


def read_sequence(root: Path, name: str) -> Sequence3DPW:
    """Read a sequence by its name, from whichever split of the dataset's folder it is in."""
    return read_found(find_sequence(root, name))


def read_found(files: SequenceFiles) -> Sequence3DPW:
    """Read a sequence that `find_sequences` found."""
    require_name(files.name)
    require_inside(files.root, files.pickle_path)
    arrays = read_sequence_file(files.pickle_path)
    images = check_sequence_images(files, arrays.n_frames)
    check_intrinsics(files.pickle_path, arrays.intrinsics_px, images.width_px, images.height_px)
    return Sequence3DPW(files, arrays, images, tuple(_problems(files, arrays, images)))


def _problems(files: SequenceFiles, arrays: SequenceArrays, images: SequenceImages) -> list[str]:
    bad_images = sum(fault != "" for fault in images.faults)
    n_people = len(arrays.people)
    odd = [_odd_60hz(person, arrays.img_frame_ids) for person in arrays.people]
    checks = (
        (arrays.name != files.name, f"the file says that it is sequence {arrays.name[:100]!r}"),
        (bad_images, f"{bad_images} of {arrays.n_frames} images can't be used"),
        (images.spare, f"{len(images.spare)} images beyond the last row"),
        (n_people > 2, f"{n_people} people, 3DPW has one or two"),
        *((what, f"person {index}: {what}") for index, what in enumerate(odd)),
    )
    return [text for is_so, text in checks if is_so]


def _odd_60hz(person: ThreedpwPerson, img_frame_ids: np.ndarray) -> str:
    """What is odd about the 60 Hz arrays: `img_frame_ids` are rows of theirs, not image numbers."""
    poses, trans = person.poses_60hz_rad, person.trans_60hz_m
    if poses is None or trans is None:
        return "no 60 Hz arrays"
    if len(poses) != len(trans):
        return f"poses_60Hz has {len(poses)} rows, trans_60Hz {len(trans)}"
    if img_frame_ids.min() < 0 or img_frame_ids.max() >= len(poses):
        return f"img_frame_ids goes to {img_frame_ids.max()}, poses_60Hz has {len(poses)} rows"
    difference = np.abs(poses[img_frame_ids] - person.poses_rad)
    if np.nanmax(difference, initial=0.0) > SAME_POSE_RAD:
        return "img_frame_ids doesn't lead from poses_60Hz to poses"
    return ""


def check_sequence_images(files: SequenceFiles, n_frames: int) -> SequenceImages:
    """Look at the image of each row: there, whole, of one size, and inside the dataset's folder."""
    if not files.image_dir.is_dir():
        remedy = "unpack 3DPW's imageFiles.zip so that it is there"
        raise MissingInput(f"{files.image_dir}: no such folder; {remedy}")
    require_inside(files.root, files.image_dir)
    paths = [files.image_path(row) for row in range(n_frames)]
    looked_at = [_look_at(files, path) for path in paths]
    sizes = Counter(size for size, _ in looked_at if size is not None)
    if not sizes:
        raise BadFrames(f"{files.image_dir}: not one image can be used: {looked_at[0][1]}")
    most = sizes.most_common(1)[0][0]
    others = f"others have {most[0]}x{most[1]} px"
    faults = tuple(
        f"image of {size[0]}x{size[1]} px, {others}" if size and size != most else fault
        for size, fault in looked_at
    )
    numbers = [number_in_name(path.name) for path in files.image_dir.glob("image_*.jpg")]
    spare = tuple(sorted(number for number in numbers if number is not None and number >= n_frames))
    return SequenceImages(tuple(paths), *most, faults, spare)


def check_intrinsics(path: Path, intrinsics_px: np.ndarray, width_px: int, height_px: int) -> None:
    """Check that K is that of the images: 3DPW has portrait and landscape sequences."""
    centre_px = intrinsics_px[:2, 2]
    if _is_middle(centre_px, (width_px, height_px)):
        return
    why = "it is that of other images; use the images at 3DPW's own size, uncropped"
    if _is_middle(centre_px, (height_px, width_px)):
        why = "it is that of the other orientation; a tool has turned the images, unpack imageFiles"
        why += " again"
    what = f"cam_intrinsics has its principal point at ({centre_px[0]:g}, {centre_px[1]:g}) px"
    raise BadSequence(f"{path}: {what}, the images are {width_px}x{height_px} px: {why}")


def _is_middle(centre_px: np.ndarray, size_px: Sequence[int]) -> bool:
    return bool((np.abs(centre_px / np.array(size_px) - 0.5) <= CENTRE_TOLERANCE).all())


def _look_at(files: SequenceFiles, path: Path) -> tuple[tuple[int, int] | None, str]:
    """(width, height) of an image, or None and what is wrong with it."""
    if path.is_symlink():
        try:
            require_inside(files.root, path)
        except BadSequence:
            return None, f"{path.name} is a link out of the dataset"
    if not path.is_file():
        return None, f"{path.name} is missing"
    try:
        return check_images([path]), ""
    except BadFrames:
        what = "empty (0 bytes)" if path.stat().st_size == 0 else "truncated or no image"
        return None, f"{path.name} is {what}"


def known_rule(rule: str) -> ValidRule:
    """A rule's name as its type; BadRecipe where there is no such rule."""
    rules: tuple[ValidRule, ...] = get_args(ValidRule)
    if rule in rules:
        return rules[rules.index(rule)]
    raise BadRecipe(f"no rule {rule!r} for valid frames; there are {', '.join(rules)}")


def frames_by_rule(person: ThreedpwPerson, rule: ValidRule) -> np.ndarray:
    """The frames that a rule keeps: (N,) bool."""
    confidence = person.poses2d_px[:, :, 2]
    confident = (confidence > CONFIDENT).sum(axis=1)
    match known_rule(rule):
        case "campose_valid":
            return person.campose_valid
        case "3dpw_eval":
            return person.campose_valid & (np.abs(person.poses2d_px).mean(axis=(1, 2)) != 0)
        case "glamr":
            return person.campose_valid & (confident >= 6)
        case "vibe":
            return np.asarray(confident > 6)
        case "slahmr":
            return person.campose_valid & (confidence > 0).any(axis=1)


def unusable_reasons(
    sequence: Sequence3DPW, person_index: int, rule: ValidRule = "campose_valid"
) -> list[str]:
    """Why each frame of a person can't be used: (N,) texts, empty where it can.

    Beyond the rule, a frame needs an image, finite numbers, a rigid camera, a body in front of it.
    """
    person, cam_from_world = sequence.arrays.people[person_index], sequence.arrays.cam_from_world
    with np.errstate(all="ignore"):
        depth_m = np.einsum("nj,nj->n", cam_from_world[:, 2, :3], person.trans_m)
        in_front = depth_m + cam_from_world[:, 2, 3] > 0
    tests = (
        (usable_rows(cam_from_world), "cam_poses is not finite"),
        (rigid_rows(cam_from_world), "cam_poses is no rigid transform"),
        (usable_rows(person.poses_rad, person.trans_m), "poses or trans is not finite"),
        (in_front, "the body is behind the camera"),
        (frames_by_rule(person, rule), _RULE_REASONS[rule]),
    )
    return first_reasons(sequence.images.faults, tests)
