"""Why a file is no video, or holds none any more: what a decoder calls invalid data."""

from pathlib import Path

GET_AGAIN = "get the whole file"
FIRST_BOXES = ("ftyp", "styp", "wide", "free", "skip", "mdat", "moov", "pnot")  # of an MP4 file
START_BYTES, MOST_BOXES = 4096, 1000  # that are looked at to say why a file is no video


def why_no_video(path: Path) -> str:
    """Why a file is no video, by its start and its parts, and what to do; empty if unknown."""
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
