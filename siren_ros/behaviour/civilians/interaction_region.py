"""The interaction region of an EMV: who is in it, and how far along the EMV's road each vehicle is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.driving.step_view import Ego, StepView, Surroundings
from siren_ros.behaviour.paths.lane_path import lanes_along
from siren_ros.numerics.arrays import Floats, Ids
from siren_ros.roads.road_network import NO_LANE
from siren_ros.scenario.interaction_region import in_region
from siren_ros.scenario.paper import ControlConstants
from siren_ros.world.actors import rows_of_ids


@dataclass(frozen=True, eq=False)
class EmvRoad:
    """The road ahead of one EMV, valid while its lane and route stay the same."""

    key: tuple[int, bytes]
    lane_start_m: Floats
    """Distance from the start of the EMV's lane to the start of each lane on its path; infinite off the path."""
    road_start_m: Floats
    """The same for every lane of the edges on its path, also beside the path."""
    on_road: npt.NDArray[np.bool_]
    """Whether each edge lies on the road: the edges ahead and those just left."""
    left_edges: tuple[int, ...]

    @classmethod
    def ahead_of(cls, ego: Ego, before: "EmvRoad | None") -> "EmvRoad | None":
        """The road of an EMV; that of the step before while nothing changes or the EMV is off the road."""
        network, lane = ego.network, ego.lane
        if lane == NO_LANE:
            return before
        key = (lane, ego.route.tobytes())
        if before is not None and before.key == key:
            return before
        edge = network.lanes[lane].edge
        left = (
            (edge,)
            if before is None
            else tuple(dict.fromkeys((edge, *before.left_edges)))[: ego.config.yielding.edges_kept]
        )
        ahead_m = network.lanes[lane].length_m + ego.config.yielding.path_ahead_m
        lane_start, road_start = np.full((2, len(network.lanes)), np.inf)
        on_road = np.zeros(len(network.edges), dtype=np.bool_)
        on_road[list(left)] = True
        way = 0.0
        for item in lanes_along(network, lane, 0.0, ego.route, ahead_m)[0]:
            edge = network.lanes[item].edge
            lane_start[item] = way
            road_start[list(network.edges[edge].lanes)] = way
            on_road[edge] = True
            way += network.lanes[item].length_m
        return cls(key, lane_start, road_start, on_road, left)


@dataclass(frozen=True, eq=False)
class InteractionRegion:
    """One EMV's road and the civilians in its interaction region."""

    road: EmvRoad | None
    members: Ids
    """Sorted."""


def way_from_emv_m(view: StepView, emv_row: int, starts_m: Floats) -> Floats:
    """Distance along lanes from an EMV's front to every vehicle's rear, shape ``(N,)``.

    Args:
        view: The step.
        emv_row: The EMV's row.
        starts_m: Where each lane starts, measured from the start of the EMV's lane (``EmvRoad.lane_start_m``).

    Returns:
        Distances, infinite for vehicles off these lanes.
    """
    traffic = view.traffic
    start = np.where(traffic.lane >= 0, starts_m[traffic.lane], np.inf)
    rear = start + traffic.lane_position_m - 2.0 * view.seen.half_length_m
    return np.asarray(rear - traffic.lane_position_m[emv_row], dtype=np.float64)


def region_members(seen: Surroundings, emv_row: int, before: Ids, constants: ControlConstants) -> Ids:
    """Ids of the civilians in an EMV's interaction region, with hysteresis.

    Args:
        seen: All actors.
        emv_row: The EMV's row.
        before: Members at the step before, sorted.
        constants: Distances between centres at which an actor enters and leaves.
    """
    distance = np.hypot(seen.x_m - seen.x_m[emv_row], seen.y_m - seen.y_m[emv_row])
    return seen.actor_id[in_region(distance, rows_of_ids(before, seen.actor_id) >= 0, constants) & ~seen.is_emv]
