"""The profile of an episode (drawn parameters, the EMV's path, the order of events), and distances of profiles."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.simulation.world.traffic_state import EventKind

POINT_STEPS: Final = round(1.0 / STEP_S)
"""Steps between two points of a path: one second."""
BEGIN: Final = "begin"
END: Final = "end"
_EMV_EVENTS: Final = frozenset(
    {
        EventKind.LANE_CHANGE_STARTED,
        EventKind.CORRIDOR_ENTERED,
        EventKind.CORRIDOR_LEFT,
        EventKind.GAP_ESCAPE_ENTERED,
        EventKind.GAP_ESCAPE_LEFT,
        EventKind.STOP_LINE_CROSSED,
    }
)
_CIVILIAN_EVENTS: Final = frozenset(kind for kind in EventKind if kind.startswith("yield_")) - {
    EventKind.YIELD_REQUESTED
}


@dataclass(frozen=True)
class InteractionProfile:
    """Profile of one episode."""

    bag: str
    template: str
    level: str
    seed: int
    map_name: str
    draw: str
    parameters: Mapping[str, float]
    """Values of the template's parameters, by their path in the template's file."""
    way_m: Floats
    """Positions of the EMV, one per second, in the frame of its first pose (x ahead, y left); shape ``(T, 2)``."""
    happenings: tuple[str, ...]
    """Events of the interaction in order, such as ``emv stop_line_crossed``; repeated ones are merged."""

    @property
    def group(self) -> tuple[str, str, str]:
        """Template, level and map. Episodes of one group differ in their seeds and draws."""
        return self.template, self.level, self.map_name

    @property
    def transitions(self) -> frozenset[tuple[str, str]]:
        """Pairs of events that follow each other directly."""
        return frozenset(pairwise((BEGIN, *self.happenings, END)))


def profile_of(bag: str, record: EpisodeRecord) -> InteractionProfile:
    """Compute the profile of a record.

    Raises:
        InputError: The episode has no EMV that was recorded.
    """
    described = record.description
    return InteractionProfile(
        bag,
        described.template,
        described.level.name,
        described.seed,
        described.map_name,
        described.draw,
        described.template_values,
        emv_way_m(record),
        tuple(_happenings(record)),
    )


def emv_way_m(record: EpisodeRecord) -> Floats:
    """Positions of the EMV, one per second, in the frame of its first pose; shape ``(T, 2)``."""
    track = record.track(record.emv_ids[0]) if record.emv_ids else None
    if track is None or not len(track):
        raise InputError("bag", record.description.template, "an episode with an EMV")
    apart = track.xy_m[::POINT_STEPS] - track.xy_m[0]
    cos, sin = np.cos(track.yaw_rad[0]), np.sin(track.yaw_rad[0])
    return np.asarray(apart @ np.array([[cos, -sin], [sin, cos]]), dtype=np.float64)


def _happenings(record: EpisodeRecord) -> Iterator[str]:
    emvs = frozenset(record.emv_ids)
    before = ""
    for event in record.events:
        if event.actor_id in emvs and event.kind in _EMV_EVENTS:
            name = f"emv {event.kind}"
        elif event.kind in _CIVILIAN_EVENTS:
            name = f"civilian {event.kind}"
        elif event.kind is EventKind.COLLISION:
            name = str(event.kind)
        else:
            continue
        if name != before:
            yield name
            before = name


def way_distance_m(first: InteractionProfile, second: InteractionProfile) -> float:
    """Mean distance between both EMVs at equal times, as long as both were recorded.

    The mean over pairs is the average self distance of Y. Yuan and K. Kitani (DLow, ECCV 2020), of whole episodes.
    """
    points = min(len(first.way_m), len(second.way_m))
    return float(np.hypot(*(first.way_m[:points] - second.way_m[:points]).T).mean())


def event_distance(first: InteractionProfile, second: InteractionProfile) -> float:
    """Levenshtein distance of two orders of events as a share of the longer one, 0 to 1."""
    longest = max(len(first.happenings), len(second.happenings))
    return _edits(first.happenings, second.happenings) / longest if longest else 0.0


def _edits(first: Sequence[str], second: Sequence[str]) -> int:
    row = list(range(len(second) + 1))
    for count, left in enumerate(first, start=1):
        before, row[0] = row[0], count
        for place, right in enumerate(second, start=1):
            kept = before + (left != right)
            before = row[place]
            row[place] = min(kept, before + 1, row[place - 1] + 1)
    return row[-1]


def distance_matrix(
    profiles: Sequence[InteractionProfile], distance: Callable[[InteractionProfile, InteractionProfile], float]
) -> Floats:
    """Distances between all pairs, shape ``(N, N)``, zero on the diagonal."""
    matrix = np.zeros((len(profiles), len(profiles)))
    for row, profile in enumerate(profiles):
        for column in range(row):
            matrix[row, column] = matrix[column, row] = distance(profile, profiles[column])
    return matrix
