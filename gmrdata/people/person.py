"""Masks of people's outlines: a detector starts the landmark network, which follows each person."""

import shutil
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.people.boxes import box_iou, fill_boxes
from gmrdata.people.landmark_network import (
    LandmarkNetwork,
    Person,
    crop_around,
    open_landmark_network,
)
from gmrdata.people.onnx import OnnxConfig, detect_all
from gmrdata.people.silhouette import dilate
from gmrdata.read.frames import check_images, list_images, read_color, read_gray, write_gray
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.records import Config


class PersonMaskConfig(Config):
    """How people are found, followed and masked."""

    min_detector_score: float = Field(default=0.35, gt=0, le=1)
    """A box that reaches this score starts a person, or is masked if it shows none."""
    min_score: float = Field(default=0.5, gt=0, le=1)
    """A person is followed while the landmark network's score reaches this."""
    same_iou: float = Field(default=0.4, gt=0, le=1)
    """Overlap of two boxes from which they are of one person."""
    min_filled: float = Field(default=0.3, ge=0, le=1)
    """A box of which outlines fill less is filled itself, if none of them has the same box."""
    dilate_px: int = Field(default=8, ge=0, le=1000)
    """Radius by which outlines and boxes are widened [px]."""


def person_masks(
    detector_path: Path,
    landmarks_path: Path,
    images_dir: Path,
    out_dir: Path,
    config: PersonMaskConfig,
    *,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: `<image stem>.png` per image, 255 on people.

    Whom the detector sees is followed from frame to frame, forward and back to where the person
    came into view.  Whom the landmark network does not see gets the detector's box.  A run that was
    stopped goes on at the next frame that the detector has not seen.

    The detector is YOLOX on COCO's 80 classes as an ONNX file, the landmark network BlazePose GHUM
    lite as a TFLite file; BadDetector where one is no such network.
    """

    def work(partial: Path) -> None:
        images = list_images(images_dir, left_out)
        check_images(images)
        look = open_landmark_network(landmarks_path)
        least = config.min_detector_score
        people = OnnxConfig(classes=("person",), min_score=least, weak_score=least)
        found = detect_all(detector_path, images, partial, people)
        boxes_px = [frame.boxes_px for frame in found]
        _Clip(images, boxes_px, partial, config, look, defaultdict(list)).mask_all()
        shutil.rmtree(partial / "seen")

    inputs = {"detector": detector_path, "landmarks": landmarks_path, "images": images_dir}
    return run_stage("person_masks", out_dir, config, inputs, work, resumable=True, run=run)


@dataclass(eq=False)
class _Clip:
    """The masks of a clip while they are made; their files take on whom a later frame shows."""

    images: list[Path]
    boxes_px: list[np.ndarray]  # (N, 4) of the detector, by frame [px]
    masks_dir: Path
    config: PersonMaskConfig
    look: LandmarkNetwork
    outlined_px: defaultdict[int, list[np.ndarray]]
    """By a frame's row: boxes (4,) of the outlines in its mask [px]."""

    def mask_all(self) -> None:
        """Go through the frames once, and from each newcomer back."""
        people: list[Person] = []
        for row, path in enumerate(with_bar(self.images, "masking people")):
            image = read_color(path)
            people = self._follow(people, image, row)
            for box_px in self.boxes_px[row]:
                if not self._is_outlined(box_px, row):
                    person = self._look_around(image, box_px)
                    if self._outline(person, row):
                        people.append(person)
                        self._follow_back(person, row)
            outlines = np.zeros(image.shape[:2], np.uint8)
            for person in people:
                outlines |= person.mask
            self._widen(row, self._boxes_without(outlines, row))

    def _follow(self, people: list[Person], image: np.ndarray, row: int) -> list[Person]:
        """Outline the same people in another frame; two who have become one are one."""
        kept = []
        for person in people:
            found = self.look(image, person.next_crop)
            if self._outline(found, row):
                kept.append(found)
        return kept

    def _follow_back(self, person: Person, row: int) -> None:
        """Outline a newcomer in the frames before, until lost or met by another outline."""
        people = [person]
        while people and row > 0:
            row -= 1
            people = self._follow(people, read_color(self.images[row]), row)

    def _look_around(self, image: np.ndarray, box_px: np.ndarray) -> Person:
        """The person in a box, seen in the crop that landmarks give: the network knows such."""
        person = self.look(image, crop_around(box_px))
        if person.score >= self.config.min_score:
            person = self.look(image, person.next_crop)
        return person

    def _outline(self, person: Person, row: int) -> bool:
        """Put a person into a frame's mask; False if there is none, or one outlined already."""
        if person.score < self.config.min_score or not person.mask.any():
            return False
        if self._is_outlined(person.box_px, row):
            return False
        self.outlined_px[row].append(person.box_px)
        self._widen(row, person.mask)
        return True

    def _is_outlined(self, box_px: np.ndarray, row: int) -> bool:
        others_px = np.array(self.outlined_px[row]).reshape(-1, 4)
        return bool((box_iou(box_px[None], others_px) >= self.config.same_iou).any())

    def _boxes_without(self, outlines: np.ndarray, row: int) -> np.ndarray:
        """The boxes in which there is no outline of a person, filled."""
        size_px = (outlines.shape[1], outlines.shape[0])
        filled = np.zeros_like(outlines)
        for box_px in self.boxes_px[row]:
            box = fill_boxes(box_px[None], size_px)
            share = np.count_nonzero(outlines & box) / max(1, np.count_nonzero(box))
            if share < self.config.min_filled and not self._is_outlined(box_px, row):
                filled |= box
        return filled

    def _widen(self, row: int, mask: np.ndarray) -> None:
        """Add a mask (H, W), 255 inside, to a frame's."""
        path = self.masks_dir / f"{self.images[row].stem}.png"
        if not path.is_file():
            write_gray(path, dilate(mask, self.config.dilate_px))
        elif mask.any():
            write_gray(path, read_gray(path) | dilate(mask, self.config.dilate_px))
