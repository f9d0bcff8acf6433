"""Labels, hits, misses and false alarms of one frame from above, and in the front camera's picture."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from siren_ros.errors import whole_file
from siren_ros.evaluation.detection.metrics.matching import DISTANCES_M
from siren_ros.evaluation.detection.protocol.boxes import Boxes, FoundBoxes
from siren_ros.evaluation.detection.protocol.frames import RANGE_M, EpisodeFrames, Frames
from siren_ros.evaluation.detection.reports.camera_view import draw_in_picture, front_picture
from siren_ros.evaluation.detection.reports.recorded_sweep import returns_from_above
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.numerics.geometry import footprint_corners

_AT_M: Final = 2.0
"""Distance of a match in the picture: that of nuScenes' true-positive errors."""
_SHOWN_SCORE: Final = 0.3
"""Less confident detections are left out of the picture."""
_WIDTH_IN: Final = 7.0
_HEIGHTS_IN: Final = (7.4, 7.8)
"""Of the picture from above alone, and with the front camera's."""
_SMALL_PT: Final = 6
_LEGEND_PT: Final = 7
_TITLE_PT: Final = 8
_LINE_PT: Final = 1.4
_RETURN_PT: Final = 1.2
_SENSOR_PT: Final = 4
_TEXT_OFFSET_PT: Final = (4, 4)
_BEHIND: Final = 0
_FILLED: Final = 0.45
"""Opacity of the labels; detections are outlines."""
_MARGIN_M: Final = 2.0
_ARROW_M: Final = 5.0
_ARROW: Final = {"arrowstyle": "-|>", "color": "k", "shrinkA": 0.0, "shrinkB": 0.0}
_DPI: Final = 120
_COLOURS: Final = {"label, found": "#2a9d3a", "label, missed": "#d62828", "hit": "#1f77b4", "false alarm": "#f39c12"}


def draw_worst_frame(scores: DetectorScores, frames: Frames, template: str, path: Path) -> None:
    """Draws the frame of a template that has the most misses and false alarms, and the text says which it is.

    Raises:
        BagError: The bag is damaged.
    """
    number = DISTANCES_M.index(_AT_M)
    matched = scores.matches.label[number]
    found = scores.found.at(scores.matches.order)
    shown, hit = found.score >= _SHOWN_SCORE, matched >= 0
    taken = np.zeros(len(scores.truth), dtype=np.bool_)
    taken[matched[hit & shown]] = True
    frame = _worst_frame(frames, template, scores.truth.frame, scores.truth.frame[~taken], found.frame[~hit & shown])
    in_truth, in_found = scores.truth.frame == frame, (found.frame == frame) & shown
    groups: dict[str, Boxes] = {
        "label, found": scores.truth.at(in_truth & taken),
        "label, missed": scores.truth.at(in_truth & ~taken),
        "hit": found.at(in_found & hit),
        "false alarm": found.at(in_found & ~hit),
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
        _draw(axes, boxes, episode.vehicle_m[row], name)
    axes.legend(fontsize=_LEGEND_PT, loc="upper right", framealpha=1.0)
    axes.set_title(
        f"{scores.name}: {frames.told(frame)}\nthe frame of {template} with the most errors: detections with a "
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
    """Of the frames with labels; the first of several."""
    count = len(frames)
    errors = np.bincount(missed, minlength=count) + np.bincount(alarms, minlength=count)
    of_template = np.array([one.template == template for one in frames.episodes])[frames.episode]
    usable = of_template & (np.bincount(labelled, minlength=count) > 0)
    return int(np.argmax(np.where(usable, errors, -1)))


def _draw_surroundings(axes: Axes, episode: EpisodeFrames, row: int) -> None:
    """What the LiDAR saw, the range that counts, and the sensor with its direction."""
    x_m, y_m = (returns_from_above(episode, row) - episode.vehicle_m[row]).T
    told = "returns 0.3 to 3 m above the ground"
    axes.plot(x_m, y_m, ".", color="0.5", markersize=_RETURN_PT, zorder=_BEHIND, label=told)
    axes.add_patch(Circle((0.0, 0.0), RANGE_M, fill=False, color="0.7", linestyle="--"))
    ahead = episode.map_from_lidar[row][:2, 0]
    axes.annotate("", _ARROW_M * ahead, (0.0, 0.0), arrowprops=_ARROW)
    axes.plot(0.0, 0.0, "ko", markersize=_SENSOR_PT, label="sensor; lines point to the front")
    limit = RANGE_M + _MARGIN_M
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="east of the sensor [m]", ylabel="north [m]")
    axes.set_aspect("equal")


def _draw(axes: Axes, boxes: Boxes, place: Floats, name: str) -> None:
    """Boxes with a line from the centre to the front, and the confidence of what is wrong."""
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
            axes.annotate(
                f"{score:.2f}",
                (x_m, y_m),
                _TEXT_OFFSET_PT,
                textcoords="offset points",
                fontsize=_SMALL_PT,
                color=colour,
            )
