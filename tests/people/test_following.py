"""People of real frames, detected, followed and linked: who is seen, where, how often."""

import shutil
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.programmes import Film, Small, film_motion, plan_clip
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.motion.gait import make_gait
from gmrdata.people.following import (
    FOLLOWED_FILE,
    SIGHTINGS_FILE,
    FollowConfig,
    FollowedRecord,
    PersonFacts,
    Sightings,
    _colours,
    _FollowedAt,
    _Follower,
    _known_people,
    cut_off,
    follow_people,
    is_among,
    load_tracks,
    outline_path,
)
from gmrdata.people.landmark_body import HIPS
from gmrdata.people.landmark_network import (
    LANDMARKS,
    LIMBS,
    LandmarkNetwork,
    PersonInCrop,
    Square,
    crop_around,
    look_mirrored,
    open_landmark_network,
    seen_twice,
)
from gmrdata.people.linking import (
    LinkConfig,
    Piece,
    cuts_in,
    detections_from_json,
    fill_boxes,
    join_pieces,
    unsure_pairs,
)
from gmrdata.people.onnx import OnnxConfig, open_detector
from gmrdata.people.sources import MasksConfig, PersonSource, make_masks
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.frames import list_images, read_color, read_frames, read_gray
from gmrdata.values.clip import save_clip
from gmrdata.values.errors import BadRecord, StaleOutput
from gmrdata.values.files import STAGE_FILE, read_json, write_json

N_FRAMES = 4
CONFIG = FollowConfig(min_frames=3)


@pytest.fixture(scope="module")
def frames_dir(standing_people, tmp_path_factory) -> Path:
    """The middle of the first frames of a real video of people who hardly move."""
    folder = tmp_path_factory.mktemp("people")
    for n, path in enumerate(standing_people[:N_FRAMES]):
        cv2.imwrite(str(folder / f"{n + 7:05d}.png"), cv2.imread(str(path))[:, 150:750])
    return folder


@pytest.fixture(scope="module")
def followed_dir(frames_dir, networks, tmp_path_factory) -> Path:
    return follow_people(
        read_frames(frames_dir), tmp_path_factory.mktemp("f") / "out", CONFIG, networks
    )


def test_people_are_followed(followed_dir):
    record, tracks = FollowedRecord.read(followed_dir / FOLLOWED_FILE), load_tracks(followed_dir)
    assert record.images == (7, 8, 9, 10) and len(tracks) == len(record.people) >= 2
    always = PersonFacts(images=N_FRAMES, seen=((7, 10),), may_be=(), unsure_from=())
    assert record.people[0] == always
    assert record.doubts() == ()
    for track, person in zip(tracks, record.people, strict=True):
        assert set(track.image_numbers) <= set(record.images) and (track.scores >= 0.5).all()
        assert person.images == len(track) and np.ptp(track.pieces) == 0
    # Each frame shows a person once.
    first = [track.image_px[0] for track in tracks if track.image_numbers[0] == 7]
    apart_px = [np.abs(a - b).max() for i, a in enumerate(first) for b in first[:i]]
    assert min(apart_px, default=99.0) > 10


def test_each_sighting_has_its_outline_and_colours(followed_dir, frames_dir):
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


def test_landmarks_are_a_standing_person_s(followed_dir):
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


def test_landmarks_are_of_two_looks(followed_dir, frames_dir, networks):
    look, track = open_landmark_network(networks.landmarks), load_tracks(followed_dir)[0]
    image = read_color(read_frames(frames_dir).paths[-1])
    x_px, y_px, side_px, turn_rad = track.crops[-1]
    crop = Square(np.array([x_px, y_px]), side_px, turn_rad)
    once = look(image, crop)
    twice = seen_twice(once, look_mirrored(look, image, crop), CONFIG.min_score)
    np.testing.assert_allclose(track.image_px[-1], twice.image_px, atol=1e-3)
    np.testing.assert_allclose(track.world_m[-1], twice.world_m, atol=1e-4)
    assert np.abs(once.world_m - twice.world_m).max() > 0.01


def test_a_stopped_run_goes_on_where_it_was(
    followed_dir, frames_dir, networks, tmp_path, monkeypatch
):
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
    frames_dir, networks, tmp_path, monkeypatch
):
    """The detector is blind but for the last frame."""
    detected = _Follower._turn

    def late(self: _Follower, before: object, image: np.ndarray, row: int) -> object:
        if row < len(self.frames.paths) - 1:
            self.detections[row] = detections_from_json([])
        return detected(self, before, image, row)

    monkeypatch.setattr(_Follower, "_turn", late)
    made = follow_people(read_frames(frames_dir, {7}), tmp_path / "out", CONFIG, networks)
    record = FollowedRecord.read(made / FOLLOWED_FILE)
    assert record.images == (8, 9, 10) and record.people[0].seen == ((8, 10),)
    with pytest.raises(StaleOutput, match="made with other values of inputs.left out 7"):
        follow_people(read_frames(frames_dir), made, CONFIG, networks)


def follower_of(
    look: LandmarkNetwork, frames_dir: Path, folder: Path, config: FollowConfig = CONFIG
) -> _Follower:
    """At its first frame, with a network for all looks."""

    def mirrored(image: np.ndarray, crop: Square) -> Future[PersonInCrop]:
        looked = Future[PersonInCrop]()
        looked.set_result(look_mirrored(look, image, crop))
        return looked

    frames = read_frames(frames_dir)
    return _Follower(frames, folder, config, lambda image: detections_from_json([]), look, mirrored)


BESIDE, APART = [330.0, 100.0, 430.0, 500.0], [450.0, 100.0, 550.0, 500.0]
UPPER, LOWER = [250.0, 100.0, 350.0, 380.0], [250.0, 250.0, 350.0, 500.0]


@pytest.mark.parametrize(
    ("off_px", "found_px", "seen"),
    [
        (15.0, [BESIDE], True),
        (15.0, [APART], True),
        (60.0, [APART], True),
        (60.0, [BESIDE], False),
        (60.0, [UPPER], True),
        (15.0, [UPPER, LOWER], True),
        (60.0, [UPPER, LOWER], False),
    ],
)
def test_who_is_another_in_a_closer_look_beside_or_as_somebody_is_not_seen(
    frames_dir, tmp_path, off_px, found_px, seen
):
    """A man behind a woman, and a woman above a man who hid her legs from a steep camera, had the
    limbs of both, and in a closer look others."""
    crop = Square(np.array([300.0, 300.0]), 500.0)
    image_px = np.random.default_rng(0).uniform(200, 400, (33, 2))
    box_px = np.array([250.0, 100.0, 350.0, 500.0])

    def look(image: np.ndarray, asked: Square) -> PersonInCrop:
        is_closer = asked.side_px < crop.side_px
        moved_px = (
            image_px + np.where(np.isin(np.arange(33), LIMBS), off_px * is_closer, 0)[:, None]
        )
        mask = np.full(image.shape[:2], 255, np.uint8)
        return PersonInCrop(1.0, mask, box_px, crop, moved_px, np.zeros((33, 3)), np.ones(33))

    follower = follower_of(look, frames_dir, tmp_path, FollowConfig())
    found = [{"box_px": one_px, "class": 0, "score": 0.9} for one_px in found_px]
    follower.detections.append(detections_from_json(found))
    image = read_color(follower.frames.paths[0])
    mirrored = follower.mirrored(image, crop)
    assert bool(follower._note(look(image, crop), crop, mirrored, 0, image, 0)) is seen


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_who_lies_or_is_head_down_is_looked_at_in_turned_crops(
    followed_dir, frames_dir, networks, tmp_path, quarters
):
    """The picture on its side, or of a camera that hangs: upright crops give limbs of somebody
    else, and are sure of them."""
    track = load_tracks(followed_dir)[0]
    image = np.rot90(read_color(list_images(frames_dir)[0]), quarters).copy()
    height_px, width_px = image.shape[:2]
    seen_px = np.concatenate([track.image_px[0], track.boxes_px[0].reshape(2, 2)])
    x, y = seen_px.T
    turned = {1: (y, height_px - x), 2: (width_px - x, height_px - y), 3: (width_px - y, x)}
    turned_px = np.stack(turned[quarters], axis=1)
    box_px = np.concatenate([turned_px[-2:].min(axis=0), turned_px[-2:].max(axis=0)])
    look = open_landmark_network(networks.landmarks)
    follower = follower_of(look, frames_dir, tmp_path)
    size_px = np.ptp(track.image_px[0, :, 1])

    def off(person: PersonInCrop) -> float:
        apart_px = np.linalg.norm(person.image_px - turned_px[:-2], axis=1)
        return float(apart_px[list(LIMBS)].mean() / size_px)

    person, crop = follower._first_look(image, box_px)
    assert off(person) < 0.05 and person.score > 0.5
    off_deg = np.rad2deg(crop.turn_rad) - {1: -90, 2: 180, 3: 90}[quarters]
    assert abs((off_deg + 180) % 360 - 180) < 25
    upright, _ = follower._settled(image, crop_around(box_px), 1)
    assert off(upright) > 0.15


def test_who_is_hidden_below_the_hips_is_not_squeezed_into_the_box(
    followed_dir, frames_dir, networks, tmp_path
):
    """A board before the legs: the box ends at it, and there the network had feet."""
    track = load_tracks(followed_dir)[1]
    image, whole_px = read_color(list_images(frames_dir)[0]), track.image_px[0]
    hips_px = whole_px[list(HIPS)].mean(axis=0)
    upper_px = np.array([*track.boxes_px[0][:3], hips_px[1] + 10])
    image[int(upper_px[3]) :] = 105
    look = open_landmark_network(networks.landmarks)
    follower = follower_of(look, frames_dir, tmp_path)

    def trunk(image_px: np.ndarray) -> float:
        """Over that of the same person whose legs are seen."""
        long_px, whole_long_px = (
            np.linalg.norm(px[[11, 12]].mean(axis=0) - px[list(HIPS)].mean(axis=0))
            for px in (image_px, whole_px)
        )
        return float(long_px / whole_long_px)

    squeezed, _ = follower._settled(image, crop_around(upper_px), 1)
    assert trunk(squeezed.image_px) < 0.8
    person, crop = follower._first_look(image, upper_px)
    assert trunk(person.image_px) == pytest.approx(1.0, rel=0.1)
    assert crop.side_px == pytest.approx(track.crops[0, 2], rel=0.1)


@pytest.mark.parametrize(
    ("seen_upto_px", "side_px"), [(9e9, 864.0), (700.0, 600.0), (580.0, 500.0)]
)
def test_a_look_that_grows_ends_where_somebody_is_seen(frames_dir, tmp_path, seen_upto_px, side_px):
    """Of who sat close to a webcam a crop far beyond the picture showed nobody, and so nobody was
    there."""

    def look(image: np.ndarray, crop: Square) -> PersonInCrop:
        score = float(crop.side_px < seen_upto_px)
        wanted = replace(crop, side_px=min(1.2 * crop.side_px, 864.0))
        marks_px, mask = np.zeros((33, 2)), np.zeros(image.shape[:2], np.uint8)
        return PersonInCrop(
            score, mask, np.zeros(4), wanted, marks_px, np.zeros((33, 3)), np.ones(33)
        )

    follower = follower_of(look, frames_dir, tmp_path)
    image, first = (
        read_color(follower.frames.paths[0]),
        Square(np.array([300.0, 300.0]), 500.0),
    )
    person, crop = follower._grown(image, look(image, first), first)
    assert person.score == 1 and crop.side_px == pytest.approx(side_px)


@pytest.mark.parametrize(
    ("other_px", "same"),
    [((100, 50, 200, 400), True), ((110, 55, 205, 170), True), ((120, 200, 180, 400), False),
     ((190, 50, 290, 400), False), ((190, 50, 290, 170), False), ((100, -20, 200, 130), False)],
)  # fmt: skip
def test_a_box_of_the_upper_half_is_of_the_same_person(other_px, same):
    """Beside the person's own: a box to the hips, a child in front, somebody beside, and somebody
    who stands behind and is seen above."""
    person_px = np.array([100.0, 50.0, 200.0, 400.0])
    assert is_among(np.array(other_px, dtype=float), [person_px], 0.4) is same
    assert is_among(person_px, np.array([other_px, (900, 0, 950, 99)], dtype=float), 0.4) is same
    assert not is_among(person_px, [], 0.4)


def test_who_stands_is_looked_at_once_more_alone(followed_dir, frames_dir, networks, tmp_path):
    image, looked = read_color(list_images(frames_dir)[0]), []
    network = open_landmark_network(networks.landmarks)

    def look(image: np.ndarray, crop: Square) -> PersonInCrop:
        looked.append(crop.turn_rad)
        return network(image, crop)

    follower = follower_of(look, frames_dir, tmp_path)
    follower._first_look(image, load_tracks(followed_dir)[0].boxes_px[0])
    assert len(looked) == 2 and looked[0] == 0.0


def test_a_video_without_people_leaves_a_record_without_people(networks, grey_dir, tmp_path):
    made = follow_people(read_frames(grey_dir), tmp_path / "out", CONFIG, networks)
    assert FollowedRecord.read(made / FOLLOWED_FILE).people == ()
    assert load_tracks(made) == []


def test_a_changed_file_is_refused(followed_dir, tmp_path):
    arrays = dict(np.load(followed_dir / SIGHTINGS_FILE))
    np.savez(tmp_path / SIGHTINGS_FILE, **arrays | {"scores": arrays["scores"][1:]})
    with pytest.raises(BadRecord, match=r"sightings\.npz: array 'scores' has shape"):
        Sightings.read(tmp_path / SIGHTINGS_FILE)


RED, BLUE = np.eye(2)
LINKS = LinkConfig()


def piece(first: int, n: int, x_px: float, colours: np.ndarray = RED, side_px: float = 100.0):
    """Somebody who goes 2 px a frame to the right from `x_px`, seen from frame `first` on."""
    crops = [[x_px + 2 * i, 50.0, side_px, 0.0] for i in range(n)]
    return Piece(np.arange(first, first + n), np.array(crops), np.tile(colours, (n, 1)))


def together(*pieces: Piece) -> Piece:
    """Pieces as one."""
    return Piece(
        np.concatenate([one.rows for one in pieces]),
        np.concatenate([one.crops for one in pieces]),
        np.concatenate([one.colours for one in pieces]),
    )


def like_red(distance: float) -> np.ndarray:
    """Colours at a distance from red."""
    share = (1 - distance**2) ** 2
    return np.array([share, 1 - share])


LATE = 20 + 60  # more than 2 s at 30 Hz


@pytest.mark.parametrize(
    ("pieces", "people"),
    [
        ([piece(0, 20, 0.0), piece(30, 20, 60.0), piece(0, 50, 400.0)], [[0, 1], [2]]),
        ([piece(0, 20, 0.0), piece(30, 20, 60.0, BLUE)], [[0], [1]]),
        ([piece(0, 20, 0.0), piece(30, 20, 60.0, side_px=200.0)], [[0], [1]]),
        (
            [piece(0, 20, 0.0), piece(LATE, 5, 2.0 * LATE), piece(LATE + 1, 5, 2.0 * LATE + 2)],
            [[0, 1], [2]],
        ),
        ([piece(0, 20, 0.0), piece(10, 20, 20.0)], [[0], [1]]),
        (
            [
                *(piece(0, 20, 0.0, one) for one in (RED, BLUE)),
                *(piece(30, 9, 60.0, one) for one in (BLUE, RED)),
            ],
            [[0, 3], [1, 2]],
        ),
    ],
    ids=["found again", "another", "twice as large", "too late", "at one time", "two who cross"],
)
def test_pieces_of_one_person_are_joined(pieces, people):
    assert join_pieces(pieces, LINKS)[0] == people


def test_a_gap_is_as_long_at_any_rate():
    """Nobody for half a second at 240 Hz, or for four at 10 Hz, was 120 and 40 frames."""
    fast = [piece(0, 20, 0.0), piece(140, 20, 280.0)]
    slow = [piece(0, 20, 0.0), piece(60, 20, 120.0)]
    assert join_pieces(fast, LINKS, 240.0)[0] == [[0, 1]]
    assert join_pieces(slow, LINKS, 10.0)[0] == [[0], [1]]
    assert join_pieces(fast, LINKS, 30.0)[0] == [[0], [1]]
    assert join_pieces(slow, LINKS, 29.97) == join_pieces(slow, LINKS)
    assert join_pieces(slow, LINKS)[0] == [[0, 1]]


def test_who_is_who_is_found_again_at_another_rate(followed_dir, frames_dir, networks):
    frames = read_frames(frames_dir).with_rate(60.0)
    with pytest.raises(StaleOutput, match="rate_hz"):
        follow_people(frames, followed_dir, CONFIG, networks)


@pytest.mark.parametrize("looks", [{}, {"looks": 2}])
def test_a_folder_of_landmarks_of_a_former_version_is_stale(
    followed_dir, frames_dir, networks, tmp_path, looks
):
    """Of one look at each person, or half a pixel off."""
    former = tmp_path / "followed"
    shutil.copytree(followed_dir, former)
    record = read_json(former / STAGE_FILE)  # as versions before left it
    del record["config"]["landmarks"]
    record["config"] |= looks
    write_json(former / STAGE_FILE, record)
    with pytest.raises(StaleOutput, match="landmarks"):
        follow_people(read_frames(frames_dir), former, CONFIG, networks)


def test_a_track_is_cut_where_another_takes_over():
    taken = together(piece(0, 20, 0.0), piece(20, 15, 40.0, BLUE), piece(35, 20, 70.0))
    assert cuts_in(taken, LINKS) == [20, 35]
    assert cuts_in(piece(0, 20, 0.0), LINKS) == []
    assert cuts_in(piece(0, 1, 0.0), LINKS) == []


def test_place_size_and_time_count_with_the_colours():
    """Who turns in one place may change its colours; after a while, or elsewhere, it is unsure."""
    turned = like_red(0.31)
    assert cuts_in(together(piece(0, 20, 0.0), piece(20, 20, 40.0, turned)), LINKS) == [20]
    before, after = piece(0, 20, 0.0), piece(20, 20, 40.0, turned)
    assert join_pieces([before, after], LINKS)[0] == [[0, 1]]
    late = piece(75, 20, 240.0, like_red(0.4))
    assert join_pieces([before, late], LINKS)[0] == [[0], [1]]
    assert unsure_pairs([before, late], LINKS) == [(0, 1)]
    elsewhere = piece(20, 20, 240.0, turned)
    assert join_pieces([before, elsewhere], LINKS)[0] == [[0], [1]]
    assert unsure_pairs([before, elsewhere], LINKS) == [(0, 1)]


def test_a_slow_change_of_colours_is_cut_at_any_rate():
    """Over a fifth of a second; at 240 Hz it was never seen."""
    other = like_red(0.55)
    for n, rate_hz in ((1, 30.0), (8, 240.0)):
        share = np.linspace(0, 1, 6 * n + 2)[1:-1, None]
        fading = piece(20 * n, 6 * n, 40.0 * n, RED)
        fading = Piece(fading.rows, fading.crops, (1 - share) * RED + share * other)
        after = piece(26 * n, 20 * n, 52.0 * n, other)
        assert cuts_in(together(piece(0, 20 * n, 0.0), fading, after), LINKS, rate_hz) == [20 * n]


def test_speed_is_of_as_long_a_time_at_any_rate():
    """Four pixels too far in the last of 5 frames at 240 Hz led elsewhere after half a second."""
    before, after = piece(0, 60, 0.0), piece(180, 20, 360.0)
    before.crops[-1, 0] += 4
    assert join_pieces([before, after], LINKS, 240.0)[0] == [[0, 1]]


def sightings_of(*pieces: Piece) -> Sightings:
    """Sightings of pieces, in images that are numbered from 7 on, without what is not asked for."""
    both, n = together(*pieces), sum(map(len, pieces))
    numbers = np.repeat(np.arange(len(pieces)), [len(one) for one in pieces])
    zeros, points = np.zeros(n), np.zeros((n, 33, 3))
    return Sightings(
        7 + both.rows, zeros, numbers, both.crops, points[..., :2], points, points[..., 0], zeros,
        both.crops, both.crops, both.colours,
    )  # fmt: skip


def doubts_of(*pieces: Piece) -> tuple[str, ...]:
    """What is said of pieces who all are one person."""
    recipe = _FollowedAt(rate_hz=30.0)
    _, people, _ = _known_people(sightings_of(*pieces), np.arange(7, 207), recipe)
    assert len(people) == 1
    return record_of(people).doubts()


def record_of(people: tuple[PersonFacts, ...]) -> FollowedRecord:
    return FollowedRecord(size_px=(64, 48), images=(), detections=(), people=people, left_out=())


def test_pieces_that_may_be_of_two_are_said():
    """Who came 1.5 s after another was lost, nearby and in like clothes, was the same, unsaid."""
    first, late = piece(0, 20, 0.0), piece(65, 20, 150.0, like_red(0.35))
    assert doubts_of(first, piece(22, 20, 44.0)) == ()
    assert doubts_of(first, late) == (
        "person 0 may be another from image 72 on: it was found again, and place and "
        "colours don't make it sure",
    )


def test_three_frames_of_other_colours_are_nobody_at_a_high_rate():
    found = sightings_of(together(piece(0, 180, 0.0), piece(180, 3, 360.0, BLUE)))
    for rate_hz, left_out in ((30.0, (3,)), (240.0, ())):
        recipe = _FollowedAt(rate_hz=rate_hz)
        assert _known_people(found, np.arange(7, 207), recipe)[2] == left_out


def test_in_a_grey_video_people_are_known_by_how_bright_they_are():
    """All were alike: grey has neither hue nor saturation."""
    image = np.full((40, 60, 3), 200, np.uint8)
    image[:, :30] = 60
    left = np.zeros((40, 60), np.uint8)
    left[5:35, 5:25] = 255
    dark, bright = _colours(image, left), _colours(image, np.fliplr(left).copy())
    assert dark.shape == bright.shape == (32,) and dark.sum() == bright.sum() == 1
    assert not (dark * bright).any()
    image[..., 0] = 0  # yellow, in which light and shade are alike
    np.testing.assert_array_equal(_colours(image, left), _colours(image, np.fliplr(left).copy()))


def test_the_dancer_whose_colours_change_at_frame_357_is_one_person():
    """Numbers of the real dancer about that frame: the track is cut there, and joined again."""
    with np.load(Path(__file__).with_name("dancer_colours.npz")) as file:
        dancer = Piece(file["image_numbers"], file["crops"], file["colours"])
    assert [int(dancer.rows[at]) for at in cuts_in(dancer, LINKS)] == [357]
    at = int(np.flatnonzero(dancer.rows == 357)[0])
    assert join_pieces([dancer.part(0, at), dancer.part(at)], LINKS)[0] == [[0, 1]]


def test_who_is_seen_together_or_in_other_colours_is_surely_two():
    assert unsure_pairs([piece(0, 20, 0.0), piece(19, 20, 400.0)], LINKS) == []
    assert unsure_pairs([piece(0, 20, 0.0), piece(30, 20, 60.0, BLUE)], LINKS) == []
    assert unsure_pairs([piece(0, 20, 0.0), piece(300, 20, 60.0)], LINKS) == [(0, 1)]


def test_whose_hands_are_out_of_the_picture_is_said():
    """Their elbows and wrists were off by 160 to 350 mm, and nobody said so."""
    piece_of = piece(0, 10, 100.0)
    person = sightings_of(piece_of)
    at = {name: n for n, name in enumerate(LANDMARKS)}
    image_px = np.full((10, 33, 2), 50.0)
    image_px[:4, at["left_wrist"]] = (-5.0, 50.0)
    image_px[:2, at["right_ankle"]] = (50.0, 481.0)
    image_px[4:7, at["left_ankle"]] = (50.0, 481.0)
    people = [
        replace(person, image_px=np.full_like(image_px, 50.0)),
        replace(person, image_px=image_px),
    ]
    cut = (
        "person 1 is cut off by the picture: left hand in 4, left foot in 3 of 10 frames, "
        "where their pose is a guess"
    )
    # Here nothing is visible: the legs of the one whose feet are in the picture are hidden.
    hidden = "the legs of person 0 are hidden in 10 of 10 frames, where their pose is a guess"
    assert list(cut_off(people, (640, 480))) == [hidden, cut]
    seen = [replace(one, visibility=np.ones_like(one.visibility)) for one in people]
    assert list(cut_off(seen, (640, 480))) == [cut]


def test_a_crowd_who_may_all_be_one_is_said_in_a_line_each():
    """It was one for each pair: 400 for the 46 people of a film."""
    n = 30
    others = [(*range(number), *range(number + 1, n)) for number in range(n)]
    people = (PersonFacts(12, ((0, 11),), may_be, unsure_from=()) for may_be in others)
    said = record_of(tuple(people)).doubts()
    assert len(said) == n - 1 and max(map(len, said)) < 100
    never = "they are never seen in one frame"
    assert said[0] == f"person 1 may be person 0: {never}"
    assert said[2] == f"person 3 may be person 0 or 1 or 2: {never}"
    assert said[28] == f"person 29 may be one of 29 before it (followed.json has them): {never}"


N_RENDERED_FRAMES = 5


@pytest.fixture(scope="module")
def rendered(anny, tmp_path_factory) -> Path:
    """`frames` and exact `masks` of a dressed person of 150 px who walks through a room."""
    folder = tmp_path_factory.mktemp("rendered")
    rng = np.random.default_rng(3)
    film = Film(fps_hz=10, duration_s=N_RENDERED_FRAMES / 10, width_px=320, height_px=240)
    motion = film_motion(make_gait("walk", N_RENDERED_FRAMES / 10, 30.0, anny, rng), film)
    clip = plan_clip("walk", motion, Small(), film, rng)
    save_clip(folder / "clip.npz", clip, anny.rest_pelvis_m(motion.shape))
    room = RenderConfig(samples=1, scene=SceneConfig(kind="room", seed=3), image_format="png")
    files = folder / "clip.npz", ANNY_FILE, folder / "render"
    return render_clip(*files, room, on_frame=lambda frame: None)


@pytest.fixture
def masked(networks, tmp_path) -> Callable[..., np.ndarray]:
    """The masks (T, H, W) bool of a folder of frames, not widened."""

    def run(frames: Path, **settings: float) -> np.ndarray:
        files = {"model": networks.detector, "landmarks": networks.landmarks}
        source = PersonSource(dilate_px=0, **files, **settings)
        return read_masks(
            make_masks(read_frames(frames), tmp_path / "masks", MasksConfig(sources=(source,)))
        )

    return run


def read_masks(folder: Path) -> np.ndarray:
    return np.stack([read_gray(path) == 255 for path in sorted(folder.glob("*.png"))])


def iou_and_recall(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    common = (found & true).sum(axis=(1, 2))
    return common / (found | true).sum(axis=(1, 2)), common / true.sum(axis=(1, 2))


@pytest.mark.slow
def test_outlines_are_those_of_the_rendered_person(rendered, masked):
    iou, recall = iou_and_recall(masked(rendered / "frames"), read_masks(rendered / "masks"))
    assert len(iou) == N_RENDERED_FRAMES
    assert iou.mean() >= 0.85 and iou.min() >= 0.8
    assert recall.mean() >= 0.95 and recall.min() >= 0.9


@pytest.mark.slow
def test_whom_the_detector_sees_in_one_frame_is_followed_to_the_first_and_the_last(
    rendered, yolox_nano, masked, tmp_path
):
    """A second person, the first one's mirror image, stands on the right from frame 1 on."""
    (tmp_path / "frames").mkdir()
    detect = open_detector(yolox_nano, OnnxConfig(classes=("person",)))
    newcomers, scores = [], []
    for row, path in enumerate(sorted((rendered / "frames").glob("*.png"))):
        image = read_color(path)
        mirrored, mask = (np.fliplr(p) for p in (image, read_gray(rendered / "masks" / path.name)))
        moved = np.float32([[1, 0, 320 - mask.any(axis=0).argmax() - 66 - 8 * row], [0, 1, 0]])
        mirrored, mask = (cv2.warpAffine(p.copy(), moved, (320, 240)) for p in (mirrored, mask))
        newcomers.append((mask == 255) & (row > 0))
        image[newcomers[-1]] = mirrored[newcomers[-1]]
        cv2.imwrite(str(tmp_path / "frames" / path.name), image)
        found = detect(image)
        scores += found.scores[found.boxes_px[:, 0] > 200].tolist()
    assert sorted(scores)[-2] < max(scores)
    found = masked(tmp_path / "frames", min_detector_score=max(scores))
    assert not found[0, :, 200:].any()
    iou, recall = iou_and_recall(found[1:, :, 200:], np.array(newcomers)[1:, :, 200:])
    assert iou.mean() >= 0.8 and recall.mean() >= 0.85 and recall.min() >= 0.75


def test_nobody_gives_empty_masks_and_is_said(masked, noise_dir, capsys):
    found = masked(noise_dir)
    assert found.shape == (3, 48, 64) and not found.any()
    said = " ".join(capsys.readouterr().err.split())
    assert "nothing is masked in frame 00000, 00001, 00002 (3 of 3)" in said


def test_whom_the_landmark_network_does_not_see_gets_the_box(
    yolox_nano, shared_path, masked, tmp_path
):
    """No score reaches 1, so that nobody counts as seen."""
    (tmp_path / "frames").mkdir()
    detect = open_detector(yolox_nano, OnnxConfig(classes=("person",), weak_score=0.35))
    boxes = []
    for row, name in enumerate(("00001.jpg", "00003.jpg")):
        image = read_color(shared_path("video/static_people") / name)
        cv2.imwrite(str(tmp_path / "frames" / f"{row}.png"), image)
        boxes.append(fill_boxes(detect(image).boxes_px, image.shape[1::-1]) == 255)
    found = masked(tmp_path / "frames", min_score=1.0)
    np.testing.assert_array_equal(found, boxes)
    assert found.any(axis=(1, 2)).all()
