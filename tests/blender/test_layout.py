"""The yard leaves room for the subject, the camera and the view; its solids are closed."""

import numpy as np
import pytest

from blender.places.courtyard import courtyard
from blender.places.layout import Thing, Yard, is_free, mesh_of
from gmrdata.film.programmes import Circular, Panning, Programme, camera_path
from tests.blender.coarse_pictures import coarse_pictures


def yard_for(programme: Programme, seed: int) -> tuple[Yard, np.ndarray, np.ndarray]:
    time_s = np.arange(20) / 4
    pelvis = np.c_[10 + 1.2 * time_s, np.sin(time_s), np.full(20, 0.93)]
    camera = camera_path(programme, pelvis, 4.0, 160, 90, 60.0, np.random.default_rng(seed))
    with coarse_pictures():
        yard = courtyard(pelvis, camera.centres_world_m, np.random.default_rng(seed))
    return yard, pelvis, camera.centres_world_m


@pytest.mark.parametrize("programme", [Circular(), Panning()], ids=["circular", "panning"])
def test_nothing_stands_in_the_way(programme: Programme) -> None:
    yard, pelvis, camera = yard_for(programme, seed=4)
    rng = np.random.default_rng(0)
    assert len(yard.things) > 40
    share = np.linspace(0, 1, 40)[:, None, None]
    sight = ((1 - share) * camera + share * (pelvis - [0, 0, 0.4])).reshape(-1, 3)
    for thing in yard.things:
        vertices_m = mesh_of(thing, rng).vertices_m
        low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
        for points, room_m in (
            (pelvis * [1, 1, 0] + [0, 0, 0.5], 0.3),
            (camera, 0.3),
            (sight, 0.0),
        ):
            inside = np.all((points > low - room_m) & (points < high + room_m), axis=1)
            assert not inside.any(), thing


def test_the_houses_stand_all_round() -> None:
    yard, pelvis, _ = yard_for(Panning(), seed=1)
    middle = pelvis.mean(axis=0)[:2]
    houses = [t for t in yard.things if t.solid == "box" and t.size_m[2] > 4]
    angles_rad = np.sort([np.arctan2(*(t.centre_m[:2] - middle)[::-1]) for t in houses])
    gaps_rad = np.diff(np.append(angles_rad, angles_rad[0] + 2 * np.pi))
    assert gaps_rad.max() < np.deg2rad(75)


def test_the_same_seed_gives_the_same_yard() -> None:
    one, two = yard_for(Circular(), 3)[0], yard_for(Circular(), 3)[0]
    assert one.ground.tobytes() == two.ground.tobytes()
    assert [t.centre_m.tolist() for t in one.things] == [t.centre_m.tolist() for t in two.things]
    other = yard_for(Circular(), 4)[0]
    assert one.ground.tobytes() != other.ground.tobytes()


def test_pictures_are_colours() -> None:
    yard = yard_for(Circular(), 8)[0]
    for picture in (yard.ground, yard.sky, *(t.picture for t in yard.things)):
        assert picture.dtype == np.float32 and picture.ndim == 3 and picture.shape[2] == 3
        assert np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1.0


@pytest.mark.parametrize("solid", ["box", "taper", "cylinder", "wheel", "blob"])
def test_solids_are_closed_and_face_outwards(solid: str) -> None:
    thing = Thing(
        solid,  # type: ignore[arg-type]
        np.array([3.0, -2.0, 1.0]),
        np.array([1.0, 1.5, 2.0]),
        0.7,
        np.zeros((4, 4, 3), np.float32),
        None,
    )
    mesh = mesh_of(thing, np.random.default_rng(0))
    corners = mesh.vertices_m[mesh.faces]
    a, b, c, d = np.moveaxis(corners, 1, 0)
    volume_m3 = (
        sum(
            np.einsum(
                "ij,ij->i", p - thing.centre_m, np.cross(q - thing.centre_m, r - thing.centre_m)
            )
            for p, q, r in ((a, b, c), (a, c, d))
        ).sum()
        / 6
    )
    round_m3 = 3.0 * np.pi / 4
    # A frustum's volume is the mean of foot, top and four middles, weighted as in Simpson's rule.
    taper_m3 = 3.0 * (1 + 4 * 0.83 * 0.92 + 0.66 * 0.84) / 6
    full_m3, rel = {
        "box": (3.0, 1e-9),
        "taper": (taper_m3, 1e-9),
        "cylinder": (round_m3, 0.02),
        "wheel": (round_m3, 0.02),
        "blob": (np.pi / 2, 0.5),
    }[solid]
    assert volume_m3 == pytest.approx(full_m3, rel=rel)
    assert mesh.uv.shape == (*mesh.faces.shape, 2)


def test_what_is_free() -> None:
    subject, camera = np.array([[0.0, 0.0]]), np.array([[6.0, 0.0]])
    assert is_free(np.array([3.0, 2.0]), 0.5, subject, camera)
    assert not is_free(np.array([3.0, 0.8]), 0.5, subject, camera)  # between them
    assert not is_free(np.array([-1.0, 0.0]), 0.5, subject, camera)  # at the subject
    assert not is_free(np.array([6.5, 1.0]), 0.5, subject, camera)  # at the camera
    assert is_free(np.array([-2.0, 0.0]), 0.5, subject, camera)  # behind the subject
