"""Where a driver is across its road, continuous over lane changes and from edge to edge."""

from dataclasses import dataclass

import numpy as np

from siren_ros.judging.lane_location import places_of
from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.roads.road_network import NO_LANE, RoadNetwork


@dataclass(frozen=True)
class LaneOffsets:
    """Arrays of shape ``(M,)``, one for each state of a track."""

    offset_m: Floats
    """From the centre line of the present lane; of the last one where the driver is in no lane."""
    lateral_m: Floats
    """Way to the left since the first state, relative to the road."""

    def select(self, rows: Flags) -> "LaneOffsets":
        """Some of the states."""
        return LaneOffsets(self.offset_m[rows], self.lateral_m[rows])


def lane_offsets(record: EpisodeRecord, track: StateRows) -> LaneOffsets:
    """Offsets of one actor. Where it changes between lanes of one edge, the way across goes on."""
    places = places_of(record, track)
    lane = _last_known(places.lane)
    offset = places.offset_m.copy()
    for off_lane in np.flatnonzero((places.lane == NO_LANE) & (lane != NO_LANE)).tolist():
        centre = record.network.lanes[int(lane[off_lane])].centre
        offset[off_lane] = float(centre.project(track.xy_m[off_lane])[1])
    jump = np.zeros(len(offset))
    changes = np.flatnonzero(lane[1:] != lane[:-1]) + 1
    for row in changes.tolist():
        if _same_edge(record.network, int(lane[row - 1]), int(lane[row])):
            moved = record.network.lanes[int(lane[row - 1])].centre.project(track.xy_m[row])[1]
            jump[row] = float(moved) - offset[row]
    lateral = offset + np.cumsum(jump)
    return LaneOffsets(offset, lateral - lateral[:1])


def _last_known(lane: np.ndarray[tuple[int], np.dtype[np.int32]]) -> np.ndarray[tuple[int], np.dtype[np.int32]]:
    known = np.where(lane != NO_LANE, np.arange(len(lane)), 0)
    return lane[np.maximum.accumulate(known)]


def _same_edge(network: RoadNetwork, before: int, after: int) -> bool:
    return NO_LANE not in (before, after) and network.lanes[before].edge == network.lanes[after].edge
