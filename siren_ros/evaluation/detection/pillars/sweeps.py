"""The last sweeps of a LiDAR in the frame of the newest one: what the vehicle moved in between is taken out."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats32, Matrix
from siren_ros.numerics.units import STEP_S

_OWN_HALF_M: Final = (4.2, 1.35)
"""Half length and half width of a box that holds every emergency vehicle: returns inside come from the carrier."""


@dataclass(frozen=True)
class _Sweep:
    step: int
    xyzi: Floats32
    map_from_lidar: Matrix


@dataclass
class SweepMemory:
    """Keeps the last sweeps of one sensor."""

    sweeps: int
    """How many, the newest included."""
    _held: list[_Sweep] = field(default_factory=list)

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Takes the sweep of a step; of a step that is not after the last one, the memory begins anew.

        Args:
            step: Of the sweep.
            points: With the fields x, y, z and intensity, in the LiDAR's frame.
            map_from_lidar: Pose at that step, shape ``(4, 4)``.
        """
        if self._held and step <= self._held[0].step:
            self._held.clear()
        columns = [points[name].astype(np.float32) for name in ("x", "y", "z", "intensity")]
        xyzi = np.stack(columns, axis=-1)
        own = (abs(xyzi[:, 0]) < _OWN_HALF_M[0]) & (abs(xyzi[:, 1]) < _OWN_HALF_M[1])
        self._held.insert(0, _Sweep(step, xyzi[~own], map_from_lidar))
        del self._held[self.sweeps :]

    def points(self) -> Floats32:
        """All points in the frame of the newest sweep, newest sweep first: x, y, z, intensity, age in seconds."""
        if not self._held:
            return np.zeros((0, 5), dtype=np.float32)
        newest = self._held[0]
        lidar_from_map = np.linalg.inv(newest.map_from_lidar)
        parts = []
        for sweep in self._held:
            age_s = (newest.step - sweep.step) * STEP_S
            table = np.empty((len(sweep.xyzi), 5), dtype=np.float32)
            table[:, :3] = sweep.xyzi[:, :3]
            if sweep is not newest:
                moved = lidar_from_map @ sweep.map_from_lidar
                table[:, :3] = sweep.xyzi[:, :3] @ moved[:3, :3].T.astype(np.float32) + moved[:3, 3].astype(np.float32)
            table[:, 3], table[:, 4] = sweep.xyzi[:, 3], age_s
            parts.append(table)
        return np.concatenate(parts)
