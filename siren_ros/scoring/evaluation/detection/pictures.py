"""Draws detections: the worst frame from above and in the front camera, and precision over recall."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image

from siren_ros.base.numerics.arrays import Floats, Matrix, Rows
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.data.datasets.visibility import BOX_EDGES, upright_corners
from siren_ros.data.episode_source import EpisodeSource, lidar_of, open_source
from siren_ros.data.interfaces.measurements import from_compressed_image, from_point_cloud
from siren_ros.errors import whole_file
from siren_ros.scoring.evaluation.detection.boxes import Boxes, FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import RANGE_M, EpisodeFrames, Frames
from siren_ros.scoring.evaluation.detection.metrics import DISTANCES_M
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.simulation.world.carrier import CameraIntrinsics

_LOW_M: Final = 0.3
_HIGH_M: Final = 3.0
"""Range of heights above the ground in which a return can come from a vehicle."""


def returns_from_above(episode: EpisodeFrames, row: int) -> Floats:
    """Returns of a frame at the height of vehicles, x and y in the ``map`` frame, shape ``(N, 2)``.

    Raises:
        BagError: The bag is damaged.
    """
    map_from_lidar = episode.map_from_lidar[row]
    ground_m = (map_from_lidar @ np.linalg.inv(episode.base_from_lidar))[2, 3]
    with open_source(Path(episode.bag)) as source:
        message = _message_at(source, lidar_of(source).topic, int(episode.step[row]))
    if message is None:
        return np.zeros((0, 2))
    points = from_point_cloud(message)
    xyz = np.stack([points[name].astype(np.float64) for name in ("x", "y", "z")], axis=-1)
    xyz = xyz @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3]
    height = xyz[:, 2] - ground_m
    return np.asarray(xyz[(height > _LOW_M) & (height < _HIGH_M), :2])


def _message_at(source: EpisodeSource, topic: str, step: int) -> Any:
    """The message of a topic at a step; None where there is none."""
    return next((held[topic].read() for at, held in source.messages_by_step({topic}) if at == step), None)


_EDGE_PT: Final = 1.2
_NEAREST_M: Final = 0.5
"""Edges nearer to the camera's plane than this are left out."""


@dataclass(frozen=True)
class FrontPicture:
    """The front camera's picture of a frame."""

    rgb: npt.NDArray[np.uint8]
    model: CameraIntrinsics
    camera_from_map: Matrix


def front_picture(episode: EpisodeFrames, row: int) -> FrontPicture | None:
    """The picture of a frame; None if the front camera took none.

    Raises:
        BagError: The bag is damaged.
    """
    if episode.camera_from_lidar is None or not episode.pictured[row]:
        return None
    with open_source(Path(episode.bag)) as source:
        camera = source.front_camera
        message = None if camera is None else _message_at(source, camera.topic, int(episode.step[row]))
    if camera is None or message is None:
        return None
    rgb = np.asarray(Image.open(io.BytesIO(from_compressed_image(message))).convert("RGB"))
    camera_from_map = episode.camera_from_lidar @ np.linalg.inv(episode.map_from_lidar[row])
    return FrontPicture(rgb, camera.model, camera_from_map)


def draw_in_picture(axes: Axes, picture: FrontPicture, boxes: Mapping[str, Boxes], colours: Mapping[str, str]) -> None:
    """Draw the picture, and the edges of boxes over it in their colours."""
    height, width = picture.rgb.shape[:2]
    axes.imshow(picture.rgb)
    for name, group in boxes.items():
        lines = list(edges_in_picture(picture, group))
        axes.add_collection(LineCollection(lines, colors=colours[name], linewidths=_EDGE_PT))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()


def edges_in_picture(picture: FrontPicture, boxes: Boxes) -> Floats:
    """End points of the edges in front of the camera, in pixels, shape ``(E, 2, 2)``."""
    corners = upright_corners(boxes.centre_m, boxes.size_m, boxes.yaw_rad)
    seen = corners @ picture.camera_from_map[:3, :3].T + picture.camera_from_map[:3, 3]
    ends = seen[:, BOX_EDGES].reshape(-1, 2, 3)
    ends = ends[(ends[..., 2] > _NEAREST_M).all(axis=1)]
    model = picture.model
    columns = model.focal_x_px * ends[..., 0] / ends[..., 2] + model.centre_x_px
    rows = model.focal_y_px * ends[..., 1] / ends[..., 2] + model.centre_y_px
    return np.asarray(np.stack((columns, rows), axis=-1))


_AT_M: Final = 2.0
"""Distance threshold of a match in the picture, that of nuScenes' true-positive errors."""
_SHOWN_SCORE: Final = 0.3
"""Detections with a lower confidence are not drawn."""
_WIDTH_IN: Final = 7.0
_HEIGHTS_IN: Final = (7.4, 7.8)
"""Heights of the figure: only the view from above, and with the front camera's picture."""
_SMALL_PT, _LEGEND_PT, _TITLE_PT = 6, 7, 8
_LINE_PT, _RETURN_PT, _SENSOR_PT = 1.4, 1.2, 4
_TEXT_OFFSET_PT: Final = (4, 4)
_BEHIND: Final = 0
_FILLED: Final = 0.45
"""Opacity of the labels; detections are drawn as outlines."""
_MARGIN_M: Final = 2.0
_ARROW_M: Final = 5.0
_ARROW: Final = {"arrowstyle": "-|>", "color": "k", "shrinkA": 0.0, "shrinkB": 0.0}
_DPI: Final = 120
_COLOURS: Final = {"label, found": "#2a9d3a", "label, missed": "#d62828", "hit": "#1f77b4", "false alarm": "#f39c12"}


def draw_worst_frame(scores: DetectorScores, frames: Frames, template: str, path: Path) -> None:
    """Draw the frame of a template with the most misses and false alarms; its title names the frame.

    Raises:
        BagError: The bag is damaged.
    """
    matched = scores.matches.label[DISTANCES_M.index(_AT_M)]
    truth, detected = scores.truth, scores.found.at(scores.matches.order)
    shown, hit = detected.score >= _SHOWN_SCORE, matched >= 0
    taken = np.zeros(len(truth), dtype=np.bool_)
    taken[matched[hit & shown]] = True
    frame = _worst_frame(frames, template, truth.frame, truth.frame[~taken], detected.frame[~hit & shown])
    labelled, in_frame = truth.frame == frame, (detected.frame == frame) & shown
    groups: dict[str, Boxes] = {
        "label, found": truth.at(labelled & taken),
        "label, missed": truth.at(labelled & ~taken),
        "hit": detected.at(in_frame & hit),
        "false alarm": detected.at(in_frame & ~hit),
    }
    episode = frames.episodes[int(frames.episode[frame])]
    row = frame - int(frames.first[frames.episode[frame]])
    picture = front_picture(episode, row)
    columns = 1 if picture is None else 2
    figure = Figure(figsize=(columns * _WIDTH_IN, _HEIGHTS_IN[columns - 1]), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(1, columns, 1)
    _draw_surroundings(axes, episode, row)
    for name, boxes in groups.items():
        draw_boxes(axes, boxes, episode.vehicle_m[row], name)
    axes.legend(fontsize=_LEGEND_PT, loc="upper right", framealpha=1.0)
    axes.set_title(
        f"{scores.name}: {frames.name_of(frame)}\nthe frame of {template} with the most errors: detections with a "
        f"confidence from {_SHOWN_SCORE:g} on, matches within {_AT_M:g} m",
        fontsize=_TITLE_PT,
    )
    if picture is not None:
        other = figure.add_subplot(1, columns, columns)
        draw_in_picture(other, picture, groups, _COLOURS)
        other.set_title("the same boxes in the front camera", fontsize=_TITLE_PT)
    with whole_file(path) as file:
        figure.savefig(file, dpi=_DPI, metadata={"Software": None})


def _worst_frame(frames: Frames, template: str, labelled: Rows, missed: Rows, alarms: Rows) -> int:
    """The frame with the most misses and false alarms among frames with labels; of equal ones the first."""
    count = len(frames)
    errors = np.bincount(missed, minlength=count) + np.bincount(alarms, minlength=count)
    of_template = np.array([episode.template == template for episode in frames.episodes])[frames.episode]
    usable = of_template & (np.bincount(labelled, minlength=count) > 0)
    return int(np.argmax(np.where(usable, errors, -1)))


def _draw_surroundings(axes: Axes, episode: EpisodeFrames, row: int) -> None:
    """Draw the returns, the scored range, and the sensor with its direction."""
    x_m, y_m = (returns_from_above(episode, row) - episode.vehicle_m[row]).T
    legend = "returns 0.3 to 3 m above the ground"
    axes.plot(x_m, y_m, ".", color="0.5", markersize=_RETURN_PT, zorder=_BEHIND, label=legend)
    axes.add_patch(Circle((0.0, 0.0), RANGE_M, fill=False, color="0.7", linestyle="--"))
    ahead = episode.map_from_lidar[row][:2, 0]
    axes.annotate("", _ARROW_M * ahead, (0.0, 0.0), arrowprops=_ARROW)
    axes.plot(0.0, 0.0, "ko", markersize=_SENSOR_PT, label="sensor; lines point to the front")
    limit = RANGE_M + _MARGIN_M
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="east of the sensor [m]", ylabel="north [m]")
    axes.set_aspect("equal")


def draw_boxes(axes: Axes, boxes: Boxes, place: Floats, name: str) -> None:
    """Draw boxes from above, each with a line from its centre to its front, and the confidence of false alarms.

    Args:
        axes: In metres from the sensor, east and north.
        boxes: Boxes on the map.
        place: The sensor's x and y on the map.
        name: What they are, for the legend: ``hit``, ``false alarm``, ``label, found`` or ``label, missed``.
    """
    centre = boxes.centre_m[:, :2] - place
    corners = footprint_corners(centre[:, 0], centre[:, 1], boxes.yaw_rad, boxes.size_m[:, 0], boxes.size_m[:, 1])
    is_label = name.startswith("label")
    colour = _COLOURS[name]
    outlines = PolyCollection(
        list(corners),
        facecolors=colour if is_label else "none",
        edgecolors=colour,
        alpha=_FILLED if is_label else 1.0,
        linewidths=_LINE_PT,
        label=f"{name}: {len(boxes)}",
    )
    axes.add_collection(outlines)
    fronts = corners[:, (0, 3)].mean(axis=1)
    axes.add_collection(LineCollection(list(np.stack((centre, fronts), axis=1)), colors=colour, linewidths=_LINE_PT))
    if isinstance(boxes, FoundBoxes) and name == "false alarm":
        for (x_m, y_m), score in zip(centre.tolist(), boxes.score.tolist(), strict=True):
            style: dict[str, Any] = {"textcoords": "offset points", "fontsize": _SMALL_PT, "color": colour}
            axes.annotate(f"{score:.2f}", (x_m, y_m), _TEXT_OFFSET_PT, **style)


_COLUMNS: Final = 4
_PANEL_IN: Final = (3.2, 3.0)
_CURVE_TITLE_PT, _CURVE_LEGEND_PT = 9, 6
_HIGHEST: Final = 1.02
"""Upper limit of the axis, so that a line at 1 is visible."""


def draw_curves(scores: DetectorScores, path: Path) -> None:
    """Draw precision over recall: a panel per template, a line per distance threshold."""
    rows = -(-len(scores.templates) // _COLUMNS)
    columns = min(_COLUMNS, len(scores.templates))
    figure = Figure(figsize=(_PANEL_IN[0] * columns, _PANEL_IN[1] * rows), layout="constrained")
    FigureCanvasAgg(figure)
    recall = np.linspace(0.0, 1.0, 101)
    for number, (name, score) in enumerate(scores.templates.items()):
        axes = figure.add_subplot(rows, columns, number + 1)
        for distance_m, precision in zip(DISTANCES_M, score.precision, strict=True):
            axes.plot(recall, precision, label=f"{distance_m:g} m, AP {score.average_precision[distance_m]:.2f}")
        axes.set_title(f"{name}: mAP {score.mean_average_precision:.3f}", fontsize=_CURVE_TITLE_PT)
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, _HIGHEST), xlabel="recall", ylabel="precision")
        axes.legend(fontsize=_CURVE_LEGEND_PT, loc="lower left")
    figure.suptitle(f"{scores.name}: Car, for each largest distance of a match", fontsize=_CURVE_TITLE_PT)
    with whole_file(path) as file:
        figure.savefig(file, dpi=_DPI, metadata={"Software": None})
