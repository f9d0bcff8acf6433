"""Names on the command line that no node declares: a typo must not pass in silence."""

from collections.abc import Iterable, Mapping
from typing import Any

from siren_ros.errors import InputError

BUILT_IN = frozenset({"use_sim_time", "start_type_description_service"})


def check_names(given: Mapping[str, Any], declared: Iterable[str]) -> None:
    """Refuse overrides of parameters that do not exist.

    Raises:
        InputError: Names the first unknown parameter and the known ones.
    """
    known = sorted(set(declared))
    for name in sorted(given):
        if name not in known and name not in BUILT_IN and not name.startswith("qos_overrides."):
            raise InputError(
                name, getattr(given[name], "value", given[name]), "one of the parameters " + ", ".join(known)
            )
