"""Speeds of EMVs at lines without right of way: one draw per driver, limited by the view."""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.simulation.conflicts.clear_view import Lookout, safe_mps, side_streets
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import JunctionEntryConfig
from siren_ros.simulation.scenario.presets import Attention


def must_give_way(connection: Connection, signals: Mapping[str, str]) -> bool:
    """Whether a movement has a line at which others have the right of way: red light, stop sign, give-way sign.

    A green light that gives way to oncoming traffic is none: that traffic is in view.
    """
    rank = rank_of(connection, signals)
    return rank in {Rank.RED, Rank.STOP_SIGN} or (rank is Rank.GIVES_WAY and connection.gives_way)


_VIEW_M: Final = 40.0
"""Distance before the line from which the view counts."""
_VIEW_STEP_M: Final = 0.5
"""Distance between the places at which the view is computed."""


class LineBook:
    """Caches the speeds at a map's lines; each is computed once."""

    def __init__(self, network: RoadNetwork, config: JunctionEntryConfig, attention: Attention, seed: int) -> None:
        self._network, self._config, self._attention, self._seed = network, config, attention, seed
        self._drivers: dict[int, float] = {}
        self._views: dict[tuple[int, int, float], tuple[Floats, Floats]] = {}

    def driver_mps(self, emv_id: int) -> float:
        """Speed at a line of one EMV's driver; it depends only on preset, seed and actor."""
        if self._config.speed_mps is not None:
            return self._config.speed_mps
        if emv_id not in self._drivers:
            drawn = self._attention.emv_line_mps.draw(random_stream(self._seed, "emv at lines", emv_id))
            self._drivers[emv_id] = drawn
        return self._drivers[emv_id]

    def approach_mps(self, emv_id: int, length_m: float, connection: Connection, ahead_m: float) -> float:
        """Speed at a distance before a line: gentle braking leads to the driver's speed at the line.

        On the way the driver goes no faster than the view of the streets from the side allows. A calibrated driver
        does what was measured.
        """
        energy, brake = self.driver_mps(emv_id) ** 2 + 2.0 * self._config.brake_mps2 * ahead_m, self._config.brake_mps2
        if self._config.speed_mps is None:
            before_m, safe_mps2 = self._view(connection, length_m)
            later = before_m < ahead_m
            energy = min(energy, float((safe_mps2 + 2.0 * brake * (ahead_m - before_m))[later].min(initial=math.inf)))
        return math.sqrt(energy)

    def _view(self, connection: Connection, length_m: float) -> tuple[Floats, Floats]:
        """Places before the line, and the square of the speed that the view allows at each."""
        key = connection.from_lane, connection.to_lane, length_m
        if key not in self._views:
            config, attention = self._config, self._attention
            lookout = Lookout(
                attention.emv_horizon_s,
                attention.emv_pet_s,
                config.stop_mps2,
                config.reaction_s,
                config.standoff_m,
                length_m,
            )
            before_m = np.arange(0.0, _VIEW_M, _VIEW_STEP_M, dtype=np.float64)
            streets = side_streets(self._network, connection)
            least = [min((safe_mps(street, at, lookout) for street in streets), default=math.inf) for at in before_m]
            self._views[key] = before_m, np.square(np.maximum(least, config.least_mps))
        return self._views[key]
