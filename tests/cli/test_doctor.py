"""What is installed here, as the command line says it."""

import json
import tomllib
from collections.abc import Callable
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import pytest

from gmrdata.read.models import MODELS, models_dir
from gmrdata.values.body import BodyModel

doctor = import_module("gmrdata.cli.doctor")  # beside the verb of that name
REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/gmrdata"


def test_it_finds_what_the_tests_run_with(
    gmrdata: Callable[..., Any], empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = gmrdata("doctor", "--json")
    assert said.returncode == 0, said.stderr
    found = json.loads(said.stdout)
    assert found["good"]
    parts = {part["name"]: part for part in found["parts"]}
    for package in ("numpy", "torch", "pycolmap", "bpy"):
        assert parts[package]["found"] == metadata.version(package)
    blender, *_ = parts["Blender"]["found"].split()  # "5.2.3 LTS"
    assert parts["bpy"]["found"].startswith(blender)
    assert [parts[name]["state"] for name in ("export", "view", "tensorboard")] == ["there"] * 3
    assert parts["SMPL"]["state"] == "missing"
    assert f"free in {empty_cache}" in parts["cache"]["found"]
    # The same as a table, with its remedies.
    monkeypatch.setattr(doctor, "find_parts", lambda: [doctor.Part(**p) for p in parts.values()])
    table = gmrdata("doctor")
    assert table.returncode == 0
    said = " ".join(table.stdout.split())  # a note may take several lines
    assert "gmrdata fetch models" in said and "All that" in said


def test_every_extra_of_users_is_looked_for() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert set(doctor.EXTRAS) == set(project["optional-dependencies"]) - {"dev", "docs"}
    for name, extra in doctor.EXTRAS.items():
        assert any(
            line.startswith(extra.package) for line in project["optional-dependencies"][name]
        )


def test_a_missing_required_part_ends_with_1(
    gmrdata: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    part = doctor.Part("packages", "torch", "missing", "", "pip install 'torch>=2.4'", True)
    monkeypatch.setattr(doctor, "find_parts", lambda: [part])
    for flags in ((), ("--json",)):
        said = gmrdata("doctor", *flags)
        assert said.returncode == 1
        assert "can't work without: torch" in said.stderr
    assert json.loads(said.stdout)["good"] is False


def test_a_library_that_does_not_load_is_said() -> None:
    names = ("json", "no_such_module")
    loaded = doctor._loaded(doctor._start("-c", doctor.LIBRARIES, *names), names)
    assert loaded == ({"json": None, "no_such_module": "No module named 'no_such_module'"}, [])
    died = doctor._loaded(doctor._start("-c", "raise SystemExit(3)"), names)
    assert died == (dict.fromkeys(names, "ended with exit code 3"), [])
    ended = doctor._blender(doctor._start("-c", "raise ImportError('libX.so: not there')"))
    assert ended.state == "broken" and ended.required
    assert ended.found == "ImportError: libX.so: not there"


def test_models_and_bodies_are_looked_into(empty_cache: Path, small_body: BodyModel) -> None:
    assert {part.state for part in doctor._models()} == {"missing"}
    models_dir().mkdir(parents=True)
    (models_dir() / MODELS[0].name).write_bytes(b"not a network")
    first = next(doctor._models())
    assert first.state == "broken" and "--redo" in first.note
    assert not any(part.required and part.state == "missing" for part in doctor._bodies())
