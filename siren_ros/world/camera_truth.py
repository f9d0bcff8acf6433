"""Labels of one picture, as a structure of arrays."""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Codes, Floats, Ids


@dataclass(frozen=True)
class CameraTruth:
    """Vehicles that a camera could see at one step; rows sorted by ``actor_id``.

    Image coordinates are those of ``sensor_msgs/CameraInfo``: (0, 0) is the centre of the top left pixel. Boxes
    bound the pixels that show the vehicle, outer edges; all zero for one that is wholly hidden.
    """

    step: int
    actor_id: Ids
    actor_class: Codes
    is_emv: npt.NDArray[np.bool_]
    u_min_px: Floats
    v_min_px: Floats
    u_max_px: Floats
    v_max_px: Floats
    visible_px: Ids
    """Pixels that show the vehicle."""
    visible_fraction: Floats
    """Of the vehicle's outline within the picture."""
    truncation: Floats
    """Share of the vehicle's outline that lies outside the picture."""

    def __len__(self) -> int:
        return len(self.actor_id)


_DTYPES: Final[dict[str, type[np.generic]]] = {
    "actor_id": np.uint32,
    "actor_class": np.uint8,
    "is_emv": np.bool_,
    "visible_px": np.uint32,
}
CAMERA_TRUTH_DTYPES: Final[dict[str, type[np.generic]]] = {
    field.name: _DTYPES.get(field.name, np.float64) for field in fields(CameraTruth) if field.name != "step"
}
"""Array fields of CameraTruth and their element types, in declaration order."""
