"""Where Blender runs: an environment of its own, with a Python of its own.

It is the one whose Python `GMRDATA_BLENDER_PYTHON` names, else the one that `gmrdata blender setup`
made, else this one, where that has a bpy.  What crosses is files, and the path of what to start.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from gmrdata.stage.locks import locked
from gmrdata.values.errors import BlenderMissing
from gmrdata.values.files import partial_of

PYTHON_NAME = "GMRDATA_BLENDER_PYTHON"
PACKAGES_DIR = Path(__file__).resolve().parents[2]
"""Where the packages `gmrdata` and `blender` are, side by side in a checkout and in a wheel."""
STARTER = PACKAGES_DIR / "blender/start.py"
REQUIREMENTS = PACKAGES_DIR / "blender/requirements.txt"
PYTHONS = ("3.11", "3.13")
"""Those that a pinned bpy is made for, what the figures were made with first."""
VERSIONS_LINE = "gmrdata-versions"  # what its process prints, with its packages as JSON
CHECK = "import sys, ensurepip; print(*sys.version_info[:2], sep='.')"
SETUP = "`gmrdata blender setup` makes it"
SYSTEM_LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXi.so.6": "libxi6",
    "libXfixes.so.3": "libxfixes3",
    "libXrender.so.1": "libxrender1",
    "libSM.so.6": "libsm6",
    "libGL.so.1": "libgl1",
    "libxkbcommon.so.0": "libxkbcommon0",
}
"""What bpy loads on Linux though it draws no window, with Debian's packages of it."""


def setup_dir() -> Path:
    """Where `gmrdata blender setup` makes the environment: in the checkout, or for the user."""
    if (PACKAGES_DIR / "pyproject.toml").is_file():
        return PACKAGES_DIR / ".venv-blender"
    root = os.environ.get("XDG_DATA_HOME")
    return (Path(root) if root else Path.home() / ".local/share") / "gmrdata/blender"


def python_of(environment: Path) -> Path:
    """An environment's Python."""
    return environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def blender_python() -> Path:
    """The Python that Blender runs in.

    Raises:
        BlenderMissing: there is none, or none where the environment names one.
    """
    if named := os.environ.get(PYTHON_NAME):
        if shutil.which(named) is None:
            remedy = f"name a Python that has bpy, or unset it: then {SETUP}"
            raise BlenderMissing(f"{PYTHON_NAME}={named}: no such program; {remedy}")
        return Path(named)
    if (made := python_of(setup_dir())).is_file():
        return made
    if find_spec("bpy") is not None:
        return Path(sys.executable)
    remedy = f"{SETUP}, or {PYTHON_NAME} names a Python that has bpy"
    raise BlenderMissing(f"Blender's environment is not there: {remedy}")


def blender_command(what: str | Path, *words: object) -> list[str]:
    """A command that runs a module, or a script, of Blender's side; errors as `blender_python`."""
    return [str(blender_python()), "-P", str(STARTER), str(what), *map(str, words)]


def blender_variables() -> dict[str, str]:
    """The variables to run that with: what leads this Python to packages is not for another."""
    own = blender_python().absolute() == Path(sys.executable).absolute()
    return {name: text for name, text in os.environ.items() if own or not _leads_python(name)}


def versions_said(lines: Sequence[str]) -> dict[str, str]:
    """Versions of the environment that its process printed; empty where it printed none."""
    said = [line.removeprefix(VERSIONS_LINE) for line in lines if line.startswith(VERSIONS_LINE)]
    return json.loads(said[-1]) if said else {}


def _leads_python(name: str) -> bool:
    return name in ("PYTHONPATH", "PYTHONHOME", "__PYVENV_LAUNCHER__", "VIRTUAL_ENV")


def is_set_up() -> bool:
    """Whether setup made the environment, from the requirements of this version, and its Python is
    still there: it is a link to another, which may have gone."""
    made_of = setup_dir() / REQUIREMENTS.name
    there = python_of(setup_dir()).is_file() and made_of.is_file()
    return there and made_of.read_bytes() == REQUIREMENTS.read_bytes()


def set_up(base: str | None = None, *, redo: bool = False) -> Path:
    """Make Blender's environment unless it is there; by uv where that is installed, else by venv.

    Args:
        base: A Python of a version in `PYTHONS` to make it with; one is looked for when None.
        redo: Make it again.

    Raises:
        BlenderMissing: no such Python is there, or what is needed could not be installed.
    """
    place = setup_dir().resolve()  # a link, as to a larger disk, stays one
    with locked(place):
        if redo or not is_set_up():
            partial = partial_of(place)
            shutil.rmtree(partial, ignore_errors=True)
            uv = shutil.which("uv")
            _make_by_uv(uv, partial, base) if uv else _make_by_venv(partial, base)
            # A folder that exists is complete: no more than its Python is used, which may move.
            shutil.copy(REQUIREMENTS, partial)
            shutil.rmtree(place, ignore_errors=True)
            partial.rename(place)
    return place


def _make_by_uv(uv: str, environment: Path, base: str | None) -> None:
    _run(uv, "venv", "--quiet", "--python", base or PYTHONS[0], environment)
    python = python_of(environment)
    _run(uv, "pip", "install", "--quiet", "--python", python, "--no-deps", "-r", REQUIREMENTS)


def _make_by_venv(environment: Path, base: str | None) -> None:
    _run(base or _find_base(), "-m", "venv", environment)
    install = "-m", "pip", "install", "--quiet", "--no-compile", "--disable-pip-version-check"
    _run(python_of(environment), *install, "--no-deps", "-r", REQUIREMENTS)


def _run(*command: object) -> None:
    words = [str(word) for word in command]
    variables = {name: text for name, text in os.environ.items() if not _leads_python(name)}
    done = subprocess.run(
        words, env=variables, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, errors="replace",
    )  # fmt: skip
    if done.returncode:
        said = "\n".join(done.stdout.splitlines()[-5:])
        raise BlenderMissing(f"Blender's environment: `{' '.join(words)}` failed:\n{said}")


def _find_base() -> str:
    """A Python that has a pinned bpy: of this process, or by its name."""
    for version in PYTHONS:
        for name in (sys.executable, f"python{version}"):
            if _version_of(name) == version:
                return name
    remedy = "install one of them (with its venv), or uv, which fetches one"
    raise BlenderMissing(
        f"Blender's environment needs Python {' or '.join(PYTHONS)}, and none is here: {remedy}; "
        "or name one with --python"
    )


def _version_of(python: str) -> str | None:
    """3.11 for a Python that can make environments; None where there is none."""
    if (program := shutil.which(python)) is None:
        return None
    done = subprocess.run([program, "-c", CHECK], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def missing_system_libraries() -> dict[str, str]:
    """Libraries that bpy needs and that do not load here, with Debian's packages of them."""
    import ctypes

    missing = {}
    for library, package in SYSTEM_LIBRARIES.items() if sys.platform == "linux" else ():
        try:
            ctypes.CDLL(library)
        except OSError:
            missing[library] = package
    return missing
