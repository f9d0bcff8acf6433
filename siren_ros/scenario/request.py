"""What a user asks for: the fields from which an episode is made. They are declared here and nowhere else."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.params.parameter_field import parameter
from siren_ros.scenario.levels import EmergencyLevel

DEFAULT_LOOK: Final = "clear"
_LEVELS: Final = ("", *EmergencyLevel.__members__)
_AV_KINDS: Final = ("", "civilian")
MAX_SEED: Final = 2**31 - 1
_LEFT_OUT: Final = frozenset({"values", "predictor", "detector"})
"""Fields that records do not have where they are empty, so that records of episodes without them stay the same."""


@dataclass(frozen=True)
class EpisodeRequest:
    """The same request gives the same episode. The nodes that take a request inherit these fields as parameters."""

    template: str = parameter("S2", "Interaction template: an id such as S2 or the path of a template file.")
    level: str = parameter("", "Emergency level; empty: the template's own.", choices=_LEVELS)
    seed: int = parameter(0, "Seed of everything random in the episode.", minimum=0, maximum=MAX_SEED)
    map: str = parameter("", "Path of a SUMO net, OpenDRIVE or OpenStreetMap file; empty: the built-in town.")
    duration_s: float = parameter(0.0, "Simulated duration; 0: the template's own.", minimum=0.0, maximum=3600.0)
    preset: str = parameter("paper", "How civilians react: a name in params/presets or the path of a preset file.")
    sensors: str = parameter("front", "Sensor suite: a name in params/suites or the path of a suite file.")
    look: str = parameter(DEFAULT_LOOK, "Weather and time of day: a name in params/looks or the path of a look file.")
    av: str = parameter(
        "",
        "Who an external controller drives: the civilian that the EMV has to pass; empty: nobody.",
        choices=_AV_KINDS,
    )
    av_sensors: str = parameter("none", "Sensor suite of that vehicle: as for sensors; its topics begin with /av.")
    values: str = parameter(
        "", "Values of the template's parameters in place of the seed's own: emv.speed_mps=12.5,duration_s=60."
    )

    predictor: str = parameter(
        "", "Program that takes part and says at every frame on /predictions where vehicles will be; empty: none."
    )

    detector: str = parameter(
        "",
        "Detector of vehicles in the sweeps of the running episode, on /emv/detections: pillars, or the path of an "
        "ONNX file; empty: none.",
    )

    @staticmethod
    def within(config: "EpisodeRequest") -> "EpisodeRequest":
        """The request that a configuration with further fields holds."""
        return EpisodeRequest(**{field.name: getattr(config, field.name) for field in fields(EpisodeRequest)})

    def to_json(self) -> dict[str, Any]:
        """The request as JSON types, for the record; without values and programs where it has none."""
        return {name: value for name, value in asdict(self).items() if name not in _LEFT_OUT or value}


def values_of(text: str) -> dict[str, float]:
    """The values in the text of a request's field ``values``, by the dotted path of the parameter.

    Raises:
        InputError: Not ``path=number`` by commas, or a path twice.
    """
    found: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        path, _, number = part.partition("=")
        try:
            value = float(number)
        except ValueError as error:
            raise InputError("values", part, "PATH=NUMBER, several by commas: emv.speed_mps=12.5") from error
        if path.strip() in found:
            raise InputError("values", part, "each parameter once")
        found[path.strip()] = value
    return found


def text_of_values(values: Mapping[str, float]) -> str:
    """Inverse of ``values_of``, to the last bit; sorted, so that the same values are the same text."""
    return ",".join(f"{path}={float(value)!r}" for path, value in sorted(values.items()))
