"""The verbs that say what is installed here and what each missing part would enable, and that make
Blender's environment."""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import TypeAdapter
from tyro.conf import Positional

from gmrdata import __version__
from gmrdata.cli.answers import answer, answer_json, fail, print_table
from gmrdata.cli.options import AsJson
from gmrdata.film import blender_environment as environment
from gmrdata.values.errors import BlenderMissing
from gmrdata.values.limits import allowed_cores, machine_bytes

State = Literal["there", "missing", "broken"]


class Finding(NamedTuple):
    """One row of what was found."""

    subject: str
    name: str
    state: State
    found: str
    """Version, place or size."""
    note: str = ""
    """The use of a missing part, and how to get it."""
    required: bool = False


class OptionalPackage(NamedTuple):
    """An optional dependency of pyproject.toml."""

    package: str
    module: str
    enables: str


EXTRAS = {
    "maskrcnn": OptionalPackage(
        "torchvision", "torchvision", "masks by Mask R-CNN: --masks maskrcnn"
    ),
    "tensorboard": OptionalPackage("tensorboard", "tensorboard", "event files of trainings"),
    "export": OptionalPackage("usd-core", "pxr.Usd", "USD scenes: export --to usd"),
    "view": OptionalPackage("rerun-sdk", "rerun", "recordings for rerun's viewer: export --to rrd"),
}
LOADED = ("scipy.spatial", "cv2", "av", "pycolmap", "ai_edge_litert.interpreter", "torch")
"""Required modules with libraries of their own, which may be there and still not load."""
ON_TORCH = ("torch", "torchvision")
"""These take as long as all others together, so they are loaded beside them."""
LIBRARIES = """
import importlib, json, sys
def problem(name):
    try:
        importlib.import_module(name)
    except Exception as error:
        return str(error) or type(error).__name__
said = {name: problem(name) for name in sys.argv[1:]}
gpus = []
if said.get("torch", "not asked for") is None:
    import torch
    if torch.cuda.is_available():
        gpus = [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
print(json.dumps([said, gpus]))
"""
LOAD_S = 600  # a busy machine takes long to load them
Loaded = tuple[dict[str, str | None], list[str]]
_LOADED = TypeAdapter(Loaded)


def doctor(as_json: AsJson = False) -> None:
    """Say what is installed here, what is missing, and what each missing part would enable.

    Packages, extras, models, bodies, Blender, GPU, cores, memory and disk. The exit code is 1 if a
    part is missing or broken that gmrdata can't do without.
    """
    parts = find_parts()
    faults = [part for part in parts if part.required and part.state != "there"]
    if as_json:
        rows = [part._asdict() for part in parts]
        answer_json({"gmrdata": __version__, "good": not faults, "parts": rows})
    else:
        rows_of_text = [(p.subject, p.name, p.state, p.found, p.note) for p in parts]
        print_table(("", "part", "state", "found", "note"), rows_of_text)
    if faults:
        fail("gmrdata can't work without: " + ", ".join(part.name for part in faults))
    elif not as_json:
        answer("All that gmrdata needs is there.")


def find_parts() -> list[Finding]:
    """All parts, in the order of the table.  What takes long to load does so side by side."""
    blender = _start_blender()
    extras = (one.module for one in EXTRAS.values() if _version(one.package) is not None)
    names = (*LOADED, *extras)
    halves = [[name for name in names if (name in ON_TORCH) == on_torch] for on_torch in (1, 0)]
    libraries = [_start("-c", LIBRARIES, *half) for half in halves]
    packages, files, machine = [*_packages()], [*_models(), *_bodies()], [*_machine()]
    (torch, gpus), (others, _) = map(_loaded, libraries, halves)
    loaded = (torch | others, gpus)
    return [
        *packages,
        *(
            Finding("packages", name, "broken", why, required=True)
            for name in LOADED
            if (why := loaded[0].get(name))
        ),
        _blender(blender),
        *_extras(loaded),
        *files,
        _gpu(loaded),
        *machine,
    ]


def _start(*arguments: str) -> subprocess.Popen[str]:
    # -P: a file in the current folder is no module of ours.
    return _popen([sys.executable, "-P", *arguments])


def _popen(command: list[str], variables: dict[str, str] | None = None) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, env=variables, stdout=pipe, stderr=pipe, text=True, errors="replace"
    )


def _start_blender() -> subprocess.Popen[str] | BlenderMissing:
    try:
        command = environment.blender_command("blender.probe")
        return _popen(command, environment.blender_variables())
    except BlenderMissing as error:
        return error


def _end(process: subprocess.Popen[str]) -> tuple[str, str]:
    """The last line that a process said, and why it failed: empty if it did not."""
    try:
        said, errors = process.communicate(timeout=LOAD_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "", f"did not load in {LOAD_S} s"
    last = (said.strip().splitlines() or [""])[-1]
    if process.returncode == 0 and last:
        return last, ""
    return "", (errors.strip().splitlines() or [f"ended with exit code {process.returncode}"])[-1]


def _packages() -> Iterator[Finding]:
    """gmrdata, python and what pyproject.toml asks for, as this gmrdata was installed."""
    # Not a dependency by name, but dask and matplotlib can't be without it.
    from packaging.requirements import Requirement

    yield Finding("python", "gmrdata", "there", __version__, required=True)
    yield Finding("python", "python", "there", platform.python_version(), required=True)
    for line in metadata.requires("gmrdata") or ():
        wanted = Requirement(line)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": ""}):
            continue
        version = _version(wanted.name)
        good = version is not None and wanted.specifier.contains(version, prereleases=True)
        state: State = "there" if good else "missing" if version is None else "broken"
        note = "" if good else f"pip install '{wanted.name}{wanted.specifier}'"
        yield Finding("packages", wanted.name, state, version or "", note, required=True)


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _extras(loaded: Loaded) -> Iterator[Finding]:
    for name, extra in EXTRAS.items():
        version, why_not = _version(extra.package), loaded[0].get(extra.module) or ""
        if version is None:
            note = f"{extra.enables}. pip install {extra.package}"
            yield Finding("extras", name, "missing", "", note)
        else:
            state: State = "broken" if why_not else "there"
            yield Finding("extras", name, state, f"{extra.package} {version}", why_not)


def _loaded(process: subprocess.Popen[str], names: Sequence[str]) -> Loaded:
    """Why each library does not load, if it does not, and the names of the GPUs."""
    said, why_not = _end(process)
    return (dict.fromkeys(names, why_not), []) if why_not else _LOADED.validate_json(said)


def blender(
    job: Positional[Literal["setup"]], python: str | None = None, redo: bool = False
) -> None:
    """Make the environment that Blender runs in, 1.1 GB: bpy and what gmrdata's side of it imports.

    It is .venv-blender of a checkout, else $XDG_DATA_HOME/gmrdata/blender (~/.local/share).
    GMRDATA_BLENDER_PYTHON names another one's Python.

    Args:
        job: setup.
        python: Python 3.11 or 3.13 to make it with.  By uv, where that is installed, it may be a
            version, which uv fetches.  When left out: of these the first that is found.
        redo: Make it again.
    """
    place = environment.set_up(python, redo=redo)
    part = blender_part()
    if part.state != "there":
        fail(f"{place}: Blender does not start: {part.found}. It is needed for {part.note}")
    answer(f"Blender {part.found}: {part.note}")


def blender_part() -> Finding:
    """Blender's environment: its versions, or what is missing and the command that gets it."""
    return _blender(_start_blender())


def _blender(process: subprocess.Popen[str] | BlenderMissing) -> Finding:
    what = "render, threedpw twin, floor and demo"
    if isinstance(process, BlenderMissing):
        return Finding("blender", "Blender", "missing", "", f"{what}. {process}", required=True)
    said, why_not = _end(process)
    if why_not:
        missing = environment.missing_system_libraries()
        remedy = f"{environment.PYTHON_NAME} names that Python: name another one, or unset it"
        if environment.PYTHON_NAME not in os.environ:
            remedy = "gmrdata blender setup --redo"
        if missing:
            packages = " ".join(missing.values())
            remedy = f"apt-get install --no-install-recommends {packages}"
        return Finding("blender", "Blender", "broken", why_not, f"{what}. {remedy}", required=True)
    versions = environment.versions_said([said])
    names = [f"{name} {version}" for name, version in versions.items() if name != "bpy"]
    note = f"{', '.join(names)} in {environment.blender_python()}"
    return Finding("blender", "Blender", "there", versions["bpy"], note, required=True)


def _models() -> Iterator[Finding]:
    from gmrdata.read.models import MODELS, models_dir
    from gmrdata.values.files import sha256_of_file

    for model in MODELS:
        path = models_dir() / model.name
        if not path.is_file():
            note = "people of video; masks --masks onnx person. `gmrdata fetch models` gets it"
            yield Finding("models", model.name, "missing", "", note)
        elif sha256_of_file(path) != model.sha256:
            note = "not the published file. `gmrdata fetch models --redo` gets it anew"
            yield Finding("models", model.name, "broken", str(path), note)
        else:
            yield Finding("models", model.name, "there", f"{path}, as published")


def _bodies() -> Iterator[Finding]:
    why = "3DPW, AMASS and EMDB on their own people: --body FILE, from https://smpl.is.tue.mpg.de"
    yield Finding("bodies", "SMPL", "missing", "", f"never part of gmrdata. {why}")


def _gpu(loaded: Loaded) -> Finding:
    if loaded[1]:
        return Finding("machine", "GPU", "there", ", ".join(loaded[1]))
    note = "training and inference with device: cuda, a torch built for CUDA and its driver"
    return Finding("machine", "GPU", "missing", "", note)


def _machine() -> Iterator[Finding]:
    from gmrdata.read.models import cache_dir

    yield Finding("machine", "cores", "there", str(allowed_cores()))
    memory_bytes = machine_bytes()
    size = "the system does not say" if memory_bytes is None else f"{memory_bytes / 2**30:.1f} GiB"
    yield Finding("machine", "memory", "there", size)
    yield _disk("cache", cache_dir())
    yield _disk("current folder", Path.cwd())


def _disk(name: str, folder: Path) -> Finding:
    """Free space of a folder, or of where it would be made, and whether it may be written to."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    free = f"{shutil.disk_usage(there).free / 2**30:.1f} GiB free in {folder}"
    if os.access(there, os.W_OK):
        return Finding("disk", name, "there", free)
    return Finding("disk", name, "broken", free, "may not be written to")
