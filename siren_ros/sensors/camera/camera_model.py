"""The optical frame of a camera, and a drawn picture."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Matrix
from siren_ros.sensors.specification import OPTICAL_FROM_BODY, inverse, transform


def optical_from_map(map_from_camera: Matrix) -> Matrix:
    """Transform into a camera's optical frame, given the pose of its body frame (x forward), ``(4, 4)``."""
    return transform(OPTICAL_FROM_BODY, np.zeros(3)) @ inverse(map_from_camera)


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """One picture and, where asked for, its labels, all from one draw; row 0 is the top."""

    rgba: npt.NDArray[np.uint8]
    """Colour, and the semantic class (CARLA's numbers) in the fourth channel, shape ``(height, width, 4)``."""
    instance: npt.NDArray[np.uint32] | None
    """Actor id, 0 off vehicles, shape ``(height, width)``."""
    depth_m: npt.NDArray[np.float32] | None
    """Along the optical axis, 0 where there is sky, shape ``(height, width)``."""

    @property
    def semantic(self) -> npt.NDArray[np.uint8]:
        """Semantic classes, shape ``(height, width)``."""
        return self.rgba[..., 3]
