"""Encounters: the drivers that the EMV comes up to from behind, from then until it has passed them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.yielding.emv_line import EmvLine, OnLine
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.record.vehicle_location import places_of
from siren_ros.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.world.actors import Lights


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


@dataclass(frozen=True)
class Encounter:
    """One driver and the EMV behind it. Rows are the steps from the beginning to the end of the episode."""

    actor_id: int
    driver: OnLine
    emv: OnLine
    gap_m: Floats
    """From the EMV's front to the driver's rear along the line; negative while they are next to each other."""
    passed_row: int
    """First row at which the EMV's rear is ahead of the driver's front; −1 where the EMV does not pass it."""
    with_siren: bool
    """Whether the siren sounds at the beginning."""
    offsets: LaneOffsets
    """The driver across its road."""
    in_the_way: Flags
    """Whether the driver's body reaches into the strip that the EMV drives through, at each row."""

    @property
    def until_passed(self) -> slice:
        """Rows before the passing, or all."""
        return slice(0, self.passed_row if self.passed_row >= 0 else None)

    @property
    def was_in_the_way(self) -> bool:
        """Whether the driver had to make way: it was in the EMV's strip as the encounter began."""
        return bool(self.in_the_way[0])


def encounters_of(record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> Iterator[Encounter]:
    """All encounters of an episode, by actor id; at most one for each driver.

    An encounter begins when the driver is ahead of the EMV within ``encounter_m``, drives in its direction, and is at
    most ``beside_m`` from its line.
    """
    for actor_id, actor in record.actors.items():
        if actor.is_emv:
            continue
        found = _encounter(record, line, actor_id, limits)
        if found is not None:
            yield found


def _encounter(record: EpisodeRecord, line: EmvLine, actor_id: int, limits: YieldThresholds) -> Encounter | None:
    driver = line.place(record, actor_id)
    if not len(driver.track):
        return None
    emv = line.emv_at(driver)
    apart = driver.arc_m - emv.arc_m
    reach = driver.half_along_m + emv.half_along_m
    gap = apart - reach
    near = (gap > 0.0) & (gap <= limits.encounter_m) & (np.abs(driver.left_m) <= limits.beside_m) & driver.same_way
    if not near.any():
        return None
    rows = np.arange(len(near)) >= int(np.argmax(near))
    driver, emv, gap, apart, reach = driver.select(rows), emv.select(rows), gap[rows], apart[rows], reach[rows]
    behind = apart < -reach
    strip = np.abs(driver.left_m) < driver.half_across_m + 0.5 * line.width_m
    on_the_line = (driver.arc_m + driver.half_along_m > 0.0) & (
        driver.arc_m - driver.half_along_m < line.driven_m + 0.5 * line.length_m + limits.beyond_m
    )
    return Encounter(
        actor_id=actor_id,
        driver=driver,
        emv=emv,
        gap_m=gap,
        passed_row=int(np.argmax(behind)) if behind.any() else -1,
        with_siren=bool(emv.track.lights[0] & Lights.SIREN),
        offsets=lane_offsets(record, driver.track),
        in_the_way=np.asarray(strip & on_the_line),
    )
