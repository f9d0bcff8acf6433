"""Civilians at L3 who pull over, and a cyclist or motorcyclist who comes up on that side."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour import lab
from behaviour.civilians.civilian_steps import UNIT

from siren_ros.simulation.behaviour.civilians.pull_over import pull_over_path, rider_comes_up, start_pull_over
from siren_ros.simulation.world.actors import ActorClass, Mode

CAR, RIDER = 2, 3
RIDERS = (ActorClass.BICYCLE, ActorClass.MOTORCYCLE)
HALF_WIDTH_M = 0.5 * lab.vehicles[ActorClass.SEDAN].width_m


def lengths_m(kind):
    return 0.5 * (lab.vehicles[ActorClass.SEDAN].length_m + lab.vehicles[kind].length_m)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("turn", np.radians([0.0, 130.0]))
@pytest.mark.parametrize("kind", [*RIDERS, ActorClass.HATCHBACK])
@pytest.mark.parametrize(
    ("beyond_m", "gap_m", "speed_mps", "turned_deg", "waits"),
    [
        (0.1, 1.4, 3.5, 0.0, True),
        (0.1, 1.6, 3.5, 0.0, False),
        (0.1, -1.0, 1.0, 0.0, True),
        (0.1, 0.1, 2.9, 0.0, False),
        (0.1, -30.0, 3.5, 0.0, False),
        (0.69, 0.5, 3.5, 0.0, True),
        (0.71, 0.5, 3.5, 0.0, False),
        (-1.0, 0.5, 3.5, 0.0, False),
        (0.1, 0.5, 3.5, 180.0, False),
    ],
)
def test_riders_count_who_are_beside_or_come_up_on_the_side_of_the_move(
    side, turn, kind, beyond_m, gap_m, speed_mps, turned_deg, waits
):
    """The car, at 3 m/s, moves 0.4 m to a side; the rider's flank is ``beyond_m`` from its own, behind its rear."""
    network, along, across = lab.turned_road(turn)
    cars = [lab.Car(CAR, 0, 100, 5, (0,)), lab.Car(RIDER, 0, 90, 5, (0,), kind)]
    aside_m = side * (HALF_WIDTH_M + beyond_m + 0.5 * lab.vehicles[kind].width_m)
    point = 100.0 * along - (lengths_m(kind) + gap_m) * along + aside_m * across
    poses = np.array([[*(100.0 * along), turn, 3.0], [*point, turn + np.radians(turned_deg), speed_mps]])
    ego = lab.view(network, lab.L3, cars, poses=poses).ego(0)
    assert rider_comes_up(ego, side, 0.4) is (waits and kind in RIDERS)
    assert not rider_comes_up(ego, -side, 0.4)


def scene(kind, behind_m, speed_mps, left_m=-1.4):
    cars = [lab.Car(CAR, 0, 100, 5.0, (0,)), lab.Car(RIDER, 0, 100 - behind_m, speed_mps, (0,), kind, left=left_m)]
    return lab.view(lab.straight_road(1), lab.L3, cars).ego(0)


@pytest.mark.parametrize("kind", RIDERS)
def test_a_driver_lets_a_rider_pass_before_pulling_over(kind):
    reacting = replace(UNIT, phase=Mode.YIELD_REACTING, side=0)
    waits = start_pull_over(reacting, scene(kind, 5.0, 7.0))
    assert (waits.unit.phase, waits.unit.side, waits.command) == (Mode.YIELD_DEFERRED, -1, None)
    assert waits.unit.deferred == "vehicle_beside"
    assert start_pull_over(waits.unit, scene(kind, -1.0, 7.0)).unit.phase is Mode.YIELD_DEFERRED
    for ego in (scene(kind, -8.0, 7.0), scene(kind, 40.0, 7.0), scene(kind, 5.0, 7.0, left_m=1.4)):
        assert start_pull_over(waits.unit, ego).unit.phase is Mode.YIELD_PULL_OVER


class Passing(lab.Loop):
    """A closed loop with a rider who rides straight on, and brakes behind a car in the way."""

    wished_mps = 0.0

    def sumo(self, i):
        if self.cars[i].actor_id != RIDER:
            return super().sumo(i)
        seen, car = self.traffic, i - 1
        gap_m = seen.x_m[car] - seen.x_m[i] - 0.5 * (self.table.length_m[car] + self.table.length_m[i])
        apart_m = abs(seen.y_m[car] - seen.y_m[i]) - 0.5 * (self.table.width_m[car] + self.table.width_m[i])
        free = apart_m > 0.1 or gap_m < -0.5
        wished = self.wished_mps if free else np.sqrt(6.0 * max(gap_m - 1.0, 0.0))
        speed = float(np.clip(wished, seen.speed_mps[i] - 0.3, seen.speed_mps[i] + 0.1))
        return float(seen.x_m[i]) + 0.05 * speed, float(seen.y_m[i]), 0.0, speed


@pytest.mark.parametrize(("behind_m", "speed_mps"), [(10.0, 9.0), (15.0, 9.0), (5.0, 7.5)])
def test_nobody_pulls_over_into_a_cyclist(behind_m, speed_mps):
    cars = [
        lab.Car(1, 0, 40, 8, (0,), ActorClass.AMBULANCE),
        lab.Car(CAR, 0, 100, 7, (0,), desired=7.0),
        lab.Car(RIDER, 0, 100 - behind_m, speed_mps, (0,), ActorClass.BICYCLE, left=-1.4),
    ]
    loop = Passing(lab.world_of(lab.straight_road(1), lab.L3), cars)
    loop.wished_mps = speed_mps
    loop.run(400)
    assert loop.touching() == []
    first = next(row for row in loop.log if row[CAR][5] == Mode.YIELD_PULL_OVER)
    assert abs(first[RIDER][0] - first[CAR][0]) > lengths_m(ActorClass.BICYCLE), "they are not side by side"


@pytest.mark.parametrize("speed_mps", [4.0, 6.0, 8.0])
@pytest.mark.parametrize("kind", RIDERS)
def test_a_rider_who_pulls_over_leans_no_more_than_drivers_like(kind, speed_mps):
    """Its wheels turn at once: the move is as long as the speed at its begin asks for."""
    ego = lab.view(lab.straight_road(1), lab.L3, [lab.Car(CAR, 0, 100, speed_mps, (0,), kind)]).ego(0)
    path = pull_over_path(replace(UNIT, side=-1), ego, 0)
    aside = speed_mps**2 * np.abs(path.curve.curvature_1pm).max()
    assert 0.5 * ego.navigator_config.lateral_accel_mps2 < aside < 1.1 * ego.navigator_config.lateral_accel_mps2
