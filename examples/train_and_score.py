"""Train a small GMR on gait that a program makes, and score it; BVH, AMC and AMASS work as well."""

import argparse
from pathlib import Path

import numpy as np

import gmrdata


def write_walks(folder: Path, count: int, rng: np.random.Generator) -> None:
    body = gmrdata.load_body("anny")
    for id in (f"{folder.name}_{index}" for index in range(count)):
        walk = gmrdata.make_gait("walk", 8.0, 30.0, body, rng)
        clip = gmrdata.Clip(id, walk, np.ones(240, bool), np.full(240, -1), None)
        gmrdata.save_clip(folder / f"{id}.npz", clip, body.rest_pelvis_m(walk.shape))


def main(out: Path, walks: int, steps: int) -> None:
    rng = np.random.default_rng(0)
    for name, count in (("training", walks), ("scored", 3)):
        write_walks(out / "files" / name, count, rng)
        gmrdata.make_library((out / "files" / name,), "anny", out / name)
    small = {"layers": 2, "hidden": 128, "output_scale": 0.1}
    settings = {"model": small, "learning_rate": 0.003, "batch_size": 16, "steps": steps}
    config = gmrdata.TrainConfig.model_validate(settings)
    run_dir = gmrdata.train([out / "training/motions.yaml"], out / "run", config)
    scored = gmrdata.score(run_dir, out / "scored/motions.yaml", out / "scores")
    error = gmrdata.Scores.read(*scored.scores).overall.pooled_over_motions.predicted
    print(f"OME {error.ome_deg:.2f} deg, TME {error.tme_mm:.1f} mm")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--walks", type=int, default=20, help="motions to train on")
    parser.add_argument("--steps", type=int, default=700, help="steps of the training")
    main(**vars(parser.parse_args()))
