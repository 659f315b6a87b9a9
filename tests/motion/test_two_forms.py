"""CMU's subject 02 as BVH and as AMC: one motion must come out of both readers."""

import numpy as np
import pytest

from gmrdata.motion.files import read_motion
from gmrdata.read.amc import read_amc
from gmrdata.read.bvh import read_bvh
from gmrdata.values.skinning import motion_joints_m

LEGS = {
    "Hips": "root", "LeftUpLeg": "lfemur", "LeftLeg": "ltibia", "LeftFoot": "lfoot",
    "LeftToeBase": "ltoes", "RightUpLeg": "rfemur", "RightLeg": "rtibia", "RightFoot": "rfoot",
    "RightToeBase": "rtoes",
}  # fmt: skip
ABOVE = {
    "LowerBack": "lowerback", "Spine": "upperback", "Spine1": "thorax", "Neck": "lowerneck",
    "Neck1": "upperneck", "Head": "head", "LeftShoulder": "lclavicle", "LeftArm": "lhumerus",
    "LeftForeArm": "lradius", "LeftHand": "lwrist", "LeftFingerBase": "lhand",
    "LeftHandIndex1": "lfingers", "LThumb": "lthumb", "RightShoulder": "rclavicle",
    "RightArm": "rhumerus", "RightForeArm": "rradius", "RightHand": "rwrist",
    "RightFingerBase": "rhand", "RightHandIndex1": "rfingers", "RThumb": "rthumb",
}  # fmt: skip
"""BVH joint -> AMC bone that starts there and turns with it."""
DIRECTIONS = (
    ("LeftUpLeg", "LeftLeg"), ("LeftLeg", "LeftFoot"), ("LeftFoot", "LeftToeBase"),
    ("RightUpLeg", "RightLeg"), ("RightLeg", "RightFoot"), ("RightFoot", "RightToeBase"),
    ("LeftArm", "LeftForeArm"), ("LeftForeArm", "LeftHand"), ("RightArm", "RightForeArm"),
    ("RightForeArm", "RightHand"), ("LeftShoulder", "LeftArm"), ("RightShoulder", "RightArm"),
    ("LowerBack", "Spine"), ("Spine", "Spine1"), ("Neck", "Neck1"), ("Neck1", "Head"),
)  # fmt: skip
"""Bones (start, end) that both skeletons have; the BVH form lacks thorax and hand."""
TRIALS = [f"02_{trial:02d}" for trial in range(1, 11)]


def _angles_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between rotations (..., 3, 3), without the rounding of an arc cosine."""
    return np.rad2deg(2 * np.arcsin(np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8)))


def _directions(positions: np.ndarray, names: tuple[str, ...], bones) -> np.ndarray:
    bone = np.stack(
        [positions[:, names.index(b)] - positions[:, names.index(a)] for a, b in bones], axis=1
    )
    return bone / np.linalg.norm(bone, axis=-1, keepdims=True)


@pytest.mark.parametrize("trial", TRIALS)
def test_both_readers_see_the_same_skeleton_move(cmu_dir, trial):
    bvh = read_bvh(cmu_dir / "bvh" / f"{trial}.bvh")
    amc = read_amc(cmu_dir / "amc" / f"{trial}.amc")
    assert "added rest pose in frame 0 dropped" in bvh.notes
    assert bvh.n_frames == amc.n_frames
    assert bvh.fps_hz == amc.fps_hz == 120.0
    (bvh_rotmats, bvh_m), (amc_rotmats, amc_m) = bvh.posed(), amc.posed()
    names = LEGS | ABOVE
    in_bvh, in_amc = (
        [bvh.names.index(n) for n in names],
        [amc.names.index(n) for n in names.values()],
    )
    n_legs = len(LEGS)
    apart_m = np.linalg.norm(bvh_m[:, in_bvh[:n_legs]] - amc_m[:, in_amc[:n_legs]], axis=-1)
    assert apart_m.max() < 1e-4
    assert _angles_deg(bvh_rotmats[:, in_bvh], amc_rotmats[:, in_amc]).max() < 0.5
    amc_bones = [(names[a], names[b]) for a, b in DIRECTIONS]
    chords = _directions(bvh_m, bvh.names, DIRECTIONS) - _directions(amc_m, amc.names, amc_bones)
    assert np.rad2deg(np.linalg.norm(chords, axis=-1)).max() < 0.5


@pytest.mark.parametrize("trial", TRIALS)
def test_both_forms_give_the_same_body(cmu_dir, small_body, trial):
    from_bvh = read_motion(cmu_dir / "bvh" / f"{trial}.bvh", small_body)
    from_amc = read_motion(cmu_dir / "amc" / f"{trial}.amc", small_body)
    apart_m = motion_joints_m(small_body, from_bvh) - motion_joints_m(small_body, from_amc)
    assert np.linalg.norm(apart_m, axis=-1).max() < 5e-3


def test_rows_without_data_are_dropped(cmu_dir):
    source = read_bvh(cmu_dir / "bvh" / "09_10.bvh")  # T-pose, 4 rows of zeros, then the run
    assert "4 empty frames dropped" in source.notes
    assert source.n_frames == 133 - 5
    steps_m = np.linalg.norm(np.diff(source.translations_m[:, 0], axis=0), axis=1)
    assert steps_m.max() < 0.1
