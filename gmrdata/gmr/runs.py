"""Clips of a manifest that can be trained on or scored, and their runs of valid frames."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import ListManifest, Manifest
from gmrdata.manifest.read import load_entry, read_manifest
from gmrdata.motion.resample import resample, valid_runs
from gmrdata.values.body import BodyModel, body_of
from gmrdata.values.clip import Clip, clip_on_body
from gmrdata.values.errors import BadManifest, BadMotionFile
from gmrdata.values.motion import Motion, whole_ratio


@dataclass(frozen=True, eq=False)
class UsableClip:
    clip: Clip
    camera_motion: str  # class of its camera's motion: "none" without a camera


@dataclass(frozen=True, eq=False)
class UsableClips:
    """Clips that a manifest vouches for, and the reason by id for those that it does not."""

    clips: tuple[UsableClip, ...]
    skipped: dict[str, str]
    manifest: Manifest


@dataclass(frozen=True)
class ClipFile:
    """A clip that the manifest vouches for, still on disk."""

    manifest_path: Path
    entry: ClipEntry

    def load(self) -> Clip:
        return load_entry(self.manifest_path, self.entry)


class LazyClips(Sequence[Clip]):
    """Clips that are read each time that they are asked for: a set may exceed the memory."""

    def __init__(self, files: Sequence[ClipFile]) -> None:
        self._files = files

    def __len__(self) -> int:
        return len(self._files)

    def __getitem__(self, index: int) -> Clip:  # type: ignore[override]  # nobody takes slices
        return self._files[index].load()


def usable_clips(path: Path) -> UsableClips:
    """Load the clips of a manifest, except those that its quality record rejects."""
    files, skipped, manifest = usable_files(path)
    clips = tuple(UsableClip(file.load(), file.entry.camera_motion) for file in files)
    return UsableClips(clips, skipped, manifest)


def usable_files(path: Path) -> tuple[list[ClipFile], dict[str, str], Manifest]:
    """The same, still on disk, and why by id for the rest."""
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        raise BadManifest(f"{path}: only lists clips and has no files. Make the clips first")
    files, skipped = [], {}
    for entry in manifest.clips:
        if entry.quality is not None and entry.quality.verdict == "rejected":
            skipped[entry.id] = "rejected: " + "; ".join(entry.quality.reasons)
        else:
            files.append(ClipFile(path, entry))
    return files, skipped, manifest


def fitting_clips(clips: Iterable[Clip], bodies: Sequence[BodyModel]) -> Iterator[Clip]:
    """The clips one by one, each with as many shape coefficients as its body.

    BadManifest, when its turn comes: a clip of no such body, or not in the world; or no clip.
    """
    clip = None
    for clip in clips:
        if clip.motion.frame != "world":
            raise BadManifest(
                f"clip {clip.id}: its motion is in the camera's frame, which moves. Give clips in"
                " the world frame"
            )
        body = body_of(clip.motion, bodies)
        if body is None:
            given = ", ".join(f"{body.name} with {body.n_shape}" for body in bodies)
            raise BadManifest(
                f"clip {clip.id}: of body {clip.motion.body} with {clip.motion.shape.size} shape"
                f" coefficients, but the given body is {given}."
                " Give the clips' own body, or a folder with the bodies of all"
            )
        yield clip_on_body(clip, body)
    if clip is None:
        raise BadManifest("no usable clips. Give manifests with clips that are not rejected")


def no_runs(n_clips: int, what: str, fps_hz: float, remedy: str) -> BadManifest:
    """The error that clips have no motion at a frame rate."""
    said = f"none of the {n_clips} {what} clips has two valid frames in a row at {fps_hz:g} fps"
    return BadManifest(f"{said}. {remedy}")


MIN_FRAMES = 2  # which make one motion


def runs_at(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[Motion]:
    """Runs of a clip's valid frames at a frame rate; none of them crosses a gap.

    Where the clip's rate is k times the asked one, every k-th frame is taken as it is; all k phases
    of that, or the one that begins with the run's first frame.  Other ratios are resampled.  Runs
    have at least two frames.
    """
    check_finite(clip)
    ratio = clip.motion.fps_hz / fps_hz
    step = whole_ratio(clip.motion.fps_hz, fps_hz)
    if ratio < 1 - 1e-3:
        raise BadMotionFile(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is lower than {fps_hz:g} fps, so frames"
            " would have to be made up. Use a source of a higher rate"
        )
    n_phases = (step or max(1, int(ratio))) if all_phases else 1
    runs = []
    for start, stop in valid_runs(clip.valid):
        for phase in range(n_phases):
            if stop - start - phase < MIN_FRAMES:
                continue
            if step is not None:
                motion = clip.motion.take(slice(start + phase, stop, step), fps_hz)
            else:
                motion = resample(clip.motion.take(slice(start + phase, stop)), fps_hz)
            if motion.n_frames >= MIN_FRAMES:
                runs.append(motion)
    return runs


def check_finite(clip: Clip) -> None:
    """Refuse NaN and infinities in valid frames, with a BadMotionFile."""
    motion = clip.motion
    finite = np.isfinite(motion.local_rotmats).all((1, 2, 3))
    finite &= np.isfinite(motion.root_rotmats).all((1, 2)) & np.isfinite(motion.pelvis_m).all(1)
    bad = np.flatnonzero(clip.valid & ~finite)
    if bad.size or not np.isfinite(motion.shape).all():
        where = f"frame {bad[0]}" if bad.size else "its shape"
        raise BadMotionFile(
            f"clip {clip.id}: {where} holds NaN or infinite numbers ({bad.size} frames in all)."
            " Mark such frames as not valid, or make the clip again"
        )
