"""Steps of one civilian, which its tests share."""

from dataclasses import replace

from behaviour.lab import stepper

from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.driver_states import Compliance, Driver, EmvView, YieldUnit
from siren_ros.simulation.world.actors import ActorClass, Mode

UNIT = YieldUnit(2, 1, Driver(Compliance.COMPLIES, 0.0, 40.0), 0, phase=Mode.YIELD_HOLD, side=-1)
NEAR = EmvView(0, passed=False, in_region=True, on_path=True, on_road=True)
"""The EMV is about, and has not passed."""
steps = stepper(step_yield, YieldState())


def emv_at(lab, s=50.0):
    return lab.Car(1, 0, s, 8, (0,), ActorClass.AMBULANCE)


def shoulder_road(lab, width=3.3):
    """A shoulder (lane 0) and two lanes, from which the route (0, 1) turns right after 150 m."""
    road = lab.RoadBuilder().edge([[0, 0], [150, 0]], 3, ("W", "J"), shoulder=True)
    road.edge([[160, -10], [160, -200]], 2, ("J", "S"), shoulder=True)
    road.edge([[175, 0], [300, 0]], 3, ("J", "E"), shoulder=True)
    road.connect(0, 3, direction="r").connect(1, 4, direction="r")
    for lane in (0, 1, 2):
        road.connect(lane, 5 + lane)
    network = road.built()
    lanes = (replace(network.lanes[0], width_m=width), *network.lanes[1:])
    return lab.world_of(replace(network, lanes=lanes), lab.L3)
