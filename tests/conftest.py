"""Fixtures that several tests share."""

import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED_DATA = REPOSITORY.parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real motions, videos and weights, which the project doesn't carry itself."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"real data not at {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def cmu_dir(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Real CMU motions, unpacked: `bvh/*.bvh` and `amc/*.{asf,amc}`."""
    root = tmp_path_factory.mktemp("cmu_data")
    subprocess.run(["bash", str(shared_data / "unpack"), str(root)], check=True)
    return root / "cmu"
