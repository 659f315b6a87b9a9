"""How long ten seconds of video take: 300 frames of 1280x720 px at 30 fps, cameras alone.

A real clip is played forward, backward and forward again until it has as many frames.
"""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import av
from networks import networks_in

N_FRAMES, RATE_HZ, SIZE_PX = 300, 30, (1280, 720)
MOST_S, MOST_BYTES = 80.0, 3 << 30
KIB = 1024


def ten_seconds(source: Path, target: Path) -> Path:
    """A file of 300 frames of a clip of 1280x720 px."""
    with av.open(str(source)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    there_and_back = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    with av.open(str(target), "w") as container:
        stream: Any = container.add_stream("libx264", rate=RATE_HZ, options={"crf": "18"})
        (stream.width, stream.height), stream.pix_fmt = SIZE_PX, "yuv420p"
        for number in range(N_FRAMES):
            picture = frames[there_and_back[number % len(there_and_back)]]
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return target


def seconds_10s_720p(source: Path, models: Path, work_dir: Path) -> dict[str, Any]:
    """Wall and processor seconds of the verb, and its memory; the machine should be quiet."""
    work_dir.mkdir(parents=True, exist_ok=True)
    video = ten_seconds(source, work_dir / "ten_seconds.mp4")
    command = [sys.executable, "-m", "gmrdata", "video", video, "--out", work_dir / "out", "--redo"]
    detector, landmarks = networks_in(models)
    command += ["--poses", "none", "--detector", detector, "--landmark-network", landmarks]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run([str(part) for part in command], check=False)
    seconds = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "seconds_10s_720p": round(seconds, 1),
        "processor_seconds_10s_720p": round(
            used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime, 1
        ),
        "most_memory_mib_10s_720p": round(used.ru_maxrss / KIB),
        "cores": os.cpu_count(),
        "exit_code_10s_720p": ended.returncode,
    }
