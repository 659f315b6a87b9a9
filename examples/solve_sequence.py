"""The world motion of one sequence, from its frames and the person in the camera's frame.

Of the camera, only the intrinsics are used.  render_clip.py makes a sequence to try it on.
"""

import argparse
from pathlib import Path

import numpy as np

import gmrdata


def path_m(motion: gmrdata.Motion) -> float:
    """Length of the pelvis' path on the ground [m]."""
    steps_m = np.diff(motion.pelvis_m[:, :2], axis=0)
    return float(np.nansum(np.linalg.norm(steps_m, axis=1)))


def main(frames: Path, seen: Path, body: Path, out: Path, truth: Path | None) -> None:
    people = (gmrdata.PersonFiles(seen, body),)
    made = gmrdata.solve_sequence(frames, people, out, gmrdata.SequenceConfig())
    clip = gmrdata.load_clip(made / "person_0.npz")
    print(f"{made}: {clip.valid.sum()} of {clip.motion.n_frames} frames have a world motion")
    print(f"path on the ground: {path_m(clip.motion):.2f} m")
    if truth is not None:
        print(f"true path: {path_m(gmrdata.load_clip(truth).motion):.2f} m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frames", type=Path, help="folder of numbered images, or a video")
    parser.add_argument("seen", type=Path, help="clip file with the motion in the camera's frame")
    parser.add_argument("body", type=Path, help="file of the person's body")
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--truth", type=Path, help="clip file with the true world motion")
    main(**vars(parser.parse_args()))
