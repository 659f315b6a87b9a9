"""The section of a page that shows frames: some of all, and one for each reason to drop any."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata.regenerate.qa.gather import Found
from gmrdata.regenerate.qa.kinds import Kind, example_frames, kinds_of
from gmrdata.regenerate.qa.style import swatch
from gmrdata.regenerate.qa.tiles import N_TILES, Tile, image_numbers, jpeg, read_tile, spaced
from gmrdata.report.markup import image, text


@dataclass(frozen=True, eq=False)
class Frames:
    """What is shown of a sequence."""

    tiles: tuple[Tile, ...]
    """Evenly spaced frames."""
    dropped: tuple[tuple[Kind, Tile], ...]
    """A frame for each kind of reason, as far as there is room."""


def read_frames(found: Found, masks_dir: Path) -> Frames:
    """Read some frames of a sequence; of one that could not be read, the images that are there."""
    files = found.files
    if files is None or not files.image_dir.is_dir():
        return Frames((), ())
    chosen = spaced(range(found.n_frames) or image_numbers(files))
    examples = example_frames(found.reasons, kinds_of(found.reasons)) if found.is_solved else {}
    return Frames(
        tuple(read_tile(files, masks_dir, number) for number in chosen),
        tuple(
            (kind, read_tile(files, masks_dir, number))
            for kind, number in list(examples.items())[:N_TILES]
        ),
    )


def frames_section(frames: Frames) -> str:
    """HTML: the strips of frames with their masks."""
    if not frames.tiles:
        return "<section><h2>Frames</h2><p>There are no images to show.</p></section>"
    dropped = ""
    if frames.dropped:
        shown = "".join(
            _tile(tile, f"<p>{swatch(kind.colour)} {text(kind.words)}</p>")
            for kind, tile in frames.dropped
        )
        dropped = (
            f'<h3>Dropped frames, one for each reason</h3><div class="tiles six">{shown}</div>'
        )
    return (
        f'<section><h2>Frames</h2><div class="tiles six">{"".join(map(_tile, frames.tiles))}</div>'
        '<p class="caption">Evenly spaced frames; what is masked is tinted and outlined: no '
        f"background point is sought there.</p>{dropped}</section>"
    )


def _tile(tile: Tile, note: str = "") -> str:
    name = f"frame {tile.image_number}"
    problem = f'<p class="bad">{text(tile.problem)}</p>' if tile.problem else ""
    if tile.picture is None:
        return f"<div><p>{name}</p>{note}{problem}</div>"
    height_px, width_px = tile.picture.shape[:2]
    picture = image(jpeg(tile.picture), "jpeg", name, width_px, height_px)
    return f"<div>{picture}<span>{name}</span>{note}{problem}</div>"
