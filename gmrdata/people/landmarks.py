"""Stage: people's landmarks in every frame, each person followed through the video with gaps.

A detector starts the landmark network, which follows each person by its own landmarks.  Where a
person is lost and found again, `people` joins the pieces.
"""

import shutil
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass as part

from gmrdata.people.boxes import box_iou
from gmrdata.people.landmark_network import (
    N_LANDMARKS,
    Crop,
    LandmarkNetwork,
    Person,
    crop_around,
    open_landmark_network,
)
from gmrdata.people.linking import LinkConfig, Sighting, cuts_in, join_pieces
from gmrdata.people.onnx import OnnxConfig, detect_all
from gmrdata.read.frames import check_images, image_number, list_images, read_color
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.files import read_json, write_json, write_npz
from gmrdata.values.people import person_file
from gmrdata.values.records import (
    PART,
    ArrayShapes,
    Config,
    Record,
    check_shapes,
    read_arrays,
)

LANDMARKS_FILE = "landmarks.json"
TRACK_FORMAT = "gmrdata-landmark-track/1"
HUES, SATURATIONS = 8, 4
"""Bins of the colours by which a person is known again."""


class LandmarksConfig(Config):
    """How people are found and followed."""

    min_detector_score: float = Field(default=0.35, gt=0, le=1)
    """A box that reaches this score may start a person."""
    detect_every: int = Field(default=3, ge=1)
    """Frames from one look of the detector to the next; it only finds who is not followed."""
    min_score: float = Field(default=0.5, gt=0, le=1)
    """A person is followed while the landmark network's score reaches this."""
    same_iou: float = Field(default=0.4, gt=0, le=1)
    """Overlap of two boxes from which they are of one person."""
    link: LinkConfig = LinkConfig()
    min_frames: int = Field(default=10, ge=2)
    """Who is seen in fewer frames is left out; the one seen in most of them only if in one frame
    alone."""


@dataclass(frozen=True, eq=False)
class LandmarkTrack:
    """One person's landmarks over the T frames in which the network saw it."""

    image_numbers: np.ndarray  # (T,) int, rising, as in the images' names
    image_px: np.ndarray  # (T, 33, 2) as the picture has them, bent by its lens [px]
    world_m: np.ndarray
    """(T, 33, 3) from the middle of the hips [m], in the axes of the camera as far as a crop tells:
    along the ray through its middle."""
    visibility: np.ndarray  # (T, 33) from 0 to 1
    scores: np.ndarray  # (T,) from 0 to 1: that there is a person
    crops: np.ndarray  # (T, 4) what the network saw: centre x and y, side [px], turn [rad]

    def write(self, path: Path) -> None:
        """Write the track as an .npz without pickled objects."""
        arrays = {key: getattr(self, key) for key in _TRACK_SHAPES}
        check_shapes(path, arrays, _TRACK_SHAPES)
        write_npz(path, {"format": TRACK_FORMAT} | arrays)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a track; BadRecord names what is wrong with the file."""
        return cls(**read_arrays(path, TRACK_FORMAT, _TRACK_SHAPES))


_TRACK_SHAPES: ArrayShapes = {
    "image_numbers": ("iu", ("T",)),
    "image_px": ("f", ("T", N_LANDMARKS, 2)),
    "world_m": ("f", ("T", N_LANDMARKS, 3)),
    "visibility": ("f", ("T", N_LANDMARKS)),
    "scores": ("f", ("T",)),
    "crops": ("f", ("T", 4)),
}


@part(frozen=True, config=PART)
class PersonFacts:
    """One person of the video."""

    images: PositiveInt
    """In which the person is seen."""
    first_image: int
    last_image: int
    pieces: PositiveInt
    """Runs of frames, lost and found again."""


class LandmarksRecord(Record):
    """`landmarks.json`: who is seen, and when."""

    format: Literal["gmrdata-landmarks/1"] = "gmrdata-landmarks/1"
    size_px: tuple[int, int]
    images: PositiveInt
    people: tuple[PersonFacts, ...]
    """In the order of `person_<n>.npz`: who is seen in most frames comes first."""
    left_out: tuple[int, ...]
    """Frames of each one who is seen in too few."""


def find_landmarks(
    detector_path: Path,
    landmarks_path: Path,
    images_dir: Path,
    out_dir: Path,
    config: LandmarksConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: `person_<n>.npz` of each person (`LandmarkTrack`), and `landmarks.json`.

    A run that was stopped goes on at the next frame that it has not seen.  A video without people
    leaves a record without people.

    The detector is YOLOX on COCO's 80 classes as an ONNX file, the landmark network BlazePose GHUM
    lite as a TFLite file; BadDetector where one is no such network.
    """

    def work(partial: Path) -> None:
        images = list_images(images_dir)
        size_px = check_images(images)
        look = open_landmark_network(landmarks_path)
        least = config.min_detector_score
        people = OnnxConfig(classes=("person",), min_score=least, weak_score=least)
        seldom = images[:: config.detect_every]
        found = detect_all(detector_path, seldom, partial, people)
        boxes_px = {image: frame.boxes_px for image, frame in zip(seldom, found, strict=True)}
        frames = _follow_all(images, boxes_px, partial / "followed", config, look)
        _write(frames, images, size_px, partial, config)
        shutil.rmtree(partial / "seen")
        shutil.rmtree(partial / "followed")

    inputs = {"detector": detector_path, "landmarks": landmarks_path, "images": images_dir}
    return run_stage("landmarks", out_dir, config, inputs, work, resumable=True, run=run)


def load_tracks(landmarks_dir: Path) -> list[LandmarkTrack]:
    """The people of a finished folder; BadRecord where a file is not whole."""
    record = LandmarksRecord.read(landmarks_dir / LANDMARKS_FILE)
    return [
        LandmarkTrack.read(landmarks_dir / person_file(number))
        for number in range(len(record.people))
    ]


_Seen = dict[str, Any]
"""What a frame's file says of one piece of a person: numbers by name."""


def _follow_all(
    images: list[Path],
    boxes_px: dict[Path, np.ndarray],
    folder: Path,
    config: LandmarksConfig,
    look: LandmarkNetwork,
) -> list[list[_Seen]]:
    """What is seen in each frame; `folder` keeps it for a later run."""
    frames: list[list[_Seen]] = []
    n_pieces = 0
    for image in with_bar(images, "landmarks"):
        path = folder / f"{image.stem}.json"
        if not path.is_file():
            before = frames[-1] if frames else []
            starts_px = boxes_px.get(image, np.zeros((0, 4)))
            write_json(path, _frame(read_color(image), before, starts_px, n_pieces, config, look))
        # Read back, so that a resumed run works on the very same numbers.
        frames.append(read_json(path))
        n_pieces = max([n_pieces, *(seen["piece"] + 1 for seen in frames[-1])])
    return frames


def _frame(
    image: np.ndarray,
    before: list[_Seen],
    starts_px: np.ndarray,
    n_pieces: int,
    config: LandmarksConfig,
    look: LandmarkNetwork,
) -> list[_Seen]:
    """Whom the frame before shows, then who is new; two who have become one are one."""
    kept: list[_Seen] = []

    def keep(person: Person, piece: int) -> bool:
        others_px = np.array([seen["box_px"] for seen in kept]).reshape(-1, 4)
        is_new = (box_iou(person.box_px[None], others_px) < config.same_iou).all()
        if person.score < config.min_score or not person.mask.any() or not is_new:
            return False
        kept.append(_as_plain(person, piece, image))
        return True

    for seen in before:
        crop = _crop(seen["next_crop"])
        keep(look(image, crop), seen["piece"])
        if kept and kept[-1]["piece"] == seen["piece"]:
            kept[-1]["crop"] = seen["next_crop"]
    for box_px in starts_px:
        others_px = np.array([seen["box_px"] for seen in kept]).reshape(-1, 4)
        if (box_iou(box_px[None], others_px) >= config.same_iou).any():
            continue
        crop = look(image, crop_around(box_px)).next_crop
        if keep(look(image, crop), n_pieces):
            kept[-1]["crop"] = _plain_crop(crop)
            n_pieces += 1
    return kept


def _as_plain(person: Person, piece: int, image: np.ndarray) -> _Seen:
    return {
        "piece": piece,
        "score": person.score,
        "box_px": person.box_px.tolist(),
        "next_crop": _plain_crop(person.next_crop),
        "image_px": person.image_px.round(3).tolist(),
        "world_m": person.world_m.round(5).tolist(),
        "visibility": person.visibility.round(5).tolist(),
        "colours": _colours(image, person.mask).round(4).tolist(),
    }


def _plain_crop(crop: Crop) -> list[float]:
    return [*crop.centre_px.tolist(), crop.side_px, crop.turn_rad]


def _crop(plain: list[float]) -> Crop:
    return Crop(np.array(plain[:2]), plain[2], plain[3])


def _colours(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(32,) shares of hues and saturations on a person."""
    import cv2

    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    counts = cv2.calcHist([hsv], [0, 1], mask, [HUES, SATURATIONS], [0, 180, 0, 256])
    return np.asarray(counts.ravel() / max(1.0, float(counts.sum())))


def _write(
    frames: list[list[_Seen]],
    images: list[Path],
    size_px: tuple[int, int],
    folder: Path,
    config: LandmarksConfig,
) -> None:
    pieces = _pieces(frames, config.link)
    joined = join_pieces([_sightings(piece) for piece in pieces], config.link)
    people = [[one for number in numbers for one in pieces[number]] for numbers in joined]
    most = max([0, *map(len, people)])
    order = sorted(range(len(people)), key=lambda one: -len(people[one]))
    kept = [one for one in order if len(people[one]) >= max(2, min(config.min_frames, most))]
    numbers = np.array([image_number(image) for image in images], dtype=np.int64)
    for n, one in enumerate(kept):
        _track(people[one], numbers).write(folder / person_file(n))
    LandmarksRecord(
        size_px=size_px,
        images=len(images),
        people=tuple(
            PersonFacts(
                images=len(people[one]),
                first_image=int(numbers[people[one][0][0]]),
                last_image=int(numbers[people[one][-1][0]]),
                pieces=len(joined[one]),
            )
            for one in kept
        ),
        left_out=tuple(len(people[one]) for one in order if one not in kept),
    ).write(folder / LANDMARKS_FILE)


_Piece = list[tuple[int, _Seen]]
"""One person in a run of frames, by the frame's row."""


def _pieces(frames: list[list[_Seen]], config: LinkConfig) -> list[_Piece]:
    """Pieces as they were followed, cut where another person took over."""
    followed: dict[int, _Piece] = {}
    for row, frame in enumerate(frames):
        for seen in frame:
            followed.setdefault(seen["piece"], []).append((row, seen))
    pieces = []
    for piece in followed.values():
        edges = [0, *cuts_in(_sightings(piece), config), len(piece)]
        pieces += [piece[start:stop] for start, stop in pairwise(edges)]
    return pieces


def _sightings(piece: _Piece) -> list[Sighting]:
    return [Sighting(row, np.array(one["crop"]), np.array(one["colours"])) for row, one in piece]


def _track(seen: _Piece, numbers: np.ndarray) -> LandmarkTrack:
    def column(key: str) -> np.ndarray:
        return np.array([one[key] for _, one in seen], dtype=np.float64)

    return LandmarkTrack(
        image_numbers=numbers[[row for row, _ in seen]],
        image_px=column("image_px"),
        world_m=column("world_m"),
        visibility=column("visibility"),
        scores=column("score"),
        crops=column("crop"),
    )
