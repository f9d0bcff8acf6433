"""The line that the EMV drove, and would go on to drive, as the axis along which all others are measured."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.yielding.way_ahead import way_ahead
from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.polyline import Polyline
from siren_ros.recording.episode_record import EpisodeRecord, StateRows

SPACING_M = 1.0
LEAST_WAY_M = 5.0
"""An EMV that covers less has no line."""
_SAME_WAY_RAD = np.pi / 3.0


@dataclass(frozen=True)
class OnLine:
    """Where an actor is relative to the line; arrays of shape ``(M,)``, one row for each step of ``track``."""

    track: StateRows
    arc_m: Floats
    """Of its centre along the line."""
    left_m: Floats
    """Of its centre from the line."""
    turn_rad: Floats
    """Its heading relative to the line's."""
    half_along_m: Floats
    """Half the extent of its footprint along the line, as it is turned."""
    half_across_m: Floats
    """The same across the line."""

    def select(self, rows: Flags) -> "OnLine":
        """Some of the rows."""
        return OnLine(
            self.track.select(rows),
            self.arc_m[rows],
            self.left_m[rows],
            self.turn_rad[rows],
            self.half_along_m[rows],
            self.half_across_m[rows],
        )

    @property
    def same_way(self) -> Flags:
        """Whether it drives in the line's direction, within 60°."""
        return np.asarray(np.abs(self.turn_rad) < _SAME_WAY_RAD)


@dataclass(frozen=True)
class EmvLine:
    """The first EMV's line: where it drove, and from there on along its lane, where those ahead of it are."""

    line: Polyline
    emv: OnLine
    driven_m: float
    """Arc length at which the EMV's record ends."""
    length_m: float
    """Of the EMV's body."""
    width_m: float

    @classmethod
    def of(cls, record: EpisodeRecord) -> Self | None:
        """The line of an episode; None where the EMV does not move.

        Raises:
            InputError: The episode has no EMV.
        """
        if not record.emv_ids or record.emv_ids[0] not in record.actors:
            raise InputError("episode", record.description.template, "one with an EMV")
        track = record.track(record.emv_ids[0])
        way = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m)))))
        if not len(track) or way[-1] < LEAST_WAY_M:
            return None
        # One point per metre: what the pose does at standstill is no line.
        marks = np.searchsorted(way, np.arange(0.0, way[-1], SPACING_M))
        driven = Polyline.through(track.xy_m[np.unique(np.append(marks, len(way) - 1))])
        line = Polyline.through(np.concatenate((driven.points, way_ahead(record, track))))
        body = record.actors[record.emv_ids[0]]
        placed = on_line(line, track, body.length_m, body.width_m)
        return cls(line, placed, driven.length_m, body.length_m, body.width_m)

    def place(self, record: EpisodeRecord, actor_id: int) -> OnLine:
        """Another actor relative to the line, at the steps at which the EMV is there too."""
        body = record.actors[actor_id]
        track = record.track(actor_id)
        track = track.select(np.isin(track.step, self.emv.track.step))
        return on_line(self.line, track, body.length_m, body.width_m)

    def emv_at(self, other: OnLine) -> OnLine:
        """The EMV at the steps of another actor's rows."""
        return self.emv.select(np.isin(self.emv.track.step, other.track.step))


def on_line(line: Polyline, track: StateRows, length_m: float, width_m: float) -> OnLine:
    """A track relative to a line."""
    arc, left = line.project(track.xy_m) if len(track) else (np.empty(0), np.empty(0))
    turn = np.asarray(wrap_angle(track.yaw_rad - line.heading_rad(arc)))
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    along, across = 0.5 * (length_m * cos + width_m * sin), 0.5 * (length_m * sin + width_m * cos)
    return OnLine(track, arc, left, turn, along, across)
