"""Search of each template: quotas of classes, one candidate after another, and a journal."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from siren_ros.base.params import plain_files
from siren_ros.errors import InputError
from siren_ros.running.studies.risk_set.candidate import Candidate, Outcome, outcome_as_json, outcome_of_json
from siren_ros.scoring.evaluation.risk.labels import (
    RiskClass,
    risk_class,
)
from siren_ros.simulation.scenario.episode import EpisodeRequest

Counts = tuple[int, int, int]
"""Number of videos: Normal, Near-Miss, Collision."""


PAPER_PER_TEMPLATE: Final = 15
PAPER_COUNTS: Final[Counts] = (74, 25, 6)
"""Counts of the paper's 105 videos, which follow from its table of risk scores."""


@dataclass(frozen=True)
class Balance:
    """Class balance of a set."""

    total: Counts
    per_template: int
    within: bool = False
    """Whether each template has the same class proportions, as far as whole numbers allow."""

    @property
    def videos(self) -> int:
        """Number of all videos."""
        return sum(self.total)


def papers_balance(templates: int, per_template: int = PAPER_PER_TEMPLATE, *, within: bool = False) -> Balance:
    """The paper's class shares in whole numbers, for some templates with equally many videos."""
    videos, all_counts = templates * per_template, sum(PAPER_COUNTS)
    near_miss, collision = (round(PAPER_COUNTS[risk] * videos / all_counts) for risk in (1, 2))
    return Balance((videos - near_miss - collision, near_miss, collision), per_template, within)


def quotas(balance: Balance, templates: Sequence[str]) -> Mapping[str, Counts]:
    """Quota of each template: equal as far as whole numbers allow, ``per_template`` videos each.

    The rare classes are dealt first; what an equal share leaves over goes to the first templates for collisions and
    to the next ones for near-misses, so that no template gets all of it.

    Raises:
        InputError: The counts do not add up to the number of templates times the videos of each.
    """
    count = len(templates)
    if balance.videos != count * balance.per_template:
        allowed = f"counts that add up to {count} templates x {balance.per_template} videos"
        raise InputError("balance", balance.total, allowed)
    shares = {template: [0, 0, 0] for template in templates}
    rare = [risk for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS) for _ in range(balance.total[risk])]
    for place, risk in enumerate(rare):
        shares[templates[place % count]][risk] += 1
    for template, share in shares.items():
        share[RiskClass.NORMAL] = balance.per_template - sum(share)
        if share[RiskClass.NORMAL] < 0:
            raise InputError("balance", balance.total, f"at most {balance.per_template} rare videos for {template}")
    return {template: (share[0], share[1], share[2]) for template, share in shares.items()}


Finding = tuple[Counts, frozenset[RiskClass]]
"""Finds of a template, and the classes that it has given up after a long search."""


def shifted(shares: Mapping[str, Counts], findings: Mapping[str, Finding], balance: Balance) -> Mapping[str, Counts]:
    """New quotas after a round of searches: templates that find a class take over from those that do not.

    A template that gave a rare class up keeps what it has found of it. What is lacking then is dealt in turn to the
    templates that have found the class and have not given it up. Quotas that stay as they are mean that nothing more
    can be gained.
    """
    changed = {key: list(counts) for key, counts in shares.items()}
    for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS):
        for key, (found, given_up) in findings.items():
            if risk in given_up:
                changed[key][risk] = min(changed[key][risk], found[risk])
        able = [key for key, (found, given_up) in findings.items() if found[risk] and risk not in given_up]
        place = 0
        while able and sum(share[risk] for share in changed.values()) < balance.total[risk]:
            share = changed[able[place % len(able)]]
            if sum(share[1:]) < balance.per_template:
                share[risk] += 1
                place += 1
            else:
                able.pop(place % len(able))
    return {key: (max(0, balance.per_template - sum(share[1:])), share[1], share[2]) for key, share in changed.items()}


def settled(shares: Mapping[str, Counts], found: Mapping[str, Counts], per_template: int) -> Mapping[str, Counts]:
    """Contribution of each template if some could not reach their quotas.

    What one template lacks of a rare class another gives that found more than its share, in the order of the
    templates; normal videos fill up. A template that has not found enough normal videos exchanges with one that has
    more of them. The totals stay as near to the quotas (``shares``) as the findings allow.
    """
    given = {key: [0, *(min(shares[key][risk], found[key][risk]) for risk in (1, 2))] for key in shares}
    for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS):
        lacking = sum(counts[risk] for counts in shares.values()) - sum(counts[risk] for counts in given.values())
        for key, counts in given.items():
            more = max(0, min(lacking, found[key][risk] - counts[risk], per_template - counts[1] - counts[2]))
            counts[risk] += more
            lacking -= more
    _exchange(given, found, per_template)
    return {
        key: (min(found[key][0], per_template - counts[1] - counts[2]), counts[1], counts[2])
        for key, counts in given.items()
    }


def balanced(shares: Mapping[str, Counts], found: Mapping[str, Counts]) -> Mapping[str, Counts]:
    """Contribution of each template so that all keep the class proportions of their quotas.

    A template that has found too few of a class has fewer of the others, too: the class with the smallest share of its
    quota decides. One that has found none of a class has no videos.
    """
    given = {}
    for key, quota in shares.items():
        wanted = [(have, want) for have, want in zip(found[key], quota, strict=True) if want]
        share = min((min(1.0, have / want) for have, want in wanted), default=0.0)
        normal, near_miss, collision = (int(share * want + 1e-9) for want in quota)
        given[key] = (normal, near_miss, collision)
    return given


def enlarged(shares: Mapping[str, Counts], findings: Mapping[str, Finding], balance: Balance) -> Mapping[str, Counts]:
    """New quotas after a round of searches if all templates must keep the same proportions (``balanced``).

    A template that has not found all keeps what its findings allow. The templates that have found all, and have not
    given a class up, are to find in its place what is lacking in the set. Quotas that stay as they are mean that
    nothing more can be gained.
    """
    given = balanced(shares, {key: found for key, (found, _) in findings.items()})
    able = [key for key, (_, given_up) in findings.items() if given[key] == shares[key] and not given_up]
    changed = {key: list(counts) for key, counts in given.items()}
    for risk in RiskClass:
        lacking = balance.total[risk] - sum(counts[risk] for counts in given.values())
        for place in range(lacking if able else 0):
            changed[able[place % len(able)]][risk] += 1
    return {key: (counts[0], counts[1], counts[2]) for key, counts in changed.items()}


def _exchange(given: dict[str, list[int]], found: Mapping[str, Counts], per_template: int) -> None:
    """Exchange videos: templates short of normal videos give one more rare video, others a normal one instead."""
    for risk in (RiskClass.NEAR_MISS, RiskClass.COLLISION):
        for key, counts in given.items():
            while counts[risk] < found[key][risk] and sum(counts[1:]) + found[key][0] < per_template:
                others = [
                    other
                    for name, other in given.items()
                    if other[risk] > 0 and sum(other[1:]) + found[name][0] > per_template and name != key
                ]
                if not others:
                    break
                max(others, key=lambda other: other[risk])[risk] -= 1
                counts[risk] += 1


PATIENCE: Final = 25
"""Number of candidates without success after which a class is given up."""


@dataclass(frozen=True)
class Trial:
    """One candidate: the class that it was drawn for, and its result."""

    looking_for: RiskClass
    outcome: Outcome

    @property
    def found(self) -> RiskClass | None:
        """The class that was found."""
        return self.outcome.label.risk if isinstance(self.outcome, Candidate) else None


@dataclass(frozen=True)
class Search:
    """Progress of a template's search, in the order of candidates."""

    quota: Counts
    budget: int
    """Largest number of candidates."""
    patience: int = PATIENCE
    trials: tuple[Trial, ...] = field(default_factory=tuple)

    @property
    def found(self) -> Counts:
        """Number of videos per class."""
        risks = [trial.found for trial in self.trials]
        return (risks.count(RiskClass.NORMAL), risks.count(RiskClass.NEAR_MISS), risks.count(RiskClass.COLLISION))

    @property
    def given_up(self) -> frozenset[RiskClass]:
        """Classes that the last candidates for them, as many as ``patience`` allows, did not find."""
        in_vain = dict.fromkeys(RiskClass, 0)
        for trial in self.trials:
            in_vain[trial.looking_for] += 1
            if trial.found is not None:
                in_vain[trial.found] = 0
        return frozenset(risk for risk, candidates in in_vain.items() if candidates >= self.patience)

    @property
    def lacking(self) -> dict[RiskClass, float]:
        """Missing share of each class; 0 for classes that were given up."""
        given_up = self.given_up
        return {
            risk: max(0, want - have) / want if want and risk not in given_up else 0.0
            for risk, have, want in zip(RiskClass, self.found, self.quota, strict=True)
        }

    @property
    def short_of(self) -> frozenset[RiskClass]:
        """Classes with fewer videos than their quota: the next find will become a video."""
        return frozenset(risk for risk in RiskClass if self.found[risk] < self.quota[risk])

    @property
    def finished(self) -> bool:
        """Whether nothing is missing, or no further candidate is allowed."""
        return len(self.trials) >= self.budget or not any(self.lacking.values())

    @property
    def looking_for(self) -> RiskClass:
        """The class with the largest missing share; of equal ones the most severe."""
        lacking = self.lacking
        return max(RiskClass, key=lambda risk: (lacking[risk], risk))

    def with_trial(self, trial: Trial) -> "Search":
        """The search after one more candidate."""
        return replace(self, trials=(*self.trials, trial))

    def chosen(self, counts: Counts) -> dict[int, Candidate]:
        """The first candidates of each class by number."""
        left, videos = list(counts), {}
        for number, outcome in enumerate(trial.outcome for trial in self.trials):
            if isinstance(outcome, Candidate) and left[outcome.label.risk] > 0:
                left[outcome.label.risk] -= 1
                videos[number] = outcome
        return videos


def continue_search(
    search: Search,
    request: Callable[[RiskClass, int], EpisodeRequest],
    run: Callable[[Search, EpisodeRequest], Outcome],
    keep: Callable[[Search], None],
) -> Search:
    """Try candidates until the search is finished.

    ``request`` gives the candidate of a number that looks for a class. ``run`` simulates and labels it, knowing the
    search so far. ``keep`` is called with the search after each candidate, to keep its outcome.
    """
    while not search.finished:
        looking_for = search.looking_for
        outcome = run(search, request(looking_for, len(search.trials)))
        search = search.with_trial(Trial(looking_for, outcome))
        keep(search)
    return search


class Journal:
    """File of one template's candidates."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> list[Trial]:
        """Read the candidates in order, without an incomplete last line; InputError if the file is not a journal."""
        if not self._path.is_file():
            return []
        lines = self._path.read_text(encoding="utf-8").split("\n")
        trials: dict[int, Trial] = {}
        try:
            for line in lines[:-1]:  # text after the last line end is incomplete
                entry = plain_files.load_json(line)
                trials[entry["number"]] = Trial(risk_class(entry["looking_for"]), outcome_of_json(entry))
        except (ValueError, KeyError, TypeError) as error:
            raise InputError("out", str(self._path), f"the journal of a search ({error})") from error
        if sorted(trials) != list(range(len(trials))):
            raise InputError("out", str(self._path), "the journal of a search, with every candidate")
        return [trials[number] for number in range(len(trials))]

    def note(self, number: int, trial: Trial) -> None:
        """Add a candidate; a second one with the same number replaces the first."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        whole = self._path.read_bytes() if self._path.is_file() else b""
        with self._path.open("ab") as file:
            if whole and not whole.endswith(b"\n"):
                file.truncate(whole.rfind(b"\n") + 1)
            entry = {"number": number, "looking_for": trial.looking_for.title, **outcome_as_json(trial.outcome)}
            file.write(json.dumps(entry).encode() + b"\n")
