"""The circle around the LiDAR that is divided into pillars, and what a network can be asked about it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Self

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES
from siren_ros.world.actors import ActorClass

SHIPPED_DETECTOR: Final = "pillars"
"""Name of the detector whose weights ship."""
SENSOR_HEIGHT_M: Final = 1.93
"""Height above the ground of the LiDAR that networks see; sweeps from other heights are lifted to it."""


@dataclass(frozen=True)
class PillarGrid:
    """Pillars in the LiDAR's frame. The cell at row 0, column 0 has the smallest x and y; rows count along y."""

    half_width_m: float = 51.2
    """Of the square of cells; points farther away than this are left out."""
    cells: int = 400
    """Along x and along y."""
    low_m: float = -5.0
    high_m: float = 3.0
    """Points below and above are left out."""
    sweeps: int = 10
    """The present one and those before it, as in nuScenes."""
    points: int = 12
    """Most points of a pillar; of more, a random sample."""
    pillars: int = 40000
    """Most pillars of a frame; those that only old sweeps have are left out first."""

    @property
    def cell_m(self) -> float:
        """Width of a pillar."""
        return 2.0 * self.half_width_m / self.cells

    def to_json(self) -> dict[str, Any]:
        """For a network's card."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Inverse of ``to_json``.

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
    """Index into ``CLASS_NAMES`` of a member of ``ActorClass``."""
    name = ActorClass(actor_class).name.lower()
    return CLASS_NAMES.index(name) if name in CLASS_NAMES else 0
