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


@pytest.mark.parametrize(
    ("passed", "in_region", "reason"),
    [(False, True, ""), (True, True, "emv_passed"), (True, False, "emv_passed"), (False, False, "emv_gone")],
)
def test_released_when_the_emv_has_passed_or_is_gone(passed, in_region, reason):
    assert release_reason(EmvView(0, passed, in_region, on_path=True, on_road=True)) == reason
