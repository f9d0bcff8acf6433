import numpy as np
import pytest
from made_records import moving
from scenes import batch_of, lit

from siren_ros.evaluation.prediction.siren_model.actor_features import (
    NEIGHBOURS,
    POSITION_SCALE_M,
    SPEED_SCALE_MPS,
    choose_neighbours,
    neighbour_columns,
    target_columns,
)
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
