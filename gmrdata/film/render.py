"""Render a clip with Blender, which runs as a process of its own.

Which of Blender's renderers can run on this machine is found out before any frame.
"""

import os
import subprocess
import threading
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, TextIO

from pydantic import Field, model_validator

from gmrdata.film.blender_environment import blender_command, blender_variables, versions_said
from gmrdata.film.character import Character, PersonConfig
from gmrdata.film.scene import SceneConfig, make_cast, save_cast
from gmrdata.read.body_file import read_body
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values import limits
from gmrdata.values.clip import CHARACTER_FILE, load_clip
from gmrdata.values.errors import EngineMissing, RenderFailed, RenderOverLimit
from gmrdata.values.files import write_text
from gmrdata.values.records import Config, with_absolute_paths
from gmrdata.write.video import write_video_of

RENDERER_LINE = "gmrdata-renderer"  # what the probe prints, with the name of what rendered
PROBE_S = 600
NAMES = {"cycles": "Cycles", "eevee": "EEVEE", "workbench": "Workbench"}
FRAME_LINE = "gmrdata-frame"
"""What the Blender process prints, with the frame's number, when a frame and its mask are there."""
FOLDERS = ("depth", "normals", "flow", "instances")
"""Folders that a recipe can ask for, with one file for each frame."""
EXTRAS_FOLDER = "extras"
CAST_FILE = "cast.npz"
"""The scene's extras, in `RenderJob.out_dir` while Blender runs."""
LOG_LINES = 12
GOES_ON = "returns null: len="
OUT_OF_MEMORY = (GOES_ON, "std::bad_alloc", "MemoryError")
"""What Blender, its C++ and its Python say then.  Blender itself goes on, without a picture."""
TICK_S = 1.0
KEEP_MEMORY = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(1 << 32)}
"""What tells glibc to keep freed memory for the next array: it gives large ones back to the kernel
at once, and pages that come anew cost 0.3 s of the time in which a place is painted.  Dask sets the
opposite for its workers, which this overrides."""
PreviewEngine = Literal["workbench", "cycles"]


@cache
def find_renderer(engine: str, device: str) -> str:
    """Name of what renders, for the stage's record: "Cycles on OPTIX: NVIDIA H200".

    Cycles on the CPU runs wherever Blender does.  Anything else is tried with a few pixels in a
    process of its own, which costs the start of Blender, once for each process that asks.
    """
    if (engine, device) == ("cycles", "cpu"):
        return "Cycles on the CPU"
    try:
        answer = subprocess.run(
            blender_command("blender.probe", engine, device),
            env=blender_variables(),
            capture_output=True,
            errors="replace",
            timeout=PROBE_S,
        )
    except subprocess.TimeoutExpired:
        raise EngineMissing(
            f"engine: {engine}: {NAMES[engine]} had not drawn eight pixels after "
            f"{PROBE_S} s; take `engine: cycles`"
        ) from None
    renderers = [line for line in answer.stdout.splitlines() if RENDERER_LINE in line]
    if answer.returncode == 0 and renderers:
        return f"{NAMES[engine]} on {renderers[-1].removeprefix(RENDERER_LINE).strip()}"
    lines = answer.stderr.splitlines()
    error, end = _error_and_end(lines, answer.returncode)
    last = lines[-1].strip() if lines else "it said nothing"
    raise EngineMissing(
        error
        or f"engine: {engine}: {NAMES[engine]} can't run here, for it draws with OpenGL 4.3 "
        f"through EGL, and Blender's trial ended with {end} ({last}). Take `engine: cycles`, or "
        "install a GPU's driver or Mesa (libegl1, libgl1, libegl-mesa0)"
    )


def _error_and_end(lines: list[str], exit_code: int) -> tuple[str | None, str]:
    """The error that Blender's process reported in our words, if it did, and how it ended."""
    said = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    end = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    return (said[-1] if said and exit_code == 1 else None), end


class RenderConfig(Config):
    """How a clip is rendered.  Size and lens are those of the clip's camera."""

    scene: SceneConfig = SceneConfig()
    person: PersonConfig = PersonConfig()
    character: Character | None = None
    """A rigged character that is filmed in place of the body, moving as the body does."""
    engine: Literal["cycles", "eevee"] = "cycles"
    """Blender's renderer of the frames: `cycles` runs everywhere, `eevee` draws with OpenGL and is
    fast on a GPU.  Masks, depth, normals and flow are traced by Cycles with either."""
    device: Literal["cpu", "gpu"] = "cpu"
    """What Cycles computes on: `gpu` needs one that Cycles knows (CUDA, OptiX, HIP, Metal, oneAPI).
    Only the CPU's pictures are promised to be the same bytes in each run."""
    samples: int = Field(default=7, ge=1, le=4096)
    """Rays per pixel; they smooth edges, the light has no noise.  Take an odd number: a
    pixel is masked when half of it is covered, and an even number of rays has ties there."""
    shutter: float = Field(default=0.0, ge=0, le=1)
    """Share of a frame's time for which the shutter is open, half before the frame's moment and
    half after it: motion blur.  0: none.  A blurred person is masked where it covers half of a
    pixel's time; depth, normals and flow stay those of the moment."""
    readout: float = Field(default=0.0, ge=0, le=1)
    """Share of a frame's time in which its rows are read out from top to bottom: a rolling shutter,
    whose middle row is of the frame's moment.  20 ms of 30 fps are 0.6.  0: all rows at once."""
    image_format: Literal["jpg", "png"] = "jpg"
    """Format of the frames; png loses nothing and takes about five times the space."""
    jpeg_quality: int = Field(default=92, ge=1, le=100)
    joints: bool = False
    """Also `joints.npz`: the 24 joints in the world, the camera and the image, with visibility."""
    depth: bool = False
    """Also `depth/00000.png`: depth along the optical axis, 16 bit [mm]."""
    normals: bool = False
    """Also `normals/00000.png`: normals in the camera's axes, 16 bit a channel."""
    flow: bool = False
    """Also `flow/00000.png`: motion of the surface in the image until the next frame [px / 64]."""
    instances: bool = False
    """Also `instances/00000.png`: who is seen at each pixel's centre, 8 bit: 0 background, 1 the
    person, then the scene's extras from 2 on."""
    video: bool = False
    """Also `video.mp4` of the frames, H.264."""
    blend: bool = False
    """Also `scene/scene.blend` with what moves in files beside it: to look into, change, render."""

    @model_validator(mode="after")
    def _cycles_has_devices_and_blur(self) -> "RenderConfig":
        if self.engine == "eevee" and self.device == "gpu":
            raise ValueError("device: is Cycles'; EEVEE draws with the OpenGL that it finds")
        if self.engine == "eevee" and self.shutter + self.readout > 0:
            raise ValueError("shutter and readout: motion blur needs `engine: cycles`")
        return self


class RenderJob(Config):
    """The job file of `python -m blender`."""

    clip_path: Path
    """Clip .npz: a world motion and a camera for each frame."""
    body_path: Path
    out_dir: Path
    """Folder to fill; frames that are there already are kept."""
    config: RenderConfig
    threads: int = Field(default=1, ge=1, le=limits.MOST_WORKERS)
    """Processor threads; the pictures don't depend on it."""
    layout_paths: tuple[Path, ...] = ()
    """Clips that share one place, which is laid out for the paths of all; none: for this clip."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by role."""
        config = self.config
        inputs = {"clip": self.clip_path, "body": self.body_path}
        for part in (config.scene, config.person, config.character):
            inputs |= {} if part is None else part.inputs
        return inputs | {f"layout{number}": path for number, path in enumerate(self.layout_paths)}


class PreviewJob(Config):
    """The job file of `python -m blender.preview`."""

    render: RenderJob
    rows: tuple[int, ...]
    percent: int = Field(ge=1, le=100)
    """Of the camera's size."""
    engine: PreviewEngine
    """Cycles takes one ray per pixel."""


def frame_files(out_dir: Path, config: RenderConfig, row: int, n_frames: int) -> dict[str, Path]:
    """Files of one frame by folder, in the order in which they are written."""
    folders = {"frames": config.image_format, "masks": "png"}
    folders |= {name: "png" for name in FOLDERS if getattr(config, name)}
    if row == n_frames - 1:  # flow leads to the next frame
        folders.pop("flow", None)
    return {name: out_dir / name / f"{row:05d}.{suffix}" for name, suffix in folders.items()}


def optional_outputs(out_dir: Path, config: RenderConfig) -> dict[str, Any]:
    """What a recipe adds to a finished folder, as keywords of `manifest.write.ClipFiles`."""
    files = {"joints": "joints.npz", "video": "video.mp4", "character": CHARACTER_FILE}
    asked = [name for name in (*files, *FOLDERS) if getattr(config, name)]
    outputs: dict[str, Any]
    outputs = {name: out_dir / files[name] for name in asked if name in files}
    outputs |= {name: out_dir / name for name in asked if (out_dir / name).is_dir()}
    extras = [out_dir / EXTRAS_FOLDER / f"{name}.npz" for name in config.scene.extras.names]
    return outputs | {"extras": extras}


def render_clip(
    clip_path: str | Path,
    body_path: str | Path,
    out_dir: str | Path,
    config: RenderConfig,
    *,
    run: Run = DEFAULT_RUN,
    threads: int = 1,
    layout_paths: Sequence[str | Path] = (),
    on_frame: Callable[[int], None] | None = None,
) -> Path:
    """Render a clip: `frames/00000.jpg` or .png, `masks/00000.png`, and `clip.npz`.

    A mask is 255 at all that moves: the person and the extras.  `clip.npz` holds the motion and the
    camera as Blender really used it.  A killed run goes on at the next missing frame.  The recipe
    can ask for more: joints, depth, normals, flow, a video.  With a character there is
    `character.npz`, its residual against the truth.  Returns `out_dir`.

    Args:
        clip_path: Clip .npz with frame "world" and a camera for each frame.
        layout_paths: Clips that share one place (a clip and its twin), each given the same list.
            The place is laid out for the paths of all of them, and lit for the first.
        on_frame: Called with each finished frame's number, instead of a progress bar.

    Raises:
        MissingInput: the clip or the body is not there.
        BadCharacter: the character's file is broken, or names files outside its folder.
        BlenderMissing: Blender's environment is not there.
        EngineMissing: the engine or device of the recipe can't run here.
        RenderFailed: Blender ended without its result, or can't use the character.
        RenderOverLimit: it took more time or memory than `values.limits` grants.
    """
    job = RenderJob(
        clip_path=Path(clip_path), body_path=Path(body_path), out_dir=Path(out_dir),
        config=config, threads=threads, layout_paths=tuple(map(Path, layout_paths)),
    )  # fmt: skip
    return render_job(job, config, run, on_frame)


def render_job(
    job: RenderJob,
    recorded: RenderConfig,
    run: Run = DEFAULT_RUN,
    on_frame: Callable[[int], None] | None = None,
) -> Path:
    """`render_clip` of a job, whose paths may be full where the record has those of a recipe."""
    work = Resumable(partial(_render, job, on_frame))
    return run_stage("render", job.out_dir, recorded, job.inputs, work, run=run)


def _render(
    job: RenderJob, on_frame: Callable[[int], None] | None, partial_dir: Path
) -> dict[str, Any]:
    from gmrdata.stage.progress import progress_bar

    config, motion = job.config, load_clip(job.clip_path).motion
    renderer = find_renderer(config.engine, config.device)
    with progress_bar(shown=on_frame is None) as bar:
        task = bar.add_task(f"rendering {job.out_dir.name}", total=motion.n_frames)
        tell = on_frame or (lambda _: bar.advance(task))
        job = job.model_copy(update={"out_dir": partial_dir})
        versions = run_blender(job, partial_dir, tell)
    if config.video:
        frames = sorted((partial_dir / "frames").glob(f"*.{config.image_format}"))
        write_video_of(frames, partial_dir / "video.mp4", motion.fps_hz)
    return {"renderer": renderer, "blender": versions}


def run_blender(
    job: RenderJob | PreviewJob,
    partial_dir: Path,
    on_frame: Callable[[int], None],
    *,
    module: str = "blender",
) -> dict[str, str]:
    """Run a module of Blender's side on a job; its log in `partial_dir` stays when it fails.

    Returns the versions of Blender's environment, as that says them.
    """
    job_path, log_path = partial_dir / "job.json", partial_dir / "blender.log"
    clip_job = job.render if isinstance(job, PreviewJob) else job
    if clip_job.config.scene.extras.names:
        _write_cast(clip_job, partial_dir / CAST_FILE)
    write_text(job_path, with_absolute_paths(job).model_dump_json())
    command = blender_command(module, job_path, "--parent", os.getpid())
    frame_s, there = _frame_s(clip_job), set(partial_dir.glob("*/*"))
    with log_path.open("w", encoding="utf-8") as log:
        exit_code = _run_and_listen(command, log, on_frame, frame_s)
    lines = log_path.read_text(encoding="utf-8").splitlines()
    if any(phrase in line for line in lines for phrase in OUT_OF_MEMORY):
        if any(GOES_ON in line for line in lines):  # no frame of this run may be gone on from
            for path in set(partial_dir.glob("*/*")) - there:
                path.unlink()
        most_mib = limits.blender_bytes() / limits.MIB
        raise RenderOverLimit(
            f"Blender asked for more memory than the {most_mib:.0f} MiB that it may have; take "
            f"smaller files or pictures, or set {limits.BLENDER_GIB_NAME} in the environment"
        )
    if exit_code:
        error, end = _error_and_end(lines, exit_code)
        tail = "\n".join(lines[-LOG_LINES:]) or "(it said nothing)"
        raise RenderFailed(
            error or f"Blender ended with {end}; run again to go on. The end of {log_path}:\n{tail}"
        )
    for path in (job_path, log_path, partial_dir / CAST_FILE):
        path.unlink(missing_ok=True)
    return versions_said(lines)


def _write_cast(job: RenderJob, path: Path) -> None:
    """Make the extras of a job: those of the place, if that is shared."""
    scene = job.config.scene
    clips = [load_clip(path) for path in job.layout_paths or (job.clip_path,)]
    save_cast(path, make_cast(scene.extras, clips, read_body(job.body_path), scene.seed))


def _frame_s(job: RenderJob) -> float:
    """How long Blender may take for a frame of a job [s]."""
    camera = load_clip(job.clip_path).camera
    size_px = 0 if camera is None else camera.width_px * camera.height_px
    return limits.blender_frame_s(size_px * job.config.samples)


class _FrameClock:
    """Ends a process that brings no frame for too long.

    It counts the seconds in which it ran itself: whoever is put to sleep with it loses nothing."""

    def __init__(self, process: subprocess.Popen[str], frame_s: float) -> None:
        self._process, self._frame_s, self._left_s = process, frame_s, frame_s
        self._stopped = threading.Event()
        self.ran_out = False
        threading.Thread(target=self._tick, daemon=True).start()

    def restart(self) -> None:
        self._left_s = self._frame_s

    def stop(self) -> None:
        self._stopped.set()

    def _tick(self) -> None:
        while not self._stopped.wait(TICK_S):
            self._left_s -= TICK_S
            if self._left_s <= 0:
                self.ran_out = True
                self._process.kill()
                return


def _run_and_listen(
    command: list[str], log: TextIO, on_frame: Callable[[int], None], frame_s: float
) -> int:
    """Run the process to its end, or end it with this one; its chatter goes to the log."""
    env, pipe = blender_variables() | KEEP_MEMORY, subprocess.PIPE
    process = subprocess.Popen(
        command, env=env, stdout=pipe, stderr=subprocess.STDOUT, errors="replace"
    )
    clock = _FrameClock(process, frame_s)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(FRAME_LINE):
                clock.restart()
                on_frame(int(line.split()[1]))
            else:
                log.write(line)
        exit_code = process.wait()
    finally:
        clock.stop()
        process.kill()
        process.wait()
    if clock.ran_out:
        raise RenderOverLimit(
            f"Blender took more than {frame_s:.0f} s for a frame, and was ended; take smaller "
            f"files or pictures, or set {limits.BLENDER_FRAME_NAME} in the environment"
        )
    return exit_code
