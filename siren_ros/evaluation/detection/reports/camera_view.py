"""Boxes in the front camera's picture of a frame."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from PIL import Image

from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.visibility import BOX_EDGES, upright_corners
from siren_ros.evaluation.detection.protocol.boxes import Boxes
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames
from siren_ros.interfaces.images import CameraIntrinsics, from_compressed_image
from siren_ros.numerics.arrays import Floats, Matrix

_LINE_PT: Final = 1.2
_NEAREST_M: Final = 0.5
"""Edges that come nearer to the camera's plane are left out."""


@dataclass(frozen=True)
class FrontPicture:
    """What the front camera saw at a frame."""

    rgb: npt.NDArray[np.uint8]
    model: CameraIntrinsics
    camera_from_map: Matrix


def front_picture(episode: EpisodeFrames, row: int) -> FrontPicture | None:
    """The picture of a frame; None where the front camera took none.

    Raises:
        BagError: The bag is damaged.
    """
    if episode.camera_from_lidar is None or not episode.pictured[row]:
        return None
    step = int(episode.step[row])
    with open_source(Path(episode.bag)) as source:
        camera = source.front_camera
        if camera is None:
            return None
        for found, held in source.messages_by_step({camera.topic}):
            if found == step:
                jpeg = from_compressed_image(held[camera.topic].read())
                rgb = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))
                camera_from_map = episode.camera_from_lidar @ np.linalg.inv(episode.map_from_lidar[row])
                return FrontPicture(rgb, camera.model, camera_from_map)
    return None


def draw_in_picture(axes: Axes, picture: FrontPicture, boxes: Mapping[str, Boxes], colours: Mapping[str, str]) -> None:
    """Draws the picture, and the edges of boxes in their colours over it."""
    height, width = picture.rgb.shape[:2]
    axes.imshow(picture.rgb)
    for name, some in boxes.items():
        lines = edges_in_picture(picture, some)
        axes.add_collection(LineCollection(list(lines), colors=colours[name], linewidths=_LINE_PT))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()


def edges_in_picture(picture: FrontPicture, boxes: Boxes) -> Floats:
    """Ends of the edges before the camera, in pixels, shape ``(E, 2, 2)``."""
    corners = upright_corners(boxes.centre_m, boxes.size_m, boxes.yaw_rad)
    seen = corners @ picture.camera_from_map[:3, :3].T + picture.camera_from_map[:3, 3]
    ends = seen[:, BOX_EDGES].reshape(-1, 2, 3)
    ends = ends[(ends[..., 2] > _NEAREST_M).all(axis=1)]
    model = picture.model
    columns = model.focal_x_px * ends[..., 0] / ends[..., 2] + model.centre_x_px
    rows = model.focal_y_px * ends[..., 1] / ends[..., 2] + model.centre_y_px
    found: Floats = np.stack((columns, rows), axis=-1)
    return found
