"""Outcomes are read back as they were noted, whatever interrupted the writer."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.evidence import Evidence, Moments, SeenContact, SeenEncroachment
from siren_ros.evaluation.risk.labels import Reason, RiskLabel
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.risk_set.candidate import Candidate, Rejected
from siren_ros.studies.risk_set.journal import Journal, outcome_as_json, outcome_of_json
from siren_ros.studies.risk_set.search import Outcome, Trial


def found() -> Candidate:
    moments = Moments(
        np.arange(5, 8),
        np.array([4, 4, 9], np.uint32),
        np.array([1 / 3, 0.1, 2.9]),
        np.array([5.0, 5.1, 1.0]),
        np.array([2.0, 3.4, 0.1]),
        np.array([3.0, 2.0, 9.0]),
    )
    evidence = Evidence(moments, (SeenEncroachment(4, 6, 0.35),), (SeenContact(9, 7, 1.7),))
    label = RiskLabel(RiskClass.COLLISION, Reason.CONTACT, 9, 7, 1.7)
    return Candidate(EpisodeRequest(template="S4", seed=12, values="emv.speed_mps=14.25"), 40, label, evidence)


def noted(trials: list[Trial]) -> list[tuple[RiskClass, dict[str, object]]]:
    return [(trial.looking_for, outcome_as_json(trial.outcome)) for trial in trials]


OUTCOMES: list[Outcome] = [found(), Rejected(EpisodeRequest(template="S6"), "SUMO failed")]


TRIALS = [Trial(RiskClass.COLLISION, OUTCOMES[0]), Trial(RiskClass.NEAR_MISS, OUTCOMES[1])]


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_round_trip(outcome: Outcome) -> None:
    again = outcome_of_json(outcome_as_json(outcome))
    assert outcome_as_json(again) == outcome_as_json(outcome)
    assert again.request == outcome.request


def test_outcomes_in_the_order_of_the_candidates(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "search" / "S4.jsonl")
    assert journal.read() == []
    for number, trial in enumerate(TRIALS):
        journal.note(number, trial)
    assert noted(journal.read()) == noted(TRIALS)
    journal.note(0, TRIALS[1])
    assert noted(journal.read()) == noted([TRIALS[1], TRIALS[1]])


def test_a_line_that_was_cut_off_is_left_out_and_written_over(tmp_path: Path) -> None:
    path = tmp_path / "S4.jsonl"
    journal = Journal(path)
    for number in range(2):
        journal.note(number, TRIALS[number])
    path.write_bytes(path.read_bytes()[:-20])
    assert noted(journal.read()) == noted(TRIALS[:1])
    journal.note(1, TRIALS[0])
    assert noted(journal.read()) == noted([TRIALS[0], TRIALS[0]])


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "S4.jsonl"
    path.write_text('{"number": 1}\n')
    with pytest.raises(InputError, match=r"S4\.jsonl"):
        Journal(path).read()
