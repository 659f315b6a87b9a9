"""Stage: people detected and followed through a sequence, once, for all that is made from it.

    followed.json                   who is seen, and when; the detector's boxes of each frame
    sightings.npz                   each person in each frame (`Sightings`)
    outlines/<stem>_<piece>.png     255 on the person

A detector starts the landmark network, which follows each person by its own landmarks, forward and
back to where the person came into view.  Where a person is lost and found again, `linking` joins
the pieces.
"""

import json
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass as part

from gmrdata.people.landmark_body import legs_hidden
from gmrdata.people.landmark_network import (
    LANDMARKS,
    LIMBS,
    N_LANDMARKS,
    LandmarkNetwork,
    PersonInCrop,
    Square,
    crop_around,
    look_mirrored,
    open_landmark_network,
    seen_twice,
)
from gmrdata.people.linking import (
    Detection,
    Detections,
    LinkConfig,
    Piece,
    box_iou,
    cuts_in,
    detections_as_json,
    join_pieces,
    unsure_pairs,
)
from gmrdata.people.onnx import Detector, OnnxConfig, detect_once, open_detector
from gmrdata.read.frames import read_color, write_gray
from gmrdata.read.models import POSE_LANDMARKS, QUICK_LANDMARKS, YOLOX_NANO, find_model
from gmrdata.stage.jobs import made_ahead
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.files import read_json, write_npz, write_text
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import PART, ArrayShapes, Config, Record, check_shapes, read_arrays

FOLLOWED_FILE, SIGHTINGS_FILE, OUTLINES_FOLDER = "followed.json", "sightings.npz", "outlines"
SIGHTINGS_FORMAT = "gmrdata-sightings/1"
MOST_NAMED = 3  # people in one line; of a crowd the record has the rest
CLOSER, TOUCHING = 0.85, 0.05
"""Side of a crop that shows less of other people, and overlap of boxes from which they may mix."""
ENDS = {
    f"{side} {part}": LANDMARKS.index(f"{side}_{joint}")
    for part, joint in (("hand", "wrist"), ("foot", "ankle"))
    for side in ("left", "right")
}
CUT_OFF = 0.2  # share of frames in which limbs are out of the picture or hidden, that is said
WIDE = 0.9
"""Width of a box over its height, from which somebody may lie or bend down: 0.3 to 0.7 of people
who stand or stride, also with arms stretched out, 1.2 and more of who sits on a floor or lies."""
TURNS_DEG = (0.0, -45.0, 45.0, -90.0, 90.0)  # of crops in which such a one is looked for
HARDLY_REACHES, HEAD_DOWN_REACHES, BETTER_REACH = 0.55, 0.6, 0.1
"""How little landmarks reach as the outline does, of 0 to 1, where somebody may be head down; how
far they do then, and by how much more.  Of 208 upright people nobody is so, nor up to 0.7; of 103
who are found in the same pictures upside down 55."""
SAME_HEAD = 0.2
"""How far apart boxes begin that begin at one head, as a share of the shorter one's height."""
GROWS, MOST_LOOKS, GREW = 1.01, 12, 1.15
"""Growth of a crop from which a first look is taken again in the larger one, and how often: a whole
body that was squeezed into a box of its upper half is as large as it should be after ten.  That of
all looks from which it was: 1.5 to 2 there, and 1.05 of people of whom all is seen."""
HUES, SATURATIONS = 8, 4
"""Bins of the colours by which a person is known again."""


class FollowConfig(Config):
    """How people are found, followed and known again."""

    min_detector_score: float = Field(default=0.35, gt=0, le=1)
    """A box that reaches this score starts a person, or is masked if it shows none."""
    min_score: float = Field(default=0.5, gt=0, le=1)
    """A person is followed while the landmark network's score reaches this."""
    same_iou: float = Field(default=0.4, gt=0, le=1)
    """Overlap of two boxes from which they are of one person."""
    max_unlike: float = Field(default=0.05, gt=0)
    """Mean distance of limbs, in sides of the crop, to those that a closer look shows, of a person
    whose box another's touches, or who has two: 0.03 and less where both are the person, mostly
    0.06 and more where the network makes one body of two people."""
    link: LinkConfig = LinkConfig()
    min_frames: int = Field(default=10, ge=2)
    """Who is seen in fewer frames has no poses; the one seen in most of them only if in one frame
    alone."""


class _FollowedAt(FollowConfig):
    """The stage's recipe: who is joined to whom also depends on how fast frames follow."""

    rate_hz: float
    landmarks: str = "of two looks, from the picture's corner"
    """Folders of former versions, of one look or half a pixel off, are not taken for these."""


class Networks(NamedTuple):
    """Files of the two networks."""

    detector: Path
    """YOLOX on COCO's 80 classes (ONNX)."""
    landmarks: Path
    """BlazePose GHUM heavy (TFLite); lite and full are of the same form."""

    @classmethod
    def find(
        cls, detector: Path | None = None, landmarks: Path | None = None, *, quick: bool = False
    ) -> Self:
        """The given files, or those of `gmrdata fetch models`, `quick` with lite; errors as of
        `find_model`."""
        network = QUICK_LANDMARKS if quick else POSE_LANDMARKS
        return cls(find_model(YOLOX_NANO, detector), find_model(network, landmarks))


Seen = dict[str, Any]
"""One of them while people are followed: plain numbers by name."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """People in frames, N of them: by frame, then by piece; of one person over its frames."""

    image_numbers: np.ndarray  # (N,) int, as in the images' names
    people: np.ndarray  # (N,) int: number of the person; -1 for who is seen in too few frames
    pieces: np.ndarray  # (N,) int: number of the run in which it was followed without a gap
    boxes_px: np.ndarray  # (N, 4) left, top, right, bottom of the outline [px]
    image_px: np.ndarray  # (N, 33, 2) as the picture has them, bent by its lens [px]
    world_m: np.ndarray
    """(N, 33, 3) from the middle of the hips [m], in the axes of the camera as far as a crop tells:
    along the ray through its middle."""
    visibility: np.ndarray  # (N, 33) from 0 to 1
    scores: np.ndarray  # (N,) from 0 to 1: that there is a person
    crops: np.ndarray  # (N, 4) what the network saw: centre x and y, side [px], turn [rad]
    next_crops: np.ndarray  # (N, 4) where its landmarks say that the person is
    colours: np.ndarray  # (N, 32) shares of hues and saturations, or of greys

    def __len__(self) -> int:
        return len(self.pieces)

    def take(self, rows: np.ndarray | slice) -> Self:
        """Some of them, by place or by what is true of them."""
        return type(self)(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})

    @classmethod
    def of(cls, seen: Sequence[Seen]) -> Self:
        """Of values by name, one after the other."""
        return cls(
            **{
                key: np.array(
                    [one[key] for one in seen], dtype=np.int64 if "i" in kinds else np.float64
                ).reshape(-1, *shape[1:])
                for key, (kinds, shape) in _SHAPES.items()
            }
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Of one or more, one after the other."""
        return cls(**{key: np.concatenate([getattr(one, key) for one in parts]) for key in _SHAPES})

    def write(self, path: Path) -> None:
        """Write them as an .npz without pickled objects."""
        arrays = {key: getattr(self, key) for key in _SHAPES}
        check_shapes(path, arrays, _SHAPES)
        write_npz(path, {"format": SIGHTINGS_FORMAT} | arrays)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read them; BadRecord names what is wrong with the file."""
        return cls(**read_arrays(path, SIGHTINGS_FORMAT, _SHAPES))


_SHAPES: ArrayShapes = {
    "image_numbers": ("iu", ("N",)),
    "people": ("i", ("N",)),
    "pieces": ("iu", ("N",)),
    "boxes_px": ("f", ("N", 4)),
    "image_px": ("f", ("N", N_LANDMARKS, 2)),
    "world_m": ("f", ("N", N_LANDMARKS, 3)),
    "visibility": ("f", ("N", N_LANDMARKS)),
    "scores": ("f", ("N",)),
    "crops": ("f", ("N", 4)),
    "next_crops": ("f", ("N", 4)),
    "colours": ("f", ("N", HUES * SATURATIONS)),
}


@part(frozen=True, config=PART)
class PersonFacts:
    """One person of the sequence."""

    images: PositiveInt
    """In which the person is seen."""
    seen: tuple[tuple[int, int], ...]
    """First and last image of each run of frames in which it is."""
    may_be: tuple[int, ...]
    """Numbers of people who may be the same one: never seen together, and in like colours."""
    unsure_from: tuple[int, ...]
    """First images of parts that were joined to it, and which may be of another."""


class FollowedRecord(Record):
    """`followed.json`: who is seen, and when."""

    format: Literal["gmrdata-followed/2"] = "gmrdata-followed/2"
    size_px: tuple[int, int]
    images: tuple[int, ...]
    """Their numbers, rising."""
    detections: tuple[list[Detection], ...]
    """The detector's boxes in each image."""
    people: tuple[PersonFacts, ...]
    """By number: who is seen in most frames comes first."""
    left_out: tuple[int, ...]
    """Frames of each one who is seen in too few."""

    def doubts(self) -> tuple[str, ...]:
        """What one should know of who is who: a line for each person who may be one before, and for
        each who may be several."""
        may_be = (
            f"person {number} may be {_one_of(others)}: they are never seen in one frame"
            for number, person in enumerate(self.people)
            if (others := [other for other in person.may_be if other < number])
        )
        may_change = (
            f"person {number} may be another from image {_some_of(person.unsure_from)} on: it was "
            "found again, and place and colours don't make it sure"
            for number, person in enumerate(self.people)
            if person.unsure_from
        )
        return (*may_be, *may_change)


def _one_of(people: Sequence[int]) -> str:
    """Some people in words, by their numbers."""
    if len(people) > MOST_NAMED:
        return f"one of {len(people)} before it ({FOLLOWED_FILE} has them)"
    return f"person {_some_of(people)}"


def _some_of(numbers: Sequence[int]) -> str:
    """A few numbers in words."""
    more = ["a later one"] if len(numbers) > MOST_NAMED else []
    return " or ".join([*map(str, numbers[:MOST_NAMED]), *more])


def follow_people(
    frames: FrameSet,
    out_dir: Path,
    config: FollowConfig,
    networks: Networks,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: detect and follow everybody.

    A run that was stopped goes on at the next frame that it has not seen.  A sequence without
    people leaves a record without people.  BadDetector where a file is no such network.
    """

    recipe = _FollowedAt(**dict(config), rate_hz=frames.known_or_usual_hz)

    def work(partial: Path) -> None:
        look, other = (open_landmark_network(networks.landmarks) for _ in range(2))
        least = config.min_detector_score
        people = OnnxConfig(classes=("person",), min_score=least, weak_score=least)
        detect = open_detector(networks.detector, people)
        with ThreadPoolExecutor(1) as beside:

            def mirrored(image: np.ndarray, crop: Square) -> Future[PersonInCrop]:
                return beside.submit(look_mirrored, other, image, crop)

            follower = _Follower(frames, partial, config, detect, look, mirrored)
            sightings = follower.all_sightings()
        known, facts, seldom = _known_people(sightings, frames.numbers, recipe)
        known.write(partial / SIGHTINGS_FILE)
        FollowedRecord(
            size_px=frames.size_px,
            images=tuple(frames.numbers.tolist()),
            detections=tuple(map(detections_as_json, follower.detections)),
            people=facts,
            left_out=seldom,
        ).write(partial / FOLLOWED_FILE)
        for folder in ("seen", FRAMES_FOLDER):
            shutil.rmtree(partial / folder)

    inputs = networks._asdict() | frames.inputs
    return run_stage("followed", out_dir, recipe, inputs, Resumable(work), run=run)


def cut_off(people: Sequence[Sightings], size_px: tuple[int, int]) -> Iterator[str]:
    """Which hands and feet are out of pictures of that (width, height), and else whose legs are
    hidden: a line for each person of whom that is so in more than `CUT_OFF` of the frames."""
    for number, person in enumerate(people):
        ends_px = person.image_px[:, list(ENDS.values())]
        outside = np.any((ends_px < 0) | (ends_px > size_px), axis=-1)
        said = [
            f"{name} in {count}"
            for name, count in zip(ENDS, outside.sum(axis=0).tolist(), strict=True)
            if count > CUT_OFF * len(person)
        ]
        hidden = int(np.count_nonzero(legs_hidden(person.visibility)))
        where = f"of {len(person)} frames, where their pose is a guess"
        if said:
            yield f"person {number} is cut off by the picture: {', '.join(said)} {where}"
        elif hidden > CUT_OFF * len(person):
            yield f"the legs of person {number} are hidden in {hidden} {where}"


def load_tracks(followed_dir: Path) -> list[Sightings]:
    """The people of a finished folder; BadRecord where a file is not whole."""
    sightings = Sightings.read(followed_dir / SIGHTINGS_FILE)
    n_people = len(FollowedRecord.read(followed_dir / FOLLOWED_FILE).people)
    return [sightings.take(sightings.people == number) for number in range(n_people)]


FRAMES_FOLDER = "frames"
"""Of the unfinished stage: whom each frame's turn brought, also in the frames before."""


@dataclass(eq=False)
class _Follower:
    """People of a sequence while they are followed."""

    frames: FrameSet
    folder: Path
    config: FollowConfig
    detect: Detector
    look: LandmarkNetwork
    mirrored: Callable[[np.ndarray, Square], Future[PersonInCrop]]
    """`look_mirrored` by a network of its own, in another thread."""
    detections: list[Detections] = field(default_factory=list)  # of the frames gone through
    n_pieces: int = 0
    met_px: defaultdict[int, dict[int, np.ndarray]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    """By a frame's row and a piece: box (4,) of the person in it [px]."""

    def all_sightings(self) -> Sightings:
        """Go through the frames once, and from each newcomer back."""
        row_of = {number: row for row, number in enumerate(self.frames.numbers.tolist())}
        everybody: list[Sightings] = []
        before: list[Seen] = []
        images = self.frames.paths
        # The detector is a frame or two ahead of the landmark network.
        looked = made_ahead(partial(detect_once, self.detect, partial=self.folder), images)
        for row, (picture, detections) in enumerate(
            with_bar(looked, "following people", len(images))
        ):
            self.detections.append(detections)
            path = self.folder / FRAMES_FOLDER / f"{images[row].stem}.json"
            if not path.is_file():
                picture = read_color(images[row]) if picture is None else picture
                # Without line breaks, which Python's own slow encoder writes.
                write_text(path, json.dumps(self._turn(before, picture, row), allow_nan=False))
            # Read back, so that a resumed run works on the very same numbers.
            seen: list[Seen] = read_json(path)
            for one in seen:
                self.met_px[row_of[one["image_numbers"]]][one["pieces"]] = one["boxes_px"]
            self.n_pieces = max([self.n_pieces, *(one["pieces"] + 1 for one in seen)])
            before = [one for one in seen if row_of[one["image_numbers"]] == row]
            everybody.append(Sightings.of(seen))
        whole = Sightings.joined(everybody)
        return whole.take(np.lexsort((whole.pieces, whole.image_numbers)))

    def _turn(self, before: list[Seen], image: np.ndarray, row: int) -> list[Seen]:
        """Whom the frame before shows, then who is new, who is also followed back."""
        here = self._go_on(before, image, row)
        earlier: list[Seen] = []
        for box_px in self.detections[row].boxes_px:
            if self._is_met(box_px, row):
                continue
            person, crop = self._first_look(image, box_px)
            mirrored = self.mirrored(image, crop)
            newcomer = self._note(person, crop, mirrored, self.n_pieces, image, row)
            if newcomer:
                here += newcomer
                self.n_pieces += 1
                earlier += self._go_back(newcomer, row)
        return here + earlier

    def _first_look(self, image: np.ndarray, box_px: np.ndarray) -> tuple[PersonInCrop, Square]:
        """The person in a detector's box, and the crop in which it was seen.

        Who lies or bends down is wider than tall, and in an upright crop the network, which knows
        upright people, makes up another pose and is sure of it.  So such a one is looked at in
        turned crops, too: where the pose is right, landmarks reach as far as the outline does.
        """
        upright = crop_around(box_px)
        width_px, height_px = box_px[2:] - box_px[:2]
        if width_px < WIDE * height_px:
            return self._grown(image, *self._head_up_or_down(image, upright))
        looks = [
            self._settled(image, replace(upright, turn_rad=turn_rad), 2)
            for turn_rad in np.deg2rad(TURNS_DEG)
        ]
        return self._grown(image, *max(looks, key=lambda one: self._reach(one[0])))

    def _head_up_or_down(self, image: np.ndarray, upright: Square) -> tuple[PersonInCrop, Square]:
        """The person in a crop: head down, as in the picture of a camera that is mounted so, only
        where the upright look shows hardly anything and the other one clearly more."""
        person, crop = self._settled(image, upright, 1)
        if (reach := self._reach(person)) >= HARDLY_REACHES:
            return person, crop
        other, turned = self._settled(image, replace(upright, turn_rad=np.pi), 1)
        clearly = self._reach(other) > max(HEAD_DOWN_REACHES, reach + BETTER_REACH)
        if clearly and other.visibility.mean() > person.visibility.mean():
            return other, turned
        return person, crop

    def _settled(self, image: np.ndarray, crop: Square, times: int) -> tuple[PersonInCrop, Square]:
        """The person in a crop, seen so often in the one that landmarks give: the network knows
        such."""
        person = self.look(image, crop)
        for _ in range(times):
            if person.score < self.config.min_score:
                break
            crop = person.next_crop
            person = self.look(image, crop)
        return person, crop

    def _grown(
        self, image: np.ndarray, person: PersonInCrop, crop: Square
    ) -> tuple[PersonInCrop, Square]:
        """The person in a crop that no longer grows, or shows nobody beyond, where it grew much.
        Of who is hidden below the hips the box shows the upper half, and the network squeezes the
        whole body into it, a little less each time.
        """
        larger, other = person, crop
        for _ in range(MOST_LOOKS):
            wanted = larger.next_crop
            if larger.score < self.config.min_score or wanted.side_px < GROWS * other.side_px:
                break
            seen = self.look(image, wanted)
            if seen.score < self.config.min_score:
                break
            larger, other = seen, wanted
        return (larger, other) if other.side_px > GREW * crop.side_px else (person, crop)

    def _reach(self, person: PersonInCrop) -> float:
        """How far a person's landmarks reach as the outline does, from 0 to 1; less for nobody."""
        if person.score < self.config.min_score:
            return person.score - 1.0
        ends_px = np.concatenate([person.image_px.min(axis=0), person.image_px.max(axis=0)])
        return float(box_iou(ends_px[None], person.box_px[None])[0, 0])

    def _go_on(self, people: list[Seen], image: np.ndarray, row: int) -> list[Seen]:
        """The same people in another frame; two who have become one are one."""
        kept = []
        for one in people:
            x, y, side_px, turn_rad = one["next_crops"]
            crop = Square(np.array([x, y]), side_px, turn_rad)
            mirrored = self.mirrored(image, crop)
            kept += self._note(self.look(image, crop), crop, mirrored, one["pieces"], image, row)
        return kept

    def _go_back(self, people: list[Seen], row: int) -> list[Seen]:
        """A newcomer in the frames before, until lost or met by another."""
        earlier = []
        while people and row > 0:
            row -= 1
            people = self._go_on(people, read_color(self.frames.paths[row]), row)
            earlier += people
        return earlier

    def _note(
        self,
        person: PersonInCrop,
        crop: Square,
        mirrored: Future[PersonInCrop],
        piece: int,
        image: np.ndarray,
        row: int,
    ) -> list[Seen]:
        """A person who was seen in a crop of a frame; nothing where there is none, one who was met
        already, or one body made of two people."""
        if person.score < self.config.min_score or not person.mask.any():
            return []
        if self._is_met(person.box_px, row) or self._shows_another(person, crop, image, row):
            return []
        self.met_px[row][piece] = person.box_px
        write_gray(outline_path(self.folder, self.frames.paths[row], piece), person.mask)
        person = seen_twice(person, mirrored.result(), self.config.min_score)
        seen: Seen = {
            "image_numbers": int(self.frames.numbers[row]),
            "people": -1,
            "pieces": piece,
            "scores": person.score,
        }
        arrays = {
            "boxes_px": person.box_px,
            "image_px": person.image_px.round(3),
            "world_m": person.world_m.round(5),
            "visibility": person.visibility.round(5),
            "crops": crop.as_array,
            "next_crops": person.next_crop.as_array,
            "colours": _colours(image, person.mask).round(4),
        }
        return [seen | {key: values.tolist() for key, values in arrays.items()}]

    def _shows_another(
        self, person: PersonInCrop, crop: Square, image: np.ndarray, row: int
    ) -> bool:
        """Whether a closer look at a person whom others touch, or who has two boxes, shows another
        body: of two people the network may make one, and be sure of it."""
        near = (self.met_px[n].values() for n in (row - 1, row, row + 1))
        detected_px = self.detections[row].boxes_px
        boxes_px = np.array([*detected_px, *chain(*near)]).reshape(-1, 4)
        overlaps = box_iou(person.box_px[None], boxes_px)[0]
        same = overlaps >= self.config.same_iou
        touched = (overlaps > TOUCHING) & ~same
        # One body made of two people has the boxes of both.
        if not touched.any() and np.count_nonzero(same[: len(detected_px)]) < 2:
            return False
        closer = self.look(image, replace(crop, side_px=CLOSER * crop.side_px))
        apart_px = np.linalg.norm(closer.image_px - person.image_px, axis=1)[list(LIMBS)].mean()
        return bool(apart_px > self.config.max_unlike * crop.side_px)

    def _is_met(self, box_px: np.ndarray, row: int) -> bool:
        return is_among(box_px, list(self.met_px[row].values()), self.config.same_iou)


def is_among(
    box_px: np.ndarray, others_px: np.ndarray | Sequence[np.ndarray], same_iou: float
) -> bool:
    """Whether one of some boxes (4,) is of the same person as another.

    Two that begin at one head are compared as far down as the shorter one reaches: of who is hidden
    below the hips a detector's box ends there, and an outline may have the legs as the network
    guesses them.
    """
    others = np.array(others_px).reshape(-1, 4)
    each = np.tile(box_px, (len(others), 1))
    apart_px = np.abs(each[:, 1] - others[:, 1])
    bottom_px = np.minimum(each[:, 3], others[:, 3])
    one_head = apart_px < SAME_HEAD * (bottom_px - others[:, 1])
    each[one_head, 3] = others[one_head, 3] = bottom_px[one_head]
    return bool((box_iou(each, others).diagonal() >= same_iou).any())


def outline_path(followed_dir: Path, image: Path, piece: int) -> Path:
    """The outline of one piece of a person in an image."""
    return followed_dir / OUTLINES_FOLDER / f"{image.stem}_{piece}.png"


def _colours(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(32,) shares of hues and saturations on a person; of how bright it is where all is grey."""
    import cv2

    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    counts = cv2.calcHist([hsv], [0, 1], mask, [HUES, SATURATIONS], [0, 180, 0, 256])
    if not hsv[mask > 0, 1].any():  # neither hue nor saturation tells one from another
        counts[:, 0] = cv2.calcHist([hsv], [2], mask, [HUES], [0, 256]).ravel()
    return np.asarray(counts.ravel() / max(1.0, float(counts.sum())))


def _known_people(
    seen: Sightings, numbers: np.ndarray, config: _FollowedAt
) -> tuple[Sightings, tuple[PersonFacts, ...], tuple[int, ...]]:
    """The same with each person's number; facts of each; frames of those seen in too few."""
    rows = np.searchsorted(numbers, seen.image_numbers)
    cut = [some for piece in np.unique(seen.pieces) for some in _cut(seen, rows, piece, config)]
    pieces = [_piece(seen, rows, some) for some in cut]
    joined, joined_by = join_pieces(pieces, config.link, config.rate_hz)
    joined.sort(key=lambda line: -sum(len(cut[number]) for number in line))
    people = [np.concatenate([cut[number] for number in line]) for line in joined]
    least = max(2, min([config.min_frames, *map(len, people[:1])]))
    kept = [places for places in people if len(places) >= least]
    of = np.full(len(seen), -1, dtype=np.int64)
    for number, places in enumerate(kept):
        of[places] = number
    unsure = unsure_pairs([_piece(seen, rows, places) for places in kept], config.link)
    facts = tuple(
        PersonFacts(
            images=len(places),
            seen=_runs(numbers, rows[places]),
            may_be=tuple(sorted(sum(pair) - n for pair in unsure if n in pair)),
            unsure_from=tuple(
                int(seen.image_numbers[cut[number][0]])
                for number in joined[n][1:]
                if joined_by[number] < config.link.sure
            ),
        )
        for n, places in enumerate(kept)
    )
    known = Sightings(**vars(seen) | {"people": of})
    return known, facts, tuple(len(places) for places in people[len(kept) :])


def _cut(seen: Sightings, rows: np.ndarray, piece: int, config: _FollowedAt) -> list[np.ndarray]:
    """Places of one piece's seen, cut where another person may have taken over."""
    places = np.flatnonzero(seen.pieces == piece)
    cuts = cuts_in(_piece(seen, rows, places), config.link, config.rate_hz)
    return [places[start:stop] for start, stop in pairwise([0, *cuts, len(places)])]


def _piece(seen: Sightings, rows: np.ndarray, places: np.ndarray) -> Piece:
    return Piece(rows[places], seen.crops[places], seen.colours[places])


def _runs(numbers: np.ndarray, rows: np.ndarray) -> tuple[tuple[int, int], ...]:
    """First and last image of each run of rows that follow each other."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return tuple((int(numbers[run[0]]), int(numbers[run[-1]])) for run in runs)
