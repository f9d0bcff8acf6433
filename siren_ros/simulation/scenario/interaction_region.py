"""The moving interaction region around the EMV: the vehicles that the paper's CARLA controls."""

from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Ids
from siren_ros.base.numerics.compiled import compiled
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS
from siren_ros.simulation.world.actors import ActorStates, rows_of_ids

REGION_TEXT: Final = f"{PAPER_CONSTANTS.region_enter_m:g} m in, {PAPER_CONSTANTS.region_leave_m:g} m out"
"""The text by which help and reports name the region."""


@compiled
def in_region(distance_m: Any, was_inside: Any, enter_m: float, leave_m: float) -> Any:
    """Whether vehicles are in the region after a step (paper, table of thresholds: hysteresis, EMV-centred).

    ``distance_m`` is between the centres of a vehicle and of the nearest EMV; ``was_inside`` is of the step before.
    """
    return (distance_m < enter_m) | (was_inside & (distance_m <= leave_m))


def region_members(before: Ids, states: ActorStates, emv_ids: Iterable[int]) -> Ids:
    """Sorted ids of the vehicles in the region after a step: those that ``in_region`` names, and the EMVs.

    ``before`` are the members at the step before, sorted. Without an EMV the region is empty.
    """
    is_emv = (states.actor_id[:, None] == np.fromiter(emv_ids, dtype=np.uint32)).any(axis=1)
    if not is_emv.any():
        return np.empty(0, dtype=np.uint32)
    xy = np.stack((states.x_m, states.y_m), axis=-1)
    distance = np.hypot(*(xy[:, None] - xy[is_emv]).transpose(2, 0, 1)).min(axis=1)
    was_inside = rows_of_ids(before, states.actor_id) >= 0
    inside = in_region(distance, was_inside, PAPER_CONSTANTS.region_enter_m, PAPER_CONSTANTS.region_leave_m)
    return states.actor_id[inside | is_emv]
