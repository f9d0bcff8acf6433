"""Emergency-vehicle interactions: generated from behaviour, sensed, recorded and scored.

The names in ``__all__`` are public, here and in the modules ``learning`` and ``training.torch_samples``; those here are
loaded when they are first used. Everything else is private. The import fixes the arithmetic of numpy
(``siren_ros/base/at_import.py``), so it stands before that of numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from siren_ros.base.at_import import allow_short_names, pin_before_numpy

if TYPE_CHECKING:
    from siren_ros.api import examine as examine
    from siren_ros.api import export as export
    from siren_ros.api import generate_study as generate_study
    from siren_ros.api import iterate_frames as iterate_frames
    from siren_ros.api import iterate_samples as iterate_samples
    from siren_ros.api import judge as judge
    from siren_ros.api import make_episode as make_episode
    from siren_ros.api import read_record as read_record
    from siren_ros.api import score_predictions as score_predictions
    from siren_ros.api import verify as verify
    from siren_ros.errors import BagError as BagError
    from siren_ros.errors import EpisodeError as EpisodeError
    from siren_ros.errors import InputError as InputError
    from siren_ros.errors import SirenError as SirenError
    from siren_ros.running.seat.seated import AvController as AvController
    from siren_ros.running.seat.sight import Sight as Sight
    from siren_ros.running.studies.matrix import Study as Study
    from siren_ros.simulation.scenario.episode import EpisodeRequest as EpisodeRequest
    from siren_ros.simulation.world.commands import AvControl as AvControl

__version__ = "0.1.0"

_MODULES: Final = {
    "siren_ros.api": (
        *("make_episode", "read_record", "judge", "verify", "score_predictions", "examine", "export"),
        *("generate_study", "iterate_samples", "iterate_frames"),
    ),
    "siren_ros.errors": ("SirenError", "InputError", "BagError", "EpisodeError"),
    "siren_ros.simulation.scenario.episode": ("EpisodeRequest",),
    "siren_ros.running.seat.seated": ("AvController",),
    "siren_ros.running.seat.sight": ("Sight",),
    "siren_ros.running.studies.matrix": ("Study",),
    "siren_ros.simulation.world.commands": ("AvControl",),
}
_MODULE_OF: Final = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_MODULE_OF)  # noqa: PLE0605 - a list of strings

pin_before_numpy()
allow_short_names()


def __getattr__(name: str) -> Any:
    """Load a public name (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
