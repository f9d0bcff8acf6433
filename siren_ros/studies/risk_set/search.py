"""The search of one template: candidates one after another, until each class has its videos or the budget is spent."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.risk_set.balance import Counts
from siren_ros.studies.risk_set.candidate import Candidate, Rejected

Outcome = Candidate | Rejected
PATIENCE: Final = 25
"""Candidates without a find after which a class is given up."""


@dataclass(frozen=True)
class Trial:
    """One candidate: the class that the search looked for when it drew it, and what it came to."""

    looking_for: RiskClass
    outcome: Outcome

    @property
    def found(self) -> RiskClass | None:
        """The class that it brought."""
        return self.outcome.label.risk if isinstance(self.outcome, Candidate) else None


@dataclass(frozen=True)
class Search:
    """What a template's search has found so far, in the order of the candidates."""

    wanted: Counts
    budget: int
    """Most candidates."""
    patience: int = PATIENCE
    trials: tuple[Trial, ...] = field(default_factory=tuple)

    @property
    def found(self) -> Counts:
        """Videos of each class."""
        risks = [trial.found for trial in self.trials]
        return (risks.count(RiskClass.NORMAL), risks.count(RiskClass.NEAR_MISS), risks.count(RiskClass.COLLISION))

    @property
    def given_up(self) -> frozenset[RiskClass]:
        """Classes that the last candidates that looked for them, as many as patience allows, have not brought."""
        return frozenset(risk for risk in RiskClass if self._in_vain(risk) >= self.patience)

    def _in_vain(self, risk: RiskClass) -> int:
        """How many candidates looked for a class since it was found last."""
        since = next((number for number, one in enumerate(reversed(self.trials)) if one.found is risk), None)
        last = self.trials[len(self.trials) - since :] if since is not None else self.trials
        return sum(trial.looking_for is risk for trial in last)

    @property
    def lacking(self) -> dict[RiskClass, float]:
        """The share of its videos that each class still lacks; classes that were given up lack none."""
        given_up = self.given_up
        return {
            risk: max(0, want - have) / want if want and risk not in given_up else 0.0
            for risk, have, want in zip(RiskClass, self.found, self.wanted, strict=True)
        }

    @property
    def short_of(self) -> frozenset[RiskClass]:
        """Classes of which there are fewer videos than wanted: the next find becomes one."""
        pairs = zip(RiskClass, self.found, self.wanted, strict=True)
        return frozenset(risk for risk, have, want in pairs if have < want)

    @property
    def finished(self) -> bool:
        """Whether nothing is lacking, or nothing more may be tried."""
        return len(self.trials) >= self.budget or not any(self.lacking.values())

    @property
    def looking_for(self) -> RiskClass:
        """The class of which the largest share is still lacking; of equal ones the most severe."""
        lacking = self.lacking
        return max(RiskClass, key=lambda risk: (lacking[risk], risk))

    def with_trial(self, trial: Trial) -> "Search":
        """The search after one more candidate."""
        return replace(self, trials=(*self.trials, trial))

    def chosen(self, counts: Counts) -> dict[int, Candidate]:
        """The first candidates of each class, by their number."""
        left = list(counts)
        videos = {}
        for number, outcome in enumerate(trial.outcome for trial in self.trials):
            if isinstance(outcome, Candidate) and left[outcome.label.risk] > 0:
                left[outcome.label.risk] -= 1
                videos[number] = outcome
        return videos


def continue_search(
    search: Search,
    request: Callable[[RiskClass, int], EpisodeRequest],
    run: Callable[[Search, EpisodeRequest], Outcome],
    told: Callable[[Search], None],
) -> Search:
    """Tries candidates until the search is finished.

    Args:
        search: What was found before; empty at first.
        request: The candidate of a number, that looks for a class.
        run: Simulates and labels it, knowing the search so far.
        told: Is told the search after each candidate, to keep its outcome.
    """
    while not search.finished:
        looking_for = search.looking_for
        outcome = run(search, request(looking_for, len(search.trials)))
        search = search.with_trial(Trial(looking_for, outcome))
        told(search)
    return search
