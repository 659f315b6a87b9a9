"""Which of Blender's renderers can run on this machine, found out before any frame."""

import subprocess
import sys
from functools import cache
from pathlib import Path

from gmrdata.errors import EngineMissing

RENDERER_LINE = "gmrdata-renderer"
"""What the probe prints, with the name of what rendered."""
PROBE_TIMEOUT_S = 600
PACKAGES_DIR = Path(__file__).resolve().parent.parent
"""Where the packages `gmrdata` and `blender` are, side by side in a checkout and in a wheel."""
NAMES = {"cycles": "Cycles", "eevee": "EEVEE", "workbench": "Workbench"}


@cache
def find_renderer(engine: str, device: str) -> str:
    """Name of what renders, for the stage's record: "Cycles on OPTIX: NVIDIA H200".

    Cycles on the CPU runs wherever Blender does.  Anything else is tried with a few pixels in a
    process of its own, which costs the start of Blender, once for each process that asks.

    Args:
        engine: "cycles", "eevee" or "workbench".
        device: "cpu" or "gpu", for Cycles.

    Raises:
        EngineMissing: it can't run here; the message says why and what can be done.
    """
    if (engine, device) == ("cycles", "cpu"):
        return "Cycles on the CPU"
    command = [sys.executable, "-m", "blender.probe", engine, device]
    try:
        answer = subprocess.run(
            command,
            cwd=PACKAGES_DIR,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EngineMissing(
            f"engine: {engine}: {NAMES[engine]} had not drawn eight pixels after "
            f"{PROBE_TIMEOUT_S} s; take `engine: cycles`"
        ) from None
    lines = answer.stdout.splitlines()
    found = [line.removeprefix(RENDERER_LINE).strip() for line in lines if RENDERER_LINE in line]
    if answer.returncode == 0 and found:
        return f"{NAMES[engine]} on {found[-1]}"
    raise EngineMissing(_why(engine, answer.returncode, answer.stderr.splitlines()))


def _why(engine: str, exit_code: int, lines: list[str]) -> str:
    said = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    if said:
        return said[-1]
    last = lines[-1].strip() if lines else "it said nothing"
    ended = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    return (
        f"engine: {engine}: {NAMES[engine]} can't run here, for it draws with OpenGL 4.3 through "
        f"EGL, and Blender's trial ended with {ended} ({last}). Take `engine: cycles`, or install "
        "a GPU's driver or Mesa (libegl1, libgl1, libegl-mesa0)"
    )
