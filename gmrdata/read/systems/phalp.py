"""PHALP's and 4D-Humans' `outputs/results/demo_<video>.pkl` (brjathu/PHALP; joblib with zlib).

By phalp/trackers/PHALP.py and the table in 4D-Humans' README, a dict from the frame's name to a
dict of `time`, the frame's number from 0, `shot`, 1 where a new shot begins, and lists with one
entry for each track:

`tid`              the track's number
`tracked_time`     frames since it was last seen; above 0 the rest is of another frame, and left out
`smpl`             `body_pose` (23, 3, 3), `global_orient` (1, 3, 3) and `betas` (10,)
`camera_bbox` (3,) s, tx, ty of a crop round `center` (2,) [px] whose side is the larger of
                   `scale` (2,) [px]; or `scale` is one number, the side over the picture's longer
                   side, as 4D-Humans' own demo has it (in 590 rows of real files
                   camera[2] = 2 * 5000 / (256 * camera_bbox[0] * scale) to 4 digits)
`camera` (3,)      the same in a square of 256 px that holds the picture, seen with 5000 px
                   (phalp/models/hmar/hmar.py, `get_3d_parameters`); read where the others lack
`size` (2,)        (height, width) of the picture [px]

No motion is bridged over the beginning of a shot, although tracks go on there.

Of a video it reads 1300 frames, unless it is told otherwise (`VideoConfig.end_frame`).  Told to
begin later (`PHALPConfig.start_frame`), it counts from there, and the images' names from the first.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import Entry, person_name, shown, whole_number
from gmrdata.values.body import N_LOCAL
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import Crop, EstimatedPeople, EstimatedPerson, InCamera

FRAME_KEYS = frozenset({"time", "tid", "smpl"})
"""What an entry of these files has, which tells them from others."""
NETWORK_PX, FOCAL_PX = 256.0, 5000.0
CROP_KEYS = ("camera_bbox", "center", "scale")
END_FRAME, ALL_FRAMES = 1300, "video.end_frame=-1"
"""How many frames of a video it takes, and what it has to be told for all of them."""
LISTS = ("tid", "tracked_time", "smpl", "camera", "size", *CROP_KEYS)
OF_VIDEO = re.compile(r"/_DEMO/[^/]+/img/(\d{6,9})\.jpg$")  # which it takes out of a video, from 1
NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")  # in a name, which may be a time in seconds


def read_phalp(content: Mapping[Any, Any], path: Path) -> EstimatedPeople:
    tracks: dict[str, dict[int, Entry]] = defaultdict(dict)
    cuts, pictures = set(), {}
    for key, values in content.items():
        frame = Entry(values, f"frame {shown(key)}", path)
        time, tracked = _tracked(frame)
        if own := OF_VIDEO.search(str(key)):
            time = int(own[1]) - 1
        pictures[time] = PurePosixPath(str(key)).stem
        if whole_number(frame.values.get("shot")):
            cuts.add(time)
        for name, row in tracked:
            if time in tracks[name]:
                raise frame.fault(f"times of {name} are not rising frame numbers")
            tracks[name][time] = row
    _require_in_order([name for _, name in sorted(pictures.items())], path)
    people = (_person(name, rows, frozenset(cuts)) for name, rows in tracks.items())
    return EstimatedPeople("phalp", (path,), tuple(people), max(pictures, default=-1) + 1)


def _require_in_order(pictures: list[str], path: Path) -> None:
    """Refuse images that followed each other by the letters of their names, and not as filmed."""
    for before, after in pairwise(pictures):
        numbers = [[*map(float, NUMBER.findall(name))] for name in (before, after)]
        if len(numbers[0]) == len(numbers[1]) and numbers[1] < numbers[0]:
            what = f"image {after} follows on image {before}, as PHALP sorts names by their letters"
            remedy = "Number the images with as many digits each (00012.jpg), and run it again"
            raise BadMotionFile(f"{path}: {what}. {remedy}")


def ends_early(results: EstimatedPeople, n_frames: int) -> bool:
    """Whether a result is PHALP's of the first frames of a video of so many, as it does by itself:
    frames have their numbers, so those that are there are the video's."""
    return results.system == "phalp" and results.n_frames == END_FRAME < n_frames


def _tracked(frame: Entry) -> tuple[int, list[tuple[str, Entry]]]:
    """The number of a frame, and the tracks that are seen in it."""
    for key in sorted(FRAME_KEYS):
        if not isinstance(frame.values, Mapping) or key not in frame.values:
            raise frame.fault(f"{frame.name} has no {key!r}")
    lists = {key: frame.values[key] for key in LISTS if frame.values.get(key) is not None}
    n_tracks = len(lists["tid"]) if isinstance(lists.get("tid"), list) else -1
    if "smpl" not in lists or any(
        not isinstance(one, list) or len(one) != n_tracks for one in lists.values()
    ):
        raise frame.fault(f"the lists of {frame.name} are of different lengths")
    time = whole_number(frame.values["time"])
    if time is None:
        raise frame.fault(f"the time of {frame.name} is no number")
    rows = []
    for at, track in enumerate(lists["tid"]):
        values = {key: one[at] for key, one in lists.items()}
        if whole_number(values.get("tracked_time", 0)) == 0:
            name = person_name(track, frame.path)
            rows.append((name, Entry(values, f"{name} in frame {time}", frame.path)))
    return time, rows


def _person(name: str, by_time: Mapping[int, Entry], cuts: frozenset[int]) -> EstimatedPerson:
    times = sorted(by_time)
    rows = [by_time[time] for time in times]
    smpl = [Entry(row.values["smpl"], row.name, row.path) for row in rows]
    whole, in_camera = Entry({"times": times}, name, rows[0].path), None
    crop_keys = CROP_KEYS if all(row.has(*CROP_KEYS) for row in rows) else ("camera",)
    lacks = _first_lack(rows, *crop_keys, "size") or _first_lack(smpl, "global_orient")
    if not lacks:
        roots = np.stack([one.flat("global_orient", 9).reshape(3, 3) for one in smpl])
        in_camera = InCamera(whole.orthonormal("global_orient", roots), None, *_crop(name, rows))
        lacks = _first_lack(smpl, "betas")
    poses = np.stack([one.array("body_pose", N_LOCAL, 3, 3) for one in smpl])
    return EstimatedPerson(
        name=name,
        frame_numbers=whole.frame_numbers("times", len(times)),
        local_rotmats=whole.orthonormal("body_pose", poses),
        in_camera=in_camera,
        betas=_betas(whole, smpl),
        cuts=cuts,
        lacks={"camera": lacks, "world": lacks},
    )


def _first_lack(entries: list[Entry], *keys: str) -> str:
    return next(filter(None, (entry.lacking(*keys) for entry in entries)), "")


def _betas(whole: Entry, smpl: list[Entry]) -> np.ndarray | None:
    """(T, S), where all rows have them."""
    if _first_lack(smpl, "betas"):
        return None
    betas = [one.flat("betas", None) for one in smpl]
    if len({one.size for one in betas}) > 1:
        raise whole.fault(f"betas of {whole.name} are of other lengths by frame")
    return np.stack(betas)


def _crop(name: str, rows: list[Entry]) -> tuple[Crop, tuple[float, float]]:
    """The crop by row, and the size of the file's pictures."""
    sizes = np.stack([row.flat("size", 2)[::-1] for row in rows])
    whole = Entry({}, name, rows[0].path)
    whole.positive("size", sizes)
    if (sizes != sizes[0]).any():
        raise BadMotionFile(f"{whole.path}: size of {name} is another by frame. Cut the video")
    width_px, height_px = sizes[0].tolist()
    long_px = max(width_px, height_px)
    if all(row.has(*CROP_KEYS) for row in rows):
        weak = np.stack([row.flat("camera_bbox", 3) for row in rows])
        middles_px = np.stack([row.flat("center", 2) for row in rows])
        sides_px = np.array([_side_px(row, long_px) for row in rows])
    else:  # the square that holds the whole picture; the ray is the person's
        seen = np.stack([row.flat("camera", 3) for row in rows])
        whole.positive("the depth", seen[:, 2])
        scales = 2.0 * FOCAL_PX / (NETWORK_PX * seen[:, 2])
        middles_px = sizes / 2.0 + scales[:, None] * long_px / 2.0 * seen[:, :2]
        weak = np.column_stack([scales, np.zeros((len(rows), 2))])
        sides_px = np.full(len(rows), long_px)
    whole.positive("the scale", np.column_stack([weak[:, 0], sides_px]))
    return Crop(middles_px, sides_px, weak, NETWORK_PX), (width_px, height_px)


def _side_px(row: Entry, long_px: float) -> float:
    """Of the crop, from `scale` in either form."""
    scale = row.flat("scale", None)
    if scale.size == 1:
        return float(scale[0]) * long_px
    return float(row.flat("scale", 2).max())
