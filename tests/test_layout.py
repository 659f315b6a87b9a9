"""The layout: folders import in one order, bottom up, and the root holds two files."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.folders import REPOSITORY

PACKAGE = REPOSITORY / "gmrdata"

ORDER = (
    "values", "stage", "read", "write", "manifest", "motion", "film", "people", "cameras", "world",
    "gmr", "fusion", "solve", "threedpw", "twins", "score", "paper", "export", "pages", "cli",
)  # fmt: skip
"""Each folder imports only folders before it, and itself."""


CAMERAS_ORDER = (
    "recipe", "files", "colmap", "frames", "match", "map", "lens", "check", "reconstruct",
    "again",
)  # fmt: skip
"""The same of the files and folders of cameras/."""


def imported_modules(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of each import of gmrdata in a file, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            package, _, rest = name.partition(".")
            if package == "gmrdata" and rest:
                yield node.lineno, rest


def imported_folders(path: Path) -> Iterator[tuple[int, str]]:
    """Line and folder of each of them."""
    for line, name in imported_modules(path):
        yield line, name.split(".")[0]


def test_the_folders_are_those_of_the_order():
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert folders == set(ORDER)


def test_the_root_holds_two_files():
    assert sorted(path.name for path in PACKAGE.glob("*.py")) == ["__init__.py", "__main__.py"]


def test_no_import_runs_back_up():
    up = []
    for path in sorted(PACKAGE.glob("*/**/*.py")):
        here = path.relative_to(PACKAGE).parts[0]
        for line, folder in imported_folders(path):
            if folder in ORDER and ORDER.index(folder) > ORDER.index(here):
                up.append(f"{path.relative_to(PACKAGE)}:{line} imports {folder}")
    assert not up


def test_no_import_runs_back_up_in_cameras():
    folder = PACKAGE / "cameras"
    up = []
    for path in sorted(folder.rglob("*.py")):
        here = path.relative_to(folder).with_suffix("").parts[0]
        for line, name in imported_modules(path):
            of, there = (*name.split("."), "")[:2]
            inside = of == "cameras" and {here, there} <= set(CAMERAS_ORDER)
            if inside and CAMERAS_ORDER.index(there) > CAMERAS_ORDER.index(here):
                up.append(f"{path.relative_to(folder)}:{line} imports {there}")
    assert not up


def test_no_circle_of_files():
    files = {
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
        for path in PACKAGE.rglob("*.py")
    }
    left = {
        name: {there for _, there in imported_modules(path)} & files.keys() - {name}
        for name, path in files.items()
    }
    # Files that import nothing that is left are in no circle.
    while done := {name for name, imports in left.items() if not imports & left.keys()}:
        left = {name: imports for name, imports in left.items() if name not in done}
    assert not left


def test_no_two_classes_have_one_name():
    files = [*PACKAGE.glob("**/*.py"), *(REPOSITORY / "blender").glob("**/*.py")]
    names = [
        node.name
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    assert [name for name, n in Counter(names).items() if n > 1] == []


def test_pages_are_imported_by_the_command_line_alone():
    importers = {
        path.relative_to(PACKAGE).parts[0]
        for path in PACKAGE.glob("*/**/*.py")
        for _, folder in imported_folders(path)
        if folder == "pages"
    }
    assert importers <= {"pages", "cli"}


def test_nothing_in_the_package_imports_blender():
    for path in PACKAGE.glob("**/*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            names = [alias.name for alias in getattr(node, "names", ())]
            module = getattr(node, "module", None) or ""
            assert not {"bpy", "blender"} & {
                module.split(".")[0],
                *(n.split(".")[0] for n in names),
            }
