import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.config import JunctionEntryConfig
from siren_ros.behaviour.emv.junction_entry import approach_mps, entry_limit_mps
from siren_ros.conflicts.outlook import Outlook
from siren_ros.scenario.presets import Attention
from siren_ros.world.actors import ActorClass
from siren_ros.world.traffic_state import SignalState

CONFIG = JunctionEntryConfig()
HALF = 0.5 * 6.5


def limit(lab, network, front_m, state, speed=9.0, attention=None):
    cars = [lab.Car(1, 0, front_m - HALF, speed, (0, 2), ActorClass.AMBULANCE)]
    traffic = replace(lab.traffic_of(network, cars), signals=(SignalState("J", state),))
    world = lab.world_of(network, lab.L2)
    if attention is not None:
        world = replace(world, preset=replace(world.preset, attention=attention))
    return entry_limit_mps(lab.view_of(world, traffic), 0)


def test_comes_to_the_entry_speed_at_the_line_by_constant_gentle_braking():
    assert approach_mps(0.0, CONFIG) == pytest.approx(20.0 / 3.6)
    way = np.linspace(0.0, 60.0, 25)
    energy = np.array([approach_mps(ahead, CONFIG) for ahead in way]) ** 2
    assert np.allclose(np.diff(energy) / np.diff(way), 2.0 * CONFIG.brake_mps2)


def test_red_counts_and_green_and_stop_signs_do_not(lab):
    network = lab.junction_road()
    assert limit(lab, network, 120.0, "r") == pytest.approx(approach_mps(30.0, CONFIG), abs=0.05)
    assert math.isinf(limit(lab, network, 120.0, "G"))
    assert math.isinf(limit(lab, network, 120.0, "g"))
    signed = (replace(one, signal_id=None, must_stop=True) for one in network.connections)
    assert math.isinf(limit(lab, replace(network, connections=tuple(signed)), 120.0, "G"))


@pytest.mark.parametrize(("red_mps", "least_mps"), [(0.0, CONFIG.speed_mps), (3.0, CONFIG.speed_mps), (11.0, 11.0)])
def test_a_driver_who_does_not_look_out_hardly_slows_down(lab, red_mps, least_mps):
    found = limit(lab, lab.junction_road(), 120.0, "r", attention=Attention(emv_red_mps=red_mps))
    assert found == pytest.approx(math.sqrt(least_mps**2 + 2.0 * CONFIG.brake_mps2 * 30.0), abs=0.05)


def test_inside_the_junction_the_limit_is_over(lab):
    assert math.isinf(limit(lab, lab.junction_road(), 151.0, "r"))


def test_the_emv_drives_so_and_enters_without_stopping(lab, monkeypatch):
    network = lab.junction_road()
    monkeypatch.setattr(Outlook, "signals", {"J": "r"})
    loop = lab.Loop(lab.world_of(network, lab.L1), [lab.Car(1, 0, 40.0, 13.0, (0, 2), ActorClass.AMBULANCE)]).run(300)
    front = np.array([row[1][0] for row in loop.log]) + HALF
    speed = np.array([row[1][3] for row in loop.log])
    line = int(np.searchsorted(front, 150.0))
    assert speed[line] == pytest.approx(CONFIG.speed_mps, abs=0.4)
    assert speed.min() > CONFIG.speed_mps - 0.5
    assert np.diff(speed[: line + 1]).min() / 0.05 > -1.6
    assert speed[-1] > 10.0


def test_a_light_that_turns_red_late_asks_for_gentle_braking_only(lab):
    network = lab.junction_road()
    gain = lab.world_of(network, lab.L2).config.emv.navigator.speed_gain_1ps
    assert limit(lab, network, 140.0, "r", speed=13.0) == pytest.approx(13.0 - CONFIG.ease_off_mps2 / gain)


@pytest.mark.parametrize(("front", "counts"), [(149.2, True), (149.9, True), (150.1, False)])
def test_a_red_light_counts_up_to_the_line(lab, front, counts):
    found = limit(lab, lab.junction_road(), front, "r", speed=4.0)
    assert math.isfinite(found) is counts
    if counts:
        assert found == pytest.approx(approach_mps(150.0 - front, CONFIG), abs=0.02)


@pytest.mark.parametrize(("front", "ahead"), [(70.0, 30.0), (125.0, 35.0)])
def test_of_two_red_lights_the_nearer_one_ahead_limits(lab, front, ahead):
    """Stop lines at 100 m and at 160 m."""
    road = lab.RoadBuilder()
    for begin, end in ((0, 100), (100, 120), (120, 160), (160, 180), (180, 400)):
        road.edge([[begin, 0], [end, 0]], 1, ("A", "B"), internal=begin in {100, 160})
    road.connect(0, 2, via=(1,), signal=True)
    road.connect(2, 4, via=(3,), signal=True)
    network = road.built()
    cars = [
        lab.Car(
            1, 0 if front < 100.0 else 2, front % 120.0 - HALF, 9.0, (0, 2, 4)[front > 100.0 :], ActorClass.AMBULANCE
        )
    ]
    traffic = replace(lab.traffic_of(network, cars), signals=(SignalState("J", "r"),))
    found = entry_limit_mps(lab.view_of(lab.world_of(network, lab.L2), traffic), 0)
    assert found == pytest.approx(approach_mps(ahead, CONFIG), abs=0.05)
