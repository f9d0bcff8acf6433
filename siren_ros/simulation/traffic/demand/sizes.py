"""Varies the sizes of vehicles within their class, where a study asks for it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan
from siren_ros.simulation.traffic.demand.vehicle_factory import Dimensions
from siren_ros.simulation.world.actors import ActorClass

WIDEST_M: Final = 2.55
"""No vehicle is wider, unless its whole class is (Directive 96/53/EC)."""


def largest(dimensions: Mapping[ActorClass, Dimensions], spread: float) -> dict[ActorClass, Dimensions]:
    """The largest sizes that can be drawn.

    Traffic is planned for them, so that every drawn vehicle has enough space.
    """
    more = 1.0 + spread
    return {kind: (more * length, more * width, more * height) for kind, (length, width, height) in dimensions.items()}


def varied_size(size: Dimensions, spread: float, seed: int, name: str) -> Dimensions:
    """A size that is drawn about that of the class: each dimension up to the share ``spread`` smaller or larger."""
    draws = random_stream(seed, f"sizes/{name}").uniform(1.0 - spread, 1.0 + spread, 3)
    length, width, height = (round(of_class * float(draw), 2) for of_class, draw in zip(size, draws, strict=True))
    return length, min(width, max(WIDEST_M, size[1])), height


def with_sizes(plan: TrafficPlan, dimensions: Mapping[ActorClass, Dimensions], spread: float, seed: int) -> TrafficPlan:
    """The plan whose vehicles have sizes drawn about those of their classes, whatever else is drawn."""

    def drawn(vehicles: tuple[PlannedVehicle, ...]) -> tuple[PlannedVehicle, ...]:
        sizes = [varied_size(dimensions[one.actor_class], spread, seed, one.name) for one in vehicles]
        return tuple(
            replace(one, length_m=length, width_m=width, height_m=height)
            for one, (length, width, height) in zip(vehicles, sizes, strict=True)
        )

    return replace(
        plan,
        emvs=drawn(plan.emvs),
        groups=drawn(plan.groups),
        background=drawn(plan.background),
        reserve=drawn(plan.reserve),
        riders=drawn(plan.riders),
    )
