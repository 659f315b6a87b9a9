# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m blender job.json [--parent PID]`: render the clip that the job file describes.

End with the process that started this one, however that one ends.
"""

import ctypes
import json
import os
import platform
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn, TypeVar

import numpy as np
from pydantic import ValidationError

from gmrdata.film.blender_environment import VERSIONS_LINE
from gmrdata.film.render import RenderJob
from gmrdata.read.body_file import read_body
from gmrdata.stage.store import package_versions
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, GmrdataError, MissingInput
from gmrdata.values.limits import blender_bytes
from gmrdata.values.records import Config

PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int) -> None:
    """Ask the kernel for SIGKILL when the parent's thread that waits for this process is gone."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if sys.platform == "win32":  # a program of the environment stands between it and its parent
        return
    if os.getppid() != parent_pid:  # it ended before the kernel was asked
        os.kill(os.getpid(), signal.SIGKILL)


JobKind = TypeVar("JobKind", bound=Config)


def main(arguments: list[str]) -> None:
    """Render the clip of a job file."""
    job_path = parse(arguments)
    job = read_job(job_path, RenderJob)
    clip, body = load_clip(job.clip_path), read_body(job.body_path)
    camera = camera_of(job, clip, body)
    import_bpy(job.threads)
    from blender.render import render

    say_versions()
    render(job, clip, body, camera)


def say_versions() -> None:
    """Tell the parent what this environment is made of."""
    versions = {"python": platform.python_version(), **package_versions()}
    sys.stdout.write(f"{VERSIONS_LINE} {json.dumps(versions)}\n")


def run(work: Callable[[], None]) -> int:
    """Do the work; the exit code is 0, or 1 with a message on stderr."""
    try:
        work()
    except (GmrdataError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    except MemoryError as error:
        sys.stderr.write(f"error: MemoryError: {error}\n")
        return 1
    return 0


def limit_memory() -> None:
    """Let the kernel refuse memory beyond the limit; only what can be written to is counted, since
    drivers of GPUs reserve far more addresses than they use."""
    if sys.platform == "linux":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        limit = blender_bytes() if hard == resource.RLIM_INFINITY else min(blender_bytes(), hard)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def parse(arguments: list[str]) -> Path:
    """The job file's path; ties this process to its parent when that is named."""
    if len(arguments) == 3 and arguments[1] == "--parent" and arguments[2].isdigit():
        die_with_parent(int(arguments[2]))
    elif len(arguments) != 1:
        raise BadRecipe("usage: python -m blender job.json [--parent PID]")
    return Path(arguments[0])


def read_job(path: Path, kind: type[JobKind]) -> JobKind:
    """Read and check a job file."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such job file")
    try:
        return kind.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise BadRecipe(f"{path}: {where}: {first['msg']}") from None


def camera_of(job: RenderJob, clip: Clip, body: BodyModel) -> CameraPath:
    """The clip's camera; what is wrong with the clip is said here, before Blender is loaded."""
    if clip.motion.frame != "world":
        raise BadMotionFile(f"{job.clip_path}: its motion is not in the world frame")
    if clip.camera is None:
        raise BadMotionFile(f"{job.clip_path}: has no camera; give it one with a camera programme")
    if not clip.camera.has_camera.all():
        raise BadMotionFile(f"{job.clip_path}: some frames have no camera; slice them off first")
    if not (np.isfinite(clip.motion.rotmats).all() and np.isfinite(clip.motion.pelvis_m).all()):
        raise BadMotionFile(f"{job.clip_path}: some frames hold no motion; slice them off first")
    if clip.motion.body != body.name or len(clip.motion.shape) != body.n_shape:
        raise BadMotionFile(
            f"{job.clip_path}: made for body {clip.motion.body!r}, "
            f"and {job.body_path} is {body.name!r}"
        )
    return clip.camera


def import_bpy(threads: int) -> None:
    """Import bpy with as much memory, and as many processors in sight, as it may use.

    Its thread library counts them once, at import; with more than Cycles is told to use, an idle
    thread spins at full load beside each working one (seen in Blender 5.0.1).
    """
    limit_memory()
    if not hasattr(os, "sched_setaffinity"):
        return
    everything = os.sched_getaffinity(0)
    os.sched_setaffinity(0, set(sorted(everything)[:threads]))
    try:
        import bpy  # noqa: F401
    finally:
        os.sched_setaffinity(0, everything)


def end(exit_code: int) -> NoReturn:
    """End the process; after success at once, for Blender takes its scene apart for 0.2 s.

    All that is left to do is to remove Blender's temporary folder.  Where that isn't empty,
    Blender does so itself.
    """
    if exit_code == 0 and "bpy" in sys.modules:
        with suppress(OSError):
            Path(sys.modules["bpy"].app.tempdir).rmdir()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)
    sys.exit(exit_code)


if __name__ == "__main__":
    end(run(lambda: main(sys.argv[1:])))
