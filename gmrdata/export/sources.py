"""What any stage left, as clips with all that lies beside them, for whoever hands them on.

A manifest, a clip's file and the folder that a stage left are told apart here and nowhere else.
Whoever writes a clip gets plain values and paths, and knows nothing of manifests.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from gmrdata.cameras.files import CAMERAS_FILE
from gmrdata.film.render import EXTRAS_FOLDER
from gmrdata.manifest.check import require_sound
from gmrdata.manifest.current import READS, ClipEntry, FolderRecord, Manifest
from gmrdata.manifest.read import listed_path, load_entry, read_data_set
from gmrdata.read.bodies import body_files, load_body_once
from gmrdata.read.frames import IMAGE_SUFFIXES, number_in_name
from gmrdata.solve.request import FRAMES, MASKS, SFM
from gmrdata.solve.verdict import FILES, VERDICT_FILE
from gmrdata.stage.store import StageRecord
from gmrdata.values.body import BodyModel, body_of, sized
from gmrdata.values.clip import CLIP_FORMAT, Clip, file_name, load_clip
from gmrdata.values.errors import (
    BadBodyFile,
    BadFrames,
    BadManifest,
    BadMotionFile,
    MissingInput,
    some,
)
from gmrdata.values.files import STAGE_FILE, read_npz, visible
from gmrdata.values.people import FUSED, PSEUDO_GT

MANIFESTS = ("pseudo_gt.yaml", "synthetic.yaml", "motions.yaml", "emdb.yaml")
"""The manifest that stands for a folder with several: a demo's result goes before its truth."""
CLIPS_WITHIN = ("render_set", "predictions")  # the folders of twins, and of a baseline
HEAD_BYTES = 1 << 16  # of a manifest, before its clips
WRONG_BODY_M = 1e-3  # a rest pelvis that far from the clip's own is of another body


@dataclass(frozen=True)
class UnreadClip:
    """Where one clip lies, and what belongs to it.  Nothing was read yet but a manifest."""

    id: str  # fit for the name of a file
    sequence: str  # people of one sequence share a world and a camera
    clip_path: Path
    listed: tuple[Path, ClipEntry] | None = None  # manifest and entry, if a manifest lists it
    images_dir: Path | None = None
    masks_dir: Path | None = None  # `<image stem>.png`, 255 = dynamic
    sfm_dir: Path | None = None  # what `gmrdata.cameras.reconstruct` left
    truth_files: "UnreadClip | None" = None  # of the exact motion
    extras_paths: tuple[Path, ...] = ()
    split: str = "test"  # of 3DPW


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedClip(UnreadClip):
    """One person's clip, with what else is known of it."""

    clip: Clip  # `valid` is False outside the manifest's kept ranges
    rest_pelvis_m: np.ndarray  # (3,) J0 of the person's shape, rest frame [m]
    body_names: tuple[str, ...]  # as `load_body` takes them: those that `body` chooses from
    truth: Clip | None  # of the same person, in a world of its own
    extras: tuple[Clip, ...]  # who moves besides, in the same rows, world and camera

    @property
    def body(self) -> BodyModel:
        """The person's body; MissingInput where it is not at hand, BadBodyFile for another one."""
        wanted, shape = self.clip.motion.body, self.clip.motion.shape
        # Of two with one name the nearer one, which stands first.
        bodies = {body.name: body for body in map(load_body_once, reversed(self.body_names))}
        if wanted not in bodies:
            there = f"; there are {', '.join(bodies)}" if bodies else ""
            raise MissingInput(
                f"clip {self.id} needs the body {wanted}{there}. Give it with --body"
            )
        body, far_m = bodies[wanted], np.inf
        if body_of(self.clip.motion, [body]) is not None:
            body = sized(body, len(shape))
            far_m = float(np.abs(body.rest_pelvis_m(shape) - self.rest_pelvis_m).max())
        if not far_m < WRONG_BODY_M:
            what = f"clip {self.id} was made with another body that is called {wanted}"
            raise BadBodyFile(f"{what}. Give that one with --body")
        return body

    def image_paths(self) -> list[Path | None]:
        """The image of each row; None for a row without one.  MissingInput without a folder."""
        if self.images_dir is None:
            remedy = "Give their folder, or the folder of the sequences' folders, with --images"
            raise MissingInput(f"clip {self.id} has no images. {remedy}")
        return self._in_rows(images_by_number(self.images_dir))

    def mask_paths(self) -> list[Path | None]:
        """The mask of each row, 255 = dynamic; empty where there are no masks.  BadFrames for masks
        of no image, as where they are numbered otherwise: their numbers fit the wrong images."""
        if self.masks_dir is None:
            return []
        masks = images_by_number(self.masks_dir, (".png",))
        images = masks if self.images_dir is None else images_by_number(self.images_dir)
        if alone := sorted(masks.keys() - images.keys()):
            what = f"no image in {self.images_dir} for the masks of number {some(alone)}"
            raise BadFrames(f"{self.masks_dir}: {what}. Number masks as their images are")
        return self._in_rows(masks)

    def _in_rows(self, by_number: Mapping[int, Path]) -> list[Path | None]:
        return [by_number.get(int(number)) for number in self.clip.image_numbers]


def images_by_number(folder: Path, suffixes: Collection[str] = IMAGE_SUFFIXES) -> dict[int, Path]:
    """The images in a folder by the number in their names, which may have gaps.

    Raises:
        MissingInput: there is no such folder.
        BadFrames: two have one number, so that either may be meant.
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder of images")
    images: dict[int, Path] = {}
    for path in sorted(visible(folder.iterdir())):
        number = number_in_name(path.name)
        if number is None or path.suffix.lower() not in suffixes:
            continue
        if (other := images.setdefault(number, path)) is not path:
            what = f"two images have the number {number}, {other.name} and {path.name}"
            raise BadFrames(f"{folder}: {what}. Keep other pictures in another folder")
    return images


def list_clips(source: Path, ids: Sequence[str] = ()) -> list[UnreadClip]:
    """The clips of a manifest, a clip's file or a stage's folder; of these, those named by `ids`.

    A stage's folder is that of a rendered set or clip, `gmrdata sfm`, `threedpw`, `motions`,
    `infer`, `floor` or a demo; of a demo its result is taken, with the rendered clips as truth.

    Raises:
        MissingInput: no such file, folder or clip.
        BadManifest: the manifest is broken, only lists clips, or two clips have one name.
    """
    clips = list(_clips_of(source))
    if unknown := sorted(set(ids) - {files.id for files in clips}):
        known = ", ".join(files.id for files in clips)
        raise MissingInput(f"{source}: no clip {', '.join(unknown)}; there are {known}")
    if repeated := [name for name, n in Counter(files.id for files in clips).items() if n > 1]:
        raise BadManifest(f"{source}: several clips have the name {repeated[0]}; rename them")
    return [files for files in clips if not ids or files.id in ids]


def load_exported(
    files: UnreadClip, *, body: Path | str | None = None, images: Path | None = None
) -> ExportedClip:
    """Load one clip.

    Args:
        files: An item of `list_clips`.
        body: The body to use, as `load_body` takes it, or a folder of bodies; what lies beside the
            clip when None.
        images: Folder with the images, in place of the one that the clip names.
    """
    clip = _sound_clip(files)
    if images is not None and not images.is_dir():
        raise MissingInput(f"{images}: no such folder of images")
    extras = (path for path in files.extras_paths if "poses" in read_npz(path))
    own = {
        "images_dir": images or files.images_dir,
        "clip": clip,
        "rest_pelvis_m": read_npz(files.clip_path)["rest_pelvis_m"],
        "body_names": _bodies(files.clip_path) if body is None else _given(body),
        "truth": None if files.truth_files is None else _sound_clip(files.truth_files),
        "extras": tuple(map(load_clip, extras)),
    }
    return ExportedClip(**(vars(files) | own))


def _sound_clip(files: UnreadClip) -> Clip:
    """A clip with the frames that its manifest keeps, whose numbers can be used."""
    clip = load_clip(files.clip_path) if files.listed is None else load_entry(*files.listed)
    return require_sound(files.clip_path, clip)


def _given(body: Path | str) -> tuple[str, ...]:
    """A body, or those of a folder."""
    folder = Path(body).expanduser()
    return tuple(map(str, body_files(folder))) if folder.is_dir() else (str(body),)


def _bodies(clip_path: Path) -> tuple[str, ...]:
    """The bodies that the stages keep beside a clip; the default one where there are none."""
    beside = [
        str(path)
        for folder in clip_path.absolute().parents[:4]
        for pattern in ("body/body.npz", "body/*/body.npz", "bodies/*/body.npz")
        for path in sorted(folder.glob(pattern))
    ]
    return tuple(beside) or ("anny",)


def _clips_of(source: Path) -> Iterator[UnreadClip]:
    if source.is_dir():
        return _clips_in_folder(source)
    if not source.is_file():
        raise MissingInput(f"{source}: no such file or folder")
    if source.suffix.lower() in (".yaml", ".yml"):
        return _clips_of_manifest(source)
    return iter([_clip_file(source)])


def _clip_file(path: Path) -> UnreadClip:
    """A single clip, with what the stage that made it left beside it."""
    if path.absolute().parent.name in (PSEUDO_GT, FUSED):
        name = _clip_name(path)
        return replace(_pseudo_gt_clip(path), id=name, sequence=name)
    return _rendered_clip(path)


def _clips_in_folder(folder: Path) -> Iterator[UnreadClip]:
    """The clips of a folder that a stage left; see `list_clips`."""
    if (manifest := _manifest_in(folder)) is not None:
        # Of a demo: the rendered clips, the truth of what was regenerated from their frames.
        rendered, is_demo = folder / "synthetic.yaml", (folder / "pseudo_gt.yaml").is_file()
        true = _clips_of_manifest(rendered) if is_demo and rendered.is_file() else ()
        truths = {files.id: files for files in true}
        for files in _clips_of_manifest(manifest):
            yield replace(files, truth_files=truths.get(files.id))
    elif within := [folder / name for name in CLIPS_WITHIN if (folder / name).is_dir()]:
        yield from _clips_in_folder(within[0])
    elif (folder / "regenerated").is_dir():  # a noise floor
        for files in _clips_in_folder(folder / "regenerated"):
            truth = UnreadClip(files.id, files.id, folder / "twins" / "truth" / f"{files.id}.npz")
            yield replace(files, truth_files=truth if truth.clip_path.is_file() else None)
    elif (folder / "infer.json").is_file():
        yield from (_rendered_clip(path) for path in sorted(folder.glob("*/clip.npz")))
    elif people := _people_in(folder):
        yield from people
    elif (folder / "clip.npz").is_file():
        yield _rendered_clip(folder / "clip.npz")
    elif alone := [path for path in _files_in(folder, "*.npz") if _is_clip(path)]:
        yield from map(_clip_file, alone)
    else:
        raise MissingInput(f"{folder}: {_without_clips(folder)}")


def _without_clips(folder: Path) -> str:
    """What a folder without clips is, and what to name or look at instead."""
    if (folder / SFM / CAMERAS_FILE).is_file():
        leaves = "`gmrdata video` leaves a COLMAP model and a TUM path of accepted cameras"
        return f"holds cameras alone, and an export is of people. {leaves} in {folder / FILES}"
    what = "no manifest, and no folder that a stage of gmrdata left with clips"
    return f"{what}. Name a manifest (.yaml) or a clip's file (.npz)"


def _manifest_in(folder: Path) -> Path | None:
    """The manifest that stands for a folder."""
    for name in MANIFESTS:
        if (folder / name).is_file():
            return folder / name
    others = [path for path in _files_in(folder, "*.yaml") if _is_manifest(path)]
    if len(others) > 1:
        names = ", ".join(path.name for path in others)
        raise MissingInput(f"{folder}: holds several manifests. Name one of {names}")
    return others[0] if others else None


def _files_in(folder: Path, pattern: str) -> list[Path]:
    """No folders; a link that leads nowhere stays, and reading it says so."""
    return sorted(path for path in visible(folder.glob(pattern)) if not path.is_dir())


def _is_clip(path: Path) -> bool:
    """Whether a file is a clip, or can't be read: loading it says what is wrong then."""
    try:
        return str(read_npz(path, plain_alone=True).get("format")) == CLIP_FORMAT
    except BadMotionFile:
        return True


def _is_manifest(path: Path) -> bool:
    """By its first lines, since a long one takes seconds to read."""
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES).decode("utf-8-sig", "replace")
    said = dict(re.findall(r"^(format|kind): *['\"]?([\w/.-]+)", head, re.MULTILINE))
    return said.get("format") in READS and said.get("kind") != "list"


def _clips_of_manifest(path: Path) -> Iterator[UnreadClip]:
    manifest = read_data_set(path)
    people = Counter(Path(entry.arrays.path).parent for entry in manifest.clips)
    for entry in manifest.clips:
        yield _entry_files(path, manifest, entry, people[Path(entry.arrays.path).parent])


def _entry_files(path: Path, manifest: Manifest, entry: ClipEntry, n_people: int) -> UnreadClip:
    """The files of one entry; `n_people` clips lie in its folder."""

    def folder(field: str, record: FolderRecord | None) -> Path | None:
        return None if record is None else inside(f"{field}.folder", record.folder)

    inside = partial(listed_path, path, entry)
    clip_path = inside("arrays.path", entry.arrays.path)
    stages = Path(entry.arrays.path).parents[1:2]
    files = UnreadClip(entry.id, entry.id, clip_path)
    if manifest.kind == "pseudo_gt" and clip_path.parent.name == PSEUDO_GT and stages:
        # What lies beside the clip must be a part of the set.
        inside("sfm", (stages[0] / SFM).as_posix())
        files = _pseudo_gt_clip(clip_path)
        # One person alone: the folder may be any, so the clip names the sequence.
        of_set = stages[0].parent.name == "sequences"
        sequence = files.sequence if n_people > 1 or of_set else entry.id
        files = replace(files, id=entry.id, sequence=sequence)
    return replace(
        files,
        listed=(path, entry),
        images_dir=folder("images", entry.images) or files.images_dir,
        masks_dir=folder("masks", entry.masks) or files.masks_dir,
        extras_paths=tuple(inside("extras", extra.arrays.path) for extra in entry.extras),
    )


def _people_in(folder: Path) -> list[UnreadClip]:
    """The people of one sequence: of a solved sequence's folder, or of a folder of people in it."""
    if (folder / PSEUDO_GT).is_dir():
        folder = world_people_dir(folder)
    paths = sorted(
        folder.glob("person_[0-9]*.npz"), key=lambda path: number_in_name(path.name) or 0
    )
    people = [replace(_pseudo_gt_clip(path), id=_clip_name(path)) for path in paths]
    one = people[0].id if len(people) == 1 else None
    return [replace(person, sequence=one or person.sequence) for person in people]


def require_solved(folder: Path) -> None:
    """MissingInput for a folder in which nothing of a sequence was solved."""
    if not any((folder / name).exists() for name in (SFM, PSEUDO_GT, VERDICT_FILE)):
        what = "holds no sfm and no pseudo_gt, so nothing of a video was solved there"
        raise MissingInput(f"{folder}: {what}. Give the folder of `gmrdata video` or `gmrdata sfm`")


def world_people_dir(folder: Path) -> Path:
    """Where a solved sequence has its people in the world: with a network's motions where they were
    put together, else as the cameras alone give them."""
    return folder / (FUSED if (folder / FUSED).is_dir() else PSEUDO_GT)


def _pseudo_gt_clip(path: Path) -> UnreadClip:
    """A person's clip in a sequence's folder, which the other stages have left theirs in."""
    folder = path.absolute().parent.parent
    return UnreadClip(
        id=path.stem,
        sequence=file_name(folder.name),
        clip_path=path,
        images_dir=_there(folder / FRAMES),
        masks_dir=_there(folder / MASKS),
        sfm_dir=folder / SFM if (folder / SFM / CAMERAS_FILE).is_file() else None,
        split=_split(folder / "people"),
    )


def _split(people_dir: Path) -> str:
    """3DPW's split, as the stage that read the sequence's file has it in its record."""
    if not (people_dir / STAGE_FILE).is_file():
        return UnreadClip.split
    return str(StageRecord.of(people_dir).config.get("split", UnreadClip.split))


def _rendered_clip(path: Path) -> UnreadClip:
    """A clip in a folder of its own, with frames and masks if it was rendered."""
    folder, name = path.absolute().parent, _clip_name(path)
    files = UnreadClip(name, name, path)
    if path.name != "clip.npz":
        return files
    return replace(
        files,
        images_dir=_there(folder / FRAMES),
        masks_dir=_there(folder / MASKS),
        extras_paths=tuple(sorted((folder / EXTRAS_FOLDER).glob("*.npz"))),
    )


def _there(folder: Path) -> Path | None:
    return folder if folder.is_dir() else None


def _clip_name(path: Path) -> str:
    """A clip's id as the name of a file; of a file that can't be read its own, or its folder's."""
    try:
        return file_name(load_clip(path).id)
    except BadMotionFile:
        return file_name(path.absolute().parent.name if path.name == "clip.npz" else path.stem)
