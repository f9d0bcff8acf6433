"""Which films the sequence model is trained and watched on: apart by seed from each other and from every test set."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from siren_ros.evaluation.risk.labels import RiskClass
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.scenario.paper import TEMPLATES
from siren_ros.scenario.templates import load_template
from siren_ros.studies.risk_set.candidate import candidate_request
from siren_ros.training.settings import Split

FIRST_SEED: Final = {Split.TRAIN: 500, Split.VALIDATION: 900}
"""Seeds of the draws. ``siren generate risk`` draws with seed 0 unless it is given another one."""
_LOOKS_FOR: Final = (RiskClass.NORMAL, RiskClass.NEAR_MISS, RiskClass.COLLISION, RiskClass.COLLISION)
_COLLISIONS_IN: Final = "S4"
"""Where collisions are found most often; further films of it look for nothing else."""
_FURTHER: Final = 1000
"""From this number on."""


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
        turn = _LOOKS_FOR[self.number % len(_LOOKS_FOR)]
        looking_for = RiskClass.COLLISION if self.number >= _FURTHER else turn
        template = load_template(self.template)
        return candidate_request(template, self.template, looking_for, FIRST_SEED[self.split], self.number, "")


@dataclass(frozen=True)
class FilmPlanSize:
    """Films of each template."""

    train: int = 4
    validation: int = 4


def plan_films(size: FilmPlanSize, templates: Sequence[str] = TEMPLATES) -> tuple[PlannedFilm, ...]:
    """All films, so that any first part has all templates and classes, and both splits.

    To those of each template as many more of the template with most collisions are added.
    """
    films = []
    for number in range(max(size.train, size.validation)):
        for split, count in ((Split.TRAIN, size.train), (Split.VALIDATION, size.validation)):
            if number < count:
                films += [PlannedFilm(split, template, number) for template in templates]
                films.append(PlannedFilm(split, _COLLISIONS_IN, _FURTHER + number))
    return tuple(films)
