"""The fields of a request are declared once and inherited by every program that takes one."""

from dataclasses import asdict, dataclass, fields

import pytest

from siren_ros.base.params.parameter_field import parameter
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeRequest, text_of_values, values_of
from siren_ros.simulation.scenario.paper import EmergencyLevel


@dataclass(frozen=True)
class Program(EpisodeRequest):
    """A configuration with a field of its own."""

    bag: str = parameter("", "Where the bag goes.")


def test_a_configuration_holds_a_request():
    program = Program(template="S5", seed=7, duration_s=3.0, bag="x")
    request = EpisodeRequest.within(program)
    assert type(request) is EpisodeRequest
    assert request == EpisodeRequest("S5", seed=7, duration_s=3.0)
    assert asdict(program) == {**asdict(request), "bag": "x"}


def test_every_field_says_what_it_is_and_its_default_is_allowed():
    for field in fields(EpisodeRequest):
        assert field.metadata["description"].endswith(".")
        choices = field.metadata["choices"]
        assert not choices or field.default in choices


def test_values_are_text_and_numbers_to_the_last_bit():
    values = {"emv.speed_mps": 0.1 + 0.2, "demand.background_vehicles": 20.0}
    text = text_of_values(values)
    assert values_of(text) == values
    assert text == "demand.background_vehicles=20.0,emv.speed_mps=0.30000000000000004"
    assert (values_of(" emv.speed_mps = 12 , "), values_of("")) == ({"emv.speed_mps": 12.0}, {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *[("emv.speed_mps", "values"), ("emv.speed_mps=fast", "values"), ("a=1,a=2", "values")],
        *[("a.b=1,a.b=2", "each parameter once"), ("a.b=1,a.b =2", "each parameter once")],
        *[(" a.b =1, a.b=1", "each parameter once"), ("a.b =1,a.b =2", "each parameter once")],
    ],
)
def test_other_texts_are_refused_and_a_parameter_is_given_once_however_it_is_spaced(text, words):
    with pytest.raises(InputError, match=words):
        values_of(text)


def test_a_record_of_a_request_without_values_is_as_it_was_before_there_were_any():
    assert "values" not in EpisodeRequest("S1").to_json()
    assert EpisodeRequest(**EpisodeRequest("S1", values="duration_s=30").to_json()).values == "duration_s=30"


def test_a_site_is_recorded_where_it_is_pinned():
    assert "site" not in EpisodeRequest("S1").to_json()
    assert EpisodeRequest(**EpisodeRequest("S1", site="a..b").to_json()).site == "a..b"
    assert described({"request": {"site": "a..b", "values": "x=1"}}).pinned == "a..b x=1"
    assert described({"request": {"site": "a..b"}}).pinned == "a..b"
    assert described({}).pinned == ""


def described(parameters):
    return EpisodeDescription("S1", EmergencyLevel.L3, 0, "town", "", 10.0, "none", "paper", (1,), parameters)


def test_the_request_names_programs_and_the_draw():
    request = {"predictor": "cv", "detector": "pillars", "values": "emv.speed_mps=12"}
    episode = described({"request": request})
    assert episode.asked == request
    assert (episode.predictor, episode.detector, episode.draw) == ("cv", "pillars", "emv.speed_mps=12")


@pytest.mark.parametrize("parameters", [{}, {"request": {}}, {"request": None}, {"request": "S1"}])
def test_a_description_without_them_has_none(parameters):
    episode = described(parameters)
    assert not episode.asked
    assert (episode.predictor, episode.detector, episode.draw) == ("", "", "")
    assert episode.template_values == {}


def test_the_templates_values_are_its_numbers():
    values = {"emv.speed_mps": 13, "response.compliance": 0.9, "emv.class": "ambulance", "flag": True}
    known = described({"template": values}).template_values
    assert known == {"emv.speed_mps": 13.0, "response.compliance": 0.9}
    assert all(isinstance(value, float) for value in known.values())
    assert described({"template": [1.0]}).template_values == {}


@pytest.mark.parametrize(("av", "number"), [({"actor_id": 4, "kind": "civilian"}, 4), (None, 0), ("civilian", 0)])
def test_the_av_is_who_the_description_names(av, number):
    assert (described({"av": av}).av_id, described({}).av_id) == (number, 0)
