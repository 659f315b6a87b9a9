"""People's landmarks of real frames: who is seen, where, and after a stop."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people import landmarks
from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.people.landmarks import (
    LANDMARKS_FILE,
    LandmarksConfig,
    LandmarksRecord,
    LandmarkTrack,
    find_landmarks,
    load_tracks,
)
from gmrdata.values.errors import BadRecord

N_FRAMES = 4
CONFIG = LandmarksConfig(detect_every=2, min_frames=3)


@pytest.fixture(scope="module")
def frames_dir(
    shared_path: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The middle of the first frames of a real video of people who hardly move."""
    folder = tmp_path_factory.mktemp("people")
    images = sorted(shared_path("video/static_people").glob("*.jpg"))[:N_FRAMES]
    for n, path in enumerate(images):
        image = cv2.imread(str(path))
        cv2.imwrite(str(folder / f"{n + 7:05d}.png"), image[:, 150:750])
    return folder


@pytest.fixture(scope="module")
def found_dir(
    frames_dir: Path,
    yolox_nano: Path,
    pose_landmarks: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    out_dir = tmp_path_factory.mktemp("landmarks") / "out"
    return find_landmarks(yolox_nano, pose_landmarks, frames_dir, out_dir, CONFIG)


def test_people_are_followed(found_dir: Path) -> None:
    record, tracks = LandmarksRecord.read(found_dir / LANDMARKS_FILE), load_tracks(found_dir)
    assert record.images == N_FRAMES and len(tracks) == len(record.people) >= 2
    assert record.people[0].images == N_FRAMES and record.people[0].first_image == 7
    for track in tracks:
        assert set(track.image_numbers) <= {7, 8, 9, 10} and (track.scores >= 0.5).all()
    # Each frame shows a person once.
    first = [track.image_px[0] for track in tracks if track.image_numbers[0] == 7]
    apart_px = [np.abs(a - b).max() for i, a in enumerate(first) for b in first[:i]]
    assert min(apart_px, default=99.0) > 10


def test_landmarks_are_a_standing_person_s(found_dir: Path) -> None:
    """Head above hips above feet, in pixels and in metres; a thigh is as long as a thigh."""
    track = load_tracks(found_dir)[0]
    at = {name: n for n, name in enumerate(LANDMARKS)}
    for points in (track.image_px, track.world_m):
        nose, hip, ankle = (points[:, at[name], 1] for name in ("nose", "left_hip", "left_ankle"))
        assert (nose < hip).all() and (hip < ankle).all()
    thigh_m = track.world_m[:, at["left_hip"]] - track.world_m[:, at["left_knee"]]
    assert 0.25 < np.linalg.norm(thigh_m, axis=1).mean() < 0.5
    np.testing.assert_allclose(track.world_m[:, [23, 24]].mean(1), 0, atol=0.02)
    height_px = np.ptp(track.image_px[0, :, 1])
    assert 0.9 * height_px < track.crops[0, 2] < 2 * height_px


def test_a_stopped_run_goes_on_where_it_was(
    found_dir: Path,
    frames_dir: Path,
    yolox_nano: Path,
    pose_landmarks: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, seen = landmarks._frame, []

    def stopped(*given: object) -> object:
        seen.append(None)
        if len(seen) == 3:
            raise KeyboardInterrupt
        return whole(*given)  # type: ignore[arg-type]

    files = yolox_nano, pose_landmarks, frames_dir, tmp_path / "out", CONFIG
    monkeypatch.setattr(landmarks, "_frame", stopped)
    with pytest.raises(KeyboardInterrupt):
        find_landmarks(*files)
    find_landmarks(*files)
    assert len(seen) == 3 + N_FRAMES - 2
    for path in [*sorted(found_dir.glob("person_*.npz")), found_dir / LANDMARKS_FILE]:
        assert (tmp_path / "out" / path.name).read_bytes() == path.read_bytes()


def test_a_video_without_people_leaves_a_record_without_people(
    yolox_nano: Path, pose_landmarks: Path, tmp_path: Path
) -> None:
    (tmp_path / "frames").mkdir()
    for n in range(2):
        cv2.imwrite(str(tmp_path / "frames" / f"{n}.png"), np.full((120, 160, 3), 90, np.uint8))
    out_dir = tmp_path / "out"
    find_landmarks(yolox_nano, pose_landmarks, tmp_path / "frames", out_dir, CONFIG)
    assert LandmarksRecord.read(out_dir / LANDMARKS_FILE).people == ()
    assert load_tracks(out_dir) == []


def test_a_changed_track_is_refused(found_dir: Path, tmp_path: Path) -> None:
    arrays = dict(np.load(found_dir / "person_0.npz"))
    np.savez(tmp_path / "person_0.npz", **arrays | {"scores": arrays["scores"][1:]})
    with pytest.raises(BadRecord, match=r"person_0\.npz: array 'scores' has shape"):
        LandmarkTrack.read(tmp_path / "person_0.npz")
