"""The result to turn round: it is drawn, moves with the frame, and needs nothing beside it."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.pages.gather import gather_video
from gmrdata.pages.view3d import (
    MOST_FRAMES,
    ViewedPerson,
    ViewedWorld,
    view_of,
    view_of_clip,
    write_view,
)
from gmrdata.values.clip import Clip
from gmrdata.values.errors import MissingInput
from tests.write.takes import HIDDEN, make_take


@pytest.fixture
def view(walk, small_body) -> ViewedWorld:
    """Two people, one with an error bar, the other not always there; a camera with a gap."""
    take = make_take(walk, small_body)
    clips = [
        Clip(one.name, one.motion, one.shown, np.arange(take.n_frames), take.camera)
        for one in take.people
    ]
    sigma_m = np.full((take.n_frames, 3), 0.1)
    people = (
        ViewedPerson(clips[0], "person", small_body, sigma_m),
        ViewedPerson(clips[1], "gmr", small_body),
    )
    points = np.random.default_rng(1).uniform(-3.0, 3.0, (500, 3))
    return ViewedWorld(np.arange(take.n_frames) / take.fps_hz, people, take.camera, points)


@pytest.mark.parametrize("width_px", [375, 1280])
def test_the_frame_moves_the_people(view, tmp_path, photograph, width_px):
    page = write_view(tmp_path / "view3d.html", view)
    first, visit = photograph(page, "0", width_px)
    again, _ = photograph(page, "0", width_px)
    last, _ = photograph(page, str(len(view.times_s) - 1), width_px)
    assert visit.complaints == [] and visit.requests == []
    np.testing.assert_array_equal(first, again)
    height_px = first.shape[0] - 60  # the slider and the frame's number stand below
    moved = (first[:height_px] != last[:height_px]).any(axis=2)
    assert 0.002 < moved.mean() < 0.5
    coloured = np.ptp(first[:height_px].astype(int), axis=2) > 60
    assert 0.002 < coloured.mean() < 0.5


def test_who_has_no_pose_is_not_drawn(view, tmp_path, photograph):
    alone = replace(view, people=view.people[1:], camera=None)
    page = write_view(tmp_path / "view3d.html", alone)

    def share_coloured(row: int) -> float:
        picture, _ = photograph(page, str(row), 500)
        return float((np.ptp(picture[:500].astype(int), axis=2) > 60).mean())

    assert share_coloured(HIDDEN[0]) < 0.5 * share_coloured(0)


def test_each_has_the_own_body_where_not_all_are_at_hand(finished):
    found = gather_video(finished)
    (one,), clip = found.people, found.clips[0]
    second = replace(clip, id="second")
    at_hand = replace(one, id="second", clip=second)
    shown = view_of(replace(found, clips={0: clip, 1: second}, people=(at_hand,))).people
    assert [person.body is not None for person in shown] == [False, True]


def test_long_sequences_stay_small(view, tmp_path):
    n_frames = 5000
    rows = np.arange(n_frames) % len(view.times_s)
    clips = [one.clip for one in view.people]
    people = [
        replace(one, clip=replace(clip, motion=clip.motion.take(rows), valid=clip.valid[rows]))
        for one, clip in zip(view.people, clips, strict=True)
    ]
    camera = view.camera.at_rows(rows) if view.camera else None
    sigma_m = np.full((n_frames, 3), 0.1)
    people = [replace(one, sigma_m=sigma_m) for one in people]
    points = np.zeros((300_000, 3))
    long = ViewedWorld(np.arange(n_frames) / 30.0, people, camera, points)
    assert len(long.rows) <= MOST_FRAMES
    assert write_view(tmp_path / "view3d.html", long).stat().st_size < 6e6


def test_points_stand_in_the_shown_world(finished):
    found = gather_video(finished)
    solved = found.reconstruction
    assert solved is not None and found.camera is not None and found.sfm_rows is not None
    # The reconstruction's own camera centres must come out as those of the world.
    centres = solved.cameras.path.world_from_cam[found.sfm_rows, :3, 3]
    view = view_of(replace(found, reconstruction=replace(solved, points=centres)))
    assert view.points is not None
    np.testing.assert_allclose(view.points, found.camera.centres_world_m, atol=1e-5)
    assert view.people[0].body is not None


def test_nothing_to_turn_round(finished):
    found = replace(gather_video(finished), camera=None, clips={})
    with pytest.raises(MissingInput, match="nothing to turn round"):
        view_of(found)


def test_a_recovered_clip_stands_beside_the_truth(report):
    clip = report.clips[0]
    true, recovered = view_of_clip(clip).people
    known = clip.has_camera
    apart_m = recovered.clip.motion.pelvis_m[known] - true.clip.motion.pelvis_m[known]
    assert np.linalg.norm(apart_m, axis=1).max() < 0.1
    camera = view_of_clip(clip).camera
    assert camera is not None and true.clip.camera is not None
    expected_m = true.clip.camera.centres_world_m[known]
    np.testing.assert_allclose(camera.centres_world_m[known], expected_m, atol=0.1)
