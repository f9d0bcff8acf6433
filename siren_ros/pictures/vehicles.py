"""Vehicles and their paths drawn from above."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize

from siren_ros.numerics.geometry import footprint_corners
from siren_ros.pictures.palette import SPEED_MAP, TEXT, colour_of
from siren_ros.recording.episode_record import StateRows
from siren_ros.world.actors import ActorDescription, ActorStates, Lights

KMH = 3.6


def draw_vehicles(axes: Axes, states: ActorStates, actors: Mapping[int, ActorDescription], line_width: float) -> None:
    """Draws footprints at one step, each with its windscreen to show which way it faces; EMVs on top."""
    described = [actors[int(key)] for key in states.actor_id]
    length = np.array([actor.length_m for actor in described])
    width = np.array([actor.width_m for actor in described])
    colours = [colour_of(int(mode), actor.is_emv) for mode, actor in zip(states.mode, described, strict=True)]
    bodies = footprint_corners(states.x_m, states.y_m, states.yaw_rad, length, width)
    ahead = 0.18 * length
    glass_x, glass_y = states.x_m + ahead * np.cos(states.yaw_rad), states.y_m + ahead * np.sin(states.yaw_rad)
    glass = footprint_corners(glass_x, glass_y, states.yaw_rad, 0.14 * length, 0.78 * width)
    axes.add_collection(
        PolyCollection(list(bodies), facecolors=colours, edgecolors=TEXT, linewidths=line_width, zorder=6)
    )
    axes.add_collection(PolyCollection(list(glass), facecolors=(1.0, 1.0, 1.0, 0.75), edgecolors="none", zorder=6.1))
    sounding = (states.lights & Lights.SIREN) != 0
    axes.scatter(states.x_m[sounding], states.y_m[sounding], s=14, marker="*", c="white", linewidths=0.0, zorder=6.2)


def draw_path(
    axes: Axes, track: StateRows, speeds: Normalize, width: float, casing: str | None = None, level: float = 3.0
) -> LineCollection | None:
    """Draws one path coloured by speed in km/h; None where there are fewer than two states.

    Args:
        axes: Where to draw.
        track: One actor's states in the order of time.
        speeds: Range of the colour scale, km/h.
        width: Line width in points.
        casing: Colour of an outline that sets the path off from others.
        level: Drawing order.
    """
    if len(track) < 2:
        return None
    segments = segments_of(track.xy_m)
    if casing is not None:
        axes.add_collection(
            LineCollection(segments, colors=casing, linewidths=width + 1.8, capstyle="round", zorder=level - 0.1)
        )
    lines = LineCollection(segments, cmap=SPEED_MAP, norm=speeds, linewidths=width, capstyle="round", zorder=level)
    lines.set_array(track.speed_mps[1:] * KMH)
    axes.add_collection(lines)
    return lines


def segments_of(xy_m: npt.NDArray[np.float64]) -> Sequence[npt.NDArray[np.float64]]:
    """Consecutive pairs of points, each of shape ``(2, 2)``."""
    return list(np.stack((xy_m[:-1], xy_m[1:]), axis=1))
