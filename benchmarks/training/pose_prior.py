"""Make `pose_prior.npz` again, from motions of CMU.

    gmrdata motions path/to/cmu --out out/cmu
    PYTHONPATH=benchmarks python -m training.pose_prior out/cmu/motions.yaml OUT/pose_prior.npz

Turns of hips, knees and spine at 10 Hz, each motion and its mirror image, each person alike.  The
shipped one is of the 17 people of the network's card: without subjects 02 and 08, whom `make
bench-poses` films, and the paper's trials, but with the two low clips' of `make bench-people`.
Few sit, squat or kneel, so how far both legs bend is left open.
"""

import sys
from pathlib import Path

import numpy as np
from render.tables import show

from gmrdata.gmr.augmentation import mirror_local
from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.runs import ClipFile, split_manifests, subject_of
from gmrdata.motion.resample import resample, resample_valid
from gmrdata.people.pose_prior import N_PRIOR, PRIOR_JOINTS, TAG
from gmrdata.stage.progress import track
from gmrdata.values.body import JOINT
from gmrdata.values.clip import load_clip
from gmrdata.values.files import write_npz
from gmrdata.values.transforms import rotvecs_from_rotmats

RATE_HZ, HELD_OUT = 10.0, (2, 8)
OWN_RAD = np.deg2rad(4.0)
"""Of each turn, besides: what retargeting and people's own ways change."""
OPEN_RAD = np.deg2rad(80.0)
"""How far both hips, or both knees, may bend more or less than those people's do."""


def turns_rad(file: ClipFile) -> np.ndarray:
    """(2 T, 7, 3) of a motion and its mirror image."""
    clip = load_clip(file.arrays_path)
    valid = resample_valid(clip.valid, clip.motion.fps_hz, RATE_HZ)
    seen = resample(clip.motion, RATE_HZ).local_rotmats[valid]
    rotmats = np.concatenate([seen, mirror_local(seen)])
    return rotvecs_from_rotmats(rotmats[:, [joint - 1 for joint in PRIOR_JOINTS]])


def pose_prior(by_person: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean (21,) and covariance (21, 21) over people, each of whom counts alike."""
    people = [turns.reshape(-1, N_PRIOR) for turns in by_person.values()]
    mean = np.mean([one.mean(axis=0) for one in people], axis=0)
    covariance = np.mean([(one - mean).T @ (one - mean) / len(one) for one in people], axis=0)
    covariance += OWN_RAD**2 * np.eye(N_PRIOR)
    for part in ("hip", "knee"):
        together = np.zeros(N_PRIOR)
        for side in ("left", "right"):
            together[3 * PRIOR_JOINTS.index(JOINT[f"{side}_{part}"])] = np.sqrt(0.5)
        covariance += OPEN_RAD**2 * np.outer(together, together)
    return mean, covariance


def make(manifest_path: Path, out: Path) -> None:
    files = split_manifests([manifest_path], DataConfig(held_out_subjects=HELD_OUT)).training
    by_person: dict[str, list[np.ndarray]] = {}
    for file in track(files, "reading motions"):
        by_person.setdefault(str(subject_of(file.entry.source)), []).append(turns_rad(file))
    mean, covariance = pose_prior({one: np.concatenate(of) for one, of in by_person.items()})
    write_npz(
        out,
        {
            "format": np.array(TAG),
            "mean_rad": mean.round(5),
            "covariance_rad2": covariance.round(6),
        },
    )
    show(f"Motions behind {out}", [{"files": len(files), "people": " ".join(sorted(by_person))}])


if __name__ == "__main__":
    make(Path(sys.argv[1]), Path(sys.argv[2]))
