import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.civilians.gap_seeking import Seek, choose_seek, seek_speed_mps, soon_free
from siren_ros.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.behaviour.config import YieldConfig
from siren_ros.behaviour.driving.lane_change import LaneGaps, Refusal
from siren_ros.world.actors import ActorClass, Mode, Owner

CONFIG = YieldConfig(seek_speed_mps=2.5)
BEHIND = LaneGaps(math.inf, 0.0, 3.0, 8.0)
AHEAD = LaneGaps(1.0, 6.0, math.inf, 0.0)


@pytest.mark.parametrize(
    ("gaps", "own_free", "refusal", "limit", "expected"),
    [
        (BEHIND, 50.0, Refusal.GAP_REAR, 13.9, Seek.DRAW_AHEAD),
        (BEHIND, 5.0, Refusal.GAP_REAR, 13.9, Seek.FALL_BACK),
        (AHEAD, 50.0, Refusal.GAP_FRONT, 13.9, Seek.FALL_BACK),
        (LaneGaps(-2.0, 6.0, math.inf, 0.0), 50.0, Refusal.BESIDE, 13.9, Seek.FALL_BACK),
        (LaneGaps(math.inf, 0.0, -2.0, 6.0), 50.0, Refusal.BESIDE, 13.9, Seek.DRAW_AHEAD),
        # Who drives at the limit cannot be left behind.
        (BEHIND, 50.0, Refusal.GAP_REAR, 8.3, Seek.FALL_BACK),
    ],
)
def test_draws_ahead_of_what_is_behind_and_lets_the_rest_past(gaps, own_free, refusal, limit, expected):
    own = LaneGaps(own_free, 6.0, math.inf, 0.0)
    assert choose_seek(gaps, own, refusal, CONFIG, limit) is expected


def test_speed_differs_from_the_vehicle_in_the_way_within_limits():
    assert seek_speed_mps(Seek.DRAW_AHEAD, BEHIND, CONFIG, 13.9) == pytest.approx(10.5)
    assert seek_speed_mps(Seek.DRAW_AHEAD, BEHIND, CONFIG, 9.0) == pytest.approx(9.0)
    assert seek_speed_mps(Seek.FALL_BACK, AHEAD, CONFIG, 13.9) == pytest.approx(3.5)
    assert seek_speed_mps(Seek.FALL_BACK, replace(AHEAD, front_mps=1.0), CONFIG, 13.9) == pytest.approx(
        CONFIG.seek_least_mps
    )


@pytest.mark.parametrize(
    ("seek", "gaps", "expected"),
    [
        (Seek.FALL_BACK, LaneGaps(-1.0, 8.0, math.inf, 0.0), True),  # 3 m are wanted, 2 s at 1.5 m/s give them
        (Seek.FALL_BACK, LaneGaps(-1.1, 8.0, math.inf, 0.0), False),
        (Seek.FALL_BACK, LaneGaps(-1.0, 5.0, math.inf, 0.0), False),
        (Seek.FALL_BACK, LaneGaps(-1.0, 8.0, -0.5, 6.0), False),
        (Seek.FALL_BACK, LaneGaps(30.0, 8.0, -0.5, 8.0), False),  # the one in the way has still to pass
        (Seek.DRAW_AHEAD, LaneGaps(math.inf, 0.0, -1.0, 5.0), True),
        (Seek.DRAW_AHEAD, LaneGaps(math.inf, 0.0, -1.0, 8.0), False),
        (Seek.DRAW_AHEAD, LaneGaps(-0.5, 5.0, -1.0, 5.0), False),
        (Seek.NOT, LaneGaps(-1.0, 8.0, math.inf, 0.0), False),
    ],
)
def test_a_gap_is_soon_free_if_the_way_gained_until_then_is_enough(seek, gaps, expected):
    assert soon_free(seek, gaps, 6.5, 2.0, 2.0) is expected


def test_a_deferred_driver_falls_back_and_then_changes_lanes(lab):
    cars = [
        lab.Car(1, 0, 40, 8, (0,), ActorClass.AMBULANCE),
        lab.Car(2, 0, 75, 7, (0,), desired=7),
        lab.Car(3, 1, 76, 7, (0,), desired=7),
    ]
    loop = lab.Loop(lab.world_of(lab.straight_road(2, 700.0), lab.L2), cars).run(10)
    assert loop.modes[2] == Mode.YIELD_DEFERRED
    assert loop.owners[2] == Owner.SUMO
    loop.run(5)
    assert loop.modes[2] == Mode.YIELD_DEFERRED
    assert loop.owners[2] == Owner.ROS
    loop.run(300)
    assert [event.actor_id for event in loop.of("yield_completed")] == [2]
    assert len(loop.of("yield_deferred")) == 1
    assert not loop.touching()


def test_no_gap_is_sought_right_before_a_junction(lab):
    network = lab.junction_road()
    cars = [
        lab.Car(1, 0, 90, 3, (0, 2), ActorClass.AMBULANCE),
        lab.Car(2, 0, 128, 3, (0, 2), desired=3),
        lab.Car(3, 1, 128, 3, (0, 2), desired=3),
    ]
    loop = lab.Loop(lab.world_of(network, lab.L2), cars).run(40)
    assert loop.of("yield_deferred")
    assert all(row[2][4] == Owner.SUMO for row in loop.log)


def test_a_gap_is_sought_in_turns_with_driving_on(lab):
    """A vehicle stays alongside whatever the driver does; the driver leads the EMV slowly for some seconds only."""
    world = lab.world_of(lab.straight_road(2, 900.0), lab.L2)
    state, owners = YieldState.initial(), []
    config = world.config.yielding
    for step in range(round((config.seek_after_s + 2.0 * (config.seek_for_s + config.seek_pause_s)) / 0.05)):
        x = 100.0 + 0.25 * step
        cars = [lab.Car(1, 0, x - 30.0, 5, (0,), ActorClass.AMBULANCE)]
        cars += [lab.Car(2, 0, x, 5, (0,)), lab.Car(3, 1, x, 5, (0,))]
        traffic = lab.traffic_of(world.network, cars, step=step, spawn=step == 0)
        state, commands = step_yield(state, traffic, world)
        assert commands.mode.tolist() == [Mode.YIELD_DEFERRED]
        owners.append(int(commands.owner[0]))
    changes = np.flatnonzero(np.diff(owners)) + 1
    expected = np.array([0.0, config.seek_for_s, config.seek_for_s + config.seek_pause_s])
    expected = np.concatenate((expected, expected[1:2] + expected[2])) + config.seek_after_s
    np.testing.assert_allclose(0.05 * changes, expected, atol=0.051)
