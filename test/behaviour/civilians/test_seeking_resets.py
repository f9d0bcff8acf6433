"""What is reset between the turns of seeking a gap, and where lane changes have room."""

from dataclasses import replace

import pytest

from siren_ros.behaviour.civilians.yield_lane_change import Seek, seek_gap
from siren_ros.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.behaviour.driving.civilian_unit import Compliance, Driver, YieldUnit
from siren_ros.behaviour.driving.lane_change import LaneChangeQuery, Refusal, assess
from siren_ros.behaviour.paths.lane_path import LanePath
from siren_ros.world.actors import ActorClass, Mode

AMBULANCE = ActorClass.AMBULANCE


def test_between_two_turns_of_seeking_nothing_of_the_first_is_left(lab):
    world = lab.world_of(lab.straight_road(2, 900.0), lab.L2)
    config = world.config.yielding
    state, found = YieldState.initial(), {}
    for step in range(round((config.seek_after_s + config.seek_for_s + 0.5) / 0.05)):
        x = 100.0 + 0.25 * step
        cars = [lab.Car(1, 0, x - 30.0, 5, (0,), AMBULANCE)]
        cars += [lab.Car(2, 0, x, 5, (0,)), lab.Car(3, 1, x, 5, (0,))]
        state, _ = step_yield(state, lab.traffic_of(world.network, cars, step=step, spawn=step == 0), world)
        found[step] = state.units[2]
    before, during, after = found[5], found[60], found[max(found)]
    assert (before.seek, before.navigator.path) == (0, None)
    assert during.seek != 0
    assert during.navigator.path is not None
    assert (after.seek, after.navigator.path) == (0, None)
    assert {unit.deferred_step for unit in found.values()} == {0}
    assert {unit.side for unit in found.values()} == {1}


def seeking(lab, step, deferred_step, seek):
    """One step of a driver with a vehicle close behind in the next lane, which is no reason to fall back."""
    network = lab.straight_road(2, 900.0)
    cars = [lab.Car(2, 0, 100, 6, (0,)), lab.Car(3, 1, 92, 7, (0,))]
    view = lab.view(network, lab.L2, cars, step=step)
    unit = YieldUnit(
        2, 1, Driver(Compliance.COMPLIES, 0.0, 40.0), 0, Mode.YIELD_DEFERRED, side=1, deferred_step=deferred_step
    )
    return seek_gap(replace(unit, seek=seek), view.ego(0), Refusal.GAP_REAR), view


@pytest.mark.parametrize(("step", "again"), [(36, False), (37, True), (38, False), (67, True)])
def test_the_driver_thinks_again_each_one_and_a_half_seconds_from_the_deferral_on(lab, step, again):
    """Deferred at step 7: 30 steps later, and 30 later again."""
    outcome, _ = seeking(lab, step, 7, Seek.FALL_BACK)
    assert outcome.unit.seek == (Seek.DRAW_AHEAD if again else Seek.FALL_BACK)


def test_the_path_of_a_driver_who_seeks_a_gap_ends_with_a_stop(lab):
    outcome, view = seeking(lab, 8, 7, Seek.NOT)
    path = outcome.unit.navigator.path
    assert path.speed_cap_mps(path.length_m) < 0.1
    assert path.curve.points[0, 0] == pytest.approx(98.0)
    assert path.length_m == pytest.approx(80.0 - float(view.seen.half_length_m[0]) - 1.0)


@pytest.mark.parametrize(("spare", "verdict"), [(0.3, LanePath), (-0.3, Refusal)])
def test_a_lane_change_ends_with_the_front_before_the_junction(lab, spare, verdict):
    network = lab.junction_road()

    def view_at(s):
        return lab.view(network, lab.L2, [lab.Car(2, 0, s, 8, (0, 2))])

    def query(view):
        return LaneChangeQuery(view.ego(0), 0, 1, 8.0, civilian=True)

    far = view_at(50.0)
    s = 150.0 - float(far.seen.half_length_m[0]) - query(far).length_m - spare
    view = view_at(s)
    assert isinstance(assess(query(view)), verdict)
