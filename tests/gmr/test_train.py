"""Training from manifests, as a stage: killed, resumed, and done once."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.body.file import save_body
from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, save_clip
from gmrdata.errors import BadManifest, StaleOutput
from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.config import TrainConfig
from gmrdata.gmr.infer import load_gmr
from gmrdata.gmr.train import train
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.write import write_manifest

PROGRAM = """
import sys
from pathlib import Path
from gmrdata.gmr.train import TrainConfig, train
manifest, body, config, run_dir = sys.argv[1:]
config = TrainConfig.model_validate_json(config)
train([Path(manifest)], Path(run_dir), config, body_path=Path(body))
"""


def write_clips(
    folder: Path, body: BodyModel, clips: list[Clip], quality: Quality | None = None
) -> Path:
    entries = []
    for clip in clips:
        path = folder / f"{clip.id}.npz"
        save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
        entries.append(
            clip_entry(
                folder,
                clip_path=path,
                camera_motion="none",
                licence="CC0-1.0",
                source=Source(dataset="gmrdata", sequence=clip.id),
                quality=quality,
            )
        )
    return write_manifest(
        folder / "manifest.yaml",
        name="walks",
        version="1.0.0",
        description="Clips to train on.",
        kind="motions",
        licence="CC0-1.0",
        clips=entries,
    )


@pytest.fixture
def manifest_path(
    make_clips: Callable[..., list[Clip]], small_body: BodyModel, tmp_path: Path
) -> Path:
    return write_clips(tmp_path / "data", small_body, make_clips(2, 1))


@pytest.fixture
def body_path(small_body: BodyModel, tmp_path: Path) -> Path:
    save_body(tmp_path / "body.npz", small_body)
    return tmp_path / "body.npz"


def test_a_run_folder(
    manifest_path: Path, body_path: Path, small_config: TrainConfig, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    paths = [manifest_path]
    assert train(paths, run_dir, small_config, body_path=body_path) == run_dir
    assert sorted(p.name for p in run_dir.iterdir()) == [
        "checkpoints",
        "metrics.jsonl",
        "stage.json",
    ]
    gmr = load_gmr(run_dir)
    assert (gmr.step, gmr.fps_hz, gmr.model.config) == (12, 10.0, small_config.model)
    written = (run_dir / "stage.json").stat().st_mtime_ns
    train(paths, run_dir, small_config, body_path=body_path)
    assert (run_dir / "stage.json").stat().st_mtime_ns == written
    other = small_config.model_copy(update={"seed": 9})
    with pytest.raises(StaleOutput, match=r"config\.seed"):
        train(paths, run_dir, other, body_path=body_path)
    train(paths, run_dir, other, body_path=body_path, redo=True)
    assert (run_dir / "stage.json").stat().st_mtime_ns != written


def test_rejected_clips_are_not_trained_on(
    make_clips: Callable[..., list[Clip]],
    small_body: BodyModel,
    body_path: Path,
    small_config: TrainConfig,
    tmp_path: Path,
) -> None:
    rejected = Quality(verdict="rejected", reasons=("drift",))
    path = write_clips(tmp_path / "bad", small_body, make_clips(1, 3), rejected)
    with pytest.raises(BadManifest, match="no usable clips"):
        train([path], tmp_path / "run", small_config, body_path=body_path)


def test_kill_9_at_any_time_ends_with_the_same_bytes(
    manifest_path: Path, body_path: Path, small_config: TrainConfig, tmp_path: Path
) -> None:
    """A process is killed twice, at moments that nobody chose, and started again."""
    config = small_config.model_copy(
        update={"steps": 110, "checkpoint_every": 7, "schedule": "cosine"}
    )
    train([manifest_path], tmp_path / "whole", config, body_path=body_path)
    run_dir = tmp_path / "killed"
    arguments = [str(manifest_path), str(body_path), config.model_dump_json(), str(run_dir)]
    steps_at_kill = []
    for more_steps in (10, 45):
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *arguments],
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        before = steps_at_kill[-1] if steps_at_kill else 0
        while _step(run_dir) < before + more_steps:
            assert process.poll() is None, "ended before it could be killed"
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        steps_at_kill.append(_step(run_dir))
    assert not run_dir.exists()
    train([manifest_path], run_dir, config, body_path=body_path)
    whole, killed = _bytes_of(tmp_path / "whole"), _bytes_of(run_dir)
    assert killed == whole


def _step(run_dir: Path) -> int:
    """Step of the unfinished run's latest checkpoint."""
    folder = latest_checkpoint(run_dir.with_name(run_dir.name + ".partial"))
    return int(folder.name.removeprefix("step_")) if folder else 0


def _bytes_of(run_dir: Path) -> dict[str, bytes]:
    """All files but the stage's record, which holds the time it took."""
    return {
        path.relative_to(run_dir).as_posix(): path.read_bytes()
        for path in sorted(run_dir.rglob("*"))
        if path.is_file() and path.name != "stage.json"
    }
