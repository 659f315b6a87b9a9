"""One error per way to fail.  Each message names the file or clip and says what to do about it."""

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from pathlib import Path


class GmrdataError(Exception):
    """Base of every error raised on purpose; the command line prints it and exits with 1."""


class MissingInput(GmrdataError):
    """A file or folder that was asked for is not there."""


class FetchFailed(GmrdataError):
    """A file could not be fetched, or what came is not the file."""


class BadMotionFile(GmrdataError):
    """A motion file (BVH, ASF/AMC, AMASS npz) is broken, or of a kind that cannot be used."""


class BadBodyFile(GmrdataError):
    """A body model file is broken, or holds something else."""


class BadCharacter(GmrdataError):
    """A rigged character's file is broken, or has no skeleton that fits the 24 joints."""


class UnsafePickle(GmrdataError):
    """A pickle wants to import something that is not plain data.  Nothing of it was run."""


class BrokenPickle(GmrdataError):
    """A pickle is truncated, or the file is no pickle."""


class BadFrames(GmrdataError):
    """Images or masks are missing, of different sizes, or not images."""


class BadIntrinsics(GmrdataError):
    """A calibration can't be read, or is not one of these frames."""


class BadSequence(GmrdataError):
    """A sequence of a dataset (3DPW) is broken, or not laid out as that dataset is."""


class BadKeypoints(GmrdataError):
    """2D keypoints are broken, of another layout, or of other images."""


class BadFeatures(GmrdataError):
    """Image features do not fit the clip or the model that they are given for."""


class BadDetector(GmrdataError):
    """A detector's model file is broken, or holds a network of another layout."""


class MissingExtra(GmrdataError):
    """A package of an extra is not installed, or cannot be imported."""


class BadManifest(GmrdataError):
    """A manifest breaks the format, or its files are not what it says."""


class BadRecipe(GmrdataError):
    """A recipe has an unknown key, a wrong type, or values that do not fit together."""


class BadCheckpoint(GmrdataError):
    """A checkpoint is truncated, or belongs to another model."""


class BadRecord(GmrdataError):
    """A record of a stage or run is cut off, of another format, or lacks a key."""


class StaleOutput(GmrdataError):
    """The output folder was made by another recipe or from other inputs."""


class StageFailed(GmrdataError):
    """A stage could not do its work on a clip."""


class NothingMade(StageFailed):
    """Every clip of a set failed, so nothing of it was written."""


class NoWorkers(NothingMade):
    """Dask's workers were not reached, can't do the work, or were lost: nothing is listed anew."""


class NothingToCompare(StageFailed):
    """Two clips have no two frames in a row in common."""


class RenderFailed(StageFailed):
    """The Blender process ended without its result."""


class RenderOverLimit(GmrdataError):
    """Blender's process took more time or memory than it may; it would do so again."""


class BadBackdrop(GmrdataError):
    """A .blend file can't be the place of a clip."""


class BlenderMissing(GmrdataError):
    """Blender's environment is not there, or could not be made."""


class EngineMissing(GmrdataError):
    """A renderer or a device that was asked for can't run on this machine."""


class NoReconstruction(StageFailed):
    """Structure from motion found no camera path that can be used, or no world of people."""

    def __init__(self, why: str, frames_dir: Path | None = None) -> None:
        super().__init__(why, frames_dir)
        self.why = why
        self.frames_dir = frames_dir

    def __str__(self) -> str:
        return self.why if self.frames_dir is None else f"{self.frames_dir}: {self.why}"

    def of(self, frames_dir: Path) -> "NoReconstruction":
        """The same of frames that lie, or will lie, somewhere else."""
        return NoReconstruction(self.why, frames_dir)


class TrainingDiverged(StageFailed):
    """The loss became infinite or NaN; the last good checkpoint is kept."""


def nearest(word: str, known: Collection[str]) -> str:
    """The end of a message that offers the known word most like a mistyped one; or empty."""
    alike = get_close_matches(word, known, n=1)
    return f"; did you mean {alike[0]!r}?" if alike else ""


def some(items: Sequence[object], most: int = 3) -> str:
    """The first few items for a reader, and how many more there are; empty for none."""
    more = len(items) - most
    return ", ".join(map(str, items[:most])) + (f" and {more} more" if more > 0 else "")
