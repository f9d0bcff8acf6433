import numpy as np
import pytest
from made_records import moving
from scenes import batch_of

from siren_ros.evaluation.prediction.siren_model.features import features_and_names
from siren_ros.roads.road_network import RoadNetwork


def paths_of(tracks, network, of=1):
    batch = batch_of(tracks, network)
    features, names = features_and_names(batch)
    first = np.flatnonzero(batch.actors.frame[batch.target] == 0)
    sample = first[batch.actors.actor_id[batch.target[first]] == of][0]
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


@pytest.mark.parametrize(("aside_m", "there"), [(2.05, 1.0), (-2.05, 1.0), (2.15, 0.0), (-2.15, 0.0)])
def test_the_strip_is_as_wide_as_both_bodies_and_a_margin(
    straight_road: RoadNetwork, aside_m: float, there: float
) -> None:
    """Two halves of 1.8 m and 0.3 m."""
    found = paths_of({1: moving(60.0, -5.25, 0.0), 2: moving(75.0, -5.25 + aside_m, 0.0)}, straight_road)
    assert found["leader_there"][0] == there
    assert found["leader_gap"][0] == pytest.approx(0.154 - 0.05 if there else 1.0)


def test_the_second_leader_is_the_next_one(straight_road: RoadNetwork) -> None:
    found = paths_of(
        {
            1: moving(60.0, -5.25, 0.0),
            2: moving(76.0, -5.25, 3.0, length_m=9.0, is_emv=True),
            3: moving(70.0, -5.25, 0.0),
            4: moving(80.0, -9.0, 0.0),
        },
        straight_road,
    )
    assert [found[f"{name}_there"][0] for name in ("leader", "second")] == [1.0, 1.0]
    assert found["leader_gap"][0] * 100.0 == pytest.approx(10.0 - 4.6, abs=0.01)
    assert found["second_gap"][0] * 100.0 == pytest.approx(16.0 + 3.0 * 3.0 - 0.5 * (4.6 + 9.0), abs=0.01)
    assert [found[f"{name}_is_emv"][0] for name in ("leader", "second")] == [0.0, 1.0]
    assert [found[f"{name}_speed"][0] for name in ("leader", "second")] == pytest.approx([0.0, 0.3])


@pytest.mark.parametrize(("length_m", "gap_m"), [(4.6, 1.0 - 4.6), (12.0, -5.0)])
def test_gaps_of_overlapping_bodies_end_at_five_metres(
    straight_road: RoadNetwork, length_m: float, gap_m: float
) -> None:
    tracks = {key: moving(x_m, -5.25, 0.0, length_m=length_m) for key, x_m in ((1, 60.0), (2, 61.0))}
    assert paths_of(tracks, straight_road)["leader_gap"][0] * 100.0 == pytest.approx(gap_m)


def test_one_leader_is_not_the_second_too(straight_road: RoadNetwork) -> None:
    """The leader is the first of all vehicles; it gets faster, and its speed is that of the present."""
    found = paths_of({1: moving(80.0, -5.25, 2.0, accel_mps2=0.5), 2: moving(60.0, -5.25, 0.0)}, straight_road, of=2)
    assert [found[f"{name}_there"][0] for name in ("leader", "second")] == [1.0, 0.0]
    assert found["leader_speed"][0] * 10.0 == pytest.approx(2.0 + 0.5 * 3.0)
    assert found["second_gap"][0] == 1.0


@pytest.mark.parametrize(("ahead_m", "there"), [(-0.3, 0.0), (0.3, 1.0)])
def test_a_vehicle_next_to_the_own_one_leads_where_its_centre_is_ahead(
    straight_road: RoadNetwork, ahead_m: float, there: float
) -> None:
    found = paths_of({1: moving(60.0, -5.25, 0.0), 2: moving(60.0 + ahead_m, -4.0, 0.0)}, straight_road)
    assert found["leader_there"][0] == there
