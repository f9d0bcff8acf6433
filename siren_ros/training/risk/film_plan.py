"""Which films the sequence model is trained and watched on: apart by seed from each other and from every test set."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.scenario.templates import load_template
from siren_ros.studies.risk_set.variation import candidate_request
from siren_ros.training.episode_plan import TEMPLATES, Split

FIRST_SEED: Final = {Split.TRAIN: 500, Split.VALIDATION: 900}
"""Seeds of the draws. ``siren generate risk`` draws with seed 0 unless told otherwise."""
_LOOKS_FOR: Final = (RiskClass.NORMAL, RiskClass.NEAR_MISS, RiskClass.COLLISION)


@dataclass(frozen=True)
class PlannedFilm:
    """One film of the data."""

    split: Split
    template: str
    number: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.split.value}_{self.template}_{self.number:03d}"

    @property
    def request(self) -> EpisodeRequest:
        """Its episode: drawn like the candidates of a search, each class in turn."""
        looking_for = _LOOKS_FOR[self.number % len(_LOOKS_FOR)]
        template = load_template(self.template)
        return candidate_request(template, self.template, looking_for, FIRST_SEED[self.split], self.number, "")


@dataclass(frozen=True)
class FilmPlanSize:
    """Films of each template."""

    train: int = 18
    validation: int = 6


def plan_films(size: FilmPlanSize, templates: Sequence[str] = TEMPLATES) -> tuple[PlannedFilm, ...]:
    """All films, so that any first part has all templates and classes, and both splits in their proportion."""
    films = []
    for number in range(max(size.train, size.validation)):
        for split, count in ((Split.TRAIN, size.train), (Split.VALIDATION, size.validation)):
            films += [PlannedFilm(split, template, number) for template in templates if number < count]
    return tuple(films)
