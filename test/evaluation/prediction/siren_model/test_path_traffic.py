import numpy as np
import pytest
from made_records import moving
from scenes import batch_of

from siren_ros.evaluation.prediction.siren_model.features import features_and_names
from siren_ros.roads.road_network import RoadNetwork


def paths_of(tracks, network):
    batch = batch_of(tracks, network)
    features, names = features_and_names(batch)
    first = np.flatnonzero(batch.actors.frame[batch.target] == 0)
    sample = first[batch.actors.actor_id[batch.target[first]] == 1][0]
    return dict(zip(names.paths, features.paths[sample].T, strict=True))


def test_leaders_are_those_in_the_strip_of_each_path(crossroads: RoadNetwork) -> None:
    found = paths_of(
        {1: moving(-34.0, 0.0, 8.0), 2: moving(30.0, 0.0, 0.0), 3: moving(20.0, 40.0, 0.0, yaw_rad=np.pi / 2)},
        crossroads,
    )
    # The sample stands at x = −10 after 3 s; paths: straight on, left, right.
    assert found["leader_there"].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert found["leader_gap"][0] * 100.0 == pytest.approx(40.0 - 4.6, abs=0.01)
    along_left = 10.0 + np.hypot(14.0, 6.0) + np.hypot(6.0, 14.0) + 20.0
    assert found["leader_gap"][1] * 100.0 == pytest.approx(along_left - 4.6, abs=0.5)
    assert found["leader_gap"][2] == 1.0
    assert (found["second_there"] == 0.0).all()


def test_vehicles_behind_and_on_other_lanes_are_no_leaders(straight_road: RoadNetwork) -> None:
    found = paths_of(
        {
            1: moving(60.0, -5.25, 5.0),
            2: moving(40.0, -5.25, 5.0),
            3: moving(80.0, -1.75, 5.0),
            4: moving(95.0, -5.25, 7.0, is_emv=True),
            5: moving(110.0, -5.25, 2.0),
        },
        straight_road,
    )
    assert found["leader_gap"][0] * 100.0 == pytest.approx(35.0 + 3.0 * 2.0 - 4.6, abs=0.01)
    assert found["leader_speed"][0] * 10.0 == pytest.approx(7.0)
    assert found["leader_is_emv"][0] == 1.0
    assert found["second_speed"][0] * 10.0 == pytest.approx(2.0)
