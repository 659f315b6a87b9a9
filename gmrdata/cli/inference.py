"""The verb for world motion from local poses: infer."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.options import body_path
from gmrdata.errors import BadRecipe
from gmrdata.gmr.config import Which


def infer(
    run: Positional[Path],
    source: Positional[Path],
    out: Path,
    body: str = "anny",
    fps_hz: float | None = None,
    joint_map: Path | None = None,
    bridge_frames: int = 0,
    which: Which = "latest",
    video: bool = True,
    redo: bool = False,
) -> None:
    """Predict people's world motion from their local poses, and write it as npz, BVH, GLB, video.

    Args:
        run: Run folder of `gmrdata train`.
        source: Local poses: VIBE's vibe_output.pkl, WHAM's wham_output.pkl, PHALP's and 4D-Humans'
            results, GVHMR's hmr4d_results.pt, an AMASS npz, a clip of gmrdata, BVH or ASF/AMC.
        out: Output folder: infer.json, and for each unbroken run of each person a folder with
            clip.npz, amass.npz, motion.bvh, body.glb, path.png and body.mp4. A run that was stopped
            goes on where it was.
        body: "anny", or the path of an SMPL model (.npz or .pkl) or of a gmrdata body (.npz).
        fps_hz: True frame rate of the poses [Hz]; estimators' files don't say it.
        joint_map: YAML or JSON file: joint name in a BVH or ASF -> joint of the SMPL tree.
        bridge_frames: Longest gap of a person's track that is filled [frames]; at longer ones a new
            motion begins, in a world of its own.
        which: Use the network's weights after its last step, or those that scored best on the clips
            held out from its training.
        video: Whether to draw body.mp4, which takes longest.
        redo: Make anew what other settings made.
    """
    from gmrdata.infer.stage import RECORD_FILE, InferConfig, infer_world_motion
    from gmrdata.store import read_json

    if fps_hz is not None and not 0 < fps_hz < float("inf"):
        raise BadRecipe(f"--fps-hz {fps_hz:g}: must be more than 0")
    if bridge_frames < 0:
        raise BadRecipe(f"--bridge-frames {bridge_frames}: give 0 or more")
    config = InferConfig(fps_hz=fps_hz, bridge_frames=bridge_frames, which=which, video=video)
    path = body_path(body)
    made = infer_world_motion(
        run, source, "anny" if path is None else str(path), out, config,
        joint_map=joint_map, redo=redo,
    )  # fmt: skip
    motions = read_json(made / RECORD_FILE)["motions"]
    print_table(
        ("motion", "frames", "of the video", "filled", "rate [Hz]", "path [m]"),
        [
            (
                name,
                f"{one['frames']}",
                f"{one['first_frame']}-{one['last_frame']}",
                f"{one['filled_frames']}",
                f"{one['fps_hz']:g}",
                f"{one['path_m']:.2f}",
            )
            for name, one in motions.items()
        ],
    )
    answer(made)
