"""What is wrong with a video: why a file is none, and frames that only repeat the one before, which
a folder of frames may have too."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from gmrdata.read.frames import read_gray
from gmrdata.stage.jobs import made_ahead
from gmrdata.stage.progress import remark

GET_AGAIN = "get the whole file"
FIRST_BOXES = ("ftyp", "styp", "wide", "free", "skip", "mdat", "moov", "pnot")  # of an MP4 file
START_BYTES, MOST_BOXES = 4096, 1000  # that are looked at to say why a file is no video

REPEATED, FEWEST_REPEATED, MOST_ON_END = 0.1, 0.15, 10
"""A frame repeats the one before if it changes by so small a share of what most do; how many repeat
where 24 pictures a second were made 30 (a fifth); and of how many frames one picture is made."""
FAR_ON = 95
"""Percentile of the changes that the one after a hang exceeds: of hangs of a third of a second in
five real clips 97 to 100 % do."""


def why_no_video(path: Path) -> str:
    """Why a file is no video, by its start and its parts, and what to do; empty if unknown.  A
    decoder calls it invalid data alone."""
    with path.open("rb") as file:
        start = file.read(START_BYTES)
    if not start:
        return f"empty file (0 bytes); {GET_AGAIN}"
    if start.startswith(b"version https://git-lfs"):
        return "a Git LFS pointer, not the file; run `git lfs pull` there"
    if start.lstrip().lower().startswith((b"<!doctype", b"<html")):
        return f"a web page, not a video; {GET_AGAIN}"
    if not start.strip(b"\0"):
        return f"begins with zeros, as copies that failed do; {GET_AGAIN}"
    if start.startswith((b"\0\0\0\1", b"\0\0\1")):
        to_mp4 = "ffmpeg -framerate RATE -i FILE -c copy FILE.mp4"
        return f"a bare stream, which has no times; put it into .mp4 with its rate: {to_mp4}"
    boxes = _boxes(path)
    names = [name for name, _ in boxes]
    if not names or names[0] not in FIRST_BOXES or "moov" in names[:-1]:
        return ""
    if names[-1] == "moov":
        return f"no video (cut off in its index, moov); {GET_AGAIN}" if boxes[-1][1] else ""
    if boxes[-1][1]:
        return f"was cut off before its index (moov); {GET_AGAIN}"
    why = "without an index, moov, as of a recording that was never finished"
    return f"no video ({why}); {GET_AGAIN}, or repair it"


def _boxes(path: Path) -> list[tuple[str, bool]]:
    """Name of each outer box of an MP4 file (ISO 14496-12, 4.2), and whether it is cut off."""
    boxes: list[tuple[str, bool]] = []
    at, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while at + 8 <= size and len(boxes) < MOST_BOXES:
            file.seek(at)
            head = file.read(16)
            n_bytes, name = int.from_bytes(head[:4], "big"), head[4:8]
            if n_bytes == 1:
                n_bytes = int.from_bytes(head[8:], "big")
            if not name.isalnum() or (n_bytes and n_bytes < 8):
                break
            # Of 0 bytes is one that is being written, or goes on to the end.
            boxes.append((name.decode("ascii"), n_bytes == 0 or at + n_bytes > size))
            at += n_bytes or size
    return boxes


def changes_between(paths: Sequence[Path]) -> np.ndarray:
    """(N-1,) mean change of brightness from each of N images to the next."""
    small = made_ahead(lambda path: thinned(read_gray(path)), paths)
    return np.array([change(before, after) for before, after in pairwise(small)])


def thinned(image: np.ndarray) -> np.ndarray:
    """Every eighth pixel of every eighth row, whose differences may be negative."""
    return image[::8, ::8].astype(np.int16)


def change(before: np.ndarray, after: np.ndarray) -> float:
    """Mean change of brightness between two such pictures."""
    return float(np.abs(after - before).mean())


def say_repeats(source: Path, changes: np.ndarray, numbers: Sequence[int]) -> None:
    """Remark on frames that repeat the one before, by mean changes (N-1,) between those that are
    taken, and their numbers."""
    if repeats := _said_of_repeats(changes, numbers):
        remark(f"{source}: {repeats}")


def _said_of_repeats(changes: np.ndarray, numbers: Sequence[int]) -> str | None:
    """What to say of frames that repeat the one before, by mean changes (N-1,) between those that
    are taken, and their numbers; None where few do, or one stands still and goes on as before."""
    repeats = changes < REPEATED * np.percentile(changes, 90)
    moves = np.flatnonzero(np.r_[True, ~repeats, True])
    apart = np.diff(moves)
    if len(apart) < 3:
        return None
    if apart.max() > MOST_ON_END:
        first, after = moves[(longest := int(apart.argmax())) : longest + 2].tolist()
        if after > len(changes) or changes[after - 1] <= np.percentile(changes[~repeats], FAR_ON):
            return None
        what = f"frames {numbers[first]} to {numbers[after - 1]} show one picture"
        return f"{what}, and the next is far on: the recording hung, people did not; cut it there"
    if repeats.sum() - apart.max() + 1 < FEWEST_REPEATED * len(changes):  # one may stand still
        return None
    every = int(apart[1])
    even = (apart[1:-1] == every).all()
    if even and every == 1:
        return None  # it only stands still at an end
    each = every * (numbers[1] - numbers[0])
    leaves_out = f"--every {each}, or a folder of one in {each}, leaves them out"
    remedy = leaves_out if even else "give the original"
    n, of = int(repeats.sum()), len(changes) + 1
    return f"{n} of {of} frames repeat the one before: it was made faster than filmed; {remedy}"
