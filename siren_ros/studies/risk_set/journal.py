"""What a search has found, line by line on disk, so that a search that was interrupted goes on where it stopped."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.evidence import Evidence, Moments, SeenContact, SeenEncroachment
from siren_ros.evaluation.risk.labels import Reason, RiskLabel
from siren_ros.evaluation.risk.risk_class import risk_class
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.risk_set.candidate import Candidate, Rejected
from siren_ros.studies.risk_set.search import Outcome, Trial


class Journal:
    """One template's candidates in one file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> list[Trial]:
        """The candidates so far, in their order. A last line that was not finished is left out.

        Raises:
            InputError: The file is not a journal.
        """
        if not self._path.is_file():
            return []
        lines = self._path.read_text(encoding="utf-8").split("\n")
        trials: dict[int, Trial] = {}
        try:
            for line in lines[:-1]:  # what follows the last line end was not finished
                entry = json.loads(line)
                trials[entry["number"]] = Trial(risk_class(entry["looking_for"]), outcome_of_json(entry))
        except (ValueError, KeyError, TypeError) as error:
            raise InputError("out", str(self._path), f"the journal of a search ({error})") from error
        if sorted(trials) != list(range(len(trials))):
            raise InputError("out", str(self._path), "the journal of a search, with every candidate")
        return [trials[number] for number in range(len(trials))]

    def note(self, number: int, trial: Trial) -> None:
        """Adds the candidate of a number; a second one of the same number takes the place of the first."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        whole = self._path.read_bytes() if self._path.is_file() else b""
        with self._path.open("ab") as file:
            if whole and not whole.endswith(b"\n"):
                file.truncate(whole.rfind(b"\n") + 1)
            entry = {"number": number, "looking_for": trial.looking_for.title, **outcome_as_json(trial.outcome)}
            file.write(json.dumps(entry).encode() + b"\n")


def outcome_as_json(outcome: Outcome) -> dict[str, Any]:
    """An outcome as JSON types."""
    request = outcome.request.to_json()
    if isinstance(outcome, Rejected):
        return {"request": request, "rejected": outcome.reason}
    evidence = outcome.evidence
    return {
        "request": request,
        "first_step": outcome.first_step,
        "label": {**asdict(outcome.label), "risk": outcome.label.risk.title},
        "moments": {one.name: getattr(evidence.moments, one.name).tolist() for one in fields(Moments)},
        "encroachments": [asdict(one) for one in evidence.encroachments],
        "contacts": [asdict(one) for one in evidence.contacts],
    }


def outcome_of_json(entry: Mapping[str, Any]) -> Outcome:
    """Inverse of ``outcome_as_json``."""
    request = EpisodeRequest(**entry["request"])
    if "rejected" in entry:
        return Rejected(request, entry["rejected"])
    label = dict(entry["label"])
    kinds = {"step": np.int64, "actor_id": np.uint32}
    moments = {
        one.name: np.array(entry["moments"][one.name], kinds.get(one.name, np.float64)) for one in fields(Moments)
    }
    return Candidate(
        request,
        entry["first_step"],
        RiskLabel(risk_class(label.pop("risk")), Reason(label.pop("reason")), **label),
        Evidence(
            Moments(**moments),
            tuple(SeenEncroachment(**one) for one in entry["encroachments"]),
            tuple(SeenContact(**one) for one in entry["contacts"]),
        ),
    )
