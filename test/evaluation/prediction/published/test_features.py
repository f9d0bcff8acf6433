import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_records import Track, moving, record_with

from siren_ros.datasets.ngsim.conventions import FOOT_M
from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.published.features import (
    bat_features,
    csp_features,
    from_polar,
    polar,
    stdan_features,
)
from siren_ros.evaluation.prediction.published.ngsim_view import NgsimView, ngsim_view
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import ActorClass

TIMES_S = np.arange(-15, 1) * 0.2


def view_of(tracks: dict[int, Track], network: RoadNetwork) -> NgsimView:
    return ngsim_view(samples_of(record_with(tracks, network), HistoryWindow(), Population.ALL).batch)


@pytest.fixture
def pair(straight_road: RoadNetwork) -> NgsimView:
    """A car in the right lane, and a truck 6.096 m (20 feet) ahead in the left one, which accelerates."""
    return view_of(
        {
            1: moving(20.0, -5.25, 6.096),
            2: moving(26.096, -1.75, 3.048, accel_mps2=0.3048, actor_class=ActorClass.TRUCK),
        },
        straight_road,
    )


def test_csp_gets_feet_to_the_right_and_ahead(pair: NgsimView) -> None:
    found = csp_features(pair)
    assert found.own.dtype == np.float32
    assert found.own.shape == (16, len(pair), 2)
    assert found.own[:, 0] == pytest.approx(np.stack((np.zeros(16), 20.0 * TIMES_S), axis=1), abs=1e-4)
    # At the first present, 3 s into the record: 20 + 10 * 3 + 0.5 * 3² − 20 * 3 feet ahead.
    assert found.neighbours[-1, 0] == pytest.approx([-3.5 / FOOT_M, -5.5], abs=1e-4)


def test_stdan_gets_class_speed_and_acceleration_too(pair: NgsimView) -> None:
    found = stdan_features(pair)
    assert np.array_equal(found.own[..., :2], csp_features(pair).own)
    assert found.own[:, 0, 2:] == pytest.approx(np.tile([2.0, 20.0, 0.0], (16, 1)))
    truck = np.stack((np.full(16, 3.0), 10.0 + 3.0 + TIMES_S, np.ones(16)), axis=1)
    assert found.neighbours[:, 0, 2:] == pytest.approx(truck, abs=1e-5)


def test_bat_gets_polar_positions_displacements_and_lanes(pair: NgsimView) -> None:
    found = bat_features(pair)
    assert found.own[:, 0, 0] == pytest.approx(-20.0 * TIMES_S, abs=1e-4)
    assert found.own[:-1, 0, 1] == pytest.approx(-np.pi / 2, abs=1e-6)
    assert found.own[-1, 0, :2].tolist() == [0.0, 0.0]
    assert found.own[0, 0, 2:4].tolist() == [0.0, 0.0]
    assert found.own[1:, 0, 2:4] == pytest.approx(np.tile([0.0, 4.0], (15, 1)), abs=1e-4)
    assert np.array_equal(found.own[..., 4:7], stdan_features(pair).own[..., 2:])
    # Lanes are counted from the left.
    assert (found.own[:, 0, 7] == 2.0).all()
    assert (found.neighbours[:, 0, 7] == 1.0).all()


def test_lanes_of_the_past_are_those_of_then(straight_road: RoadNetwork) -> None:
    drift = moving(10.0, -5.25, 5.0)
    drift.states[:, 1] = np.where(np.arange(len(drift.states)) < 45, -5.25, -1.75)
    found = bat_features(view_of({1: drift}, straight_road))
    # The first present is step 60: the points before step 45 are in the right lane.
    assert found.own[:, 0, 7].tolist() == [2.0] * 12 + [1.0] * 4


def test_off_the_lanes_the_number_is_0(straight_road: RoadNetwork) -> None:
    assert (bat_features(view_of({1: moving(0.0, 500.0, 5.0)}, straight_road)).own[..., 7] == 0.0).all()


@given(yaw_rad=st.sampled_from([0.0, 0.7, 2.0, -2.0, np.pi, -np.pi / 2]))
def test_the_direction_of_one_who_stands_does_not_depend_on_the_heading(
    yaw_rad: float, straight_road: RoadNetwork
) -> None:
    found = bat_features(view_of({1: moving(3.0, 500.0, 0.0, yaw_rad=yaw_rad)}, straight_road))
    assert (found.own[..., :4] == 0.0).all()


@given(x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3))
def test_polar_there_and_back(x: float, y: float) -> None:
    assert from_polar(polar(np.array([x, y]))) == pytest.approx([x, y], abs=1e-9)
