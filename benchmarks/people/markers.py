"""People whose joints markers measured: phone videos of a walk, sit-to-stands and squats.

They lie in `public/samples` of Seeeeeyo/opencap-visualizer (at 795d1ef), each a `video.mp4` beside
`sample_mocap.json`: the segments of an OpenSim model that was fitted to markers, in metres, y up.
Where a segment begins is a joint.  The camera rests, and nobody says where it is.  Videos and
markers begin together.  Nothing is told, and nothing was chosen on these people.
"""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from networks import networks_in, own_people
from people.in_world import level_figures, limbs_and_hips_m, place_figures
from poses.score import aligned_mm, wa_mpjpe_mm
from scipy.interpolate import make_interp_spline

from gmrdata.fusion.record import load_sigma, sigma_file
from gmrdata.read.systems.entries import Z_UP_FROM_Y_UP
from gmrdata.solve.videos import solve_video
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import load_clip
from gmrdata.values.people import FUSED, PSEUDO_GT, person_file
from gmrdata.values.transforms import fit_similarity
from gmrdata.world.judge import load_record

CLIPS = ("walk", "walk_ts", "STS", "squat")
SEGMENTS = [
    f"{part}_{side}"
    for part in ("humerus", "ulna", "hand", "femur", "tibia", "talus")
    for side in ("l", "r")
]
"""Which begin at `TWELVE`."""


@dataclass(frozen=True)
class MarkersRow:
    """One video's person in the world; joints are the 12 of limbs."""

    clip: str
    accepted: bool
    frames: int
    pa_mm: float
    worst_pa_mm: float
    wa_mm: float
    level_deg: float
    """Of the world in which joints over all frames lie best: also what people seem to lean by."""
    said_deg: float
    way_m: float
    """From the first frame's hips to the last one's."""
    true_way_m: float
    place_mm: float
    within: tuple[float, float]
    """As in `WorldRow`."""


def markers_rows(
    folder: Path, out_dir: Path, models_dir: Path, body: BodyModel
) -> Iterator[MarkersRow]:
    """Each clip's, which is solved anew."""
    for name in CLIPS:
        solved = out_dir / name
        shutil.rmtree(solved, ignore_errors=True)
        config = own_people(networks_in(models_dir))
        solve_video(folder / name / "video.mp4", solved, poses="own", config=config)
        yield _row(name, folder / name / "sample_mocap.json", solved, body)


def _row(name: str, truth: Path, solved: Path, body: BodyModel) -> MarkersRow:
    clip, quality = load_clip(solved / FUSED / person_file(0)), load_record(solved / PSEUDO_GT)
    joints_m, hips_m = limbs_and_hips_m(clip, body)
    true_m = _true_m(truth, clip.image_numbers / clip.motion.fps_hz)
    true_hips_m = true_m[:, 6:8].mean(axis=1)
    pa_mm = aligned_mm(joints_m, true_m)
    turn = fit_similarity(joints_m.reshape(-1, 3), true_m.reshape(-1, 3), scale=False).rotmat
    return MarkersRow(
        clip=name,
        **level_figures(turn[:, 2], quality, 0),
        pa_mm=float(pa_mm.mean()),
        worst_pa_mm=float(pa_mm.max()),
        wa_mm=wa_mpjpe_mm(joints_m, true_m),
        way_m=float(np.linalg.norm(hips_m[-1, :2] - hips_m[0, :2])),
        true_way_m=float(np.linalg.norm(true_hips_m[-1, :2] - true_hips_m[0, :2])),
        **place_figures(hips_m, true_hips_m, load_sigma(solved / FUSED / sigma_file(0))),
    )


def _true_m(path: Path, times_s: np.ndarray) -> np.ndarray:
    """The 12 joints (T, 12, 3) at these times, z up; between two rows as they lie."""
    said = json.loads(path.read_text(encoding="utf-8"))
    known_s = np.array(said["time"]) - said["time"][0]
    joints_m = np.stack([said["bodies"][one]["translation"] for one in SEGMENTS], axis=1)
    lines = make_interp_spline(known_s, joints_m @ Z_UP_FROM_Y_UP.T, k=1)
    return np.asarray(lines(np.clip(times_s, *known_s[[0, -1]])))
