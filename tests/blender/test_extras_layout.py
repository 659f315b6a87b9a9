"""A place leaves the extras their ways and closes round them; without them it is as it was."""

import numpy as np
import pytest

from blender.places.courtyard import courtyard
from blender.places.layout import Yard, mesh_of, with_ways
from blender.places.park import park
from blender.places.room import room
from blender.places.street import PAVEMENT_M, street
from gmrdata.film.programmes import Circular, Film, Panning, Programme, film_motion, plan_clip
from gmrdata.film.scene import Cast, Extras, make_cast
from gmrdata.film.walkers import CAR_SIZE_M
from gmrdata.motion.gait import make_gait
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of

pytestmark = pytest.mark.usefixtures("coarse_pictures")

PLACES = {"courtyard": courtyard, "street": street, "park": park, "room": room}
CASES: list[tuple[str, Programme]] = [
    ("courtyard", Circular()),
    ("street", Circular()),
    ("park", Panning()),
    ("room", Panning()),
]


def filmed(body: BodyModel, programme: Programme, seed: int) -> Clip:
    rng = np.random.default_rng(seed)
    motion = film_motion(make_gait("walk", 4.0, 10.0, body, rng), Film(fps_hz=10))
    return plan_clip("clip", motion, programme, Film(), rng)


def yard_of(kind: str, clip: Clip, ways_m: np.ndarray) -> Yard:
    paths = clip.motion.pelvis_m, camera_of(clip).centres_world_m
    return PLACES[kind](*with_ways(*paths, ways_m), np.random.default_rng(3))


def cast_of(kind: str, clip: Clip, body: BodyModel) -> Cast:
    cars = 0 if kind == "room" else 1
    return make_cast(Extras(company=1, passers_by=2, cars=cars), [clip], body, 5)


def what_stands(yard: Yard) -> list[list[float]]:
    return [[*t.centre_m, *t.size_m, t.yaw_rad, float(t.picture.mean())] for t in yard.things]


@pytest.mark.parametrize(("kind", "programme"), CASES, ids=lambda case: getattr(case, "kind", case))
def test_nothing_stands_in_the_extras_ways(small_body, kind, programme):
    clip = filmed(small_body, programme, seed=6)
    cast = cast_of(kind, clip, small_body)
    yard = yard_of(kind, clip, cast.ground_m)
    walks = [
        np.concatenate([walker.pelvis_m[:, :2] for walker in cast.walkers]),
        *(car.world_from_car[:, :2, 3] for car in cast.cars),
    ]
    rooms_m = [np.array([0.4, 0.4])]
    for car in cast.cars:
        half_m = CAR_SIZE_M[:2] / 2 + 0.05
        rooms_m.append(half_m if abs(car.ahead[0]) > 0.5 else half_m[::-1])
    for thing in yard.things:
        vertices_m = mesh_of(thing, np.random.default_rng(0)).vertices_m
        low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
        if low[2] > 1.2:
            continue  # a crown or a lantern; people pass below its edge
        for path_m, room_m in zip(walks, rooms_m, strict=True):
            inside = (path_m > low[:2] - room_m) & (path_m < high[:2] + room_m)
            assert not inside.all(axis=1).any(), thing
    side_m = yard.ground_side_m / 2
    for path_m, room_m in zip(walks, rooms_m, strict=True):
        assert (np.abs(path_m - yard.ground_centre_m) + room_m < side_m).all()


def test_a_car_keeps_to_the_road(small_body):
    for seed in range(2):
        clip = filmed(small_body, Circular(), seed)
        cast = cast_of("street", clip, small_body)
        yard = yard_of("street", clip, cast.ground_m)
        parked = [thing for thing in yard.things if thing.solid == "taper"]
        car = cast.cars[0]
        along = int(abs(car.ahead[1]) > 0.5)
        # Houses stand 3 m beyond all ways, and the pavement is narrower than that.
        low, high = cast.ground_m[:, :2].min(axis=0), cast.ground_m[:, :2].max(axis=0)
        assert (high - low)[along] > (high - low)[1 - along]
        for thing in parked:  # along the same road
            assert abs(np.sin(thing.yaw_rad - along * np.pi / 2)) < 1e-9
            gap_m = np.abs(car.world_from_car[:, :2, 3] - thing.centre_m[:2])[:, 1 - along]
            assert (gap_m > CAR_SIZE_M[1]).all()
        assert PAVEMENT_M + CAR_SIZE_M[1] / 2 < 3.0 + 0.5


@pytest.mark.parametrize("kind", ["courtyard", "room"])
def test_who_is_in_nobodys_way_changes_nothing(small_body, kind):
    """A place depends on the extras only through its size and through what has to give way."""
    clip = filmed(small_body, Panning(), seed=2)
    bare = yard_of(kind, clip, np.empty((0, 3)))
    company_m = clip.motion.pelvis_m * [0.999, 0.999, 1.0]
    assert what_stands(yard_of(kind, clip, company_m)) == what_stands(bare)
    far_m = clip.motion.pelvis_m + np.array([20.0, 0.0, 0.0])
    assert what_stands(yard_of(kind, clip, far_m)) != what_stands(bare)
