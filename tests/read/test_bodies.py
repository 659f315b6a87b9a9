"""Loading a body by name or by file."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gmrdata.read import anny as anny_body
from gmrdata.read.bodies import anny_file, cache_dir, load_body, save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadBodyFile, MissingInput


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "gmrdata"


def test_our_own_file_is_known_by_its_content(small_body: BodyModel, tmp_path: Path) -> None:
    save_body(tmp_path / "x.npz", small_body)
    assert load_body(str(tmp_path / "x.npz")).name == "small"


def test_missing_file_says_where_smpl_comes_from(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match=r"SMPL_MALE\.pkl.*'anny'.*smpl\.is\.tue\.mpg\.de"):
        load_body(str(tmp_path / "SMPL_MALE.pkl"))


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "body.obj").write_text("v 0 0 0\n")
    with pytest.raises(BadBodyFile, match=r"body\.obj.*\.npz or \.pkl"):
        load_body(str(tmp_path / "body.obj"))


def test_cache_folder_follows_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_dir() == tmp_path / ".cache" / "gmrdata"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    assert cache_dir() == tmp_path / "elsewhere" / "gmrdata"


def test_askers_at_once_share_one_build(
    small_body: BodyModel, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builds = []

    def slow_build(work_dir: Path) -> BodyModel:
        builds.append(threading.get_ident())
        time.sleep(0.2)
        return small_body

    monkeypatch.setattr(anny_body, "build_anny", slow_build)
    with ThreadPoolExecutor(4) as pool:
        paths = list(pool.map(lambda _: anny_file(), range(4)))
    assert len(builds) == 1
    assert set(paths) == {own_cache / anny_body.file_name()}
    assert load_body("anny").name == "small"


def test_failed_build_leaves_no_file_and_can_be_repeated(
    small_body: BodyModel, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing_build(work_dir: Path) -> BodyModel:
        raise BadBodyFile("anny has other bones")

    monkeypatch.setattr(anny_body, "build_anny", failing_build)
    with pytest.raises(BadBodyFile, match="other bones"):
        load_body("anny")
    assert list(own_cache.glob("*.npz")) == []
    monkeypatch.setattr(anny_body, "build_anny", lambda work_dir: small_body)
    assert load_body("anny").name == "small"


def test_broken_cached_file_says_what_to_delete(own_cache: Path) -> None:
    path = own_cache / anny_body.file_name()
    path.parent.mkdir(parents=True)
    path.write_bytes(b"PK\x03\x04 cut")
    with pytest.raises(BadBodyFile, match=f"Delete {path}"):
        load_body("anny")
