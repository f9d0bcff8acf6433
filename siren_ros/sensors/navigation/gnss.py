"""A satellite receiver: latitude, longitude and altitude of its antenna, through the map's geo-reference."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Matrix
from siren_ros.roads.map_projection import geodetic_from_projected
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.navigation.bias_walk import BiasWalk
from siren_ros.sensors.suite.noise import sensor_generator
from siren_ros.sensors.suite.suite import GnssSpec

DEFAULT_PROJECTION: Final = "+proj=tmerc +lat_0=49 +lon_0=8.4 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
"""Place of maps without a geo-reference, such as the built-in town: 49° N, 8.4° E, in the Rhine valley."""


@dataclass(frozen=True)
class GeoReference:
    """Takes the ``map`` frame to the WGS 84 ellipsoid; z 0 lies on it."""

    projection: str
    origin_m: tuple[float, float]
    """Projected coordinates of the map frame's origin."""

    @classmethod
    def of(cls, network: RoadNetwork) -> "GeoReference":
        """The map's own, or the default where the map has none in transverse Mercator or UTM."""
        if network.origin_lat_lon_deg is None:
            return cls(DEFAULT_PROJECTION, (0.0, 0.0))
        return cls(network.projection, network.projected_origin_m)

    def geodetic(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Latitude and longitude in degrees of a place in the ``map`` frame.

        Raises:
            InputError: A projection that is not understood.
        """
        found = geodetic_from_projected(self.projection, x_m + self.origin_m[0], y_m + self.origin_m[1])
        if found is None:
            raise InputError("projection", self.projection, "a transverse Mercator or UTM projection")
        return found


@dataclass(frozen=True, eq=False)
class GnssFix:
    """One position."""

    sensor: str
    step: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    """Above the ellipsoid."""
    variance_m2: npt.NDArray[np.float64]
    """Variances east, north and up: white noise plus the bias walk so far, shape ``(3,)``."""


class Gnss:
    """One receiver on one carrier."""

    def __init__(self, spec: GnssSpec, reference: GeoReference, seed: int) -> None:
        """Prepare the noise; ``seed`` is that of the carrier's noise."""
        self.spec = spec
        self._reference = reference
        self._seed = seed
        self._bias = BiasWalk(seed, spec.name, np.full(3, spec.bias_walk_m_per_sqrt_s))

    def measure(self, step: int, map_from_base: Matrix, time_s: float) -> GnssFix:
        """The position at a step.

        Args:
            step: Of the simulation.
            map_from_base: Pose of the carrier, shape ``(4, 4)``.
            time_s: Simulated time since the walk of the bias began.
        """
        spec, mount = self.spec, self.spec.mount
        antenna = map_from_base @ np.array([mount.x_m, mount.y_m, mount.z_m, 1.0])
        flat, up = spec.horizontal_noise_stddev_m, spec.vertical_noise_stddev_m
        noise = sensor_generator(self._seed, spec.name, step).standard_normal(3) * np.array([flat, flat, up])
        east, north, height = antenna[:3] + self._bias.at(step) + noise
        latitude, longitude = self._reference.geodetic(float(east), float(north))
        walked = spec.bias_walk_m_per_sqrt_s**2 * time_s
        variance = np.array([flat**2, flat**2, up**2]) + walked
        return GnssFix(spec.name, step, latitude, longitude, float(height), variance)
