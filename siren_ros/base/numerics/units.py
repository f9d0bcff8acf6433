"""Units and the simulated clock."""

from typing import Final

NS_PER_S: Final = 1_000_000_000
STEP_NS: Final = 50_000_000
"""One step of the lockstep: 0.05 s, 20 Hz (paper, section "Co-Simulation Loop and Control Ownership")."""
STEP_S: Final = STEP_NS / NS_PER_S
STEPS_PER_S: Final = NS_PER_S // STEP_NS
GRAVITY_MPS2: Final = 9.80665
NEVER: Final = -(10**9)
"""A step number before all real steps."""


def mps_from_kmh(speed_kmh: float) -> float:
    """Convert km/h, the unit of the paper's tables, to m/s."""
    return speed_kmh / 3.6


def time_ns_of_step(step: int) -> int:
    """Simulated time of a step: step 0 is time 0."""
    return step * STEP_NS


def step_of_time_ns(time_ns: int) -> int:
    """Step of a simulated time; raises ValueError when the time is not on the step grid."""
    step, rest = divmod(time_ns, STEP_NS)
    if rest:
        raise ValueError(f"{time_ns} ns is not a multiple of the step of {STEP_NS} ns")
    return step


def exact_s(time_ns: int) -> str:
    """A time in seconds with all its nanoseconds as text: 2.05 and 2.050000001 differ."""
    seconds, rest = divmod(abs(time_ns), NS_PER_S)
    digits = f"{seconds}.{rest:09d}".rstrip("0").rstrip(".")
    return f"-{digits}" if time_ns < 0 else digits


def steps_from_s(duration_s: float) -> int:
    """Number of whole steps nearest to a duration."""
    return round(duration_s * STEPS_PER_S)
