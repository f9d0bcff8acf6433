"""Pictures of a step from above: as an observation, and for people."""

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")
pytest.importorskip("pygame", reason="the extra learn is not installed")

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from hand_made_record import NORTHBOUND, SOUTHBOUND, Driven, at_speed
from made_seat_state import state_of
from seen_on_crossing import NETWORK

from siren_ros.lab.learning.top_view import RASTER_SHAPE, RasterView, TopView, Window
from siren_ros.scoring.pictures.moving_birdseye import rgb_of
from siren_ros.scoring.pictures.plot_parts import colour_of
from siren_ros.simulation.world.actors import Lights, Mode

VIEW = RasterView(NETWORK)


def within(ahead, left, box: tuple[float, ...], margin_m: float) -> np.ndarray:
    """Whether points lie in a box (centre, yaw, length, width) that is larger by a margin."""
    x, y, yaw, length, width = box
    along = (ahead - x) * np.cos(yaw) + (left - y) * np.sin(yaw)
    across = (left - y) * np.cos(yaw) - (ahead - x) * np.sin(yaw)
    return (abs(along) < 0.5 * length + margin_m) & (abs(across) < 0.5 * width + margin_m)


def test_every_pixel_of_the_raster_shows_what_is_there() -> None:
    """The own vehicle at (5.25, -50) looks 0.3 rad to the left of north; pixels on the rim of a shape may be either."""
    others = {3: Driven(NORTHBOUND, at_speed(84.5, 10.0, 2)), 4: Driven(SOUTHBOUND, at_speed(175.5, 10.0, 2))}
    state = state_of(own_m=69.5, emv_m=49.5, others=others)
    sight = state.sight
    turned = np.where(sight.states.actor_id == 2, sight.states.yaw_rad + 0.3, sight.states.yaw_rad)
    picture = VIEW.draw(replace(state, sight=replace(sight, states=replace(sight.states, yaw_rad=turned))))
    assert (picture.shape, picture.dtype) == (RASTER_SHAPE, np.uint8)
    row, column = np.mgrid[:64, :64]
    ahead, left, yaw = 32.0 - row, 32.0 - column, 0.5 * np.pi + 0.3
    x, y = 5.25 + ahead * np.cos(yaw) - left * np.sin(yaw), -50.0 + ahead * np.sin(yaw) + left * np.cos(yaw)
    north = 0.5 * np.pi
    roads = [(4.75, -70.0, north, 100.0, 9.5), (-1.75, -70.0, north, 100.0, 3.5), (14.0, -70.0, north, 100.0, 3.5)]
    roads += [(70.0, -6.5, 0.0, 100.0, 6.0), (5.0, -5.0, north, 30.0, 30.0)]  # to the east, and the junction
    way = (5.25, 0.0, north, 100.0, 0.5)
    cars = [(5.25, -35.0, north, 4.0, 1.8), (-1.75, -66.0, north, 4.0, 1.8)]
    emv, own = (5.25, -70.0, north, 6.0, 2.1), (5.25, -50.0, yaw, 4.0, 1.8)
    shapes = (
        (0, [(box, 90) for box in roads] + [(way, 180)]),
        (1, [(box, 255) for box in cars]),
        (2, [(emv, 255), (own, 120)]),
    )
    for channel, boxes in shapes:
        expected, sure = np.zeros((64, 64)), np.ones((64, 64), np.bool_)
        for box, value in boxes:
            expected = np.where(within(x, y, box, 0.0), value, expected)
            sure &= within(x, y, box, -1.5) | ~within(x, y, box, 1.5)
        assert (picture[..., channel] == expected)[sure].all(), channel
        assert sure.sum() > 2500, channel
        for box, value in boxes[-2:]:
            assert (picture[..., channel][within(x, y, box, 0.5)] == value).sum() >= 3, (channel, value)


def test_the_view_for_people_follows_one_vehicle_and_stays_where_it_was_last() -> None:
    """5 pixels are a metre, north is up; a ring of 20 pixels is around the vehicle, or around its last place."""
    others = {3: Driven(NORTHBOUND, at_speed(79.5, 10.0, 2)), 4: Driven(SOUTHBOUND, at_speed(170.0, 10.0, 2))}
    sight, view, traffic = state_of(own_m=49.5, emv_m=29.5, others=others).sight, TopView(NETWORK), SimpleNamespace()
    traffic.signals = ()
    # Where the rear halves of the vehicles are: those of 1 to 3 are south of their centres, that of 4 is north of it.
    rears = {1: (5.25, -91.8), 2: (5.25, -71.2), 3: (5.25, -41.2), 4: (-1.75, -59.3)}
    for there, key, centre in (
        ({1, 2, 3, 4}, 2, (5.25, -70.0)),
        ({1, 3, 4}, 2, (5.25, -70.0)),
        ({2, 4}, 4, (-1.75, -60.5)),
    ):
        states = sight.states.select(np.isin(sight.states.actor_id, [*there]))
        picture = view.draw(SimpleNamespace(states=states, traffic=traffic), sight.bodies, key)
        assert (picture.shape, picture.dtype) == ((400, 640, 3), np.uint8)
        colours = {
            number: tuple(picture[round(200 - 5.0 * (y - centre[1])), round(320 + 5.0 * (x - centre[0]))].tolist())
            for number, (x, y) in rears.items()
        }
        paints = {number: rgb_of(colour_of(Mode.NOMINAL, is_emv=number == 1))[:3] for number in rears}
        assert {number: colours[number] for number in there} == {number: paints[number] for number in there}
        assert not any(colours[number] in paints.values() for number in set(rears) - there)
        ring = (picture == rgb_of("#1a86b8")[:3]).all(axis=-1).nonzero()
        assert [(int(axis.min()), int(axis.max())) for axis in ring] == [(180, 220), (300, 340)]


@pytest.mark.parametrize(("siren", "shown"), [(0, 180), (int(Lights.SIREN), 255)])
def test_an_emv_is_bright_by_its_own_siren_whoever_else_is_near(siren, shown) -> None:
    """The first EMV is too far away to be drawn; the siren of all others is as that of number 3 is not."""
    state = state_of(own_m=100.0, emv_m=20.0, others={3: Driven(NORTHBOUND, at_speed(80.0, 10.0, 2))})
    sight, number_3 = state.sight, state.sight.bodies[3]
    lights = np.where(sight.states.actor_id == 3, siren, int(Lights.SIREN) - siren).astype(np.uint8)
    bodies = {**sight.bodies, 3: replace(number_3, is_emv=True)}
    seen = replace(sight, bodies=bodies, states=replace(sight.states, lights=lights))
    assert VIEW.draw(replace(state, sight=seen))[52, 32, 2] == shown


def test_a_window_shows_a_picture_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    picture = np.random.default_rng(0).integers(0, 255, (40, 64, 3), dtype=np.uint8)
    window = Window("test")
    window.show(picture, 1000)
    import pygame

    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert (shown == picture).all()
    window.close()
    assert pygame.display.get_surface() is None
    window.close()
