"""Pictures of a step from above: as an observation, and for people."""

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")
pytest.importorskip("pygame", reason="the extra learn is not installed")

from dataclasses import replace

import numpy as np
from hand_made_record import NORTHBOUND, SOUTHBOUND, Driven, at_speed
from made_seat_state import state_of
from seen_on_crossing import NETWORK

from siren_ros.lab.learning.top_view import RASTER_SHAPE, RasterView, Window
from siren_ros.simulation.world.actors import Lights

VIEW = RasterView(NETWORK)


def test_the_own_heading_is_up_and_the_emv_behind_is_below() -> None:
    picture = VIEW.draw(state_of(own_m=50.0, emv_m=30.0))
    assert picture.shape == RASTER_SHAPE
    assert picture.dtype == np.uint8
    assert picture[32, 32, 2] == 120
    assert picture[52, 32, 2] == 255
    assert picture[12, 32, 2] == 0
    assert (picture[:, :, 1] == 0).all()
    assert picture[20, 32, 0] == 180, "the way ahead"
    assert picture[45, 32, 0] == 90, "the way behind is road"
    assert picture[20, 35, 0] == 90, "the shoulder"
    assert picture[20, 5, 0] == 0, "27 m to the left there is no road"


def test_others_are_where_they_are() -> None:
    others = {3: Driven(NORTHBOUND, at_speed(70.0, 10.0, 2)), 4: Driven(SOUTHBOUND, at_speed(170.0, 10.0, 2))}
    picture = VIEW.draw(state_of(others=others))
    assert picture[12, 32, 1] == 255
    assert picture[22, 25, 1] == 255
    assert picture[22, 39, 1] == 0


@pytest.mark.parametrize(("siren", "shown"), [(0, 180), (int(Lights.SIREN), 255)])
def test_an_emv_is_bright_by_its_own_siren_whoever_else_is_near(siren, shown) -> None:
    """The first EMV is too far away to be drawn; the siren of all others is as that of number 3 is not."""
    state = state_of(own_m=100.0, emv_m=20.0, others={3: Driven(NORTHBOUND, at_speed(80.0, 10.0, 2))})
    sight, number_3 = state.sight, state.sight.bodies[3]
    lights = np.where(sight.states.actor_id == 3, siren, int(Lights.SIREN) - siren).astype(np.uint8)
    bodies = {**sight.bodies, 3: replace(number_3, is_emv=True)}
    seen = replace(sight, bodies=bodies, states=replace(sight.states, lights=lights))
    assert VIEW.draw(replace(state, sight=seen))[52, 32, 2] == shown


def test_the_picture_turns_with_the_own_heading() -> None:
    state = state_of(own_m=50.0, emv_m=30.0)
    yaw = state.sight.states.yaw_rad + np.array([0.0, np.pi / 2.0])
    states = replace(state.sight.states, yaw_rad=yaw)
    turned = VIEW.draw(replace(state, sight=replace(state.sight, states=states)))
    # The own vehicle now looks west: the EMV, to the south, is on its left.
    assert turned[32, 12, 2] == 255
    assert turned[52, 32, 2] == 0
    assert turned[32, 20, 0] == 90, "the road to the south is on its left"


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
