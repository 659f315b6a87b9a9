"""The verb that hands results on to other programs: export."""

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from gmrdata.cli import options as flags
from gmrdata.cli.gmr import Weights
from gmrdata.values.errors import BadRecipe

FormatName = Literal[
    "colmap",
    "tum",
    "kitti",
    "gem-x",
    "3dpw",
    "emdb",
    "wham",
    "gvhmr",
    "amass",
    "bvh",
    "glb",
    "usd",
    "rrd",
    "mp4",
]
Trajectory = Literal["camera", "person"]
Seen = Literal["keyframes", "all", "none"]


def export(
    source: Positional[Path],
    to: tuple[FormatName | Literal["onnx"], ...],
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
    """Write clips in the formats of other programs.  What can't be written is said by clip.

    Args:
        source: A manifest, a clip's file, or the folder of a rendered set, of sfm, threedpw, floor,
            motions, infer, a baseline or a demo; or of clips' files.
        to: Formats.
            colmap: a COLMAP model, binary and text, with the tracks of a solved sequence.
            tum: trajectory as TUM's RGB-D benchmark has it, with times.
            kitti: trajectory as KITTI's odometry has it, a line per frame.
            gem-x: GEM-X's camera file, preprocess/camera.pt.
            3dpw: 3DPW's sequence files, people and cameras in one world that does not drift.
            emdb: EMDB's files.
            wham: wham_output.pkl.
            gvhmr: hmr4d_results.pt.
            amass: SMPL+H's npz, a file for each unbroken stretch of valid frames.
            bvh: Mixamo's joints [cm], in such files.
            glb: a person and the camera, animated.
            usd: all people of a sequence and the camera (extra `export`).
            rrd: the same for rerun, with frames, masks, points and truth (extra `view`).
            mp4: the frames with bodies and paths drawn over them.
            onnx: the network of a training run, whose folder is then the source.
        out: Output folder: <format>/<clip id>.
        clips: Names of the clips to write; all when left out.
        of: Whose trajectory tum and kitti hold: the camera's, or the person's pelvis.
        observations: Which image points a COLMAP model has: of the keyframes, which the bundle
            adjustment had and whose error is the stage's; those of the frames between too; or none.
        body: "anny", or the file of a body model; the one that lies beside the clips when left out.
        images: Folder with the images of one sequence, or with a folder for each of several, by
            name; for clips that do not say where theirs are.
        truth: Manifest, folder or clip with the exact motions of the same clips, by id.
        threedpw: 3DPW's own folder: the 2D keypoints and clothed templates for 3dpw.
        redo: Write again what is there.
    """
    from gmrdata.export.files import Given, write_exports, write_network
    from gmrdata.export.formats import ExportOptions

    flags.need(to, "a format: --to tum")
    if "onnx" in to and len(set(to)) > 1:
        raise BadRecipe("onnx is of a training run, the other formats of clips. Export it alone")
    if "onnx" in to:
        write_network(source, out, which, redo=redo, dry_run=dry_run)
        return
    write_exports(
        Given(source, clips, body, images, truth),
        tuple(dict.fromkeys(name for name in to if name != "onnx")),
        out,
        ExportOptions(of=of, observations=observations, threedpw=threedpw),
        redo=redo,
        dry_run=dry_run,
    )
