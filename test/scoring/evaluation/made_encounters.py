"""Records of an EMV that comes up to cars on the road to the north of the small crossing."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from hand_made_record import EMV, NORTHBOUND, Driven, crossing, hand_made, line

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.yielding.encounters import EmvLine, Encounter, YieldThresholds, encounters_of
from siren_ros.simulation.world.actors import Lights

CAR = 2
STEPS = 240
IN_LANE = line((5.25, -120.0), (5.25, 110.0))
PULLS_RIGHT = line((5.25, -120.0), (5.25, -60.0), (7.85, -50.0), (7.85, -20.0), (5.25, -10.0), (5.25, 110.0))
"""Leaves the lane by 2.6 m over 10 m, and comes back behind the stop line."""


def arc(*pieces: tuple[float, float], start_m: float = 0.0) -> npt.NDArray[np.float64]:
    """Arc lengths of consecutive (speed in m/s, time in s) pieces."""
    speeds = np.concatenate([np.full(round(time_s / STEP_S), speed) for speed, time_s in pieces])
    return start_m + np.concatenate(([0.0], np.cumsum(speeds * STEP_S)))


def record_of(emv_arc_m: npt.NDArray[np.float64], cars: dict[int, Driven], siren: bool = True) -> EpisodeRecord:
    """The record; the EMV drives north in the right lane."""
    record = hand_made(crossing(), {EMV: Driven(NORTHBOUND, emv_arc_m), **cars})
    if not siren:
        return record
    sounding = []
    for states in record.states:
        lights = states.lights.copy()
        lights[states.actor_id == EMV] |= int(Lights.SIREN)
        sounding.append(replace(states, lights=lights))
    return replace(record, states=tuple(sounding))


def passing(siren: bool = True) -> EpisodeRecord:
    """An EMV at 10 m/s comes up to a car at 5 m/s that pulls to the right and comes back."""
    return record_of(arc((10.0, 20.0)), {CAR: Driven(PULLS_RIGHT, arc((5.0, 30.0), start_m=46.0))}, siren=siren)


def blocking() -> EpisodeRecord:
    """A car stands in the lane; the EMV comes up, stands 5 m behind it until the end."""
    return record_of(arc((10.0, 4.0), (0.0, 6.0)), {CAR: Driven(IN_LANE, arc((0.0, 10.0), start_m=50.0))})


def line_of(record: EpisodeRecord) -> EmvLine:
    """The line of an EMV that moves."""
    line = EmvLine.of(record)
    assert line is not None
    return line


def encounters_in(record: EpisodeRecord) -> list[Encounter]:
    """All encounters by the usual thresholds."""
    return list(encounters_of(record, line_of(record), YieldThresholds()))
