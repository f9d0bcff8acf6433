import numpy as np
import pytest

from siren_ros.behaviour.civilians.release import emv_fully_passed, release_reason
from siren_ros.behaviour.civilians.unit import EmvView
from siren_ros.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def view_of(lab, cars, network=None):
    network = network or lab.straight_road()
    return lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars))


@pytest.mark.parametrize(("ahead", "passed"), [(6.62, False), (6.63, True), (-30.0, False)])
def test_passed_when_the_rear_is_a_metre_ahead_of_the_front(lab, ahead, passed):
    """Half of 6.5 m and half of 4.75 m and 1 m make 6.625 m between the centres."""
    view = view_of(lab, [lab.Car(1, 0, 100 + ahead, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))])
    assert emv_fully_passed(view, 1, 0) is passed


def test_passing_is_measured_along_the_civilians_lane(lab):
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 107, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    poses = np.array([[107.0, 0.0, 0.0, 8.0], [100.0, 3.3, 0.5, 2.0]])
    view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
    assert emv_fully_passed(view, 1, 0)


@pytest.mark.parametrize("turn", np.radians([30.0, 60.0, 140.0, -100.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "passed"),
    [
        (6.62, 3.3, 0.0, False),
        (6.63, 3.3, 0.0, True),
        (6.63, -3.3, 0.0, True),
        (0.0, 8.0, 0.0, False),
        (-6.7, 0.0, 0.0, False),
        (1.0 + 2.375 + 1.04, 5.0, np.pi / 2.0, False),
        (1.0 + 2.375 + 1.06, 5.0, -np.pi / 2.0, True),
    ],
)
def test_passing_on_a_road_that_points_elsewhere(lab, turn, ahead, left, yaw, passed):
    """On a road through the origin; the EMV is 6.5 m long and 2.1 m wide, the car 4.75 m long."""
    road = lab.RoadBuilder()
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    road.edge([[0.0, 0.0], 300.0 * along], 2, ("A", "B"))
    network = road.built()
    own, emv = 100.0 * along, (100.0 + ahead) * along + left * across
    poses = np.array([[*emv, turn + yaw, 8.0], [*own, turn + 0.2, 2.0]])
    cars = [lab.Car(1, 0, 100, 8, (0,), AMBULANCE), lab.Car(2, 0, 100, 2, (0,))]
    view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
    assert emv_fully_passed(view, 1, 0) is passed


@pytest.mark.parametrize(
    ("passed", "in_region", "reason"),
    [(False, True, ""), (True, True, "emv_passed"), (True, False, "emv_passed"), (False, False, "emv_gone")],
)
def test_released_when_the_emv_has_passed_or_is_gone(passed, in_region, reason):
    assert release_reason(EmvView(0, passed, in_region, on_path=True, on_road=True)) == reason
