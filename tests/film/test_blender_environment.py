"""Where Blender runs: which environment is found, what it sees, and how it is made."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.film import blender_environment as environment
from gmrdata.values.errors import BlenderMissing
from tests.blender.jobs import in_blender


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> Path:
    """A checkout without any of Blender."""
    monkeypatch.delenv(environment.PYTHON_NAME, raising=False)
    monkeypatch.setattr(environment, "PACKAGES_DIR", tmp_path)
    monkeypatch.setattr(environment, "find_spec", lambda _: None)
    (tmp_path / "pyproject.toml").touch()
    return tmp_path


def test_the_named_one_comes_before_the_made_one_and_this_one_last(checkout, monkeypatch):
    with pytest.raises(BlenderMissing, match="`gmrdata blender setup` makes it"):
        environment.blender_python()
    monkeypatch.setattr(environment, "find_spec", lambda name: name == "bpy")
    assert environment.blender_python() == Path(sys.executable)
    made = environment.python_of(checkout / ".venv-blender")
    made.parent.mkdir(parents=True)
    made.touch()
    assert environment.blender_python() == made
    monkeypatch.setenv(environment.PYTHON_NAME, sys.executable)
    assert environment.blender_python() == Path(sys.executable)
    monkeypatch.setenv(environment.PYTHON_NAME, str(checkout / "none"))
    with pytest.raises(BlenderMissing, match="none: no such program; name a Python"):
        environment.blender_python()


def test_without_a_checkout_it_is_in_the_users_data(checkout, monkeypatch):
    (checkout / "pyproject.toml").unlink()
    monkeypatch.setenv("XDG_DATA_HOME", str(checkout / "data"))
    assert environment.setup_dir() == checkout / "data/gmrdata/blender"
    monkeypatch.delenv("XDG_DATA_HOME")
    assert environment.setup_dir() == Path.home() / ".local/share/gmrdata/blender"


def test_only_our_packages_cross(tmp_path, monkeypatch):
    """What lies beside them in site-packages is made for the library's Python."""
    for name in ("gmrdata", "blender", "numpy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"where = 'beside: {name}'")
    start = tmp_path / "blender/start.py"
    start.write_bytes(environment.STARTER.read_bytes())
    monkeypatch.setattr(environment, "STARTER", start)
    script = tmp_path / "script.py"
    script.write_text("import gmrdata, numpy, sys; print(gmrdata.where, numpy.__file__, *sys.argv)")
    said = in_blender(script, "a word").stdout
    assert said.startswith("beside: gmrdata") and str(tmp_path / "numpy") not in said
    assert said.endswith(f"{script} a word\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    own = str(environment.blender_python().absolute()) == sys.executable
    assert ("PYTHONPATH" in environment.blender_variables()) == own


def test_what_does_not_load_is_said_in_a_line():
    said = in_blender("blender.no_such_module", check=False)
    assert said.returncode == 1 and "Traceback" not in said.stderr
    assert "can't load what it needs: No module named" in said.stderr
    assert "`gmrdata doctor` says how to get it" in said.stderr


@pytest.fixture
def made(checkout, monkeypatch) -> Callable[[], Path]:
    """Makes the environment of no packages, with this Python."""
    requirements = checkout / "requirements.txt"
    requirements.write_text("# none\n")
    monkeypatch.setattr(environment, "REQUIREMENTS", requirements)
    monkeypatch.setattr(environment.shutil, "which", {"uv": None}.get)
    return lambda: environment.set_up(sys.executable)


def test_setup_makes_it_once_again_for_others_and_leaves_it_where_that_fails(made):
    place = made()
    python = environment.python_of(place)
    assert environment.blender_python() == python and python.is_file()
    assert not place.with_name(".venv-blender.partial").exists()
    (place / "mine").touch()
    assert made() == place and (place / "mine").exists()
    environment.REQUIREMENTS.write_text("# others\n")
    assert made() == place and not (place / "mine").exists()
    environment.REQUIREMENTS.write_text("./no_such_folder\n")
    with pytest.raises(BlenderMissing, match=r"pip install .* failed:"):
        made()
    assert environment.python_of(place).is_file() and not environment.is_set_up()


def test_setup_follows_a_link_to_a_larger_disk(made, tmp_path):
    """It made all beside the link, and ended in an OSError."""
    link, disk = environment.setup_dir(), tmp_path / "disk"
    disk.mkdir()
    link.symlink_to(disk / "blender")
    assert made() == made() == disk / "blender" and link.is_symlink()
    environment.REQUIREMENTS.write_text("# others\n")
    assert made() == disk / "blender" and environment.is_set_up()
    assert sorted(path.name for path in disk.iterdir() if path.suffix != ".lock") == ["blender"]


def test_setup_makes_it_again_where_its_python_has_gone(made, monkeypatch):
    """As after an upgrade of what it links to; setup did nothing, and was the remedy named."""

    def make(folder: Path, _base: str | None) -> None:
        environment.python_of(folder).parent.mkdir(parents=True)
        environment.python_of(folder).touch()

    monkeypatch.setattr(environment, "_make_by_venv", make)
    python = environment.python_of(made())
    python.unlink()
    assert not environment.is_set_up()
    assert environment.python_of(made()) == environment.blender_python() == python


def test_uv_makes_it_where_it_is_installed(made, checkout, monkeypatch):
    ran: list[list[str]] = []

    def run(*words: object) -> None:
        ran.append(list(map(str, words)))
        (checkout / ".venv-blender.partial").mkdir(exist_ok=True)

    monkeypatch.setattr(environment, "_run", run)
    monkeypatch.setattr(environment.shutil, "which", {"uv": "/bin/uv"}.get)
    environment.set_up()
    assert [words[:3] for words in ran] == [
        ["/bin/uv", "venv", "--quiet"],
        ["/bin/uv", "pip", "install"],
    ]
    assert ran[0][3:5] == ["--python", "3.11"] and ran[1][-2:] == [
        "-r",
        str(environment.REQUIREMENTS),
    ]


def test_without_a_python_that_has_bpy_both_remedies_are_said(made, monkeypatch):
    monkeypatch.setattr(environment.sys, "executable", "/no/python3.12")
    with pytest.raises(BlenderMissing, match=r"needs Python 3\.11 or 3\.13.*uv.*--python"):
        environment.set_up()


def test_system_libraries_that_do_not_load_are_named(monkeypatch):
    monkeypatch.setattr(
        environment, "SYSTEM_LIBRARIES", {"libc.so.6": "libc6", "libno.so.1": "libno1"}
    )
    monkeypatch.setattr(environment.sys, "platform", "linux")
    assert environment.missing_system_libraries() == {"libno.so.1": "libno1"}
    monkeypatch.setattr(environment.sys, "platform", "darwin")
    assert environment.missing_system_libraries() == {}
