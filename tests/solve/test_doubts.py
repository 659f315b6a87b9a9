"""What a video's own times, lost frames, lens and jumps change in the verdict on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import CAMERAS_FILE, QUALITY_FILE, SfmCameras, save_cameras
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.motion.gait import make_gait
from gmrdata.people.sources import MasksConfig, OnnxSource, PersonSource
from gmrdata.solve import solve, verdict
from gmrdata.solve.request import PeopleBySystem, SolveConfig, Solved, SolveRequest
from gmrdata.solve.verdict import (
    TOO_FEW,
    UNCHECKED,
    judge_cameras,
    judge_video,
    video_doubts,
    with_lens_error,
    write_doubts,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, Source
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadRecord, NoReconstruction
from gmrdata.values.files import write_json
from gmrdata.values.frame_set import VideoRecord
from gmrdata.values.people import DOUBTS_FILE
from gmrdata.values.transforms import rigid
from gmrdata.world.recipe import Doubts, Dropped, PseudoGtConfig, ScaleConfig, VerdictConfig
from tests.frame_sets import frame_set
from tests.reconstructions import good_quality, lens, pseudo_gt_quality


def video(times_s: list[float], *, every: int = 1, n_lost: int = 0) -> VideoRecord:
    n = len(times_s)
    return VideoRecord(
        container="mp4",
        codec="h264",
        pixel_format="yuv420p",
        stored_size_px=(64, 48),
        size_px=(64, 48),
        is_turned=False,
        n_deinterlaced=0,
        n_expected=n * every + n_lost,
        n_decoded=n * every,
        is_part=False,
        every=every,
        rate_hz=1.0 / float(np.median(np.diff(times_s))),
        numbers=tuple(range(0, n * every, every)),
        times_s=tuple(times_s),
    )


def walk(body: BodyModel, n: int = 10, fps_hz: float = 10.0) -> Clip:
    motion = make_gait("circle", n / fps_hz, fps_hz, body, np.random.default_rng(2))
    n = motion.n_frames
    return Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n), None)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("every", 0, "`every` is wrong"),
        ("rate_hz", 0.0, "`rate_hz` is wrong"),
        ("times_s", [0.0, 0.1], "3 numbers, but 2 times_s"),
    ],
)
def test_a_record_of_a_video_that_cannot_be_is_refused(key, value, said, tmp_path):
    """No rate was believed, and the others ended in tracebacks."""
    path = tmp_path / "video.json"
    write_json(path, video([0.0, 0.1, 0.2]).model_dump(mode="json") | {key: value})
    with pytest.raises(BadRecord, match=rf"video\.json: .*{said}"):
        VideoRecord.read(path)


def test_even_times_of_the_bodys_rate_are_no_doubt(anny):
    clip = walk(anny)
    jitter = 0.1 * np.arange(clip.motion.n_frames) + 0.005 * (np.arange(clip.motion.n_frames) % 2)
    doubts = video_doubts(video(jitter.tolist()), [clip])
    assert doubts.sequence == () and not any(doubts.frames[0])


def test_a_frame_that_came_late_is_not_used(anny):
    clip = walk(anny)
    times_s = 0.1 * np.arange(clip.motion.n_frames)
    times_s[4:] += 0.1
    doubts = video_doubts(video(times_s.tolist()), [clip, clip])
    assert doubts.sequence == ()
    for frames in doubts.frames:
        assert [row for row, text in enumerate(frames) if text] == [4]
        assert frames[4] == "shown 0.200 s after the image before, not 0.100 s"


def test_times_are_compared_once_for_all_people(anny, monkeypatch):
    """They share their rows, and for 46 people of a film it took 46 times as long."""
    looked_at_hz, odd_steps = [], verdict._odd_steps

    def look(steps_s, fps_hz):
        looked_at_hz.append(fps_hz)
        return odd_steps(steps_s, fps_hz)

    monkeypatch.setattr(verdict, "_odd_steps", look)
    clip = walk(anny)
    video_doubts(video((0.1 * np.arange(clip.motion.n_frames)).tolist()), 3 * [clip])
    assert looked_at_hz == [10.0]


def test_a_stretch_at_another_rate_is_not_used(anny):
    """A phone in the dark takes fewer images: each step is within reason, but not their speed."""
    clip = walk(anny, 40)
    steps_s = np.where(np.arange(clip.motion.n_frames - 1) < 25, 0.1, 0.1 / 0.88)
    doubts = video_doubts(video([0.0, *np.cumsum(steps_s).tolist()]), [clip])
    assert doubts.sequence == ()
    assert {row for row, text in enumerate(doubts.frames[0]) if text} == set(range(25, 40))
    assert doubts.frames[0][30] == "among images at 8.8 per second, not 10"


def test_another_rate_is_named(anny):
    clip = walk(anny)
    times_s = (0.04 * np.arange(clip.motion.n_frames)).tolist()
    doubts = video_doubts(video(times_s), [clip])
    assert doubts.sequence == ("the body has 10 frames per second, the video 25",)
    # Every second row of a body has twice the time between its images.
    numbers = 2 * np.arange(clip.motion.n_frames)
    half = replace(clip, image_numbers=numbers)
    times_s = (0.05 * np.arange(2 * clip.motion.n_frames)).tolist()
    assert video_doubts(video(times_s), [half]).sequence == ()
    assert video_doubts(video(times_s, every=2), [half]).sequence == ()


def test_lost_frames_reject(anny, tmp_path):
    clip = walk(anny)
    times_s = (0.1 * np.arange(clip.motion.n_frames)).tolist()
    record = video(times_s, n_lost=5)
    (reason,) = video_doubts(record, [clip]).sequence
    n = clip.motion.n_frames
    assert reason.startswith(f"5 of the video's {n + 5} frames could not be decoded")
    path = write_doubts(tmp_path, [clip], record, None)
    assert path == tmp_path / DOUBTS_FILE and Doubts.read(path).sequence == (reason,)
    assert write_doubts(tmp_path, [clip], video(times_s), None) is None and not path.exists()


def most(source: Source, sigma: float) -> float:
    return with_lens_error(PseudoGtConfig(), lens(source, sigma)).verdict.max_focal_deviation


@pytest.mark.parametrize(
    ("source", "sigma", "deviation"),
    [
        # A pan over a street: 1373 px to 9 % was a guess, and the background asks for 1.11 of it.
        ("prior", 0.094, 0.188),
        ("prior", 0.3, 0.6),
        ("prior", 0.7, 0.99),
        ("self_calibrated", 0.03, 0.06),
        ("metadata", 0.12, 0.24),
        ("self_calibrated", 0.002, 0.01),
        ("given", 0.01, 0.01),
        ("given", 0.06, 0.12),
    ],
)
def test_a_background_may_ask_for_another_focal_length_by_the_error_of_one_nobody_measured(
    source, sigma, deviation
):
    assert most(source, sigma) == deviation


def test_what_is_set_of_the_scale_stays_for_people_of_unknown_size():
    """A threshold of 2 % became 25 %.  A recipe that was read again has every key and sets none."""
    asked = PseudoGtConfig(
        scale=ScaleConfig(creep_m_per_s=0.05), verdict=VerdictConfig(max_scale_sigma_share=0.02)
    )
    read_again = PseudoGtConfig.of_plain(PseudoGtConfig().model_dump(mode="json"))
    found, usual = (
        solve._with_size_errors(config, (0.07,), own_feet=True) for config in (asked, read_again)
    )
    assert found.verdict == asked.verdict
    assert found.scale == ScaleConfig(**solve.OWN_FEET | {"creep_m_per_s": 0.05})
    assert usual.verdict.max_scale_sigma_share == pytest.approx(np.hypot(0.06, 0.25))
    assert usual.scale == ScaleConfig(**solve.OWN_FEET)
    assert solve._with_size_errors(asked, (), own_feet=False) == asked


def test_frames_on_both_sides_of_a_jump_are_dropped(tmp_path):
    """The one before it was kept."""
    n = 100
    angles_rad = np.where(np.arange(n) < 50, 0.0, 0.4)
    turns = Rotation.from_rotvec(angles_rad[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    known, cameras = np.ones(n, dtype=bool), rigid(turns, np.zeros(3))
    path = CameraPath(np.diag([900.0, 900.0, 1.0]), 1280, 720, cameras, known)
    save_cameras(tmp_path / CAMERAS_FILE, SfmCameras(path, "full", np.arange(n), ~known))
    good_quality(n).write(tmp_path / QUALITY_FILE)
    found = judge_cameras(tmp_path, 30.0, CamerasVerdictConfig())
    assert found.accepted and found.dropped == (Dropped(49, 51, "the camera jumps"),)


@pytest.mark.parametrize(
    ("masks", "said"),
    [
        (None, UNCHECKED),
        (MasksConfig(), UNCHECKED),  # silhouettes of the bodies themselves
        (MasksConfig(sources=(OnnxSource(classes=("car",)),)), UNCHECKED),
        (MasksConfig(sources=(PersonSource(),)), f"walk: {TOO_FEW}"),
    ],
)
def test_masks_that_show_nobody_are_not_said_to_be_missing(masks, said, tmp_path):
    world = pseudo_gt_quality(good_quality(12), 1.0).model_copy(update={"picture_fits": (None,)})
    world.write(tmp_path / QUALITY_FILE)
    solved = Solved(
        SolveRequest(Path("walk.mp4"), PeopleBySystem()),
        tmp_path,
        SolveConfig(masks=masks),
        frame_set(np.arange(12), (1280, 720), 30.0),
        lens=lens("given", 0.01),
        unsolved=NoReconstruction("its cameras are not here"),
        world_dir=tmp_path,
    )
    notes = judge_video(solved).notes
    assert [note for note in notes if "was not checked" in note] == [said]
