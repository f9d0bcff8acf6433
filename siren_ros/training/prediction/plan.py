"""Which episodes a predictor is trained on, watched on and judged on, and with which inputs.

The splits differ by seed; the last one also by map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Final

from siren_ros.evaluation.prediction.siren_model.siren_predictor import Ablation
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.training.settings import Split

_LEVELS: Final = ("", "L0", "", "L1", "", "L0", "", "L2", "", "L3")
"""Half of the training episodes at the template's own level, a fifth without emergency driving."""


FIRST_SEED: Final = {Split.TRAIN: 100, Split.VALIDATION: 900, Split.TEST_SEEDS: 1000, Split.TEST_MAPS: 1000}

_SEEDS_APART: Final = 3
"""Of one template on one map; the next map begins one seed later, so that maps seldom share one."""


@dataclass(frozen=True)
class PlannedEpisode:
    """One episode of the data."""

    split: Split
    request: EpisodeRequest

    @property
    def name(self) -> str:
        """Name of its file."""
        request = self.request
        map_name = Path(request.map).name.split(".")[0] if request.map else "town"
        return f"{request.template}_{request.level or 'own'}_{map_name}_seed{request.seed}"


@dataclass(frozen=True)
class PlanSize:
    """Seeds of each template and map in each split."""

    train: int = 8
    validation: int = 1
    test: int = 3


def plan_episodes(maps: Sequence[str], held_out: Sequence[str], size: PlanSize) -> tuple[PlannedEpisode, ...]:
    """All episodes, so that any first part of the training episodes has all templates, maps and levels.

    Maps to train on and held-out maps, which only judge, are files; "" is the built-in town.
    """
    episodes = []
    for split, files, turns in (
        (Split.TRAIN, maps, size.train),
        (Split.VALIDATION, maps, size.validation),
        (Split.TEST_SEEDS, maps, size.test),
        (Split.TEST_MAPS, held_out, size.test),
    ):
        for turn, (place, file), (number, template) in product(range(turns), enumerate(files), enumerate(TEMPLATES)):
            seed = FIRST_SEED[split] + _SEEDS_APART * turn + place
            level = _LEVELS[(turn + 3 * number + 7 * place) % len(_LEVELS)] if split is Split.TRAIN else ""
            episodes.append(PlannedEpisode(split, EpisodeRequest(template, level, seed, file, sensors="none")))
    return tuple(episodes)


def is_ordinary(request: EpisodeRequest) -> bool:
    """Whether nobody drives as in an emergency in the episode."""
    return request.level == EmergencyLevel.L0.name


@dataclass(frozen=True)
class Variant:
    """One way to train."""

    summary: str
    ablation: Ablation = Ablation.NONE
    ordinary_only: bool = False
    """Whether only episodes without emergency driving (L0) are trained on."""
    as_few_as_ordinary: bool = False
    """Whether no more episodes are trained on than there are ordinary ones."""


FULL: Final = "full"
VARIANTS: Final = MappingProxyType(
    {
        FULL: Variant("everything"),
        "no_siren": Variant("without beacon and siren", Ablation.SIREN),
        "no_map": Variant("without lanes, stop lines and signals", Ablation.MAP),
        "ordinary": Variant("trained on ordinary traffic only (L0)", ordinary_only=True),
        "few": Variant("trained on as many episodes as ordinary, of all levels", as_few_as_ordinary=True),
    }
)
"""By name. ``few`` tells what of the loss of ``ordinary`` is due to fewer episodes."""
