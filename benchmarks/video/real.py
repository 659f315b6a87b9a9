"""Real videos through `gmrdata video`, lens unknown: right or rejected, also by other ways.

    python benchmarks/video/real.py VIDEOS OUT [NAME ...]

VIDEOS holds the files that `CLIPS` names, or folders NAME of images and NAME_masks of masks.  They
are fetched for reading and not committed; a missing one is said.  Each is solved as a user would,
and again backward, by every second frame and by two other seeds.  An accepted clip is wrong where
another way gives another path (1 degree, 3 % of the extent), where the camera does otherwise than a
person sees in the pictures, or where a known focal length is off.  Frames are few and small.
`PYTHONPATH=benchmarks` finds what the measurements share.
"""

import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from networks import networks_in
from render.tables import show

from gmrdata.cameras.again import AGAIN_FILE, AgainRecord, solve_again
from gmrdata.cameras.files import Geometry, load_quality
from gmrdata.cameras.lens.intrinsics import IntrinsicsConfig, load_intrinsics
from gmrdata.cameras.lens.self_calibration import SelfCalibrationConfig
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.people.sources import FolderSource, MasksConfig, masks_named
from gmrdata.read.frames import list_images, read_frames
from gmrdata.read.video import VideoConfig
from gmrdata.solve.request import FRAMES, MASKS, QUICK_SFM, SFM, SolveConfig
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.solve.videos import solve_video
from gmrdata.values.files import write_json

LONGEST_PX = 640
FOLDER_FPS_HZ = 15.0  # of a folder of images, about
IN_PLACE: tuple[Geometry, ...] = ("static", "rotation_only")
ANY: tuple[Geometry, ...] = ("static", "rotation_only", "full")


@dataclass(frozen=True)
class RealVideo:
    """A video, the part that is taken, and what a person sees in its pictures."""

    file: str
    """A video, or a folder of images, in the folder of videos."""
    shows: str
    right: tuple[Geometry, ...]
    """What the camera may be said to do."""
    to_s: float
    every: int
    masks: tuple[str, ...] = ("person",)
    focal: float | None = None
    """Focal length over the longer side, where it is known; it is not told."""


CLIPS = {
    "dog": RealVideo("dog.mp4", "a hand's camera before a running dog", ("full",), 4.1, 3,
                     ("onnx",)),
    "static_people": RealVideo("static_people", "a tripod, two people and traffic", IN_PLACE, 0, 1),
    "dancer": RealVideo("dance", "a phone, upright, about a dancer", ("full",), 0, 1,
                        focal=0.747),
    "bear": RealVideo("bear.mp4", "a camera that follows a bear", ANY, 9, 2, ("onnx",)),
    "street": RealVideo("openpose.avi", "a pan over a crowded street", ANY, 9, 4),
    "juggler": RealVideo("05_default_juggle.mp4", "a tripod on grass under trees", IN_PLACE, 9, 5),
    "backpack": RealVideo("backpack.mp4", "a phone, upright, a person fills half", ANY, 9, 2),
    "sign": RealVideo("asl_walk.mkv", "a still camera, uneven times", IN_PLACE, 9, 2),
    "glider": RealVideo("paragliding-launch.mp4", "a pan after a glider", ANY, 9, 2),
    "bedroom": RealVideo("bedroom.mp4", "a hand's camera, children jump on a bed", ANY, 9, 4),
    "dog_walker": RealVideo("01_dog.mp4", "a tripod, a person and a dog", IN_PLACE, 9, 6),
    "apple": RealVideo("apple.mp4", "a phone about an apple", ("full",), 9, 1, ("none",)),
    "queue": RealVideo("one_by_one.mp4", "a fixed camera, people pass", IN_PLACE, 40, 8),
    "tennis": RealVideo("tennis.mp4", "a player, variable rate", ANY, 9, 5),
}  # fmt: skip
"""From repositories that show them: facebookresearch/sam2 (demo/data/gallery, notebooks/videos),
facebookresearch/co-tracker (gradio_demo/videos), CMU-Perceptual-Computing-Lab/openpose
(examples/media), intel-iot-devkit/sample-videos and zju3dv/GVHMR (docs/example_video)."""


@dataclass(frozen=True)
class RealRow:
    """What came of one video."""

    name: str
    shows: str
    accepted: bool
    wrong: bool
    """Accepted, and not right."""
    reasons: tuple[str, ...]
    frames: int
    geometry: str | None
    focal_px: float | None
    focal_sigma: float | None
    focal_source: str | None
    disagreement: tuple[str, ...]
    """What other ways say against it; empty where they all agree."""
    ways: tuple[tuple[str, str | None, float | None, float | None], ...]
    """Name, geometry, turn [degrees] and place [share of the extent] of the other ways."""
    against: str
    """What a person or known cameras say against it."""


def real_row(name: str, videos: Path, out: Path, models: Path) -> RealRow:
    """Solve one video, and again the other ways."""
    clip, folder = CLIPS[name], out / name
    source = _source(videos, name)
    if source.is_dir():
        source = _renumbered(source, folder / "images")
    path = solve_video(
        source,
        folder,
        poses="none",
        config=(config := _config(clip, models, videos / f"{name}_masks")),
        part=None if source.is_dir() else VideoConfig(to_s=clip.to_s, every=clip.every),
        fps_hz=FOLDER_FPS_HZ if source.is_dir() else None,
    )
    verdict = VideoVerdict.read(path)
    lens = load_intrinsics(folder / "intrinsics")
    row = RealRow(
        name, clip.shows, verdict.accepted, False, verdict.reasons, verdict.camera.frames, None,
        round(lens.focal_px, 1), round(lens.focal_sigma, 4), lens.source, (), (), "",
    )  # fmt: skip
    if not (folder / SFM).is_dir():
        return row
    images = source if source.is_dir() else folder / FRAMES
    masks = None if config.masks is None else folder / MASKS
    again = solve_again(folder / SFM, read_frames(images), masks, folder / "ways", config.sfm)
    record, quality = AgainRecord.read(again / AGAIN_FILE), load_quality(folder / SFM)
    against = "" if quality.geometry in clip.right else f"the camera is not {quality.geometry}"
    if clip.focal is not None:
        true_px = clip.focal * max(lens.width_px, lens.height_px)
        against += _focal_error(lens.focal_px, lens.focal_sigma, true_px)
    said = tuple(record.reasons(config.pseudo_gt.verdict))
    ways = tuple(
        (one.name, one.geometry, one.agreement and one.agreement.turn_deg,
         one.agreement and one.agreement.place_share)
        for one in record.solutions
    )  # fmt: skip
    values = asdict(row) | {"geometry": quality.geometry, "disagreement": said, "ways": ways}
    values |= {"against": against, "wrong": verdict.accepted and bool(said or against)}
    return RealRow(**values)


def real_rows(
    videos: Path, out: Path, models: Path, names: Sequence[str] = tuple(CLIPS)
) -> Iterator[RealRow]:
    """Rows of the videos that are there; each is written to `out` as soon as it is known."""
    for name in names:
        if _source(videos, name).exists():
            row = real_row(name, videos, out, models)
            write_json(out / f"{name}.json", asdict(row))
            yield row


def missing(videos: Path) -> list[str]:
    """Videos that are not there."""
    return [name for name in CLIPS if not _source(videos, name).exists()]


def real_figures(rows: Sequence[RealRow]) -> dict[str, Any]:
    """The figures of `video.json`."""
    return {
        "real_clips": [asdict(row) for row in rows],
        "real_wrong": sum(row.wrong for row in rows),
        "real_accepted": sum(row.accepted for row in rows),
    }


def _source(videos: Path, name: str) -> Path:
    """The folder NAME of images where there is one, with NAME_masks beside it, else the file."""
    return videos / name if (videos / name).is_dir() else videos / CLIPS[name].file


def _config(clip: RealVideo, models: Path, given_masks: Path) -> SolveConfig:
    masks: MasksConfig | None = None
    if given_masks.is_dir():
        masks = MasksConfig(sources=(FolderSource(path=given_masks),))
    elif clip.masks != ("none",):
        networks, person = networks_in(models), "person" in clip.masks
        landmarks = networks.landmarks if person else None
        masks = masks_named(clip.masks, detector=networks.detector, landmark_network=landmarks)
    calibration = SelfCalibrationConfig(max_image_size_px=LONGEST_PX)
    return SolveConfig(
        masks=masks,
        intrinsics=IntrinsicsConfig(self_calibration=calibration),
        sfm=SfmConfig.model_validate(QUICK_SFM.model_dump() | {"max_image_size_px": LONGEST_PX}),
    )


def _renumbered(images: Path, folder: Path, most: int = 51) -> Path:
    """Copies of a folder's images under consecutive numbers, of the first ones or every second."""
    if not folder.is_dir():
        folder.mkdir(parents=True)
        found = sorted(p for p in images.iterdir() if p.suffix in (".jpg", ".png"))[: 2 * most]
        step = 2 if len(found) > most else 1
        for number, path in enumerate(found[::step]):
            shutil.copyfile(path, folder / f"{number:05d}{path.suffix}")
    assert len(list_images(folder)) > 1
    return folder


def _focal_error(focal_px: float, sigma: float, true_px: float) -> str:
    off = focal_px / true_px - 1.0
    return "" if abs(off) <= max(0.03, 2 * sigma) else f"the focal length is {off:+.1%} off"


def main(videos: Path, out: Path, names: Sequence[str]) -> None:
    models = Path("../shared/data/models")
    rows = list(real_rows(videos, out, models, names or tuple(CLIPS)))
    table = [
        {
            "clip": row.name,
            "accepted": row.accepted,
            "wrong": row.wrong,
            "camera": row.geometry,
            "said": "; ".join([*row.reasons, *row.disagreement, row.against]),
        }
        for row in rows
    ]
    show("Real videos", table)
    figures = real_figures(rows)
    show("Together", [{"clips": len(rows), "missing": ", ".join(missing(videos))}])
    write_json(out / "real.json", figures)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
