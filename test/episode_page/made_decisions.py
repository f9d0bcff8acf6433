"""Decisions from formulas."""

from siren_ros.behaviour.guards import GuardState
from siren_ros.generation.decisions import Decision, Limit
from siren_ros.world.actors import Mode

NO_GAP = GuardState("gap", False, "none is free")
GAP = GuardState("gap", True, "is free")


def decision(target_mps: float, limits: tuple[Limit, ...] = (), guards: tuple[GuardState, ...] = ()) -> Decision:
    return Decision(Mode.YIELD_LANE_CHANGE, target_mps, limits, guards)
