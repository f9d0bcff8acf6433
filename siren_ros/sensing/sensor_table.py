"""The table of sensor types: section in a suite's file, specification, and measurement of each type.

``SENSOR_MESSAGES`` in ``siren_ros.data.sensor_messages`` has the topic and the message of each type.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from siren_ros.sensing.microphone import Microphone, MicrophoneSpec
from siren_ros.sensing.navigation import GeoReference, Gnss, GnssSpec, Imu, ImuSpec, PlanarMotion
from siren_ros.sensing.specification import CameraSpec, CarrierView, LidarSpec, Measure, SensorSpec
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.measurements import ImuSample


@dataclass(frozen=True)
class SensorType:
    """One row of the table."""

    spec: type[SensorSpec]
    begin: Callable[[Any, RoadNetwork, int], Measure] | None = None
    """Makes the measuring function of a sensor from its specification, the map and the seed of the carrier's noise.
    None for LiDARs and cameras: the rig makes them, because they share one scene."""
    on_vehicles_only: bool = False


def _gnss(spec: GnssSpec, network: RoadNetwork, seed: int) -> Measure:
    receiver = Gnss(spec, GeoReference.of(network), seed)
    return lambda view: receiver.measure(view.states.step, view.map_from_base)


def _imu(spec: ImuSpec, _: RoadNetwork, seed: int) -> Measure:
    unit = Imu(spec, seed)

    def measure(view: CarrierView) -> ImuSample:
        states, row = view.states, view.row
        values = (states.yaw_rad[row], states.vx_mps[row], states.vy_mps[row], states.yaw_rate_radps[row])
        return unit.measure(PlanarMotion(states.step, *map(float, values)))

    return measure


def _microphone(spec: MicrophoneSpec, _: RoadNetwork, seed: int) -> Measure:
    microphone = Microphone(spec, seed)
    return lambda view: microphone.hear(view.states, view.map_from_base)


SENSOR_TYPES: Final[dict[str, SensorType]] = {
    "lidars": SensorType(LidarSpec),
    "cameras": SensorType(CameraSpec),
    "gnss": SensorType(GnssSpec, _gnss, on_vehicles_only=True),
    "imus": SensorType(ImuSpec, _imu, on_vehicles_only=True),
    "microphones": SensorType(MicrophoneSpec, _microphone),
}
"""Sensor types by section of a suite's file. Mounts, topics and the messages of a step keep this order."""
