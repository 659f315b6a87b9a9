"""The verb that hands results on to other programs: export."""

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from gmrdata.cli import options as flags

FormatName = Literal["colmap", "tum", "kitti", "gem-x"]
Trajectory = Literal["camera", "person"]
Seen = Literal["keyframes", "all", "none"]


def export(
    source: Positional[Path],
    to: tuple[FormatName, ...],
    out: Path,
    clips: tuple[str, ...] = (),
    of: Trajectory = "camera",
    observations: Seen = "keyframes",
    body: str | None = None,
    images: Path | None = None,
    truth: Path | None = None,
    redo: bool = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Write clips in the formats of other programs.  What can't be written is said by clip.

    Args:
        source: A manifest, a clip's file, or the folder of a rendered set, of sfm, threedpw, floor,
            infer or a demo.
        to: Formats. colmap: a COLMAP model, binary and text, with the tracks of a solved sequence;
            tum: trajectory as TUM's RGB-D benchmark has it, with times;
            kitti: trajectory as KITTI's odometry has it, a line per frame;
            gem-x: GEM-X's camera file, preprocess/camera.pt.
        out: Output folder: <format>/<clip id>.
        clips: Names of the clips to write; all when left out.
        of: Whose trajectory tum and kitti hold: the camera's, or the person's pelvis.
        observations: Which image points a COLMAP model has: of the keyframes, which the bundle
            adjustment had and whose error is the stage's; those of the frames between too; or none.
        body: "anny", or the file of a body model; the one that lies beside the clips when left out.
        images: Folder with the images, or with a folder of them for each sequence, where the
            clips do not say it.
        truth: Manifest, folder or clip with the exact motions of the same clips, by id.
        redo: Write again what is there.
    """
    from gmrdata.cli.export_files import Given, write_exports
    from gmrdata.cli.export_formats import ExportOptions

    flags.need(to, "a format: --to tum")
    write_exports(
        Given(source, clips, body, images, truth),
        tuple(dict.fromkeys(to)),
        out,
        ExportOptions(of=of, observations=observations),
        redo=redo,
        dry_run=dry_run,
    )
