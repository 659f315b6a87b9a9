"""What the stages of one sequence of 3DPW left, as far as it can be read, and its pictures."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from gmrdata.pages.frames import jpeg_image, masked_tile
from gmrdata.pages.solved import Reader, Solved, read_people, read_reconstruction, reasons_by_person
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import number_in_name, read_color, read_gray
from gmrdata.read.threedpw_layout import SequenceFiles, require_inside
from gmrdata.threedpw.people import DATASET_CAMERA_FILE, DOUBTS_FILE, PEOPLE_FILE, PeopleRecord
from gmrdata.threedpw.recipe import SetPaths
from gmrdata.threedpw.regenerate import SequenceVerdict
from gmrdata.values.errors import GmrdataError
from gmrdata.world.quality import load_record
from gmrdata.world.verdict import Doubts, load_dataset_camera


@dataclass(frozen=True, eq=False, kw_only=True)
class Found(Solved):
    """A sequence of 3DPW with T frames and P people, and what the data set itself says of it."""

    verdict: SequenceVerdict
    message: str  # the whole message if it could not be regenerated; else empty
    files: SequenceFiles | None  # None where the name can't be trusted: nothing of it is opened
    people: PeopleRecord | None
    doubts: tuple[tuple[str, ...], ...]  # (P, T) why the data set doubts a frame; else empty

    @property
    def name(self) -> str:
        """As it stands in the data set: any text."""
        return self.verdict.sequence


def gather(
    verdict: SequenceVerdict, message: str, files: SequenceFiles | None, paths: SetPaths
) -> Found:
    """Read what there is of one sequence; what can't be read is named in `missing`."""
    reader = Reader()
    name = "" if files is None else files.name
    sequence_dir, pseudo_gt_dir = paths.sequence_dir(name), paths.pseudo_gt_dir(name)
    people_dir = sequence_dir / "people"
    is_read = files is not None and people_dir.is_dir()
    people = reader.read(PeopleRecord.read, people_dir / PEOPLE_FILE) if is_read else None
    doubts = reader.read(Doubts.read, people_dir / DOUBTS_FILE) if is_read else None
    by_set = () if doubts is None else doubts.frames
    # What an earlier run left of a sequence that now failed is not this run's answer.
    is_done = files is not None and not message
    record = reader.read(load_record, pseudo_gt_dir) if is_done else None
    is_solved = record is not None and record.cameras is not None
    dataset_camera = None
    if is_solved:
        dataset_camera = reader.read(load_dataset_camera, people_dir / DATASET_CAMERA_FILE)
    return Found(
        verdict=verdict,
        message=message,
        files=files,
        people=people,
        doubts=by_set,
        record=record,
        reasons=reasons_by_person(record) or by_set,
        clips=read_people(reader, pseudo_gt_dir, record) if is_solved else {},
        reconstruction=read_reconstruction(reader, sequence_dir / "sfm") if is_solved else None,
        dataset_camera=dataset_camera,
        missing=tuple(reader.missing),
    )


TILE_WIDTH_PX = 260
JPEG_QUALITY = 80


@dataclass(frozen=True, eq=False)
class Tile:
    image_number: int
    picture: np.ndarray | None  # (h, w, 3) BGR, the masked part tinted; None if it can't be read
    problem: str  # why there is no picture, or no mask on it; else empty

    @property
    def shown(self) -> Markup | None:
        name = f"frame {self.image_number}"
        return None if self.picture is None else jpeg_image(self.picture, name, JPEG_QUALITY)


def image_numbers(files: SequenceFiles) -> list[int]:
    """Numbers of the images that lie in a sequence's folder, in order; none if it leads out."""
    try:
        require_inside(files.root, files.image_dir)
    except GmrdataError:
        return []
    found = [number_in_name(path.name) for path in files.image_dir.glob("image_*.jpg")]
    return sorted(number for number in found if number is not None)


def read_tile(files: SequenceFiles, masks_dir: Path, number: int) -> Tile:
    """One frame with its mask; a file that can't be read is named, and no error."""
    path = files.image_path(number)
    try:
        # A link could show a file from anywhere on the page.
        require_inside(files.root, path)
        image = read_color(path)
    except (GmrdataError, OSError) as error:
        return Tile(number, None, str(error))
    mask, problem = np.zeros(image.shape[:2], np.uint8), "no masks were made"
    if masks_dir.is_dir():
        try:
            mask = read_gray(find_mask(masks_dir, path), (image.shape[1], image.shape[0]))
            problem = ""
        except (GmrdataError, OSError) as error:
            problem = str(error)
    return Tile(number, masked_tile(image, mask, TILE_WIDTH_PX), problem)
