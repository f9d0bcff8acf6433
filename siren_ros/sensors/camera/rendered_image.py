"""The result of a renderer."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


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
