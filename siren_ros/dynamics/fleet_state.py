"""The vehicles of an episode at one step, and how actors join and leave them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from siren_ros.dynamics.collisions import Pairs
from siren_ros.dynamics.parameters import ParameterTable, VehicleParameters
from siren_ros.dynamics.tracker import Reference, TrackerState, track
from siren_ros.dynamics.vehicle_model import BodyState, step_bodies
from siren_ros.errors import EpisodeError
from siren_ros.numerics.arrays import Codes, Flags, Floats, Ids
from siren_ros.numerics.units import STEP_S
from siren_ros.world.actors import ActorClass, ActorDescription, Owner
from siren_ros.world.traffic_state import TrafficState


@dataclass(frozen=True)
class FleetState:
    """All vehicles at one step; rows sorted by actor id."""

    step: int
    parameters: Mapping[ActorClass, VehicleParameters]
    descriptions: tuple[ActorDescription, ...]
    actor_id: Ids
    length_m: Floats
    width_m: Floats
    table: ParameterTable
    bodies: BodyState
    tracker: TrackerState
    owner: Codes
    touching: Pairs
    stopped: tuple[int, ...] = ()
    """Actors that have been in contact, sorted: they brake to a standstill and stay."""
    sounding: tuple[int, ...] = ()
    """Actors whose siren sounds, sorted."""

    @classmethod
    def empty(cls, parameters: Mapping[ActorClass, VehicleParameters]) -> "FleetState":
        """The fleet before the first step; loads the compiled equations, which takes a while at first."""
        none = np.empty(0)
        fleet = cls(
            step=-1,
            parameters=parameters,
            descriptions=(),
            actor_id=np.empty(0, np.uint32),
            length_m=none,
            width_m=none,
            table=ParameterTable.of((), parameters),
            bodies=BodyState.moving(none, none, none, none),
            tracker=TrackerState.at(none, none, none),
            owner=np.empty(0, np.uint8),
            touching=(),
        )
        reference = Reference(none, none, none, none, none)
        controls, _ = track(fleet.bodies, fleet.tracker, reference, fleet.table, STEP_S)
        step_bodies(fleet.bodies, controls, fleet.table, STEP_S)
        return fleet


def without_actors(fleet: FleetState, removed: Ids) -> FleetState:
    """The fleet without the removed actors; ids that it does not hold are passed over."""
    if not len(removed):
        return fleet
    kept = ~np.isin(fleet.actor_id, removed)
    described = _described(fleet, tuple(item for item, stays in zip(fleet.descriptions, kept, strict=True) if stays))
    return replace(
        described,
        bodies=fleet.bodies.select(kept),
        tracker=fleet.tracker.select(kept),
        owner=fleet.owner[kept],
    )


def with_spawned(fleet: FleetState, traffic: TrafficState) -> tuple[FleetState, Flags]:
    """The fleet with the spawned actors at SUMO's pose and speed, and the mask of their rows.

    Raises:
        EpisodeError: the actors are then not those of ``traffic``.
    """
    if not traffic.spawned and np.array_equal(fleet.actor_id, traffic.actor_id):
        return fleet, np.zeros(len(traffic), dtype=bool)
    arrivals = tuple(sorted(traffic.spawned, key=lambda item: item.actor_id))
    ids = np.concatenate((fleet.actor_id, np.array([item.actor_id for item in arrivals], dtype=np.uint32)))
    order = np.argsort(ids, kind="stable")
    if not np.array_equal(ids[order], traffic.actor_id):
        odd = sorted(set(ids.tolist()) ^ set(traffic.actor_id.tolist()))
        raise EpisodeError(f"actors at step {traffic.step} are not those that were spawned and not removed: {odd}")
    fresh = order >= len(fleet.actor_id)
    pose = traffic.sumo_x_m[fresh], traffic.sumo_y_m[fresh], traffic.sumo_yaw_rad[fresh]
    bodies = BodyState.moving(*pose, traffic.sumo_speed_mps[fresh])
    everyone = fleet.descriptions + arrivals
    joined = replace(
        _described(fleet, tuple(everyone[i] for i in order)),
        bodies=BodyState.joined((fleet.bodies, bodies)).select(order),
        tracker=TrackerState.joined((fleet.tracker, TrackerState.at(*pose))).select(order),
        owner=np.concatenate((fleet.owner, np.full(len(arrivals), Owner.SUMO, np.uint8)))[order],
    )
    return joined, fresh


def _described(fleet: FleetState, descriptions: tuple[ActorDescription, ...]) -> FleetState:
    """The fleet with all that follows from its descriptions."""
    return replace(
        fleet,
        descriptions=descriptions,
        actor_id=np.array([item.actor_id for item in descriptions], dtype=np.uint32),
        length_m=np.array([item.length_m for item in descriptions], dtype=np.float64),
        width_m=np.array([item.width_m for item in descriptions], dtype=np.float64),
        table=ParameterTable.of([item.actor_class for item in descriptions], fleet.parameters),
    )
