"""The measurements use the tests' fixtures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from real.session import RealSession
    from sfm.session import Session

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE)]
pytest_plugins = ["conftest"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--small`: try every part of a measurement, without its bars.  `--twins`: see bench_sfm.
    `--clips`, `--ours-alone`: see bench_real.  `--bvh`, `--released`: see bench_open."""
    parser.addoption("--small", action="store_true", help="small sizes, and no bars")
    parser.addoption("--twins", type=Path, help="a folder that `gmrdata threedpw twin` made")
    parser.addoption("--pseudo-gt", type=Path, help="what `threedpw regenerate` left of twins")
    parser.addoption("--motions", type=Path, help="a manifest of CMU's motions")
    parser.addoption("--gmr", type=Path, help="a run that held the twins' people out")
    parser.addoption("--clips", type=Path, help="a folder that real/layout.py made")
    parser.addoption("--videos", type=Path, help="a folder of the videos of video/real.py")
    parser.addoption("--bvh", type=Path, help="a folder of BVH files of others")
    parser.addoption("--released", type=Path, help="a folder of clones of others' evaluators")
    parser.addoption("--beside", help="an older commit, for bench_speed.py")
    parser.addoption("--hours", type=float, default=1.0, help="how long bench_soak.py takes")
    parser.addoption("--minutes", type=float, default=10.0, help="how long bench_fuzz.py takes")
    parser.addoption("--lengths", type=int, nargs="+", help="frames of the runs of bench_long.py")
    parser.addoption("--target", help="the one reader that bench_fuzz.py tries")
    parser.addoption("--ours-alone", action="store_true", help="nothing beside it, no bars")
    parser.addoption("--resume", action="store_true", help="take up rows of an earlier run")


@pytest.fixture(scope="session")
def sfm(request: pytest.FixtureRequest) -> Session:
    """What the measurements of the COLMAP stage share."""
    from sfm.session import Session

    return Session(
        small=request.config.getoption("--small"),
        twins_given=request.config.getoption("--twins"),
        motions_dir=lambda: request.getfixturevalue("cmu_dir"),
    )


@pytest.fixture(scope="session")
def real(request: pytest.FixtureRequest, shared_data: Path) -> RealSession:
    """What the measurements on real clips share."""
    from real.session import RealSession

    return RealSession(
        small=request.config.getoption("--small"),
        ours_alone=request.config.getoption("--ours-alone"),
        clips_dir=request.config.getoption("--clips") or Path("out/bench/clips"),
        detector=shared_data / "models" / "yolox_nano.onnx",
        resume=request.config.getoption("--resume"),
    )
