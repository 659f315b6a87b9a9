"""What a user installs carries recipes, published manifests and the Blender stage."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = "import sys, setuptools.build_meta as build; build.build_wheel(sys.argv[1])"


@pytest.fixture(scope="session")
def wheel(tmp_path_factory) -> Path:
    """A wheel built from a copy of what the repository holds."""
    pytest.importorskip("setuptools", minversion="77")
    root = tmp_path_factory.mktemp("wheel")
    copy = root / "copy"
    copy.mkdir()
    unwanted = shutil.ignore_patterns("__pycache__")
    for name in ("gmrdata", "blender", "manifests", "pipelines"):
        shutil.copytree(REPOSITORY / name, copy / name, symlinks=True, ignore=unwanted)
    for file in REPOSITORY.glob("[A-Za-z]*"):
        if file.is_file():
            shutil.copy(file, copy)
    command = [sys.executable, "-c", BUILD, str(root)]
    subprocess.run(command, cwd=copy, check=True, capture_output=True)
    return next(root.glob("*.whl"))


def test_wheel_carries_every_resource(wheel):
    carried = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"gmrdata/{link}/{file.relative_to(REPOSITORY / folder).as_posix()}"
        for link, folder in (("published", "manifests"), ("pipelines", "pipelines"))
        for file in (REPOSITORY / folder).rglob("*")
        if file.is_file()
    }
    assert "gmrdata/published/schema/v1.json" in wanted
    assert wanted - carried == set()
    read = {
        file.relative_to(REPOSITORY).as_posix()
        for folder in ("gmr/weights", "pages", "people", "read")
        for file in (REPOSITORY / "gmrdata" / folder).rglob("*.*")
        if "__pycache__" not in file.parts
    }
    assert {"gmrdata/people/pose_prior.npz", "gmrdata/people/landmark_body.json"} <= read
    assert read - carried == set()
    assert {"blender/start.py", "blender/requirements.txt"} <= carried
    templates = [file.name for file in (REPOSITORY / "gmrdata/pages/templates").iterdir()]
    assert {f"gmrdata/pages/templates/{name}" for name in templates} - carried == set()
    assert "style.css" in templates and "report.html.j2" in templates


def test_installed_package_finds_its_resources(wheel, tmp_path):
    """Unpacked elsewhere and run in an empty folder, with the checkout out of sight."""
    installed, empty = tmp_path / "installed", tmp_path / "empty"
    zipfile.ZipFile(wheel).extractall(installed)
    empty.mkdir()
    code = (
        "import gmrdata, pathlib, sys; from gmrdata.stage import recipes as r;"
        "assert pathlib.Path(gmrdata.__file__).is_relative_to(sys.argv[1]), gmrdata.__file__;"
        "from gmrdata.manifest.read import read_manifest;"
        "print(len(read_manifest(r.published_manifest('paper_table8')).clips), *r.recipe_names())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(installed)],
        cwd=empty,
        env={"PYTHONPATH": str(installed), "PATH": "/usr/bin:/bin"},
        check=True,
        capture_output=True,
        text=True,
    )
    recipes = (REPOSITORY / "pipelines").rglob("*.yaml")
    names = sorted(
        path.relative_to(REPOSITORY / "pipelines").with_suffix("").as_posix() for path in recipes
    )
    assert done.stdout.split() == ["50", *names]
