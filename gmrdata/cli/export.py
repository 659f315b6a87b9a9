"""The verb that hands results on to other programs: export."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.gmr import Weights
from gmrdata.export.formats import FORMATS, NETWORK, FormatName, Seen, Trajectory
from gmrdata.values.errors import StageFailed

if TYPE_CHECKING:
    from gmrdata.export.export import Exported

HEADINGS = ("format", "clip", "file or folder", "state")
SAID = {name: format.says for name, format in FORMATS.items()} | {"onnx": NETWORK}
Formats = Annotated[
    tuple[FormatName | Literal["onnx"], ...],
    arg(help="\n".join(["Formats.", *(f"{name}: {says}." for name, says in SAID.items())])),
]


def export(
    source: Positional[Path],
    to: Formats,
    out: Path,
    clips: tuple[str, ...] = (),
    of: Trajectory = "camera",
    observations: Seen = "keyframes",
    body: str | None = None,
    images: Path | None = None,
    truth: Path | None = None,
    threedpw: Path | None = None,
    which: Weights = "latest",
    redo: bool = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Write clips in the formats of other programs.  Clips that can't be written are named.

    Args:
        source: A manifest, a clip's file, or the folder of a video, a rendered set, sfm, threedpw,
            floor, motions, infer, a baseline, a demo, or clips' files; onnx: a training or bundled.
        out: Output folder: <format>/<clip id>.
        clips: Names of the clips to write; all when left out.
        of: The trajectory in tum and kitti: of the camera, or of the person's pelvis.
        observations: Image points of a COLMAP model: those of the keyframes, as in the bundle
            adjustment, those of the frames between too, or none.
        body: "anny", or the file of a body model; the one that lies beside the clips when left out.
        images: Folder with the images of one sequence, or with a folder for each of several, by
            name; for clips that do not say where theirs are.
        truth: Manifest, folder or clip with the exact motions of the same clips, by id.
        threedpw: 3DPW's own folder: the 2D keypoints and clothed templates for 3dpw.
        redo: Write again what is there.
    """
    from gmrdata.export.export import export as write

    flags.need(to, "a format: --to tum")
    results = write(
        source, to, out, clips=clips, of=of, observations=observations, body=body, images=images,
        truth=truth, threedpw=threedpw, which=which, redo=redo, dry_run=dry_run,
    )  # fmt: skip
    if dry_run:
        print_table(HEADINGS, [_planned(one, redo) for one in results])
        return
    _say(results, out)


def _say(results: "Sequence[Exported]", out: Path) -> None:
    """Where files are and what was left out, which is an error."""
    written = [one.unit for one in results if not one.left_out]
    for path in dict.fromkeys(out / unit.format if unit.ids else unit.path for unit in written):
        answer(path)
    left_out = [(unit, reason) for unit, reason in results if reason]
    listed = "".join(f"\n  {unit.name}: no {unit.format}: {reason}" for unit, reason in left_out)
    if left_out:
        raise StageFailed(f"{len(left_out)} of {len(results)} could not be written:{listed}")


def _planned(one: "Exported", redo: bool) -> tuple[str, str, str, str]:
    there = "to replace" if redo else "there, which needs --redo"
    state = there if one.unit.path.exists() else "to write"
    state = f"left out: {one.left_out}" if one.left_out else state
    return one.unit.format, one.unit.name, str(one.unit.path), state
