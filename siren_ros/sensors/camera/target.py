"""Framebuffers that a picture is drawn to and read from."""

import moderngl
import numpy as np

from siren_ros.sensors.camera.rendered_image import RenderedImage


class Target:
    """Framebuffers of one picture size; labels are attached only where they are asked for."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        """Allocate memory for a picture and its labels."""
        size = (width, height)
        self._colour = context.texture(size, 4)
        self._actor = context.texture(size, 1, dtype="u4")
        self._depth = context.texture(size, 1, dtype="f4")
        buffer = context.depth_renderbuffer(size)
        self.plain = context.framebuffer([self._colour], buffer)
        self.instances = context.framebuffer([self._colour, self._actor], buffer)
        self.labelled = context.framebuffer([self._colour, self._actor, self._depth], buffer)
        self._shape = (height, width)

    def read(self, *, instances: bool, depth: bool) -> RenderedImage:
        """Wait for the drawing; return its pixels, with the labels that were drawn."""
        rgba = np.empty((*self._shape, 4), np.uint8)
        self.plain.read_into(rgba, components=4, alignment=1)
        actor = depth_m = None
        if instances:
            actor = np.empty(self._shape, np.uint32)
            self.instances.read_into(actor, components=1, attachment=1, dtype="u4", alignment=1)
        if depth:
            depth_m = np.empty(self._shape, np.float32)
            self.labelled.read_into(depth_m, components=1, attachment=2, dtype="f4", alignment=1)
        return RenderedImage(rgba, actor, depth_m)
