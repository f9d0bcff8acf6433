"""Sorts the points of sweeps into pillars, the cells of a grid seen from above: the input of the detector's network.

After PointPillars (Lang et al. 2019).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats32
from siren_ros.base.numerics.compiled import Array, X, Y, Z, compiled
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.simulation.world.actors import ActorClass

SENSOR_HEIGHT_M: Final = 1.93
"""Height above the ground at which networks expect the LiDAR; sweeps from other heights are shifted to it."""


@dataclass(frozen=True)
class PillarGrid:
    """Grid of pillars in the LiDAR's frame.

    The cell at row 0, column 0 has the smallest x and y; rows count along y.
    """

    half_width_m: float = 51.2
    """Half width of the square of cells; points outside are left out."""
    cells: int = 400
    """Number of cells along x and along y."""
    low_m: float = -5.0
    high_m: float = 3.0
    """Upper limit of height; points below and above the limits are left out."""
    sweeps: int = 10
    """Number of sweeps: the present one and earlier ones, as in nuScenes."""
    points: int = 12
    """Maximum number of points per pillar; of more points, a random sample is used."""
    pillars: int = 40000
    """Maximum number of pillars per frame; pillars with old points only are left out first."""

    @property
    def cell_m(self) -> float:
        """Width of a pillar."""
        return 2.0 * self.half_width_m / self.cells

    def to_json(self) -> dict[str, Any]:
        """The grid as JSON types, for a network's card."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Reads the message that ``to_json`` makes.

        Raises:
            InputError: A number is missing, unknown or of no use.
        """
        try:
            grid = cls(**values)
            usable = min(grid.half_width_m, grid.cells, grid.sweeps, grid.points, grid.pillars) > 0
            usable = usable and grid.low_m < grid.high_m
        except TypeError as error:
            raise InputError("card", f"grid {dict(values)}", f"the fields {', '.join(asdict(cls()))}") from error
        if not usable:
            raise InputError("card", f"grid {dict(values)}", "numbers above 0, low_m below high_m")
        return grid


def class_of(actor_class: int) -> int:
    """Index into ``CLASS_NAMES`` for a member of ``ActorClass``."""
    name = ActorClass(actor_class).name.lower()
    return CLASS_NAMES.index(name) if name in CLASS_NAMES else 0


COLUMNS: Final = ("x_m", "y_m", "z_m", "intensity", "age_s")
"""Columns of a point, in the LiDAR's frame at the time of the newest sweep."""
FEATURES: Final = ("x", "y", "z", "intensity", "age", "x_mean", "y_mean", "z_mean", "x_middle", "y_middle")
"""Features of a point in a pillar, as in PointPillars: with its offset from the mean of the pillar's points and from
the pillar's middle. Lengths are divided by the grid's half width, heights by 2 m, ages by 0.25 s."""
_HEIGHT_M: Final = 2.0
_AGE_S: Final = 0.25


@dataclass(frozen=True)
class Pillars:
    """The pillars of one frame that contain points: the network's input."""

    points: Floats32
    """Features with columns ``FEATURES``, shape ``(P, grid.points, 10)``. Unused slots repeat the first point, which
    changes no maximum."""
    cell: npt.NDArray[np.int64]
    """Cell of each pillar as ``row * grid.cells + column``, shape ``(P,)``; each cell occurs once."""

    def __len__(self) -> int:
        return len(self.cell)


@dataclass(frozen=True)
class SortedPoints:
    """Points sorted into the slots of their pillars."""

    slots: Floats32
    """Points with columns ``COLUMNS``, shape ``(P, grid.points, 5)``; unused slots are zero."""
    count: npt.NDArray[np.int64]
    """Number of points of each pillar, shape ``(P,)``."""
    cell: npt.NDArray[np.int64]


def pillars_of(points: Floats32, grid: PillarGrid) -> Pillars:
    """The pillars of a frame; arguments are those of ``sorted_points``."""
    held = sorted_points(points, grid)
    features = np.empty((len(held.cell), grid.points, len(FEATURES)), dtype=np.float32)
    _describe(held.slots, held.count, held.cell, grid.cells, grid.cell_m, grid.half_width_m, features)
    return Pillars(features, held.cell)


def sorted_points(points: Floats32, grid: PillarGrid) -> SortedPoints:
    """Sort points into pillars.

    The sample of a pillar with too many points is drawn with a generator that starts the same in every frame. Points
    have shape ``(N, 5)``, columns as in ``COLUMNS``, the newest sweep first.
    """
    most = min(grid.pillars, grid.cells * grid.cells)
    slots = np.zeros((most, grid.points, len(COLUMNS)), dtype=np.float32)
    seen, cell = np.zeros(most, dtype=np.int64), np.zeros(most, dtype=np.int64)
    pillar_of_cell = np.full(grid.cells * grid.cells, -1, dtype=np.int32)
    limits = (grid.half_width_m, 1.0 / grid.cell_m, grid.low_m, grid.high_m)
    filled = _sort(points, limits, grid.cells, pillar_of_cell, slots, seen, cell)
    return SortedPoints(slots[:filled], np.minimum(seen[:filled], grid.points), cell[:filled])


_INTENSITY, _AGE = 3, 4
"""Columns of points after the place."""


@compiled
def _sort(
    points: Array, limits: tuple[float, ...], cells: int, pillar_of_cell: Array, slots: Array, seen: Array, cell: Array
) -> int:
    """Fill the slots of the pillars; returns the number of pillars."""
    half_width_m, cells_per_m, low_m, high_m = limits
    most, filled, state = slots.shape[1], 0, 1
    for row in range(points.shape[0]):
        column = int(np.floor((points[row, X] + half_width_m) * cells_per_m))
        line = int(np.floor((points[row, Y] + half_width_m) * cells_per_m))
        if column < 0 or line < 0 or column >= cells or line >= cells:
            continue
        away = points[row, X] * points[row, X] + points[row, Y] * points[row, Y]
        if not (low_m <= points[row, Z] <= high_m and away <= half_width_m * half_width_m):
            continue
        place = line * cells + column
        pillar = pillar_of_cell[place]
        if pillar < 0:
            if filled == slots.shape[0]:
                continue
            pillar = filled
            pillar_of_cell[place] = pillar
            cell[pillar] = place
            filled += 1
        slot = seen[pillar]
        seen[pillar] += 1
        if slot >= most:
            # Reservoir sampling: every point of the pillar has the same chance to remain.
            state = (state * 1664525 + 1013904223) & 0xFFFFFFFF
            slot = (state * (slot + 1)) >> 32
            if slot >= most:
                continue
        for axis in range(points.shape[1]):
            slots[pillar, slot, axis] = points[row, axis]
    return filled


@compiled
def _describe(
    slots: Array, count: Array, cell: Array, cells: int, cell_m: float, half_width_m: float, features: Array
) -> None:
    """Compute the features of all slots."""
    for pillar in range(slots.shape[0]):
        held = count[pillar]
        mean_x, mean_y, mean_z = 0.0, 0.0, 0.0
        for slot in range(held):
            mean_x += slots[pillar, slot, X]
            mean_y += slots[pillar, slot, Y]
            mean_z += slots[pillar, slot, Z]
        mean_x, mean_y, mean_z = mean_x / held, mean_y / held, mean_z / held
        middle_x = (cell[pillar] % cells + 0.5) * cell_m - half_width_m
        middle_y = (cell[pillar] // cells + 0.5) * cell_m - half_width_m
        for place in range(slots.shape[1]):
            slot = place if place < held else 0
            x, y, z = slots[pillar, slot, X], slots[pillar, slot, Y], slots[pillar, slot, Z]
            row = features[pillar, place]
            row[0], row[1], row[2] = x / half_width_m, y / half_width_m, z / _HEIGHT_M
            row[3], row[4] = slots[pillar, slot, _INTENSITY], slots[pillar, slot, _AGE] / _AGE_S
            row[5], row[6], row[7] = x - mean_x, y - mean_y, z - mean_z
            row[8], row[9] = x - middle_x, y - middle_y
