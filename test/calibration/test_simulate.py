"""Simulated tries of a few seconds: a search comes closer to what is known; what cannot be simulated is far away."""

from collections.abc import Callable

import numpy as np
import pytest

from siren_ros.calibration.fit import fit
from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import parameters_named
from siren_ros.calibration.simulate import FAILED_M, Situation, Target, driven
from siren_ros.calibration.tries import residuals_over
from siren_ros.errors import BagError, InputError
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.request import EpisodeRequest

SITUATION = Situation(EpisodeRequest("S4", "L1", 0, sensors="none"))
SPEED = "controller.target_speed_mps"
UNTIL_S = 2.0


def test_a_generation_of_tries_comes_closer_to_a_known_parameter() -> None:
    """The benchmark of the recovery searches to the end, with several parameters."""
    truth = 10.5
    target = Target("made", SITUATION, driven(SITUATION, {SPEED: truth}, UNTIL_S))
    with residuals_over([target], 1) as residuals:
        (at_the_truth,) = residuals([{SPEED: truth}], WHOLE)
        assert not at_the_truth.any(), "the same parameters give the same trajectory"
        found = fit(parameters_named([SPEED]), residuals, 11)
    assert found.evaluations >= 11
    assert 0.0 < found.error_m < found.start_error_m
    assert abs(found.values[SPEED] - truth) < 1.5, "the middle of the range is 3.5 m/s off"


def test_a_situation_that_cannot_be_set_up_is_far_away() -> None:
    target = Target("made", SITUATION, driven(SITUATION, {}, 0.2))
    nowhere = Target("no such", Situation(EpisodeRequest("S99", "L1", 0)), target.trajectory)
    with residuals_over([target, nowhere], 1) as residuals:
        (found,) = residuals([{}], WHOLE)
    assert np.linalg.norm(found) == pytest.approx(np.sqrt(0.5) * FAILED_M)


def test_records_that_do_not_say_what_they_were_made_from_are_refused(record_of: Callable[..., EpisodeRecord]) -> None:
    with pytest.raises(BagError, match="request"):
        Situation.of_record(record_of(duration_s=1.0))


def test_an_episode_with_an_av_is_refused(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=1.0)
    parameters = {**record.description.parameters, "request": EpisodeRequest("S2", av="civilian").to_json()}
    object.__setattr__(record.description, "parameters", parameters)
    with pytest.raises(InputError, match="AV under test"):
        Situation.of_record(record)
