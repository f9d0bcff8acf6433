"""All vehicles of an episode: from SUMO's state and the controllers' commands to simulated states and events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, changed
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.dynamics.collisions import (
    Contact,
    Footprints,
    Pairs,
    any_close,
    collide,
    find_contacts,
    overlapping,
)
from siren_ros.simulation.dynamics.controls import (
    DEFAULT_GAINS,
    NEXT_ACCEL,
    NEXT_PACE,
    NEXT_YAW,
    PACE,
    SMOOTH_ACCEL,
    SPEED,
    SUMO_ACCEL,
    Orders,
    TrackerGains,
    TrackerState,
    follow,
    merge_commands,
    stopped_orders,
    walk,
)
from siren_ros.simulation.dynamics.vehicle_model import (
    ACCEL,
    ASKED_BRAKE,
    ASKED_HAND_BRAKE,
    ASKED_STEER,
    ASKED_THROTTLE,
    BRAKE,
    DRIVE_FACTOR,
    FORWARD,
    LATERAL,
    QUICKNESS,
    YAW_RATE,
    BodyState,
    ParameterTable,
    Records,
    VehicleParameters,
    advance,
    substeps,
)
from siren_ros.simulation.roads.road_network import mirror_image
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Owner,
    TrafficState,
    rows_of_ids,
)
from siren_ros.simulation.world.commands import VehicleCommands


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
    walks: Flags
    """Whether an actor is a pedestrian."""
    stopped: tuple[int, ...] = ()
    """Actors that have been in contact, sorted: they brake to a standstill and stay."""
    sounding: tuple[int, ...] = ()
    """Actors whose siren is on, sorted."""
    left_hand: bool = False
    """Whether traffic keeps left; the fleet is then the exact mirror image of that on the map."""

    @classmethod
    def empty(cls, parameters: Mapping[ActorClass, VehicleParameters], *, left_hand: bool = False) -> "FleetState":
        """The fleet before the first step; the call also loads the compiled equations, which is slow at first."""
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
            left_hand=left_hand,
            walks=np.empty(0, np.bool_),
        )
        orders = Orders(fleet.owner, none, none, none, fleet.walks, fleet.owner, fleet.owner)
        _one_step(*_before(fleet), np.empty((5, 0)), orders, fleet.walks, DEFAULT_GAINS, _SUBSTEPS)
        return fleet


def without_actors(fleet: FleetState, removed: Ids) -> FleetState:
    """The fleet without the removed actors; unknown ids are ignored."""
    if not len(removed):
        return fleet
    kept = ~np.isin(fleet.actor_id, removed)
    described = _described(fleet, tuple(item for item, stays in zip(fleet.descriptions, kept, strict=True) if stays))
    bodies, tracker = fleet.bodies.select(kept), fleet.tracker.select(kept)
    return replace(described, bodies=bodies, tracker=tracker, owner=fleet.owner[kept])


def with_spawned(fleet: FleetState, traffic: TrafficState) -> tuple[FleetState, Flags]:
    """The fleet with the spawned actors at SUMO's pose and speed, and the mask of their rows.

    Raises:
        EpisodeError: the actors are then not those of ``traffic``.
    """
    if not traffic.spawned and fleet.actor_id.tobytes() == traffic.actor_id.tobytes():
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
    """The fleet with everything that follows from its descriptions."""
    return replace(
        fleet,
        descriptions=descriptions,
        actor_id=np.array([item.actor_id for item in descriptions], dtype=np.uint32),
        length_m=np.array([item.length_m for item in descriptions], dtype=np.float64),
        width_m=np.array([item.width_m for item in descriptions], dtype=np.float64),
        table=ParameterTable.of_rows(
            [fleet.parameters[one.actor_class].sized(one.length_m, one.width_m, one.height_m) for one in descriptions]
        ),
        walks=np.array([item.actor_class is ActorClass.PEDESTRIAN for item in descriptions], np.bool_),
    )


BRAKE_LIGHT_PEDAL: Final = 0.02
"""The brake light is on from this brake pedal position."""
BRAKE_LIGHT_DECEL_MPS2: Final = 1.3
"""The brake light is on from this deceleration, whatever its cause (UN R13-H, 5.2.22.4)."""
_SUBSTEPS: Final = substeps(STEP_S)
_ROS: Final = np.uint8(Owner.ROS)
_BRAKE_LIGHT: Final = np.uint8(Lights.BRAKE)
_SIREN: Final = np.uint8(Lights.SIREN)
_OF_BODIES: Final = tuple(field.name for field in fields(BodyState) if field.name in ACTOR_STATE_DTYPES)
"""Columns of the actors' states that are columns of the bodies."""


def step_fleet(
    state: FleetState, traffic: TrafficState, commands: Sequence[VehicleCommands]
) -> tuple[FleetState, ActorStates, tuple[Event, ...]]:
    """The fleet at SUMO's step.

    Commands of owner ROS drive their actors from the step before to this one. All other actors track SUMO's pose at
    this step. A spawned actor starts at SUMO's pose with SUMO's speed. An actor that ROS hands back at this step rolls
    on with its speed, because SUMO's pose is still the mirror of its own; tracking begins at the next step. So does an
    actor whose vehicle in SUMO was brought back to it. ``state`` is the fleet at the step before, or any earlier one
    while it is empty.

    Returns:
        The fleet, the simulated states and the events at this step. ``residual_m`` is zero for actors that ROS
        drives or hands back at this step. Events come in the order spawned, removed, owner changed, siren on or off,
        collision (each sorted by actor), then the commands' events by source, then those of traffic.

    Raises:
        EpisodeError: steps do not match, actors are not those of ``traffic``, or commands contradict each other,
            name unknown actors or are not finite.
    """
    if state.left_hand:
        fleet, states, events = _step(state, mirror_image(traffic), [mirror_image(command) for command in commands])
        return fleet, mirror_image(states), tuple(map(mirror_image, events))
    return _step(state, traffic, commands)


def _step(
    state: FleetState, traffic: TrafficState, commands: Sequence[VehicleCommands]
) -> tuple[FleetState, ActorStates, tuple[Event, ...]]:
    _check_steps(state, traffic, commands)
    fleet, fresh = with_spawned(without_actors(state, traffic.removed), traffic)
    orders = stopped_orders(merge_commands(traffic, commands), fleet.actor_id, fleet.stopped, fleet.bodies.steer_rad)
    realigned = [event.actor_id for event in traffic.events if event.kind is EventKind.REALIGNED]
    brought_back = np.isin(fleet.actor_id, realigned) if realigned else np.zeros(len(traffic), dtype=np.bool_)
    brought_back &= orders.owner != _ROS
    bodies, tracker = _move(fleet, traffic, orders, brought_back)
    if realigned:
        theirs = TrackerState.at(traffic.sumo_x_m, traffic.sumo_y_m, traffic.sumo_yaw_rad)
        tracker = TrackerState.where(brought_back, theirs, tracker)
    if traffic.spawned:
        bodies = BodyState.where(fresh, fleet.bodies, bodies)
        tracker = TrackerState.where(fresh, fleet.tracker, tracker)
    bodies, contacts, touching = _after_contacts(fleet, bodies)
    states = _states(fleet, traffic, orders, bodies, brought_back)
    sirens, sounding = _siren_changes(state, states)
    collisions = tuple(
        Event(traffic.step, EventKind.COLLISION, *contact[:4], {"impact_speed_mps": contact.impact_speed_mps})
        for contact in contacts
    )
    changes = _spawned(states, traffic) + _removed(state, traffic) + _owner_changes(fleet, states) + sirens
    reported = tuple(event for command in sorted(commands, key=lambda c: c.source) for event in command.events)
    after = changed(
        fleet,
        step=traffic.step,
        bodies=bodies,
        tracker=tracker,
        owner=orders.owner,
        touching=touching,
        stopped=tuple(sorted({*fleet.stopped, *_struck(fleet, contacts)})),
        sounding=sounding,
    )
    return after, states, changes + collisions + reported + traffic.events


def _check_steps(state: FleetState, traffic: TrafficState, commands: Sequence[VehicleCommands]) -> None:
    if traffic.step <= state.step or (len(state.descriptions) and traffic.step != state.step + 1):
        raise EpisodeError(f"traffic of step {traffic.step} cannot follow the fleet's step {state.step}")
    for command in commands:
        if command.step != traffic.step:
            raise EpisodeError(f"commands of {command.source} are of step {command.step}, traffic of {traffic.step}")


def _move(
    fleet: FleetState, traffic: TrafficState, orders: Orders, brought_back: Flags
) -> tuple[BodyState, TrackerState]:
    """Bodies and tracker at this step; those brought back are SUMO's whose vehicle in SUMO was moved to its pose."""
    sumo = np.array((
        *(traffic.sumo_x_m, traffic.sumo_y_m, traffic.sumo_yaw_rad, traffic.sumo_speed_mps, traffic.sumo_accel_mps2),
    ))  # fmt: skip
    bodies, tracker = _one_step(*_before(fleet), sumo, orders, brought_back, DEFAULT_GAINS, _SUBSTEPS)
    return BodyState.of_columns(bodies), TrackerState.of_columns(tracker)


def _before(fleet: FleetState) -> tuple[Floats, Floats, Codes, Records, Flags]:
    """What ``_one_step`` takes of a fleet."""
    return fleet.bodies.columns, fleet.tracker.columns, fleet.owner, fleet.table.records, fleet.walks


@compiled
def _one_step(
    bodies: Floats,
    tracker: Floats,
    owner_before: Codes,
    records: Records,
    walks: Flags,
    reference: Floats,
    orders: Orders,
    brought_back: Flags,
    gains: TrackerGains,
    count: int,
) -> tuple[Floats, Floats]:
    """Columns of bodies and tracker one step later, by ``count`` substeps; ``reference`` is what SUMO reports.

    Those who are driven do what is asked of them. The others follow SUMO; those who have just been handed back roll on.
    """
    n = len(records)
    after, controls, driven = np.empty_like(bodies), np.zeros((6, n)), orders.owner == _ROS
    handed_back = ((owner_before == _ROS) & ~driven) | brought_back
    for k in range(n):
        if handed_back[k]:
            ahead, yaw = STEP_S * bodies[FORWARD, k], bodies[YAW, k]
            reference[X, k], reference[Y, k] = bodies[X, k] + ahead * np.cos(yaw), bodies[Y, k] + ahead * np.sin(yaw)
            reference[YAW, k], reference[SPEED, k], reference[SUMO_ACCEL, k] = yaw, bodies[FORWARD, k], 0.0
    follow(bodies, tracker, reference, records, walks, STEP_S, gains, controls)
    tracked = np.empty((5, n))
    for k in range(n):
        tracked[X, k], tracked[Y, k] = reference[X, k], reference[Y, k]
        tracked[YAW, k], tracked[PACE, k] = controls[NEXT_YAW, k], controls[NEXT_PACE, k]
        tracked[SMOOTH_ACCEL, k] = controls[NEXT_ACCEL, k]
        controls[ASKED_HAND_BRAKE, k] = 0.0
        controls[QUICKNESS, k], controls[DRIVE_FACTOR, k] = gains.quickness, gains.drive_factor
        if driven[k]:
            controls[ASKED_THROTTLE, k], controls[ASKED_BRAKE, k] = orders.throttle[k], orders.brake[k]
            controls[ASKED_STEER, k], controls[ASKED_HAND_BRAKE, k] = orders.steer_rad[k], orders.hand_brake[k]
            controls[QUICKNESS, k], controls[DRIVE_FACTOR, k] = 1.0, 1.0
    advance(bodies, controls, records, walks, count, STEP_S / count, after)
    walk(bodies, reference, walks, STEP_S, after)
    for k in range(n):
        if driven[k] or handed_back[k]:
            tracked[X, k], tracked[Y, k], tracked[YAW, k] = after[X, k], after[Y, k], after[YAW, k]
            tracked[PACE, k], tracked[SMOOTH_ACCEL, k] = 1.0, 0.0
    return after, tracked


def _after_contacts(fleet: FleetState, bodies: BodyState) -> tuple[BodyState, tuple[Contact, ...], Pairs]:
    """Bodies after the impacts of a step, the contacts that begin at it, and the pairs that touch."""
    places = bodies.x_m, bodies.y_m, bodies.yaw_rad
    if not any_close(*places, fleet.length_m, fleet.width_m, fleet.walks):
        return bodies, (), ()
    velocity = bodies.velocity_mps(fleet.table)
    motion = *velocity, bodies.yaw_rate_radps
    boxes = Footprints(fleet.actor_id, *places, *motion, fleet.length_m, fleet.width_m, fleet.walks)
    contacts, touching = find_contacts(boxes, fleet.touching)
    if touching:  # pedestrians are moved by SUMO alone
        after = collide(bodies, boxes, fleet.table, overlapping(boxes, touching), STEP_S)
        bodies = BodyState.where(fleet.walks, bodies, after) if fleet.walks.any() else after
    return bodies, contacts, touching


def _struck(fleet: FleetState, contacts: tuple[Contact, ...]) -> set[int]:
    """Vehicles in some contacts; people continue as SUMO says."""
    walkers = fleet.actor_id[fleet.walks].tolist() if contacts else ()
    return {actor for contact in contacts for actor in contact[:2]}.difference(walkers)


def _states(
    fleet: FleetState, traffic: TrafficState, orders: Orders, bodies: BodyState, brought_back: Flags
) -> ActorStates:
    sumo_m, records = (traffic.sumo_x_m, traffic.sumo_y_m), fleet.table.records
    lights, vx_mps, vy_mps, residual_m = _shown(
        bodies.columns, *sumo_m, orders, fleet.owner, brought_back, records, _BRAKE_LIGHT
    )
    lights[fleet.walks] = 0
    of_bodies: dict[str, Any] = {name: getattr(bodies, name) for name in _OF_BODIES}
    return ActorStates(
        step=traffic.step,
        actor_id=fleet.actor_id,
        z_m=np.zeros(len(bodies)),
        vx_mps=vx_mps,
        vy_mps=vy_mps,
        owner=orders.owner,
        mode=orders.mode,
        lights=lights,
        residual_m=residual_m,
        **of_bodies,
    )


@compiled
def _shown(
    bodies: Floats,
    sumo_x_m: Floats,
    sumo_y_m: Floats,
    orders: Orders,
    owner_before: Codes,
    brought_back: Flags,
    records: Records,
    brake_light: np.uint8,
) -> tuple[Codes, Floats, Floats, Floats]:
    """Lights with the brake light, velocities as ``BodyState.velocity_mps``, and the distances from SUMO's poses.

    The distance is 0 for those whose pose SUMO mirrors.
    """
    shown, n = orders.lights.copy(), len(records)
    vx_mps, vy_mps, residual_m = np.empty(n), np.empty(n), np.zeros(n)
    for k in range(n):
        cos, sin = np.cos(bodies[YAW, k]), np.sin(bodies[YAW, k])
        forward, left = bodies[FORWARD, k], bodies[LATERAL, k] + records[k].centre_ahead_of_cg_m * bodies[YAW_RATE, k]
        vx_mps[k], vy_mps[k] = forward * cos - left * sin, forward * sin + left * cos
        if bodies[BRAKE, k] > BRAKE_LIGHT_PEDAL or bodies[ACCEL, k] < -BRAKE_LIGHT_DECEL_MPS2:
            shown[k] |= brake_light
        if orders.owner[k] != _ROS and (owner_before[k] != _ROS or brought_back[k]):
            residual_m[k] = np.hypot(sumo_x_m[k] - bodies[X, k], sumo_y_m[k] - bodies[Y, k])
    return shown, vx_mps, vy_mps, residual_m


def _spawned(states: ActorStates, traffic: TrafficState) -> tuple[Event, ...]:
    if not traffic.spawned:
        return ()
    rows = rows_of_ids(states.actor_id, np.array(sorted(item.actor_id for item in traffic.spawned), dtype=np.uint32))
    return tuple(_event(states, states, traffic.step, EventKind.SPAWNED, row) for row in rows)


def _removed(before: FleetState, traffic: TrafficState) -> tuple[Event, ...]:
    """Removals, each at the actor's last simulated place."""
    if not len(traffic.removed):
        return ()
    rows = rows_of_ids(before.actor_id, np.sort(traffic.removed))
    return tuple(_event(before, before.bodies, traffic.step, EventKind.REMOVED, row) for row in rows[rows >= 0])


def _owner_changes(fleet: FleetState, states: ActorStates) -> tuple[Event, ...]:
    if states.owner.tobytes() == fleet.owner.tobytes():
        return ()
    rows = np.flatnonzero(states.owner != fleet.owner)
    details = [{"owner": Owner(int(states.owner[row])).name} for row in rows]
    changed = zip(rows, details, strict=True)
    return tuple(_event(states, states, states.step, EventKind.OWNER_CHANGED, row, detail) for row, detail in changed)


def _siren_changes(before: FleetState, states: ActorStates) -> tuple[tuple[Event, ...], tuple[int, ...]]:
    """Sirens that switch on or off, also those of actors that have left, and the actors with a siren on now."""
    sounding = tuple(states.actor_id[(states.lights & _SIREN) != 0].tolist())
    events = []
    for actor_id in sorted(set(sounding) ^ set(before.sounding)):
        kind = EventKind.SIREN_ON if actor_id in sounding else EventKind.SIREN_OFF
        actor = np.array([actor_id], dtype=np.uint32)
        row, last = rows_of_ids(states.actor_id, actor)[0], rows_of_ids(before.actor_id, actor)[0]
        if row >= 0:
            events.append(_event(states, states, states.step, kind, row))
        else:
            events.append(_event(before, before.bodies, states.step, kind, last))
    return tuple(events), sounding


def _event(
    actors: ActorStates | FleetState,
    places: ActorStates | BodyState,
    step: int,
    kind: EventKind,
    row: np.intp,
    detail: Mapping[str, float | int | str] | None = None,
) -> Event:
    x_m, y_m = float(places.x_m[row]), float(places.y_m[row])
    return Event(step, kind, int(actors.actor_id[row]), x_m=x_m, y_m=y_m, detail=detail or {})
