"""SUMO's advice: lane-change intent, leader, free speed, and who reacts to which EMV."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.traffic_state import EmvAdvice, TrafficFlags

_LEFT, _RIGHT = 1 << 1, 1 << 2
_REASONS = (1 << 3) | (1 << 4) | (1 << 5) | (1 << 6)
"""SUMO's LCA_STRATEGIC, LCA_COOPERATIVE, LCA_SPEEDGAIN, LCA_KEEPRIGHT (https://sumo.dlr.de/docs/TraCI: lane change
state); a wish without one of these is alignment within the lane."""
_HELD_UP = (1 << 5) | (1 << 6)
"""Of these the wishes that come from the vehicle ahead: to gain speed, and to keep right where there is none."""
HELD_UP_M: Final = 40.0
"""A vehicle further ahead holds nobody up: 3 s at the paper's 50 km/h."""
_UNKNOWN = 1 << 30


def lane_change_intent(name: str, reasons: int = _REASONS) -> int:
    """+1 where SUMO's lane-change model wants the vehicle one lane to the left, −1 right, 0 neither."""
    for side, bit in ((1, _LEFT), (-1, _RIGHT)):
        wish, _ = libsumo.vehicle.getLaneChangeState(name, side)
        if not wish & _UNKNOWN and wish & bit and wish & reasons:
            return side
    return 0


def intent_flags(name: str) -> TrafficFlags:
    """The intent as flags."""
    return (TrafficFlags.WANTS_RIGHT, TrafficFlags.NONE, TrafficFlags.WANTS_LEFT)[lane_change_intent(name) + 1]


def emv_advice(
    name: str,
    actor_id: int,
    ids: Mapping[str, int],
    yielding: Collection[str],
    leader_range_m: float,
    min_gap_m: float,
    rescue_count: int,
) -> EmvAdvice:
    """What SUMO advises one EMV. The leader's gap is from bumper to bumper; SUMO leaves out the minimum gap.

    A wish to gain speed counts while a vehicle ahead holds up the EMV that does not make way. It outlasts its cause in
    SUMO, and SUMO knows nothing of yielding: behind a vehicle that leaves the lane it wants the lane next to it, which
    is the one that the vehicle goes to.

    Args:
        name: The EMV in SUMO.
        actor_id: Its id.
        ids: Ids of all vehicles.
        yielding: Names of the vehicles that leave their lanes for an EMV.
        leader_range_m: How far ahead a leader is looked for.
        min_gap_m: The EMV's minimum gap.
        rescue_count: Vehicles that react to it.
    """
    leader = libsumo.vehicle.getLeader(name, leader_range_m)
    found = leader is not None and leader[0] in ids
    held_up = found and leader[0] not in yielding and float(leader[1]) < HELD_UP_M
    return EmvAdvice(
        actor_id=actor_id,
        lane_change_intent=lane_change_intent(name, _REASONS if held_up else _REASONS & ~_HELD_UP),
        leader_id=ids[leader[0]] if found else NO_ACTOR,
        leader_gap_m=float(leader[1]) + min_gap_m if found else leader_range_m,
        speed_without_control_mps=float(libsumo.vehicle.getSpeedWithoutTraCI(name)),
        rescue_count=rescue_count,
    )


def rescued_names(names: Iterable[str], emv_names: Iterable[str]) -> dict[str, list[str]]:
    """Of SUMO's bluelight device: the vehicles that react to each EMV."""
    reacting: dict[str, list[str]] = {emv: [] for emv in emv_names}
    for name in names:
        for emv in libsumo.vehicle.getParameter(name, "rescueLane").split():
            if emv in reacting:
                reacting[emv].append(name)
    return reacting


def ahead_on_route(
    emv: npt.NDArray[np.float64],
    emv_yaw_rad: float,
    route: Sequence[int],
    points: npt.NDArray[np.float64],
    edges: npt.NDArray[np.int32],
    reach_m: float,
) -> npt.NDArray[np.bool_]:
    """Vehicles that hear an EMV come from behind: on its route's edges, ahead of it and within reach.

    The same criterion as that of SUMO's bluelight device (vehicles on the EMV's upcoming edges within
    ``reactiondist``), for levels at which the device itself must not run.

    Args:
        emv: Centre of the EMV, shape ``(2,)``.
        emv_yaw_rad: Its heading.
        route: Edges ahead of the EMV, the present one (or the one before the junction) first.
        points: Centres of all vehicles, shape ``(N, 2)``.
        edges: Present edge of each vehicle, or the one before the junction, shape ``(N,)``.
        reach_m: Greatest distance between the two vehicles' centres.
    """
    relative = points - emv
    near = np.hypot(relative[:, 0], relative[:, 1]) <= reach_m
    on_route = np.array([edge in route for edge in edges.tolist()], dtype=np.bool_)
    same = edges == (route[0] if len(route) else -1)
    forward = relative @ np.array([np.cos(emv_yaw_rad), np.sin(emv_yaw_rad)]) > 0.0
    return near & on_route & (forward | ~same)
