"""The networks' files: fetched from a real server on this machine, verified, found again."""

from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.download import FetchConfig, fetch_plan
from gmrdata.read.models import (
    MODELS,
    POSE_LANDMARKS,
    QUICK_LANDMARKS,
    YOLOX_NANO,
    fetch_models,
    find_model,
    wanted_models,
)
from gmrdata.values.errors import BadDetector, BadRecipe, FetchFailed, MissingInput
from tests.fixtures.command_line import fails_cleanly
from tests.fixtures.file_server import Server, drop_half, status

NAMES = ["pose_landmark_heavy.tflite", "pose_landmark_lite.tflite", "yolox_nano.onnx"]


@pytest.fixture
def server(file_server, shared_path) -> Server:
    """Serves the published files."""
    for model in MODELS:
        file_server.files[f"/{model.name}"] = shared_path(f"models/{model.name}").read_bytes()
    return file_server


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """The folder in which models are looked for, which is not there yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "gmrdata" / "models"


def fetch(server: Server, out: Path, redo: bool = False) -> list[Path]:
    config = FetchConfig(base_url=server.url, timeout_s=5.0, attempts=2)
    rng = np.random.default_rng(1)
    return fetch_models(out, config, rng, redo=redo, sleep=lambda wait_s: None)


def names(out: Path) -> list[str]:
    return sorted(path.name for path in out.iterdir())


def test_the_command_fetches_once_and_says_where_they_are(server, cache, works):
    for _ in range(2):
        told = works("fetch", "models", "--base-url", server.url).stdout.split()
        assert told == [str(cache / model.name) for model in MODELS]
    assert len(server.seen) == 3
    assert names(cache) == NAMES
    for model in MODELS:
        assert find_model(model).read_bytes() == server.files[f"/{model.name}"]


def test_a_folder_of_this_machine_is_a_mirror(server, tmp_path):
    folder = tmp_path / "mirror"
    folder.mkdir()
    for name, content in server.files.items():
        (folder / name[1:]).write_bytes(content)
    made = fetch_models(tmp_path / "models", FetchConfig(base_url=str(folder)))
    assert [path.read_bytes() for path in made] == [server.files[f"/{m.name}"] for m in MODELS]
    assert not server.seen
    with pytest.raises(BadRecipe, match="--base-url .*or a folder that is there"):
        fetch_models(tmp_path / "models", FetchConfig(base_url=str(tmp_path / "gone")))


def test_a_dry_run_tells_the_published_addresses_and_what_is_there(server, cache, works):
    assert not cache.exists()
    _, rows = fetch_plan(wanted_models(cache, FetchConfig()))
    assert rows == [
        (model.name, model.url, "to do") for model in (YOLOX_NANO, POSE_LANDMARKS, QUICK_LANDMARKS)
    ]
    server.answers["/yolox_nano.onnx"] = [drop_half, status(503)]
    with pytest.raises(FetchFailed):
        fetch(server, cache)
    states = [file.state() for file in wanted_models(cache, FetchConfig())]
    assert states == ["unfinished", "done", "done"]
    assert "pose_landmark_heavy.tflite" in works("fetch", "models", "--dry-run").stdout


def test_a_stopped_run_leaves_no_half_file_and_a_later_one_goes_on(server, cache):
    server.answers["/yolox_nano.onnx"] = [drop_half, status(503)]
    with pytest.raises(FetchFailed, match=r"503.*The same command goes on"):
        fetch(server, cache)
    assert names(cache) == [*NAMES[:2], "yolox_nano.onnx.part", "yolox_nano.onnx.part.json"]
    with pytest.raises(MissingInput, match=r"yolox_nano\.onnx: no such model file"):
        find_model(YOLOX_NANO)
    fetch(server, cache)
    half = len(server.files["/yolox_nano.onnx"]) // 2
    assert server.requests("yolox_nano.onnx") == [None, f"bytes={half}-", f"bytes={half}-"]
    assert names(cache) == NAMES and find_model(YOLOX_NANO) == cache / "yolox_nano.onnx"


def test_another_content_is_refused_and_the_other_file_comes(server, cache):
    server.files["/yolox_nano.onnx"] += b"\0"
    with pytest.raises(
        FetchFailed, match=r"/yolox_nano\.onnx: not the published file: its SHA-256"
    ):
        fetch(server, cache)
    assert names(cache) == NAMES[:2]


def test_a_file_of_another_content_is_kept_without_redo(server, cache):
    cache.mkdir(parents=True)
    (cache / "yolox_nano.onnx").write_text("mine")
    with pytest.raises(FetchFailed, match="another hash: move it away, or pass --redo"):
        fetch(server, cache)
    assert (cache / "yolox_nano.onnx").read_text() == "mine"
    with pytest.raises(BadDetector, match="not the published file; `gmrdata fetch models`"):
        find_model(YOLOX_NANO)
    assert find_model(POSE_LANDMARKS, cache / "yolox_nano.onnx") == cache / "yolox_nano.onnx"
    fetch(server, cache, redo=True)
    assert find_model(YOLOX_NANO).read_bytes() == server.files["/yolox_nano.onnx"]


def test_wrong_command_lines_are_told(cache, gmrdata):
    fails_cleanly(gmrdata("fetch", "models", "02_03"), "trials and --list are for fetch cmu")
    with pytest.raises(BadRecipe, match="--base-url"):
        fetch_models(cache, FetchConfig(base_url="ftp://here"), np.random.default_rng())
    assert not cache.exists()
