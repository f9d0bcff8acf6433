"""How many videos of each class a template contributes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.risk_class import RiskClass

Counts = tuple[int, int, int]
"""Normal, Near-Miss, Collision."""


PAPER_PER_TEMPLATE: Final = 15
PAPER_COUNTS: Final[Counts] = (74, 25, 6)
"""Of the paper's 105 videos, implied by the scores in its table of risk understanding."""


@dataclass(frozen=True)
class Balance:
    """The classes that a set is to have."""

    total: Counts
    per_template: int

    @property
    def videos(self) -> int:
        """Number of all videos."""
        return sum(self.total)


def papers_balance(templates: int, per_template: int = PAPER_PER_TEMPLATE) -> Balance:
    """The paper's shares of the classes, in whole numbers, for some templates with some videos of each."""
    videos, all_counts = templates * per_template, sum(PAPER_COUNTS)
    near_miss, collision = (round(PAPER_COUNTS[risk] * videos / all_counts) for risk in (1, 2))
    return Balance((videos - near_miss - collision, near_miss, collision), per_template)


def quotas(balance: Balance, templates: Sequence[str]) -> Mapping[str, Counts]:
    """The share of each template: as equal as whole numbers allow, each template with ``per_template`` videos.

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
    place = 0
    for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS):
        for _ in range(balance.total[risk]):
            shares[templates[place % count]][risk] += 1
            place += 1
    for template, share in shares.items():
        share[RiskClass.NORMAL] = balance.per_template - sum(share)
        if share[RiskClass.NORMAL] < 0:
            raise InputError("balance", balance.total, f"at most {balance.per_template} rare videos for {template}")
    return {template: (share[0], share[1], share[2]) for template, share in shares.items()}


@dataclass(frozen=True)
class Finding:
    """What a template's search came to."""

    found: Counts
    given_up: frozenset[RiskClass] = frozenset()
    """Classes that it looked for long enough without a find."""


def shifted(wanted: Mapping[str, Counts], findings: Mapping[str, Finding], balance: Balance) -> Mapping[str, Counts]:
    """New quotas after a round of searches: what one template cannot find, those that can are to find in its place.

    A template that gave a rare class up keeps what it has found of it. What is lacking then is dealt in turn to the
    templates that have found the class and have not given it up. Quotas that stay as they are mean that nothing more
    can be gained.
    """
    shares = {key: list(counts) for key, counts in wanted.items()}
    for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS):
        for key, finding in findings.items():
            if risk in finding.given_up:
                shares[key][risk] = min(shares[key][risk], finding.found[risk])
        able = [key for key, one in findings.items() if one.found[risk] and risk not in one.given_up]
        place = 0
        while able and sum(share[risk] for share in shares.values()) < balance.total[risk]:
            share = shares[able[place % len(able)]]
            if sum(share[1:]) < balance.per_template:
                share[risk] += 1
                place += 1
            else:
                able.pop(place % len(able))
    return {key: (max(0, balance.per_template - sum(share[1:])), share[1], share[2]) for key, share in shares.items()}


def settled(wanted: Mapping[str, Counts], found: Mapping[str, Counts], per_template: int) -> Mapping[str, Counts]:
    """The classes that each template contributes when some could not find what they were to have.

    What one template lacks of a rare class another gives that found more than its share, in the order of the
    templates; normal videos fill up. A template that has not found enough normal videos exchanges with one that has
    more of them. The totals stay as near to what is wanted as the findings allow.

    Args:
        wanted: Quotas.
        found: How many videos of each class each template has found.
        per_template: Videos of each template.
    """
    given = {key: [0, *(min(wanted[key][risk], found[key][risk]) for risk in (1, 2))] for key in wanted}
    for risk in (RiskClass.COLLISION, RiskClass.NEAR_MISS):
        lacking = sum(counts[risk] for counts in wanted.values()) - sum(counts[risk] for counts in given.values())
        for key, counts in given.items():
            more = max(0, min(lacking, found[key][risk] - counts[risk], per_template - counts[1] - counts[2]))
            counts[risk] += more
            lacking -= more
    _exchange(given, found, per_template)
    return {
        key: (min(found[key][0], per_template - counts[1] - counts[2]), counts[1], counts[2])
        for key, counts in given.items()
    }


def _exchange(given: dict[str, list[int]], found: Mapping[str, Counts], per_template: int) -> None:
    """Templates that lack normal videos show a rare one more, and others a normal one in its place."""
    for risk in (RiskClass.NEAR_MISS, RiskClass.COLLISION):
        for key, counts in given.items():
            while counts[risk] < found[key][risk] and sum(counts[1:]) + found[key][0] < per_template:
                others = [
                    one
                    for name, one in given.items()
                    if one[risk] > 0 and sum(one[1:]) + found[name][0] > per_template and name != key
                ]
                if not others:
                    break
                max(others, key=lambda one: one[risk])[risk] -= 1
                counts[risk] += 1
