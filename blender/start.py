# SPDX-License-Identifier: GPL-3.0-or-later
"""`python start.py MODULE ...`, or SCRIPT.py: run that in Blender's environment.

`gmrdata` and `blender` come from beside this file, all else from the environment of the Python that
runs it: the packages next to them may be made for another Python.
"""

import runpy
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

PACKAGES = ("gmrdata", "blender")


class BesideThisFile:
    """Finds these two packages, and nothing that lies next to them."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        folder = str(Path(__file__).resolve().parents[1])
        return PathFinder.find_spec(name, [folder]) if name in PACKAGES else None


def main(what: str) -> None:
    """Run the module or script; what can't be imported is said in one line."""
    sys.meta_path.insert(0, BesideThisFile())
    try:
        if what.endswith(".py"):
            runpy.run_path(what, run_name="__main__")
        else:
            runpy.run_module(what, run_name="__main__", alter_sys=True)
    except ImportError as error:
        why = f"{sys.executable}, in which Blender runs, can't load what it needs: {error}"
        sys.exit(f"error: {why}. `gmrdata doctor` says how to get it")


if __name__ == "__main__":
    del sys.argv[0]
    main(sys.argv[0])
