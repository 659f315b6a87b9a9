"""Fixtures that several tests share."""

import tests.shape_checks  # noqa: F401, I001  First: it checks the modules that are imported after it.

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from dataclasses import replace
from gmrdata.read.bodies import load_body
from gmrdata.values.body import JOINT, PARENTS, BodyModel
from tests.folders import REPOSITORY
from tests.sharing import made_once

# A busy machine is no failure.  Few examples by default; `.ci/run` tries many.
settings.register_profile("few", deadline=None, max_examples=20)
settings.register_profile("many", deadline=None, max_examples=100)
settings.load_profile("many" if os.environ.get("GMRDATA_TEST_REQUIRE_ALL") == "1" else "few")

# As `make test` sets it, for whoever runs pytest: sums of several threads differ in the last bits.
os.environ.setdefault("OMP_NUM_THREADS", "1")

pytest_plugins = (
    "tests.browser",
    "tests.filming",
    "tests.fixtures.command_line",
    "tests.fixtures.file_server",
    "tests.fixtures.filmed_sets",
    "tests.fixtures.inference",
    "tests.fixtures.motion_files",
    "tests.fixtures.threedpw_files",
    "tests.required",
)

SHARED_DATA = REPOSITORY.parent / "shared" / "data"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that processes of a run end at about the same time."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real motions, videos and weights, which the project doesn't carry itself."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data not at {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def shared_path(shared_data) -> Callable[[str], Path]:
    """Finds a file or folder of the real data by its place in there."""

    def find(place: str) -> Path:
        if not (path := shared_data / place).exists():
            pytest.skip(f"real data not at {path}")
        return path

    return find


@pytest.fixture(scope="session")
def yolox_nano(shared_path) -> Path:
    """The real YOLOX-nano weights."""
    return shared_path("models/yolox_nano.onnx")


@pytest.fixture(scope="session")
def pose_landmarks(shared_path) -> Path:
    """The real weights of BlazePose GHUM lite."""
    return shared_path("models/pose_landmark_lite.tflite")


@pytest.fixture
def no_scheduler(monkeypatch) -> str:
    """An address at which no Dask scheduler is, for which nobody waits the usual five seconds."""
    monkeypatch.setattr("gmrdata.stage.workers.CONNECT_S", 0.5)
    return "tcp://127.0.0.1:9"


@pytest.fixture(scope="session")
def cmu_dir(shared_data, tmp_path_factory) -> Path:
    """Real CMU motions, unpacked: `bvh/*.bvh` and `amc/*.{asf,amc}`."""

    def unpack(root: Path) -> None:
        subprocess.run(["bash", str(shared_data / "unpack"), str(root)], check=True)

    return made_once(tmp_path_factory, "cmu_data", unpack) / "cmu"


# Joints of a standing person of 1.72 m: left side and middle, height above the floor, [m].
_SMALL_JOINTS_M = {
    "pelvis": (0.0, 0.95, 0.0), "spine1": (0.0, 1.06, -0.02), "spine2": (0.0, 1.19, -0.02),
    "spine3": (0.0, 1.25, -0.01), "neck": (0.0, 1.46, -0.02), "head": (0.0, 1.54, 0.02),
    "left_hip": (0.09, 0.90, 0.0), "left_knee": (0.10, 0.50, 0.0),
    "left_ankle": (0.10, 0.09, -0.03), "left_foot": (0.11, 0.03, 0.10),
    "left_collar": (0.08, 1.37, -0.01),
    "left_shoulder": (0.18, 1.40, -0.02), "left_elbow": (0.44, 1.40, -0.03),
    "left_wrist": (0.69, 1.40, -0.03), "left_hand": (0.77, 1.395, -0.03),
}  # fmt: skip
_SMALL_TIPS_M = {
    "head": (0.0, 0.18, 0.0),
    "left_hand": (0.10, 0.0, 0.0),
    "right_hand": (-0.10, 0.0, 0.0),
    "left_foot": (0.0, 0.0, 0.08),
    "right_foot": (0.0, 0.0, 0.08),
}
_SMALL_GROWTH = {  # coefficient -> joints whose bone from the parent it lengthens by 5 %
    2: ("knee", "ankle"), 3: ("elbow", "wrist"), 4: ("collar", "shoulder"), 5: ("hip",),
    6: ("spine1", "spine2", "spine3"), 7: ("neck", "head"), 8: ("foot",), 9: ("hand",),
}  # fmt: skip
_BOX_FACES = [
    (0, 1, 2), (1, 3, 2), (4, 6, 5), (5, 6, 7), (0, 4, 1), (1, 4, 5),
    (2, 3, 6), (3, 7, 6), (0, 2, 4), (2, 6, 4), (1, 5, 3), (3, 5, 7),
]  # fmt: skip


def _small_joints_m() -> np.ndarray:
    joints_m = np.zeros((24, 3))
    for name, place_m in _SMALL_JOINTS_M.items():
        joints_m[JOINT[name]] = place_m
        if name.startswith("left"):
            joints_m[JOINT[name.replace("left", "right")]] = np.multiply(place_m, (-1, 1, 1))
    # As in SMPL, the origin is neither the pelvis nor the floor.
    return joints_m - (0.002, 1.18, -0.02)


def _small_box(start_m: np.ndarray, end_m: np.ndarray) -> np.ndarray:
    """Corners (8, 3) of a box round the line between two points, off the line by up to 7 cm."""
    along = (end_m - start_m) / np.linalg.norm(end_m - start_m)
    aside = np.cross(along, (0.0, 0.0, 1.0) if abs(along[2]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    third = np.cross(along, aside)
    half_m = 0.07 if abs(start_m[0]) < 0.1 and start_m[1] > -0.35 else 0.045
    offsets_m = [half_m * (i * aside + j * third) for i in (-1, 1) for j in (-1, 1)]
    return np.array([p + o for p in (start_m, end_m) for o in offsets_m])


@pytest.fixture(scope="session")
def anny() -> BodyModel:
    """The default body."""
    return load_body("anny")


@pytest.fixture(scope="session")
def small_body() -> BodyModel:
    """A made-up body of 1.72 m with boxes for bones: 224 vertices, SMPL's axes, 10 coefficients.

    Coefficient 0 makes the whole body 4 % larger per unit, 1 makes it 5 % stouter, the others
    lengthen bones.  The soles are at y = -1.195 m of the rest frame at shape zero.
    """
    joints_m = _small_joints_m()
    bones = [(PARENTS[j], j, joints_m[j]) for j in range(1, 24)]
    bones += [(JOINT[n], JOINT[n], joints_m[JOINT[n]] + tip) for n, tip in _SMALL_TIPS_M.items()]
    boxes_m = [_small_box(joints_m[start], end_m) for start, _, end_m in bones]
    weights = np.zeros((8 * len(bones), 24))
    joint_share = np.zeros_like(weights)  # the joint that each vertex goes with as bones grow
    for n, (start, end, _) in enumerate(bones):
        near, far = slice(8 * n, 8 * n + 4), slice(8 * n + 4, 8 * n + 8)
        weights[near, start] += 1.0
        weights[far, start] += 0.7
        weights[far, end] += 0.3
        joint_share[near, start] = joint_share[far, end] = 1.0
    template_m = np.concatenate(boxes_m)
    joint_dirs_m, dirs_m = np.zeros((24, 3, 10)), np.zeros((len(template_m), 3, 10))
    joint_dirs_m[..., 0], dirs_m[..., 0] = 0.04 * joints_m, 0.04 * template_m
    dirs_m[..., 1] = 0.05 * (template_m - joint_share @ joints_m)
    for coefficient, grown in _SMALL_GROWTH.items():
        for j in range(1, 24):
            name = next(n for n, i in JOINT.items() if i == j).split("_")[-1]
            bone_m = 0.05 * (joints_m[j] - joints_m[PARENTS[j]]) if name in grown else np.zeros(3)
            joint_dirs_m[j, :, coefficient] = joint_dirs_m[PARENTS[j], :, coefficient] + bone_m
        dirs_m[..., coefficient] = joint_share @ joint_dirs_m[..., coefficient]
    faces = np.concatenate([np.array(_BOX_FACES) + 8 * n for n in range(len(bones))])
    return BodyModel(
        name="small",
        template_m=template_m,
        shape_dirs_m=dirs_m,
        joints_template_m=joints_m,
        joint_shape_dirs_m=joint_dirs_m,
        skin_weights=weights,
        faces=faces,
        pose_dirs_m=None,
        licence="CC0-1.0",
    )


@pytest.fixture(scope="session")
def neutral(small_body) -> BodyModel:
    """The small body by the name of SMPL's neutral one, as other systems' people are of."""
    return replace(small_body, name="smpl-neutral")
