"""Which civilian drivers look out for an EMV where ways cross."""

from dataclasses import replace

from siren_ros.numerics.random_streams import random_stream
from siren_ros.traffic.demand.plan import PlannedVehicle, TrafficPlan


def with_attention(plan: TrafficPlan, share: float, seed: int) -> TrafficPlan:
    """The plan with a share of attentive drivers; each driver has a draw of its own, whatever else is drawn."""
    if share >= 1.0:
        return plan

    def drawn(vehicles: tuple[PlannedVehicle, ...], purpose: str) -> tuple[PlannedVehicle, ...]:
        return tuple(
            replace(vehicle, attentive=bool(random_stream(seed, f"attention/{purpose}", index).random() < share))
            for index, vehicle in enumerate(vehicles)
        )

    return replace(
        plan,
        groups=drawn(plan.groups, "groups"),
        background=drawn(plan.background, "background"),
        reserve=drawn(plan.reserve, "reserve"),
    )
