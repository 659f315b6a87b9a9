"""Plot the path that a GMR sees beside the true one, from above, and how they part over time."""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gmrdata


def main(run_dir: Path, motion: Path, out: Path) -> None:
    gmr = gmrdata.load_gmr(run_dir)
    true = gmrdata.read_motion(motion, gmrdata.load_body("anny"))
    # The network sees the local pose alone; the true first pose puts both into one world.
    first = {"first_root_rotmat": true.root_rotmats[0], "first_pelvis_m": true.pelvis_m[0]}
    predicted = gmrdata.predict_world_motion(gmr, true, **first)
    times_s = np.arange(predicted.n_frames) / predicted.fps_hz
    rows = np.round(times_s * true.fps_hz).astype(int)
    error_m = np.linalg.norm(predicted.pelvis_m - true.pelvis_m[rows], axis=1)

    figure, (above, over_time) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for path_m, name in ((true.pelvis_m, "true"), (predicted.pelvis_m, "predicted")):
        above.plot(path_m[:, 0], path_m[:, 1], label=name)
    above.set(title="from above", xlabel="x [m]", ylabel="y [m]", aspect="equal")
    above.legend()
    over_time.plot(times_s, error_m)
    over_time.set(title="distance between the two", xlabel="time [s]", ylabel="distance [m]")
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run_dir", type=Path, help="folder of a trained GMR")
    parser.add_argument("motion", type=Path, help="BVH, AMC or AMASS file, or a clip of gmrdata")
    parser.add_argument("out", type=Path, help="picture to write (.png)")
    main(**vars(parser.parse_args()))
