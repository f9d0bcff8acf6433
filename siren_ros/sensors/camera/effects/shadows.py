"""Shadow maps of the sun."""

from dataclasses import dataclass
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Matrix

_UNIT_FROM_CLIP: Final = np.array(
    [[0.5, 0.0, 0.0, 0.5], [0.0, 0.5, 0.0, 0.5], [0.0, 0.0, 0.5, 0.5], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class ShadowView:
    """The space that a shadow map covers."""

    clip_from_map: Matrix
    """Shape ``(4, 4)``."""

    @property
    def unit_from_map(self) -> Matrix:
        """Texture coordinates and depth, each 0–1, of points in the ``map`` frame, shape ``(4, 4)``."""
        return _UNIT_FROM_CLIP @ self.clip_from_map


def sun_view(
    towards_sun: npt.NDArray[np.float64], centre_m: tuple[float, float], half_m: float, heights_m: tuple[float, float]
) -> ShadowView:
    """Parallel projection along the sun's rays that covers a square of the ground and everything that shades it."""
    up = np.array([0.0, 0.0, 1.0]) if abs(towards_sun[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards_sun)
    right /= np.linalg.norm(right)
    rotation = np.stack((right, np.cross(towards_sun, right), -towards_sun))
    low, high = heights_m
    corners = np.array(
        [(centre_m[0] + sx * half_m, centre_m[1] + sy * half_m, z) for sx in (-1, 1) for sy in (-1, 1) for z in (low,)]
    )
    seen = corners @ rotation.T
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    extent = (seen.max(axis=0) - seen.min(axis=0)) / 2.0
    margin = (high - low) / max(float(towards_sun[2]), 0.1)
    depth = extent[2] + margin + 1.0
    clip = np.eye(4)
    for axis, reach in ((0, extent[0]), (1, extent[1]), (2, depth)):
        clip[axis, :3] = rotation[axis] / reach
        clip[axis, 3] = -centre[axis] / reach
    return ShadowView(clip)


class ShadowMap:
    """A square depth texture that shaders compare against."""

    def __init__(self, context: moderngl.Context, size: int) -> None:
        """Allocate ``size`` × ``size`` texels."""
        self.texture = context.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self._framebuffer = context.framebuffer(depth_attachment=self.texture)
        self._context = context

    def begin(self, program: Any, view: ShadowView) -> None:
        """Clear the map and aim a shadow program (uniform ``clip_from_map``) at it."""
        self._framebuffer.use()
        self._framebuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.polygon_offset = 1.5, 2.0
        program["clip_from_map"].write(np.ascontiguousarray(view.clip_from_map.T, dtype=np.float32).tobytes())

    def end(self) -> None:
        """Leave the shadow pass. The outermost texels say "lit"; lookups beyond the map return them."""
        size = self.texture.width
        for border in ((0, 0, size, 1), (0, size - 1, size, 1), (0, 0, 1, size), (size - 1, 0, 1, size)):
            self._framebuffer.clear(depth=1.0, viewport=border)
        self._context.polygon_offset = 0.0, 0.0
