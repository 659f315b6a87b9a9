"""GEM-X's `preprocess/hpe_results.pt`: one person, with a row for every frame (NVlabs/GEM-X).

And `smpl_params.pt` of GEM-SMPL (NVlabs/GENMO, scripts/demo/demo_smpl_hpe.py), under the same keys:
its body is GVHMR's, so `body_pose` is (T, 63).

By scripts/demo/demo_soma.py and gem/gem.py it is laid out as GVHMR's, with `body_params_global` and
`body_params_incam` of the SOMA body: `body_pose` (T, 228), axis-angle of its 76 joints after the
hips, `global_orient` and `transl` (T, 3), where the hips are [m].  By soma/soma.py (NVlabs/SOMA-X)
a rotation is off SOMA's T-pose, in axes that are the body's, as SMPL's are: y up, z front.

SOMA has one neck joint more; what lies between two joints of SMPL's tree is taken together, and the
hands stay straight.  By nv-tlabs/kimodo's skeleton of SOMA thighs, shins and arms then point 1, 5
and 0 degrees off on the default body.  `identity_coeffs` are of SOMA.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.systems.entries import rotmats_of
from gmrdata.read.systems.gvhmr import GVHMR, Layout, read_gvhmr
from gmrdata.values.body import N_LOCAL
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import EstimatedPeople

_NECK = (4, 5)
# SOMA's joint, the hips being 0, of each joint of SMPL's tree after the pelvis; 0 is none.
_JOINTS = (67, 72, 1, 68, 73, 2, 69, 74, 3, 70, 75, _NECK[0], 11, 39, 6, 12, 40, 13, 41, 14, 42)


def _local_rotmats(body_pose: np.ndarray) -> np.ndarray:
    """Local rotations (T, 23, 3, 3) of SMPL's tree from SOMA's `body_pose` (T, 228) [rad]."""
    rotmats = rotmats_of(body_pose)
    soma = np.concatenate([np.tile(np.eye(3), (len(rotmats), 1, 1, 1)), rotmats], axis=1)
    soma[:, _NECK[0]] = soma[:, _NECK[0]] @ soma[:, _NECK[1]]
    return soma[:, [*_JOINTS, *[0] * (N_LOCAL - len(_JOINTS))]]


GEM = Layout(
    "gem-x", "body_params_global", "body_params_incam", 76, _local_rotmats, np.zeros(3),
    "GEM-X's hpe_results.pt",
)  # fmt: skip

GEM_SMPL = replace(
    GVHMR, system="gem-smpl", world=GEM.world, camera=GEM.camera, file="GEM-SMPL's smpl_params.pt"
)


def read_gem(content: Mapping[Any, Any], path: Path) -> EstimatedPeople:
    segments = content.get("segment_info")  # of demo_smpl.py, which takes videos and texts
    if isinstance(segments, list) and len(segments) > 1:
        what = f"holds {len(segments)} videos or motions of a text, one after another"
        raise BadMotionFile(f"{path}: {what}. Run GEM-SMPL on the one video alone")
    params = [content.get(key) for key in (GEM.world, GEM.camera)]
    poses = [one.get("body_pose") for one in params if isinstance(one, Mapping)]
    of_smpl = any(getattr(one, "shape", ())[-1:] == (3 * GEM_SMPL.n_joints,) for one in poses)
    return read_gvhmr(content, path, GEM_SMPL if of_smpl else GEM)
