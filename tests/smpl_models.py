"""Made-up bodies in SMPL's name and layout: the real ones may not be passed on."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.read.body_file import save_body
from gmrdata.values.body import PARENTS, BodyModel

SIZES = {"female": 0.94, "male": 1.06, "neutral": 1.0}
"""How much larger the body of a gender is; its arms are that much larger again."""
FILES = {
    "female": "basicmodel_f_lbs_10_207_0_v1.1.0.npz",
    "male": "male/model.npz",
    "neutral": "SMPL_NEUTRAL.npz",
}
"""Names of model files, each as one of SMPL's releases has them."""


def save_smpl(path: Path, small_body: BodyModel, gender: str) -> BodyModel:
    """Write the tests' small body under the name of one of SMPL's."""
    body = replace(small_body, name=f"smpl-{gender}")
    path.parent.mkdir(parents=True, exist_ok=True)
    save_body(path, body)
    return body


def write_smpl_folder(folder: Path, small_body: BodyModel, n_shape: int = 16) -> None:
    """Write SMPL's arrays of bodies of each gender, of other proportions, under usual names."""
    for gender, name in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **smpl_arrays(small_body, SIZES[gender], n_shape))  # type: ignore[arg-type]


def smpl_arrays(small_body: BodyModel, size: float, n_shape: int) -> dict[str, np.ndarray]:
    """The tests' small body in SMPL's layout, its regressor and its tree included."""
    n_vertices = len(small_body.template_m)
    regressor = np.zeros((24, n_vertices))
    regressor[0, :4] = 0.25  # the near end of the first bone's box, then the far ends of all
    for joint in range(1, 24):
        regressor[joint, 8 * joint - 4 : 8 * joint] = 0.25
    template_m = size * small_body.template_m * [size, 1.0, 1.0]
    shape_dirs_m = np.zeros((n_vertices, 3, n_shape))
    shape_dirs_m[..., :10] = small_body.shape_dirs_m
    for extra in range(10, n_shape):
        shape_dirs_m[..., extra] = 0.004 * np.sin(extra * template_m)
    return {
        "v_template": template_m,
        "shapedirs": shape_dirs_m,
        "posedirs": np.zeros((n_vertices, 3, 207)),
        "J_regressor": regressor,
        "weights": small_body.skin_weights,
        "kintree_table": np.stack([[2**32 - 1, *PARENTS[1:]], np.arange(24)]).astype(np.uint32),
        "f": small_body.faces.astype(np.uint32),
    }
