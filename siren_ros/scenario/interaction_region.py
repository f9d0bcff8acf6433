"""The moving interaction region around the EMV: the vehicles that the paper's CARLA controls."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Flags, Floats, Ids
from siren_ros.scenario.paper import PAPER_CONSTANTS, ControlConstants
from siren_ros.world.actors import ActorStates

REGION_TEXT: Final = f"{PAPER_CONSTANTS.region_enter_m:g} m in, {PAPER_CONSTANTS.region_leave_m:g} m out"
"""How help texts and reports name the region."""


def in_region(distance_m: Floats, was_inside: Flags, constants: ControlConstants = PAPER_CONSTANTS) -> Flags:
    """Whether vehicles are in the region after a step (paper, table of thresholds: hysteresis, EMV-centred).

    Args:
        distance_m: Between the centres of each vehicle and of the nearest EMV, shape ``(N,)``.
        was_inside: Whether each vehicle was in the region at the step before, shape ``(N,)``.
        constants: A vehicle enters closer than ``region_enter_m`` and leaves farther away than ``region_leave_m``.
    """
    return (distance_m < constants.region_enter_m) | (was_inside & (distance_m <= constants.region_leave_m))


def region_members(before: Ids, states: ActorStates, emv_ids: Iterable[int]) -> Ids:
    """The vehicles in the region after a step: those that ``in_region`` names, and the EMVs that are there.

    Without an EMV nobody is in it.

    Args:
        before: Members at the step before, sorted; empty at the first step.
        states: All actors at the step.
        emv_ids: The emergency vehicles.

    Returns:
        Sorted ids.
    """
    is_emv = np.isin(states.actor_id, np.fromiter(emv_ids, dtype=np.uint32))
    if not is_emv.any():
        return np.empty(0, dtype=np.uint32)
    xy = np.stack((states.x_m, states.y_m), axis=-1)
    distance = np.hypot(*(xy[:, None] - xy[is_emv]).transpose(2, 0, 1)).min(axis=1)
    return states.actor_id[in_region(distance, np.isin(states.actor_id, before)) | is_emv]
