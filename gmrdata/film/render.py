"""Render a clip with Blender, which runs as a process of its own.

Which of Blender's renderers can run on this machine is found out before any frame.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from gmrdata.film.character import CHARACTER_FILE, Character
from gmrdata.film.people import PersonConfig
from gmrdata.film.scene import SceneConfig
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import EngineMissing, RenderFailed
from gmrdata.values.files import write_json
from gmrdata.values.records import Config
from gmrdata.write.video import write_video_of

RENDERER_LINE = "gmrdata-renderer"
"""What the probe prints, with the name of what rendered."""
PROBE_TIMEOUT_S = 600
PACKAGES_DIR = Path(__file__).resolve().parents[2]
"""Where the packages `gmrdata` and `blender` are, side by side in a checkout and in a wheel."""
NAMES = {"cycles": "Cycles", "eevee": "EEVEE", "workbench": "Workbench"}


FRAME_LINE = "gmrdata-frame"
"""What the Blender process prints, with the frame's number, when a frame and its mask are there."""
FOLDERS = ("depth", "normals", "flow", "instances")
"""Folders that a recipe can ask for, with one file for each frame."""
EXTRAS_FOLDER = "extras"
"""Folder of the extras' truth, one file each."""
LOG_FILE = "blender.log"
LOG_LINES = 12
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


class RenderConfig(Config):
    """How a clip is rendered.  Size and lens are those of the clip's camera."""

    scene: SceneConfig = SceneConfig()
    """The place."""
    person: PersonConfig = PersonConfig()
    """How the person looks."""
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
    image_format: Literal["jpg", "png"] = "jpg"
    """Format of the frames; png loses nothing and takes about five times the space."""
    jpeg_quality: int = Field(default=92, ge=1, le=100)
    """Quality of the frames' JPEG files."""
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
        if self.engine == "eevee" and self.shutter > 0:
            raise ValueError("shutter: motion blur needs `engine: cycles`")
        return self


class RenderJob(Config):
    """The job file of `python -m blender`."""

    clip_path: Path
    """Clip .npz: a world motion and a camera for each frame."""
    body_path: Path
    """Body .npz that the motion's shape belongs to."""
    out_dir: Path
    """Folder to fill; frames that are there already are kept."""
    config: RenderConfig
    """How to render."""
    threads: int = Field(default=1, ge=1)
    """Processor threads; the pictures don't depend on it."""
    layout_paths: tuple[Path, ...] = ()
    """Clips that share one place, which is laid out for the paths of all; none: for this clip."""


class PreviewJob(Config):
    """The job file of `python -m blender.preview`."""

    render: RenderJob
    """The clip and its place."""
    rows: tuple[int, ...]
    """Frames to draw."""
    percent: int = Field(ge=1, le=100)
    """Size of the pictures in percent of the camera's."""
    engine: PreviewEngine
    """What draws them; Cycles takes one ray per pixel."""


def frame_files(out_dir: Path, config: RenderConfig, row: int, n_frames: int) -> dict[str, Path]:
    """Files of one frame by folder, in the order in which they are written.

    Flow leads to the next frame, so the last frame has none.
    """
    folders = {"frames": config.image_format, "masks": "png"}
    folders |= {name: "png" for name in FOLDERS if getattr(config, name)}
    if row == n_frames - 1:
        folders.pop("flow", None)
    return {name: out_dir / name / f"{row:05d}.{suffix}" for name, suffix in folders.items()}


def optional_outputs(out_dir: Path, config: RenderConfig) -> dict[str, Any]:
    """What a recipe adds to a finished folder, as keywords of `manifest.entry.clip_entry`."""
    folders = {
        f"{name}_dir": out_dir / name
        for name in FOLDERS
        if getattr(config, name) and (out_dir / name).is_dir()  # one frame alone has no flow
    }
    files = {
        "joints_path": ("joints", "joints.npz"),
        "video_path": ("video", "video.mp4"),
        "character_path": ("character", CHARACTER_FILE),
    }
    singles = {key: out_dir / file for key, (name, file) in files.items() if getattr(config, name)}
    extras = [out_dir / EXTRAS_FOLDER / f"{name}.npz" for name in config.scene.extras.names]
    return folders | singles | {"extras_paths": extras}


def render_clip(
    clip_path: Path,
    body_path: Path,
    out_dir: Path,
    config: RenderConfig,
    *,
    run: Run = DEFAULT_RUN,
    threads: int = 1,
    layout_paths: Sequence[Path] = (),
    on_frame: Callable[[int], None] | None = None,
) -> Path:
    """Render a clip: `frames/00000.jpg` or .png, `masks/00000.png` (255 = person), and `clip.npz`.

    `clip.npz` holds the motion and the camera as Blender really used it.  A killed run goes on at
    the next missing frame.  The recipe can ask for more: joints, depth, normals, flow, a video.
    With a character there is `character.npz`, its residual against the truth.

    Args:
        clip_path: Clip .npz with frame "world" and a camera for each frame.
        threads: Processor threads for Blender; the pictures don't depend on it.
        layout_paths: Clips that share one place (a clip and its twin), each given the same list;
            the place is laid out for the paths of all of them, and lit for the first.
        on_frame: Called with each finished frame's number, instead of a progress bar.

    Returns:
        `out_dir`.

    Raises:
        MissingInput: the clip or the body is not there.
        BadCharacter: the character's file is broken, or names files outside its folder.
        EngineMissing: the engine or device of the recipe can't run here.
        RenderFailed: Blender ended without its result, or can't use the character; the message has
            the reason or the end of its log.
    """

    def work(partial_dir: Path) -> dict[str, str]:
        renderer = find_renderer(config.engine, config.device)
        job = RenderJob(
            clip_path=clip_path.resolve(),
            body_path=body_path.resolve(),
            out_dir=partial_dir.resolve(),
            config=with_full_paths(config),
            threads=threads,
            layout_paths=tuple(path.resolve() for path in layout_paths),
        )
        with ExitStack() as stack:
            tell = on_frame
            if tell is None:
                from gmrdata.stage.progress import progress_bar

                bar = stack.enter_context(progress_bar())
                n_frames = load_clip(clip_path).motion.n_frames
                task = bar.add_task(f"rendering {out_dir.name}", total=n_frames)

                def tell(_: int) -> None:
                    bar.advance(task)

            run_blender(job, partial_dir, tell)
        if config.video:
            frames = sorted((partial_dir / "frames").glob(f"*.{config.image_format}"))
            fps_hz = load_clip(clip_path).motion.fps_hz
            write_video_of(frames, partial_dir / "video.mp4", fps_hz)
        return {"renderer": renderer}

    inputs = render_inputs(clip_path, body_path, config, layout_paths)
    return run_stage("render", out_dir, config, inputs, work, resumable=True, run=run)


def render_inputs(
    clip_path: Path, body_path: Path, config: RenderConfig, layout_paths: Sequence[Path]
) -> dict[str, Path]:
    """Files that a clip's pictures depend on, by role; arguments as for `render_clip`."""
    inputs = {"clip": clip_path, "body": body_path} | config.scene.inputs | config.person.inputs
    if config.character is not None:
        inputs |= config.character.inputs
    return inputs | {f"layout{number}": path for number, path in enumerate(layout_paths)}


def with_full_paths(value: Any) -> Any:
    """A recipe, or a value of one, for a process that runs in another folder."""
    if isinstance(value, Path):
        return value.resolve()
    if isinstance(value, tuple):
        return tuple(with_full_paths(item) for item in value)
    if isinstance(value, Config):
        full = {name: with_full_paths(getattr(value, name)) for name in type(value).model_fields}
        return value.model_copy(update=full)
    return value


def run_blender(
    job: RenderJob | PreviewJob,
    partial_dir: Path,
    on_frame: Callable[[int], None],
    *,
    module: str = "blender",
) -> None:
    """Run the Blender process on a job, its chatter in a log that only stays when it fails.

    Args:
        job: The job file's content.
        partial_dir: Gets the job file and the log.
        on_frame: Called with each finished frame's number.
        module: What reads the job file.

    Raises:
        RenderFailed: Blender ended without its result; the message has the end of its log.
    """
    job_path, log_path = partial_dir / "job.json", partial_dir / LOG_FILE
    write_json(job_path, job.model_dump(mode="json"))
    command = [sys.executable, "-m", module, str(job_path), "--parent", str(os.getpid())]
    with log_path.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command,
            env=os.environ | KEEP_MEMORY,
            cwd=PACKAGES_DIR,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(FRAME_LINE):
                    on_frame(int(line.split()[1]))
                else:
                    log.write(line)
            exit_code = process.wait()
        finally:
            process.kill()
            process.wait()
    if exit_code:
        raise RenderFailed(_what_happened(log_path, exit_code))
    job_path.unlink()
    log_path.unlink()


def _what_happened(log_path: Path, exit_code: int) -> str:
    lines = log_path.read_text(encoding="utf-8").splitlines()
    said = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    if said and exit_code == 1:
        return said[-1]
    tail = "\n".join(lines[-LOG_LINES:]) or "(it said nothing)"
    ended = f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    return f"Blender ended with {ended}; run again to go on. The end of {log_path}:\n{tail}"
