"""Gymnasium and PettingZoo environments in which drivers learn; the import registers them."""

from typing import Any, Final

from siren_ros.errors import InputError

try:
    import gymnasium
except ModuleNotFoundError as missing:
    _runs = "the extra learn, as ./env --with learn … brings it"
    raise InputError("environment", f"no {missing.name}", _runs) from missing

ENVIRONMENTS: Final = {"siren/Yield-v0": "YieldEnv", "siren/Emergency-v0": "EmergencyEnv"}
"""Classes in ``siren_ros.lab.learning.environment`` by environment name."""


def register_environments() -> None:
    """Register the environments for ``gymnasium.make``; those already registered stay."""
    for name, kind in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, f"siren_ros.lab.learning.environment:{kind}")


def parallel_env(**options: Any) -> Any:
    """Make an environment with several drivers, for PettingZoo's parallel API.

    Args:
        options: Those of ``siren_ros.lab.learning.several_seats.SeveralSeatsEnv``.

    Raises:
        InputError: An option cannot be used.
    """
    from siren_ros.lab.learning.several_seats import SeveralSeatsEnv  # noqa: PLC0415 - needs PettingZoo, which one seat does not

    return SeveralSeatsEnv(**options)


__all__ = ["parallel_env"]

register_environments()
