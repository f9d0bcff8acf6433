"""The fields of a request are declared once and inherited by every program that takes one."""

from dataclasses import asdict, dataclass, fields

from siren_ros.params.parameter_field import parameter
from siren_ros.scenario.request import EpisodeRequest


@dataclass(frozen=True)
class Program(EpisodeRequest):
    """A configuration with a field of its own."""

    bag: str = parameter("", "Where the bag goes.")


def test_a_configuration_holds_a_request() -> None:
    program = Program(template="S5", seed=7, duration_s=3.0, bag="x")
    request = EpisodeRequest.within(program)
    assert type(request) is EpisodeRequest
    assert request == EpisodeRequest("S5", seed=7, duration_s=3.0)
    assert asdict(program) == {**asdict(request), "bag": "x"}


def test_every_field_says_what_it_is_and_its_default_is_allowed() -> None:
    for field in fields(EpisodeRequest):
        assert field.metadata["description"].endswith(".")
        choices = field.metadata["choices"]
        assert not choices or field.default in choices
