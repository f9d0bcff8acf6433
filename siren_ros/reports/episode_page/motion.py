"""Stores actors and their motion as columns: one row per actor and frame, from its first frame to its last."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, shown_text
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.reports.episode_page.emv_measures import measures_of_emvs
from siren_ros.simulation.world.actors import ActorDescription

_FARTHEST_M: Final = 2e6
"""Largest coordinate that a 32-bit column holds in millimetres."""
ABSENT: Final = 255
"""Mode that marks a frame in which an actor is absent, between frames in which it is present."""
_UNITS: Final[Mapping[str, tuple[float, int]]] = {
    "x_m": (0.001, 2),
    "y_m": (0.001, 2),
    "z_m": (0.001, 2),
    "yaw_rad": (0.0002, 2),
    "speed_mps": (0.01, 1),
    "accel_mps2": (0.01, 1),
    "steer_rad": (0.005, 1),
    "residual_m": (0.001, 1),
    "owner": (1.0, 1),
    "lights": (1.0, 1),
    "mode": (1.0, 1),
}
"""Unit and order (``ColumnFile.add``) of each column."""


def check_motion(record: EpisodeRecord) -> None:
    """Check that a record can be shown; damaged bags often cannot.

    Raises:
        InputError: No states, states that are no numbers or far away, or actors without a description.
    """
    rows, template = record.rows, record.description.template
    if len(rows) == 0:
        raise InputError("bag", template, "an episode with at least one recorded actor state")
    known = all(
        actor_id in record.actors and all(0.0 < size < _FARTHEST_M for size in _size_m(record.actors[actor_id]))
        for actor_id in np.unique(rows.actor_id).tolist()
    )
    if not known or not all((np.abs(getattr(rows, name)) < _FARTHEST_M).all() for name in _UNITS):
        raise InputError("bag", template, "an episode whose states and sizes are numbers within 2,000 km")


def _size_m(actor: ActorDescription) -> tuple[float, float, float]:
    return actor.length_m, actor.width_m, actor.height_m


def add_motion(file: ColumnFile, record: EpisodeRecord, prefix: str = "") -> list[dict[str, Any]]:
    """Add the columns ``frame.step`` and ``motion.*``; returns the actors for the head, in the order of the columns.

    The columns' names begin with ``prefix``.
    """
    rows = record.rows
    steps = np.array([state.step for state in record.states], np.int64)
    file.add(f"{prefix}frame.step", steps)
    frame = np.searchsorted(steps, rows.step)
    actors, gathered, absent = [], [], []
    for actor_id in np.unique(rows.actor_id).tolist():
        mine = record.rows_of(actor_id)
        frames = frame[mine]
        every = np.arange(frames[0], frames[-1] + 1)
        latest = np.searchsorted(frames, every, side="right") - 1
        gathered.append(mine[latest])
        absent.append(frames[latest] != every)
        actors.append(_actor(record.actors[actor_id]) | {"first": int(frames[0]), "frames": len(every)})
    row = np.concatenate(gathered) if gathered else np.empty(0, np.intp)
    hidden = np.concatenate(absent) if absent else np.empty(0, np.bool_)
    for name, (unit, order) in _UNITS.items():
        values: npt.NDArray[Any] = getattr(rows, name)[row]
        if name == "yaw_rad":
            values = np.unwrap(values)
        file.add(f"{prefix}motion.{name}", np.where(hidden, ABSENT, values) if name == "mode" else values, unit, order)
    for name, of_emvs in zip(("ttc_s", "gap_m", "delay_s"), measures_of_emvs(record), strict=True):
        file.add(f"{prefix}motion.{name}", of_emvs[row], 0.01)
    return actors


def _actor(actor: ActorDescription) -> dict[str, Any]:
    red, green, blue = actor.colour_rgb
    return {
        "id": actor.actor_id,
        "name": shown_text(actor.name),
        "class": actor.actor_class.name,
        "size_m": [round(size, 4) for size in _size_m(actor)],
        "rgb": (red << 16) + (green << 8) + blue,
        "emv": actor.is_emv,
    }
