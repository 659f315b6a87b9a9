"""2D keypoints in the JSON of OpenPose and STAF: one file per frame, people in no fixed order.

    {"people": [{"person_id": [3], "pose_keypoints_2d": [x0, y0, confidence0, x1, ...]}]}

`person_id` is STAF's track, -1 where nothing tracks.  x and y are in pixels of the image; OpenPose
adds half a pixel to the peaks of its maps, so (0, 0) is the outer corner of the first pixel, as
everywhere here.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.frames import number_in_name
from gmrdata.values.body import JOINT, N_JOINTS
from gmrdata.values.errors import BadKeypoints, MissingInput
from gmrdata.values.files import read_json, visible

OPENPOSE_JOINTS = {
    1: JOINT["neck"],
    2: JOINT["right_shoulder"], 3: JOINT["right_elbow"], 4: JOINT["right_wrist"],
    5: JOINT["left_shoulder"], 6: JOINT["left_elbow"], 7: JOINT["left_wrist"],
    8: JOINT["right_hip"], 9: JOINT["right_knee"], 10: JOINT["right_ankle"],
    11: JOINT["left_hip"], 12: JOINT["left_knee"], 13: JOINT["left_ankle"],
}  # fmt: skip
"""OpenPose's COCO keypoint -> SMPL joint.  Nose, eyes and ears (0, 14-17) are no SMPL joints."""
LAYOUTS = {25: "BODY_25 of OpenPose", 21: "BODY_21A of STAF"}
"""Number of keypoints -> layout.  Both begin with the same 15."""
PAIRS = {point + (point > 7): joint for point, joint in OPENPOSE_JOINTS.items()}
"""Keypoint of both layouts -> SMPL joint.

Left out, since SMPL has no joint there: nose (0), eyes and ears (15-18), heels and the tips of the
toes (19-24; SMPL's `foot` is the ball of it), LSP's neck and the top of the head (STAF's 19, 20);
and the middle of the hips (8), which adds nothing to the hips and lies below SMPL's pelvis.
"""


@dataclass(frozen=True, eq=False)
class Person2d:
    """One person in one frame."""

    id: int | None  # track, or None where nothing tracks
    keypoints: np.ndarray
    """(24, 3) x [px], y [px], confidence of SMPL's joints; zero for those without a pair."""

    @property
    def confidence(self) -> float:
        """Sum of the joints' confidences."""
        return float(self.keypoints[:, 2].sum())


def keypoint_files(folder: Path) -> dict[int, Path]:
    """The frames of a folder by number: the last run of digits in each file's name.

    OpenPose counts a video's frames from 0 (`clip_000000000012_keypoints.json` is the 13th), and
    keeps the names of images (`00012_keypoints.json`).
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder of keypoints, one JSON file per frame")
    files: dict[int, Path] = {}
    for path in sorted(visible(folder.glob("*.json"))):
        number = number_in_name(path.name)
        if number is None:
            raise BadKeypoints(f"{path}: no number in the name; name it 00012_keypoints.json")
        if number in files:
            raise BadKeypoints(f"{path}: and {files[number].name} are both of frame {number}")
        files[number] = path
    if not files:
        raise MissingInput(f"{folder}: no JSON files; run OpenPose or STAF with --write_json")
    return files


def read_people(path: Path) -> list[Person2d]:
    record = read_json(path)
    people = record.get("people") if isinstance(record, dict) else None
    if not isinstance(people, list):
        raise BadKeypoints(f"{path}: no list of people; give OpenPose's JSON (--write_json)")
    return [_person(path, person) for person in people]


def _person(path: Path, person: Any) -> Person2d:
    flat = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(flat, list) or len(flat) not in {3 * n for n in LAYOUTS}:
        count = f"{len(flat)} numbers" if isinstance(flat, list) else "none"
        known = " or ".join(f"{3 * n} ({name})" for n, name in LAYOUTS.items())
        raise BadKeypoints(f"{path}: pose_keypoints_2d has {count}, expected {known}")
    # Whole numbers of JSON have no largest one, and NaN is below nothing.
    if not all(type(n) in (int, float) and abs(n) < 1e9 for n in flat) or min(flat[2::3]) < 0:
        what = "something that is no number, or a confidence below zero"
        raise BadKeypoints(f"{path}: pose_keypoints_2d holds {what}; write it again")
    keypoints = np.zeros((N_JOINTS, 3))
    keypoints[list(PAIRS.values())] = np.reshape(flat, (-1, 3))[list(PAIRS)]
    given = person.get("person_id", -1)
    number = given[0] if isinstance(given, list) and len(given) == 1 else given
    if type(number) is not int:
        raise BadKeypoints(f"{path}: person_id is {given!r}, expected [number]")
    return Person2d(None if number < 0 else number, keypoints)
