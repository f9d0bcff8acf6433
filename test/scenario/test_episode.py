"""What a description says of its request and its template, and of one that says nothing."""

from collections.abc import Mapping

import pytest

from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.scenario.levels import EmergencyLevel


def described(parameters: Mapping[str, object]) -> EpisodeDescription:
    return EpisodeDescription("S1", EmergencyLevel.L3, 0, "town", "", 10.0, "none", "paper", (1,), parameters)


def test_the_request_names_programs_and_the_draw() -> None:
    request = {"predictor": "cv", "detector": "pillars", "values": "emv.speed_mps=12"}
    episode = described({"request": request})
    assert episode.asked == request
    assert (episode.predictor, episode.detector, episode.draw) == ("cv", "pillars", "emv.speed_mps=12")


@pytest.mark.parametrize("parameters", [{}, {"request": {}}, {"request": None}, {"request": "S1"}])
def test_a_description_without_them_has_none(parameters: Mapping[str, object]) -> None:
    episode = described(parameters)
    assert not episode.asked
    assert (episode.predictor, episode.detector, episode.draw) == ("", "", "")
    assert episode.template_values == {}


def test_the_templates_values_are_its_numbers() -> None:
    values = {"emv.speed_mps": 13, "response.compliance": 0.9, "emv.class": "ambulance", "flag": True}
    found = described({"template": values}).template_values
    assert found == {"emv.speed_mps": 13.0, "response.compliance": 0.9}
    assert all(isinstance(value, float) for value in found.values())
    assert described({"template": [1.0]}).template_values == {}


@pytest.mark.parametrize(("av", "number"), [({"actor_id": 4, "kind": "civilian"}, 4), (None, 0), ("civilian", 0)])
def test_the_av_is_who_the_description_names(av: object, number: int) -> None:
    assert described({"av": av}).av_id == number
    assert described({}).av_id == 0
