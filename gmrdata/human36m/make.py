"""Human3.6M as two manifests of world clips: everybody's training and test subjects."""

from collections.abc import Iterator
from pathlib import Path

from gmrdata.body.file import read_body
from gmrdata.body.keep import keep_body
from gmrdata.clip import save_clip
from gmrdata.config import Config
from gmrdata.errors import BadSequence
from gmrdata.human36m.clips import take_clip
from gmrdata.human36m.layout import (
    SIZES_PX,
    TEST_SUBJECTS,
    TRAINING_SUBJECTS,
    find_cameras,
    find_subjects,
)
from gmrdata.human36m.parse import read_cameras, read_takes
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Source
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.progress import track
from gmrdata.store import run_stage

LICENCE = "Human3.6M's licence (academic use; not to be passed on)"


class Human36mConfig(Config):
    """What decides a subject's clips."""

    subject: int
    """Number of the subject."""
    camera: int = 4
    """Number of the camera that the clips have, 1 to 4.  The motion is the same in each; 4 is the
    frontal one (60457274), which HMR and SPIN test on."""


def make_human36m(root: Path, body: str, out_dir: Path, *, redo: bool = False) -> tuple[Path, ...]:
    """Write one clip per take, `train.yaml` (S1, S5, S6, S7, S8) and `test.yaml` (S9, S11).

    Args:
        root: Folder of the annotation files, see `gmrdata.human36m.parse`.
        body: SMPL's neutral model, as `load_body` takes it.
        out_dir: Folder to make.
        redo: Make anew what other settings made.

    Returns:
        The manifests of those subjects that are there.

    Raises:
        MissingInput: no subject's parameters, or not its cameras.
        BadSequence: a file is broken, or laid out otherwise.
        BadBodyFile: not SMPL's neutral body.
    """
    out_dir = out_dir.resolve()
    parameter_paths = find_subjects(root)
    body_path = keep_body(body, out_dir / "body", redo=redo)
    made = []
    for name, subjects in (("train", TRAINING_SUBJECTS), ("test", TEST_SUBJECTS)):
        there = [subject for subject in subjects if subject in parameter_paths]
        entries = [
            entry
            for subject in track(there, f"reading Human3.6M's {name} subjects")
            for entry in _entries(parameter_paths[subject], subject, body_path, out_dir, redo)
        ]
        if not entries:
            continue
        path = write_manifest(
            out_dir / f"{name}.yaml",
            name=f"human36m_{name}",
            version="1.0.0",
            description=f"Human3.6M's {name} subjects in the world, with one fixed camera.",
            kind="motions",
            licence=LICENCE,
            clips=entries,
            created_by=created_by({"subjects": there}),
            redo=redo,
        )
        made.append(path)
    return tuple(made)


def _entries(
    parameter_path: Path, subject: int, body_path: Path, out_dir: Path, redo: bool
) -> Iterator[ClipEntry]:
    folder = _make_subject(parameter_path, subject, body_path, out_dir, redo)
    for path in sorted(folder.glob("*.npz")):
        yield clip_entry(
            out_dir,
            clip_path=path,
            camera_motion="static",
            licence=LICENCE,
            source=Source(dataset="Human3.6M", sequence=path.stem.replace(".", "/")),
            dropped_reason="no finite SMPL parameters in the file",
            recipe=stage_recipe(folder),
        )


def _make_subject(
    parameter_path: Path, subject: int, body_path: Path, out_dir: Path, redo: bool
) -> Path:
    config = Human36mConfig(subject=subject)
    camera_path = find_cameras(parameter_path, subject)

    def work(partial_dir: Path) -> None:
        body = read_body(body_path)
        cameras = read_cameras(camera_path)
        if config.camera not in cameras:
            raise BadSequence(
                f"{camera_path}: has no camera {config.camera} of {', '.join(map(str, SIZES_PX))}"
            )
        for take in read_takes(parameter_path):
            clip = take_clip(subject, take, config.camera, cameras[config.camera], body)
            rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
            save_clip(partial_dir / f"{clip.id}.npz", clip, rest_pelvis_m)

    inputs = {"parameters": parameter_path, "cameras": camera_path, "body": body_path}
    return run_stage("human36m", out_dir / "clips" / f"S{subject}", config, inputs, work, redo=redo)
