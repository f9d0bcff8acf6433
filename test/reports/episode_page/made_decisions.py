"""Decisions from formulas."""

from siren_ros.running.generation.replay_check import Decision
from siren_ros.simulation.behaviour.driving.driver_states import GuardState
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.world.actors import Mode

NO_GAP = GuardState("gap", False, "none is free")
GAP = GuardState("gap", True, "is free")


def decision(target_mps: float, guards: tuple[GuardState, ...] = (), **limits: SpeedLimit) -> Decision:
    """A decision with limits by their mechanisms."""
    return Decision(Mode.YIELD_LANE_CHANGE, target_mps, limits, guards)
