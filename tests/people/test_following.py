"""People of real frames, followed: who is seen, where, how often, and after a stop."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people.following import (
    FOLLOWED_FILE,
    SIGHTINGS_FILE,
    FollowConfig,
    FollowedRecord,
    Networks,
    PersonFacts,
    Sightings,
    _Follower,
    follow_people,
    load_tracks,
    outline_path,
)
from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.read.frames import list_images, read_frames, read_gray
from gmrdata.values.errors import BadRecord

N_FRAMES = 4
CONFIG = FollowConfig(min_frames=3)


@pytest.fixture(scope="module")
def frames_dir(standing_people: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The middle of the first frames of a real video of people who hardly move."""
    folder = tmp_path_factory.mktemp("people")
    for n, path in enumerate(standing_people[:N_FRAMES]):
        cv2.imwrite(str(folder / f"{n + 7:05d}.png"), cv2.imread(str(path))[:, 150:750])
    return folder


@pytest.fixture(scope="module")
def followed_dir(
    frames_dir: Path, networks: Networks, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    return follow_people(
        read_frames(frames_dir), tmp_path_factory.mktemp("f") / "out", CONFIG, networks
    )


def test_people_are_followed(followed_dir: Path) -> None:
    record, tracks = FollowedRecord.read(followed_dir / FOLLOWED_FILE), load_tracks(followed_dir)
    assert record.images == (7, 8, 9, 10) and len(tracks) == len(record.people) >= 2
    assert record.people[0] == PersonFacts(images=N_FRAMES, seen=((7, 10),), may_be=())
    assert record.doubts() == ()
    for track, person in zip(tracks, record.people, strict=True):
        assert set(track.image_numbers) <= set(record.images) and (track.scores >= 0.5).all()
        assert person.images == len(track) and np.ptp(track.pieces) == 0
    # Each frame shows a person once.
    first = [track.image_px[0] for track in tracks if track.image_numbers[0] == 7]
    apart_px = [np.abs(a - b).max() for i, a in enumerate(first) for b in first[:i]]
    assert min(apart_px, default=99.0) > 10


def test_each_sighting_has_its_outline_and_colours(followed_dir: Path, frames_dir: Path) -> None:
    everybody = Sightings.read(followed_dir / SIGHTINGS_FILE)
    images = dict(zip((7, 8, 9, 10), list_images(frames_dir), strict=True))
    assert len(list(followed_dir.glob("outlines/*.png"))) == len(everybody)
    for n in range(len(everybody)):
        image, piece = images[int(everybody.image_numbers[n])], int(everybody.pieces[n])
        left, top, width, height = cv2.boundingRect(
            read_gray(outline_path(followed_dir, image, piece))
        )
        assert everybody.boxes_px[n].tolist() == [left, top, left + width, top + height]
    np.testing.assert_allclose(everybody.colours.sum(axis=1), 1, atol=2e-3)


def test_landmarks_are_a_standing_person_s(followed_dir: Path) -> None:
    """Head above hips above feet, in pixels and in metres; a thigh is as long as a thigh."""
    track = load_tracks(followed_dir)[0]
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
    followed_dir: Path,
    frames_dir: Path,
    networks: Networks,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, seen = _Follower._turn, []

    def stopped(*given: object) -> object:
        seen.append(None)
        if len(seen) == 3:
            raise KeyboardInterrupt
        return whole(*given)  # type: ignore[arg-type]

    given = read_frames(frames_dir), tmp_path / "out", CONFIG, networks
    monkeypatch.setattr(_Follower, "_turn", stopped)
    with pytest.raises(KeyboardInterrupt):
        follow_people(*given)
    follow_people(*given)
    assert len(seen) == 3 + N_FRAMES - 2
    for name in (FOLLOWED_FILE, SIGHTINGS_FILE):
        assert (tmp_path / "out" / name).read_bytes() == (followed_dir / name).read_bytes()


def test_who_is_seen_late_is_followed_back_and_left_out_images_are_not_looked_at(
    frames_dir: Path, networks: Networks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The detector is blind but for the last frame."""
    detected = _Follower._turn

    def late(self: _Follower, before: object, image: np.ndarray, row: int) -> object:
        if row < len(self.frames.paths) - 1:
            self.boxes_px[row] = self.boxes_px[row][:0]
        return detected(self, before, image, row)

    monkeypatch.setattr(_Follower, "_turn", late)
    made = follow_people(read_frames(frames_dir, {7}), tmp_path / "out", CONFIG, networks)
    record = FollowedRecord.read(made / FOLLOWED_FILE)
    assert record.images == (8, 9, 10) and record.people[0].seen == ((8, 10),)


def test_a_video_without_people_leaves_a_record_without_people(
    networks: Networks, grey_dir: Path, tmp_path: Path
) -> None:
    made = follow_people(read_frames(grey_dir), tmp_path / "out", CONFIG, networks)
    assert FollowedRecord.read(made / FOLLOWED_FILE).people == ()
    assert load_tracks(made) == []


def test_a_changed_file_is_refused(followed_dir: Path, tmp_path: Path) -> None:
    arrays = dict(np.load(followed_dir / SIGHTINGS_FILE))
    np.savez(tmp_path / SIGHTINGS_FILE, **arrays | {"scores": arrays["scores"][1:]})
    with pytest.raises(BadRecord, match=r"sightings\.npz: array 'scores' has shape"):
        Sightings.read(tmp_path / SIGHTINGS_FILE)
