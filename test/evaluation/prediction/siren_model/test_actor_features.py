import numpy as np
import pytest
from made_records import Track, moving
from scenes import batch_of, lit

from siren_ros.evaluation.prediction.siren_model.actor_features import (
    NEIGHBOURS,
    POSITION_SCALE_M,
    SPEED_SCALE_MPS,
    choose_neighbours,
    neighbour_columns,
    target_columns,
)
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import Lights


def sample_of(batch, actor_id):
    return int(np.flatnonzero(batch.actors.actor_id[batch.target] == actor_id)[0])


def test_the_own_past_lies_behind(straight_road: RoadNetwork) -> None:
    batch = batch_of({1: moving(10.0, -5.0, 6.0, accel_mps2=0.5)}, straight_road)
    own = target_columns(batch)
    speed = 6.0 + 0.5 * 3.0
    assert own["vx-1"][0] * SPEED_SCALE_MPS == pytest.approx(speed)
    assert own["x-16"][0] * POSITION_SCALE_M == pytest.approx(-(6.0 * 3.0 + 0.25 * 9.0))
    assert own["x_gained_in3"][0] * SPEED_SCALE_MPS == pytest.approx(0.5)
    assert own["y-16"] == pytest.approx(0.0)


def test_emergency_vehicles_come_first_then_the_nearest(straight_road: RoadNetwork) -> None:
    tracks = {
        1: moving(100.0, -5.0, 0.0),
        2: moving(110.0, -5.0, 0.0),
        3: moving(105.0, -1.75, 0.0),
        4: moving(60.0, -5.0, 0.0, is_emv=True),
        5: moving(300.0, -5.0, 0.0),
    }
    batch = batch_of(tracks, straight_road)
    choice = choose_neighbours(batch)
    sample = sample_of(batch, 1)
    there = choice.there[sample]
    assert batch.actors.actor_id[choice.actor[sample, there]].tolist() == [4, 3, 2]
    seen = neighbour_columns(batch, choice)
    assert seen["is_emv"][sample, :4].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert seen["x"][sample, 0] * POSITION_SCALE_M == pytest.approx(-40.0)
    assert all((values[sample, ~there] == 0.0).all() for values in seen.values())


def test_the_nearest_are_kept_where_there_are_many(straight_road: RoadNetwork) -> None:
    tracks = {1 + number: moving(5.0 * number, -5.0, 0.0, steps=161) for number in range(NEIGHBOURS + 4)}
    batch = batch_of(tracks, straight_road)
    choice = choose_neighbours(batch)
    assert choice.there[sample_of(batch, 1)].all()
    assert batch.actors.actor_id[choice.actor[sample_of(batch, 1)]].tolist() == list(range(2, NEIGHBOURS + 2))


def test_siren_and_indicators_are_seen(straight_road: RoadNetwork) -> None:
    tracks = {1: moving(100.0, -5.0, 0.0), 2: moving(60.0, -5.0, 8.0, is_emv=True)}
    batch = lit(batch_of(tracks, straight_road), 2, Lights.SIREN | Lights.INDICATOR_LEFT)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    sample = sample_of(batch, 1)
    assert [seen[name][sample, 0] for name in ("siren", "beacon", "indicates_left", "brake")] == [1.0, 0.0, 1.0, 0.0]
    own = target_columns(batch)
    assert own["siren"].tolist() == (batch.actors.actor_id[batch.target] == 2).astype(float).tolist()


def test_bodies_are_told_in_tens_of_metres_and_pairs_of_metres(straight_road: RoadNetwork) -> None:
    batch = batch_of({1: moving(10.0, -5.0, 6.0, length_m=5.5), 2: moving(30.0, -5.0, 6.0, is_emv=True)}, straight_road)
    own = target_columns(batch)
    first, second = sample_of(batch, 1), sample_of(batch, 2)
    assert own["length"][[first, second]] == pytest.approx([0.55, 0.46])
    assert own["width"] == pytest.approx(0.9), "1.8 m"
    assert own["is_emv"][[first, second]].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("rate_radps", [0.3, -0.2])
def test_the_own_past_in_a_bend(straight_road: RoadNetwork, rate_radps: float) -> None:
    """At 6 m/s on a circle: each point of the past is where the circle was, seen from the present."""
    speed, heading = 6.0, 2.0 + rate_radps * STEP_S * np.arange(201)
    radius = speed / rate_radps
    place = 40.0 + radius * np.sin(heading), -30.0 - radius * np.cos(heading)
    states = np.stack((*place, speed * np.cos(heading), speed * np.sin(heading), heading), axis=1)
    own = target_columns(batch_of({1: Track(states)}, straight_road))
    for number in range(1, 16):
        turned = rate_radps * 0.2 * number
        at = -1 - number
        assert own[f"x{at}"][0] * POSITION_SCALE_M == pytest.approx(-radius * np.sin(turned))
        assert own[f"y{at}"][0] * POSITION_SCALE_M == pytest.approx(radius * (1.0 - np.cos(turned)))
        assert own[f"vx{at}"][0] * SPEED_SCALE_MPS == pytest.approx(speed * np.cos(turned))
        assert own[f"vy{at}"][0] * SPEED_SCALE_MPS == pytest.approx(-speed * np.sin(turned))
        if number % 2:
            assert own[f"turned{at}"][0] == pytest.approx(-turned)
    assert f"turned{-1}" not in own, "it is always 0"
    for points in (1, 3, 7):
        turned, time = rate_radps * 0.2 * points, 0.2 * points
        assert own[f"x_gained_in{points}"][0] * SPEED_SCALE_MPS == pytest.approx(speed * (1.0 - np.cos(turned)) / time)
        assert own[f"y_gained_in{points}"][0] * SPEED_SCALE_MPS == pytest.approx(speed * np.sin(turned) / time)


def test_a_neighbours_past_as_the_sample_sees_it(straight_road: RoadNetwork) -> None:
    """The sample drives at 4 m/s in the direction 2.0; the other one, seen for 1.5 s, gets faster in another one."""
    accel, first_mps, heading = 0.8, 5.0, 0.7
    tracks = {
        1: moving(40.0, -30.0, 4.0, yaw_rad=2.0),
        2: moving(55.0, -20.0, first_mps, accel, yaw_rad=heading, first_step=30),
    }
    batch = batch_of(tracks, straight_road)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    sample = sample_of(batch, 1)
    found = {name: float(values[sample, 0]) for name, values in seen.items()}

    def other(after_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Place and velocity of the other one, some time after it came, in the sample's axes at 3 s."""
        along = first_mps * after_s + 0.5 * accel * after_s**2
        place = np.array([55.0, -20.0]) + along * np.array([np.cos(heading), np.sin(heading)])
        own = np.array([40.0, -30.0]) + 12.0 * np.array([np.cos(2.0), np.sin(2.0)])
        turn = np.array([[np.cos(2.0), np.sin(2.0)], [-np.sin(2.0), np.cos(2.0)]])
        direction = np.array([np.cos(heading - 2.0), np.sin(heading - 2.0)])
        return turn @ (place - own), (first_mps + accel * after_s) * direction

    (place, velocity), (before, slower) = other(1.5), other(0.5)
    assert [found["x"], found["y"]] == pytest.approx(place / POSITION_SCALE_M)
    assert found["distance"] == pytest.approx(np.hypot(*place) / POSITION_SCALE_M)
    assert [found["cos"], found["sin"]] == pytest.approx([np.cos(heading - 2.0), np.sin(heading - 2.0)])
    assert [found["vx"], found["vy"]] == pytest.approx(velocity / SPEED_SCALE_MPS)
    assert found["closing_x"] == pytest.approx((velocity[0] - 4.0) / SPEED_SCALE_MPS)
    assert [found["moved_x-6"], found["moved_y-6"]] == pytest.approx((before - place) / POSITION_SCALE_M)
    assert found["gained_x-6"] == pytest.approx((velocity[0] - slower[0]) / SPEED_SCALE_MPS)
    assert [found[f"seen{at}"] for at in (-6, -11, -16)] == [1.0, 0.0, 0.0]
    assert all(found[f"{name}{at}"] == 0.0 for name in ("moved_x", "moved_y", "gained_x") for at in (-11, -16))


@pytest.mark.parametrize(("away_m", "shown"), [(79.9, True), (80.1, False)])
def test_neighbours_are_shown_up_to_eighty_metres(straight_road: RoadNetwork, away_m: float, *, shown: bool) -> None:
    turned = away_m * np.cos(2.5), away_m * np.sin(2.5)
    batch = batch_of({1: moving(100.0, -5.0, 0.0), 2: moving(100.0 + turned[0], -5.0 + turned[1], 0.0)}, straight_road)
    assert bool(choose_neighbours(batch).there[sample_of(batch, 1)].any()) is shown


def test_a_neighbours_heading_is_that_of_the_present(straight_road: RoadNetwork) -> None:
    """It turns on the spot by 0.2 rad/s from 0.7 on; the sample stands and looks in the direction 2.0."""
    heading = 0.7 + 0.2 * STEP_S * np.arange(201)
    spot = np.stack((np.full(201, 50.0), np.full(201, -20.0), *np.zeros((2, 201)), heading), axis=1)
    batch = batch_of({1: moving(40.0, -30.0, 0.0, yaw_rad=2.0), 2: Track(spot)}, straight_road)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    for frame in (0, 5):
        sample = int(np.flatnonzero(batch.actors.actor_id[batch.target] == 1)[frame])
        turned = 0.7 + 0.2 * (3.0 + 0.1 * frame) - 2.0
        assert [seen[name][sample, 0] for name in ("cos", "sin")] == pytest.approx([np.cos(turned), np.sin(turned)])
