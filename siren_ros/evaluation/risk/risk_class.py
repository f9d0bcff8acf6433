"""The three classes of risk."""

from collections.abc import Iterable
from enum import IntEnum

from siren_ros.errors import InputError


class RiskClass(IntEnum):
    """What a scene comes to, by severity (paper, "Risk understanding")."""

    NORMAL = 0
    NEAR_MISS = 1
    COLLISION = 2

    @property
    def title(self) -> str:
        """As the paper and answer files write it: Normal, Near-Miss or Collision."""
        return _TITLES[self]


_TITLES = {RiskClass.NORMAL: "Normal", RiskClass.NEAR_MISS: "Near-Miss", RiskClass.COLLISION: "Collision"}
TITLES = tuple(_TITLES[one] for one in RiskClass)


def risk_class(title: str) -> RiskClass:
    """The class of a title; case, spaces, hyphens and underscores do not matter.

    Raises:
        InputError: Another word.
    """
    plain = "".join(letter for letter in title.casefold() if letter.isalpha())
    for known, written in _TITLES.items():
        if plain == written.casefold().replace("-", ""):
            return known
    raise InputError("class", title, ", ".join(TITLES))


def most_severe(classes: Iterable[RiskClass]) -> RiskClass:
    """The paper's max-severity rule over the predictions of one video.

    Raises:
        ValueError: No class at all.
    """
    return max(classes)
