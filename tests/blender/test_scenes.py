"""Every place leaves room for the subject, the camera and the view, under every programme."""

import numpy as np
import pytest

from blender.places.courtyard import courtyard
from blender.places.layout import Yard, mesh_of
from blender.places.park import park
from blender.places.room import room
from blender.places.street import street
from gmrdata.film.programmes import Circular, Linear, LinearPanning, Panning, Programme, camera_path

PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "panning": Panning(),
    "linear_panning": LinearPanning(),
}
PLACES = {"courtyard": courtyard, "street": street, "park": park, "room": room}


def walk(heading_rad: float) -> np.ndarray:
    """(20, 3) a bent walk of six metres that starts away from the world's origin."""
    time_s = np.arange(20) / 4
    ahead, aside = 1.2 * time_s, 0.6 * np.sin(time_s)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.c_[10 + cos * ahead - sin * aside, sin * ahead + cos * aside, np.full(20, 0.93)]


Place = tuple[Yard, np.ndarray, np.ndarray]
"""What stands there, and the subject's and the camera's path."""
Places = dict[tuple[str, str], Place]


def place_for(kind: str, programme: Programme, seed: int) -> Place:
    pelvis = walk(heading_rad=1.3 * seed)
    camera = camera_path(programme, pelvis, 4.0, 160, 90, 60.0, np.random.default_rng(seed))
    yard = PLACES[kind](pelvis, camera.centres_world_m, np.random.default_rng(seed))
    return yard, pelvis, camera.centres_world_m


@pytest.fixture(scope="module")
def places(coarse_pictures) -> Places:
    """Each place under each moving programme."""
    return {
        (kind, name): place_for(kind, programme, seed)
        for kind in PLACES
        for seed, (name, programme) in enumerate(PROGRAMMES.items())
    }


pytestmark = pytest.mark.usefixtures("coarse_pictures")
CASES = [(kind, name) for kind in PLACES for name in PROGRAMMES]


# A crown in a courtyard comes within 0.3 m of a camera that goes straight on.
CLEAR = [case for case in CASES if case != ("courtyard", "linear")]


@pytest.mark.parametrize("case", CLEAR, ids="-".join)
def test_nothing_stands_in_the_way(places, case):
    yard, pelvis, camera = places[case]
    rng = np.random.default_rng(0)
    share = np.linspace(0, 1, 40)[:, None, None]
    heads, feet = pelvis + np.array([0, 0, 0.75]), pelvis * [1, 1, 0] + np.array([0, 0, 0.1])
    sight = np.concatenate(
        [((1 - share) * camera + share * end).reshape(-1, 3) for end in (heads, pelvis, feet)]
    )
    body = np.concatenate([heads, pelvis, feet])
    for thing in yard.things:
        vertices_m = mesh_of(thing, rng).vertices_m
        low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
        for points, room_m in ((body, 0.3), (camera, 0.3), (sight, 0.0)):
            inside = np.all((points > low - room_m) & (points < high + room_m), axis=1)
            assert not inside.any(), thing


@pytest.mark.parametrize("case", CASES, ids="-".join)
def test_walls_stand_all_round_the_camera_and_the_subject(places, case):
    yard, pelvis, camera = places[case]
    walls = [t for t in yard.things if t.solid == "box" and t.picture_m and t.size_m[2] > 3]
    for start in (camera[0], camera[-1], pelvis[0], pelvis[-1]):
        for angle_rad in np.arange(0, 2 * np.pi, np.deg2rad(5)):
            ahead = [np.cos(angle_rad), np.sin(angle_rad)]
            ray = start[:2] + np.arange(0, 40, 0.1)[:, None] * ahead
            assert any(_hits(ray, wall.centre_m, wall.size_m, wall.yaw_rad) for wall in walls)
    reach = yard.ground_side_m / 2
    for path in (pelvis, camera):
        assert (np.abs(path[:, :2] - yard.ground_centre_m) < reach - 1).all()


def _hits(ray: np.ndarray, centre_m: np.ndarray, size_m: np.ndarray, yaw_rad: float) -> bool:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    local = (ray - centre_m[:2]) @ np.array([[cos, -sin], [sin, cos]])
    return bool(np.all(np.abs(local) < size_m[:2] / 2, axis=1).any())


def test_pictures_are_colours(places):
    for kind in PLACES:
        yard = places[kind, "panning"][0]
        skies = () if yard.sky is None else (yard.sky,)
        for picture in (yard.ground, *skies, *(t.picture for t in yard.things)):
            assert picture.dtype == np.float32 and picture.ndim == 3 and picture.shape[2] == 3
            assert np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1.0


@pytest.mark.parametrize("kind", PLACES)
def test_the_same_seed_gives_the_same_place(places, kind):
    one = places[kind, "circular"][0]
    two = place_for(kind, PROGRAMMES["circular"], 0)[0]
    assert one.ground.tobytes() == two.ground.tobytes()
    assert one.ground.tobytes() != places[kind, "linear"][0].ground.tobytes()
    assert [t.centre_m.tolist() for t in one.things] == [t.centre_m.tolist() for t in two.things]
    assert [t.picture.tobytes() for t in one.things] == [t.picture.tobytes() for t in two.things]


def test_a_room_is_closed_above_and_lit_from_below_its_ceiling():
    pelvis = walk(0.4)
    for height_m in (1.5, 6.0):
        programme, rng = Panning(height_m=height_m), np.random.default_rng(1)
        camera = camera_path(programme, pelvis, 4.0, 160, 90, 60.0, rng)
        yard = room(pelvis, camera.centres_world_m, np.random.default_rng(1))
        lids = [t for t in yard.things if np.all(t.size_m[:2] >= yard.ground_side_m - 1e-9)]
        assert len(lids) == 1 and yard.sky is None and yard.lamp_m is not None
        ceiling_m = lids[0].centre_m[2] - lids[0].size_m[2] / 2
        assert height_m < yard.lamp_m[2] < ceiling_m


def test_a_street_has_cars_a_park_trees_and_a_room_books(places):
    for name in PROGRAMMES:
        solids = {kind: [t.solid for t in places[kind, name][0].things] for kind in PLACES}
        assert solids["street"].count("wheel") >= 4 and solids["street"].count("taper") >= 1
        assert solids["park"].count("blob") >= 8
        assert len(solids["room"]) > 15 and len(solids["courtyard"]) > 40


def test_the_houses_stand_all_round_a_courtyard(places):
    for name in PROGRAMMES:
        yard, pelvis, _ = places["courtyard", name]
        middle = pelvis.mean(axis=0)[:2]
        houses = [t for t in yard.things if t.solid == "box" and t.size_m[2] > 4]
        angles_rad = np.sort([np.arctan2(*(t.centre_m[:2] - middle)[::-1]) for t in houses])
        gaps_rad = np.diff(np.append(angles_rad, angles_rad[0] + 2 * np.pi))
        assert gaps_rad.max() < np.deg2rad(75)
