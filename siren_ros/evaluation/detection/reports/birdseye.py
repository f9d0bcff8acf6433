"""Labels, hits, misses and false alarms of one frame from above, and in the front camera's picture."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from siren_ros.evaluation.detection.metrics.matching import DISTANCES_M
from siren_ros.evaluation.detection.protocol.boxes import Boxes
from siren_ros.evaluation.detection.protocol.frames import RANGE_M, Frames
from siren_ros.evaluation.detection.reports.camera_view import draw_in_picture, front_picture
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import footprint_corners

_AT_M: Final = 2.0
"""Distance of a match in the picture: that of nuScenes' true-positive errors."""
_SHOWN_SCORE: Final = 0.3
"""Less confident detections are left out of the picture."""
_COLOURS: Final = {"label, found": "#2a9d3a", "label, missed": "#d62828", "hit": "#1f77b4", "false alarm": "#f39c12"}


def draw_worst_frame(scores: DetectorScores, frames: Frames, template: str, path: Path) -> None:
    """Draws the frame of a template that has the most misses and false alarms, and the text says which it is."""
    number = DISTANCES_M.index(_AT_M)
    matched = scores.matches.label[number]
    found = scores.found.at(scores.matches.order)
    shown = found.score >= _SHOWN_SCORE
    hit = matched >= 0
    taken = np.zeros(len(scores.truth), dtype=np.bool_)
    taken[matched[hit & shown]] = True
    errors = np.bincount(scores.truth.frame[~taken], minlength=len(frames)) + np.bincount(
        found.frame[~hit & shown], minlength=len(frames)
    )
    of_template = np.array([one.template == template for one in frames.episodes])[frames.episode]
    frame = int(
        np.argmax(np.where(of_template & (np.bincount(scores.truth.frame, minlength=len(frames)) > 0), errors, -1))
    )
    in_truth, in_found = scores.truth.frame == frame, (found.frame == frame) & shown
    groups: dict[str, Boxes] = {
        "label, found": scores.truth.at(in_truth & taken),
        "label, missed": scores.truth.at(in_truth & ~taken),
        "hit": found.at(in_found & hit),
        "false alarm": found.at(in_found & ~hit),
    }
    episode = int(frames.episode[frame])
    picture = front_picture(frames.episodes[episode], frame - int(frames.first[episode]))
    figure = Figure(figsize=(6.4 if picture is None else 13.6, 6.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(1, 1 if picture is None else 2, 1)
    place = frames.vehicle_m[frame]
    for name, boxes in groups.items():
        _draw(axes, boxes, place, name)
    if picture is not None:
        draw_in_picture(figure.add_subplot(1, 2, 2), picture, groups, _COLOURS)
    axes.plot(0.0, 0.0, "k^", markersize=8)
    axes.set(xlim=(-RANGE_M, RANGE_M), ylim=(-RANGE_M, RANGE_M), xlabel="east of the sensor [m]", ylabel="north [m]")
    axes.set_aspect("equal")
    axes.legend(fontsize=7, loc="upper right")
    axes.set_title(
        f"{scores.name}: {frames.told(frame)}\nthe frame of {template} with the most errors "
        f"(confidence from {_SHOWN_SCORE:g}, matches within {_AT_M:g} m)",
        fontsize=8,
    )
    figure.savefig(path, dpi=120, metadata={"Software": None})


def _draw(axes: Axes, boxes: Boxes, place: Floats, name: str) -> None:
    x_m, y_m = (boxes.centre_m[:, :2] - place).T
    corners = footprint_corners(x_m, y_m, boxes.yaw_rad, boxes.size_m[:, 0], boxes.size_m[:, 1])
    is_label = name.startswith("label")
    colour = _COLOURS[name]
    outlines = PolyCollection(
        list(corners),
        facecolors=colour if is_label else "none",
        edgecolors=colour,
        alpha=0.45 if is_label else 1.0,
        linewidths=1.4,
        label=f"{name}: {len(boxes)}",
    )
    axes.add_collection(outlines)
