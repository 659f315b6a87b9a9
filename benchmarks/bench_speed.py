"""Where the camera stage's time goes on 300 frames of 1080x1920.

The dancer of the test data, twice as large and cut to that shape, without masks.  Prints processor
seconds by part and writes out/bench/speed.json; `--small` takes 45 frames.  With `--beside COMMIT`
the whole stage is run twice by that version and by this one, in turns, on all cores: the two shares
of time must be 0.7 at most.
"""

import json
import subprocess
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
from dask.local import SynchronousExecutor
from record import OUT_DIR
from render.tables import show

from gmrdata.cameras import reconstruct as stage
from gmrdata.cameras.check import agreement
from gmrdata.cameras.map import mapping
from gmrdata.cameras.match import keyframes, matches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.read.frames import read_frames
from gmrdata.stage import store
from gmrdata.values.camera import Lens
from gmrdata.values.files import write_json

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "speed.json"
SIZE_PX = (1080, 1920)
MOST_OF_OLDER = 0.7  # of the older version's time
HERE = Path(__file__).parent
PARTS: dict[str, list[tuple[Any, str]]] = {
    "hashing and sizes": [(store, "sha256_of_file"), (stage, "check_images")],
    "decoding": [(cv2, "imdecode")],
    "reducing": [(cv2, "resize"), (cv2, "imencode")],
    "following points": [(keyframes, "_flow"), (cv2, "goodFeaturesToTrack")],
    "choosing keyframes": [(stage, "choose_keyframes")],
    "features": [(matches, "find_features")],
    "matching": [(matches, "match_features"), (matches, "sort_pairs"), (matches, "read_matches")],
    "keypoint adjustment": [(stage, "adjust_keypoints")],
    "pure rotation": [(stage, "solve_rotation_only")],
    "mapping": [(pycolmap, "global_mapping"), (pycolmap, "incremental_mapping")],
    "adjusting": [(mapping, "_finish")],
    "frames between": [(stage, "with_frames_between"), (mapping, "place_frames")],
    "checks": [(mapping, "freed_focal"), (stage, "weakest_step")],
    "second solution": [(agreement, "map_again")],
    "refinement": [(stage, "refine_mapped")],
}


class Clock:
    """Processor seconds by part; those of a part within another count for the inner one alone."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys([*PARTS, "all else"], 0.0)
        self._open, self._since = ["all else"], process_time()

    def switch(self) -> None:
        """Book the time since the last switch."""
        now = process_time()
        self.seconds[self._open[-1]] += now - self._since
        self._since = now

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            self.switch()
            self._open.append(part)
            try:
                return function(*args, **kwargs)
            finally:
                self.switch()
                self._open.pop()

        return call


def lay_out(archive: Path, n_frames: int, images_dir: Path) -> np.ndarray:
    """Write the frames; their calibration matrix (3, 3) [px]."""
    images_dir.mkdir()
    with tarfile.open(archive) as tar:
        metadata = json.load(tar.extractfile("dance/metadata"))  # type: ignore[arg-type]
        for i in range(n_frames):
            data = tar.extractfile(f"dance/rgbd/{i}.jpg").read()  # type: ignore[union-attr]
            image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
            large = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
            left = (large.shape[1] - SIZE_PX[0]) // 2
            middle = np.ascontiguousarray(large[: SIZE_PX[1], left : left + SIZE_PX[0]])
            quality = [cv2.IMWRITE_JPEG_QUALITY, 92]
            cv2.imwrite(str(images_dir / f"{i:05d}.jpg"), middle, quality)
    intrinsics_px = np.array(metadata["K"]).reshape(3, 3).T
    intrinsics_px[:2] *= 2
    intrinsics_px[0, 2] -= left
    return np.asarray(intrinsics_px)


def test_where_the_time_goes(
    shared_data: Path, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: Any
) -> None:
    n_frames = 45 if request.config.getoption("--small") else 300
    images_dir = tmp_path / "frames"
    intrinsics_px = lay_out(shared_data / "video" / "dance.tar", n_frames, images_dir)
    # With one thread for each of them, and what runs beside mapping done before it, no part runs
    # while another is timed.
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(stage, "ThreadPoolExecutor", lambda _: SynchronousExecutor())
    clock = Clock()
    for part, functions in PARTS.items():
        for module, name in functions:
            monkeypatch.setattr(module, name, clock.timed(part, getattr(module, name)))
    frames = read_frames(images_dir)
    lens = Lens.of_matrix(intrinsics_px, frames.size_px)
    stage.reconstruct(frames, None, lens, tmp_path / "sfm", SfmConfig())
    clock.switch()
    rows = [{"part": part, "seconds": round(s, 2)} for part, s in clock.seconds.items()]
    total = round(sum(clock.seconds.values()), 2)
    show(
        f"{n_frames} frames of 1080x1920: processor seconds",
        [*rows, {"part": "all", "seconds": total}],
    )
    write_json(OUT, {"frames": n_frames, "seconds": total, "parts": clock.seconds})


def test_beside_an_older_version(
    shared_data: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    commit, small = request.config.getoption("--beside"), request.config.getoption("--small")
    if commit is None:
        pytest.skip("--beside names the version")
    images_dir, older, root = tmp_path / "frames", tmp_path / "older", HERE.parent
    intrinsics_px = lay_out(shared_data / "video" / "dance.tar", 45 if small else 300, images_dir)
    np.save(tmp_path / "K.npy", intrinsics_px)
    archive = tmp_path / "older.tar"
    subprocess.run(["git", "archive", "--output", str(archive), commit], cwd=root, check=True)
    with tarfile.open(archive) as tar:
        tar.extractall(older, filter="data")

    def run(tree: Path, name: str) -> dict[str, float]:
        paths = [HERE / "sfm" / "older.py", tree, images_dir, tmp_path / "K.npy", tmp_path / name]
        command = [sys.executable, *map(str, paths)]
        done = subprocess.run(command, check=True, capture_output=True, cwd=tree)
        return dict(json.loads(done.stdout.splitlines()[-1]))

    rows: list[dict[str, Any]] = []
    shares = []
    for turn in range(2):
        before, now = run(older, f"older{turn}"), run(root, f"now{turn}")
        shares.append(now["seconds"] / before["seconds"])
        rows.append({"version": commit, "share": 1.0} | before)
        rows.append({"version": "now", "share": round(shares[-1], 2)} | now)
    show(f"The stage of this version beside {commit}", rows)
    assert small or max(shares) <= MOST_OF_OLDER
