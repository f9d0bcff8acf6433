"""Whole interactions in closed loop: EMV, civilians, vehicle model and a stand-in for SUMO."""

from pathlib import Path

import numpy as np
import pytest
from known_outputs import assert_known

from siren_ros.simulation.world.actors import ActorClass, Mode, Owner

AMBULANCE = ActorClass.AMBULANCE


def known(name, loop):
    assert_known(Path(__file__).parent / "known" / f"{name}.json", loop.told(), digits=5, decimals=2)


def continuous(loop, slack=0.05):
    """No actor moves by more than its speed allows, also when its owner changes."""
    for before, after in zip(loop.log, loop.log[1:], strict=False):
        for actor_id, pose in after.items():
            old = before[actor_id]
            assert np.hypot(pose[0] - old[0], pose[1] - old[1]) <= max(pose[3], old[3]) * 0.05 + slack


def test_s2_civilians_leave_the_lane_the_emv_passes_and_all_are_released(lab):
    cars = [lab.Car(1, 0, 10, 11, (0,), AMBULANCE)]
    cars += [lab.Car(2 + i, 0, 45 + 15 * i, 7, (0,), desired=7) for i in range(3)]
    loop = lab.Loop(lab.world_of(lab.straight_road(2, 900.0), lab.L2), cars).run(600)
    for kind in ("yield_started", "yield_completed", "yield_released"):
        assert sorted(event.actor_id for event in loop.of(kind)) == [2, 3, 4]
    emv = loop.log[-1][1]
    assert all(emv[0] > loop.log[-1][actor][0] + 10.0 for actor in (2, 3, 4))
    assert all(abs(row[1][1]) < 0.3 for row in loop.log)
    assert all(loop.owners.get(actor, Owner.SUMO) == Owner.SUMO for actor in (2, 3, 4))
    yielding = [pose[3] * 3.6 for row in loop.log for pose in row.values() if pose[5] == Mode.YIELD_LANE_CHANGE]
    asked_mps2, steps = loop.world.config.civilian_driver.lane_change.own_brake_mps2, len(yielding) / 3
    assert 25.2 - min(yielding) == pytest.approx(3.6 * asked_mps2 * 0.05 * steps, rel=0.1)
    assert 9.0 < min(yielding) < 16.0
    assert not loop.touching()
    continuous(loop)
    known("lane_cleared", loop)


def test_s1_the_corridor_stays_open_for_a_second_emv(lab):
    """It follows 4 s behind the first one. Nobody comes back between the two, and both pass without a stop."""
    cars = [lab.Car(1, 0, 50, 11, (0,), AMBULANCE), lab.Car(2, 0, 10, 11, (0,), AMBULANCE)]
    cars += [lab.Car(10 + i, 0, 90 + 9 * i, 2, (0,), desired=2) for i in range(4)]
    cars += [lab.Car(20 + i, 1, 93 + 9 * i, 2, (0,), desired=2) for i in range(4)]
    loop = lab.Loop(lab.world_of(lab.straight_road(2, 900.0), lab.L3), cars).run(520)
    held = {event.actor_id for event in loop.of("yield_held") if not event.detail["partial"]}
    assert held == {10, 11, 12, 13, 20, 21, 22, 23}
    assert {event.actor_id for event in loop.of("yield_released")} == held
    assert [event.kind.value for event in loop.events if event.actor_id == 1] == ["corridor_entered", "corridor_left"]
    for emv in (1, 2):
        assert max(abs(row[emv][1] - 1.65) for row in loop.log if 100.0 < row[emv][0] < 125.0) < 0.5
    for actor in held:
        back = [step for step, row in enumerate(loop.log) if row[actor][5] == Mode.REJOIN]
        first, second = (next(k for k, row in enumerate(loop.log) if row[emv][0] > row[actor][0]) for emv in (1, 2))
        assert first < second < back[0]
    assert min(row[2][3] for row in loop.log) > 1.0
    assert not loop.touching()
    continuous(loop)
    known("corridor", loop)


@pytest.mark.parametrize("later_m", [8.0, -8.0])
def test_l1_two_emvs_from_crossing_streets_do_not_meet(lab, junction, later_m):
    """Both run their red lights."""
    crossing = len(junction.lanes) - 1
    cars = [lab.Car(1, 0, 60, 13.9, (0, 2), AMBULANCE), lab.Car(5, crossing, 0.1 + 30 + later_m, 12, (5,), AMBULANCE)]
    loop = lab.Loop(lab.world_of(junction, lab.L1), cars).run(320)
    assert loop.log[-1][1][0] > 200.0
    assert not loop.touching()
    known(f"crossing_{later_m:g}", loop)


def test_l1_emv_runs_the_red_light_and_lets_a_crossing_vehicle_pass(lab, junction):
    crossing = len(junction.lanes) - 1
    free = lab.Loop(lab.world_of(junction, lab.L1), [lab.Car(1, 0, 60, 13.9, (0, 2), AMBULANCE)]).run(200)
    assert min(row[1][3] for row in free.log) > 13.0
    cars = [lab.Car(1, 0, 60, 13.9, (0, 2), AMBULANCE), lab.Car(5, crossing, 40, 8, (5,), desired=8)]
    loop = lab.Loop(lab.world_of(junction, lab.L1), cars).run(280)
    assert loop.log[-1][1][0] > 200.0
    assert not loop.touching()
    known("red_light", loop)


def test_l1_emv_changes_to_the_turning_lane_and_turns_right(lab):
    loop = lab.Loop(lab.world_of(lab.junction_road(), lab.L1), [lab.Car(1, 1, 20, 13.9, (0, 4), AMBULANCE)]).run(330)
    happened = [event.kind.value for event in loop.events]
    assert happened == ["lane_change_requested", "lane_change_started", "lane_change_completed"]
    poses = np.array([row[1][:3] for row in loop.log])
    assert abs(poses[-1, 0] - 160.0) < 0.3
    assert poses[-1, 2] == pytest.approx(-np.pi / 2.0, abs=0.02)
    on_turn = poses[(poses[:, 0] > 150.0) & (poses[:, 1] > -10.0)]
    radius = np.hypot(on_turn[:, 0] - 150.0, on_turn[:, 1] + 10.0)
    assert np.abs(radius - 10.0).max() < 0.5
    continuous(loop)
    known("turn", loop)
