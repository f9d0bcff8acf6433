"""The fields of a request are declared once and inherited by every program that takes one."""

from dataclasses import asdict, dataclass, fields

import pytest

from siren_ros.errors import InputError
from siren_ros.params.parameter_field import parameter
from siren_ros.scenario.request import EpisodeRequest, text_of_values, values_of


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


def test_values_are_text_and_numbers_to_the_last_bit() -> None:
    values = {"emv.speed_mps": 0.1 + 0.2, "demand.background_vehicles": 20.0}
    text = text_of_values(values)
    assert values_of(text) == values
    assert text == "demand.background_vehicles=20.0,emv.speed_mps=0.30000000000000004"
    assert values_of(" emv.speed_mps = 12 , ") == {"emv.speed_mps": 12.0}
    assert values_of("") == {}


@pytest.mark.parametrize("text", ["emv.speed_mps", "emv.speed_mps=fast", "a=1,a=2"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="values"):
        values_of(text)


def test_a_record_of_a_request_without_values_is_as_it_was_before_there_were_any() -> None:
    assert "values" not in EpisodeRequest("S1").to_json()
    assert EpisodeRequest(**EpisodeRequest("S1", values="duration_s=30").to_json()).values == "duration_s=30"


@pytest.mark.parametrize("text", ["a.b=1,a.b=2", "a.b=1,a.b =2", " a.b =1, a.b=1", "a.b =1,a.b =2"])
def test_a_parameter_is_given_once_however_it_is_spaced(text: str) -> None:
    with pytest.raises(InputError, match="each parameter once"):
        values_of(text)
