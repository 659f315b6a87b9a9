"""Film a walking person, who is made by a program: frames, masks, exact camera and world motion."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import gmrdata


def main(out: Path, kind: str, duration_s: float, width_px: int) -> None:
    rng = np.random.default_rng(0)
    body = gmrdata.load_body("anny")
    gmrdata.save_body(out / "body.npz", body)
    walk = gmrdata.make_gait("walk", duration_s, 10.0, body, rng)
    rest_pelvis_m = body.rest_pelvis_m(walk.shape)
    programme, size_px = gmrdata.camera_programme(kind), (width_px, width_px * 9 // 16)
    camera = gmrdata.camera_path(programme, walk.pelvis_m, walk.fps_hz, *size_px, 60.0, rng)
    rows = np.arange(walk.n_frames)
    clip = gmrdata.Clip("walk", walk, rows >= 0, rows, camera)
    planned = out / "planned.npz"
    gmrdata.save_clip(planned, clip, rest_pelvis_m)
    config = gmrdata.RenderConfig(samples=3)
    made = gmrdata.render_clip(planned, out / "body.npz", out / "clip", config)

    # What a data set like 3DPW gives of a person: the motion in the camera's frame.
    seen = replace(clip, motion=gmrdata.motion_in_camera(walk, camera.world_from_cam))
    gmrdata.save_clip(out / "seen.npz", seen, rest_pelvis_m)
    print(f"{made / 'frames'}: {walk.n_frames} frames of {size_px[0]} x {size_px[1]} pixels")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--kind", default="circular", help="camera programme")
    parser.add_argument("--duration-s", type=float, default=3.0, help="length [s]")
    parser.add_argument("--width-px", type=int, default=640, help="image width [px]")
    main(**vars(parser.parse_args()))
