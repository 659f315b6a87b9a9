"""Render a clip with Blender, which runs as a process of its own."""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from gmrdata.clip import load_clip
from gmrdata.config import Config
from gmrdata.errors import RenderFailed
from gmrdata.progress import progress_bar
from gmrdata.scene_config import SceneConfig
from gmrdata.store import run_stage, write_json
from gmrdata.video_out import write_video_of

FRAME_LINE = "gmrdata-frame"
"""What the Blender process prints, with the frame's number, when a frame and its mask are there."""
LOG_FILE = "blender.log"
LOG_LINES = 12
PACKAGES_DIR = Path(__file__).resolve().parent.parent
"""Where the packages `gmrdata` and `blender` are, side by side in a checkout and in a wheel."""


class RenderConfig(Config):
    """How a clip is rendered.  Size and lens are those of the clip's camera."""

    scene: SceneConfig = SceneConfig()
    """The place."""
    engine: Literal["cycles"] = "cycles"
    """Blender's renderer: Cycles on the CPU."""
    samples: int = Field(default=6, ge=1, le=4096)
    """Rays per pixel; they smooth edges, the light has no noise."""
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
    video: bool = False
    """Also `video.mp4` of the frames, H.264."""


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


def frame_files(out_dir: Path, config: RenderConfig, row: int, n_frames: int) -> dict[str, Path]:
    """Files of one frame by folder, in the order in which they are written.

    Flow leads to the next frame, so the last frame has none.
    """
    folders = {"frames": "jpg", "masks": "png"}
    folders |= {name: "png" for name in ("depth", "normals", "flow") if getattr(config, name)}
    if row == n_frames - 1:
        folders.pop("flow", None)
    return {name: out_dir / name / f"{row:05d}.{suffix}" for name, suffix in folders.items()}


def optional_outputs(out_dir: Path, config: RenderConfig) -> dict[str, Any]:
    """What a recipe adds to a finished folder, as keywords of `manifest.entry.clip_entry`."""
    folders = {
        f"{name}_dir": out_dir / name
        for name in ("depth", "normals", "flow")
        if getattr(config, name) and (out_dir / name).is_dir()  # one frame alone has no flow
    }
    files = {"joints_path": ("joints", "joints.npz"), "video_path": ("video", "video.mp4")}
    return folders | {
        key: out_dir / file for key, (name, file) in files.items() if getattr(config, name)
    }


def render_clip(
    clip_path: Path,
    body_path: Path,
    out_dir: Path,
    config: RenderConfig,
    *,
    redo: bool = False,
    threads: int = 1,
    on_frame: Callable[[int], None] | None = None,
) -> Path:
    """Render a clip: `frames/00000.jpg`, `masks/00000.png` (255 = person), and `clip.npz`.

    `clip.npz` holds the motion and the camera as Blender really used it.  A killed run goes on at
    the next missing frame.  The recipe can ask for more: joints, depth, normals, flow, a video.

    Args:
        clip_path: Clip .npz with frame "world" and a camera for each frame.
        body_path: Body .npz.
        out_dir: The stage's folder.
        config: The recipe.
        redo: Throw away a result that another recipe made.
        threads: Processor threads for Blender; the pictures don't depend on it.
        on_frame: Called with each finished frame's number, instead of a progress bar.

    Returns:
        `out_dir`.

    Raises:
        MissingInput: the clip or the body is not there.
        RenderFailed: Blender ended without its result; the message has the end of its log.
    """

    def work(partial_dir: Path) -> None:
        job = RenderJob(
            clip_path=clip_path.resolve(),
            body_path=body_path.resolve(),
            out_dir=partial_dir.resolve(),
            config=config.model_copy(update={"scene": config.scene.with_full_paths()}),
            threads=threads,
        )
        with ExitStack() as stack:
            tell = on_frame
            if tell is None:
                bar = stack.enter_context(progress_bar())
                n_frames = load_clip(clip_path).motion.n_frames
                task = bar.add_task(f"rendering {out_dir.name}", total=n_frames)

                def tell(_: int) -> None:
                    bar.advance(task)

            _run_blender(job, partial_dir, tell)
        if config.video:
            frames = sorted((partial_dir / "frames").glob("*.jpg"))
            fps_hz = load_clip(clip_path).motion.fps_hz
            write_video_of(frames, partial_dir / "video.mp4", fps_hz)

    inputs = {"clip": clip_path, "body": body_path} | config.scene.inputs
    return run_stage("render", out_dir, config, inputs, work, resumable=True, redo=redo)


def _run_blender(job: RenderJob, partial_dir: Path, on_frame: Callable[[int], None]) -> None:
    """Run the Blender process on a job, its chatter in a log that only stays when it fails."""
    job_path, log_path = partial_dir / "job.json", partial_dir / LOG_FILE
    write_json(job_path, job.model_dump(mode="json"))
    command = [sys.executable, "-m", "blender", str(job_path), "--parent", str(os.getpid())]
    with log_path.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command,
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
