"""A camera of a suite: noisy pictures as JPEG, and their labels."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import simplejpeg

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.sensing.camera.antialiasing import smooth_edges
from siren_ros.sensing.camera.raycast_renderer import RaycastRenderer
from siren_ros.sensing.camera.renderer import RenderedImage, Renderer
from siren_ros.sensing.meshes.placement import VehiclePlacement
from siren_ros.sensing.specification import CameraSpec, sensor_generator
from siren_ros.sensing.suite import LabelKinds
from siren_ros.simulation.world.measurements import CameraIntrinsics


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """One exposure. All its images show the same instant."""

    sensor: str
    step: int
    camera: CameraIntrinsics
    image: RenderedImage
    encoded: Future[bytes]
    """Gives the JPEG; the encoder may still be working on it."""

    @property
    def jpeg(self) -> bytes:
        """Colour image as JPEG."""
        return self.encoded.result()

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Colour image as ``rgb8``, contiguous, shape ``(height, width, 3)``."""
        return np.ascontiguousarray(self.image.rgba[..., :3])


class Camera:
    """One camera on one carrier; the renderer may serve several."""

    def __init__(self, spec: CameraSpec, renderer: Renderer | RaycastRenderer, seed: int, encoder: Executor) -> None:
        """Prepare the intrinsics; ``seed`` is the episode's. The encoder runs while the next picture is drawn."""
        self._encoder = encoder
        self.spec = spec
        self.intrinsics = spec.intrinsics
        self._renderer = renderer
        self._seed = seed

    def expose(
        self,
        step: int,
        map_from_camera: Matrix,
        placement: VehiclePlacement,
        rolled_m: Floats,
        signals: Mapping[str, str],
        labels: LabelKinds,
    ) -> Callable[[], CameraFrame]:
        """Begin a picture from a pose of the camera's body frame; the returned function waits for it. Call it once."""
        drawn: dict[str, Any] = {"labels": labels.depth, "instances": labels.instance or labels.boxes}
        scene = (map_from_camera, placement, rolled_m, signals, step)
        picture = self._renderer.begin(self.intrinsics, *scene, exposure=self.spec.exposure, **drawn)
        return partial(self._develop, step, picture)

    def _develop(self, step: int, picture: Callable[[], RenderedImage]) -> CameraFrame:
        image, spec = picture(), self.spec
        if spec.anti_aliasing:
            smooth_edges(image.rgba)
        colours = image.rgba[..., :3]  # noise and blur change the colours only, not the labels
        if spec.blur_px > 0.0:
            from scipy.ndimage import gaussian_filter  # noqa: PLC0415 - loads slowly, and few suites need it

            blurred = gaussian_filter(colours.astype(np.float32), spec.blur_px, axes=(0, 1), truncate=3.0)
            colours[:] = np.rint(blurred).astype(np.uint8)
        if spec.noise_stddev > 0.0:
            rng = sensor_generator(self._seed, spec.name, step)
            noise = rng.standard_normal(colours.shape, np.float32) * np.float32(spec.noise_stddev)
            colours[:] = np.clip(np.rint(colours + noise), 0, 255).astype(np.uint8)
        encode = partial(simplejpeg.encode_jpeg, colorspace="RGBX", colorsubsampling="420", fastdct=True)
        encoded = self._encoder.submit(encode, image.rgba, spec.jpeg_quality)
        return CameraFrame(spec.name, step, self.intrinsics, image, encoded)
