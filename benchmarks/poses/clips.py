"""Twelve rendered clips of CMU's subjects 02 and 08, on which nothing was trained.

    FOLDER/<clip>/clip.json, frames/, masks/, clip.npz      as benchmarks/video/clips.py has them

People of their own in four kinds of places, under every camera programme.
`python benchmarks/poses/clips.py FOLDER MOTIONS` makes them.
"""

import sys
from pathlib import Path

from video.clips import HAND, Clip, Take, render_clips

CLIPS: dict[str, Clip] = {
    "courtyard_walk": ("wide", "02_01", {"kind": "circular", "rate_deg_per_s": 20.0} | HAND),
    "room_scoop": ("wide", "02_06", {"kind": "circular", "rate_deg_per_s": 15.0} | HAND),
    "street_stride": ("wide", "08_04", {"kind": "linear_panning"} | HAND),
    "room_wash": ("usual", "02_10", {"kind": "static"}),
    "park_walk": ("usual", "08_03", {"kind": "linear"} | HAND),
    "street_strike": ("usual", "02_05", {"kind": "circular", "rate_deg_per_s": 15.0} | HAND),
    "park_run": ("upright", "02_03", {"kind": "panning"} | HAND),
    "courtyard_sword": ("upright", "02_07", {"kind": "linear"} | HAND),
    "street_slow": ("upright", "08_06", {"kind": "panning"} | HAND),
    "room_sword": ("bent", "02_09", {"kind": "small"}),
    "park_jump": ("bent", "02_04", {"kind": "linear_panning"} | HAND),
    "courtyard_march": ("bent", "08_11", {"kind": "linear"} | HAND),
}
SMALL = ("room_wash",)
SEED, DURATION_S = 23, 3.4
"""Others take world errors over 100 frames at 30 Hz, 3.3 s: each clip is one such window, and those
of six short trials end before."""


def make_pose_clips(folder: Path, motions_dir: Path, *, small: bool = False) -> list[Path]:
    """Render what is not there yet; the clips' folders, of one clip if it is `small`."""
    clips = {name: CLIPS[name] for name in SMALL} if small else CLIPS
    take = Take("poses", "trial", SEED, DURATION_S, motions_dir)
    return render_clips(clips, folder, folder / "rendered", take)


if __name__ == "__main__":
    make_pose_clips(Path(sys.argv[1]), Path(sys.argv[2]))
