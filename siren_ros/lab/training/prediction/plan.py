"""Which episodes a predictor is trained on, watched on and judged on, and with which inputs.

``siren_ros.simulation.scenario.splits`` fixes the split of each episode.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count, islice, product
from pathlib import Path
from types import MappingProxyType
from typing import Final

from siren_ros.data.record.bag_survey import bag_sha256, episode_name
from siren_ros.data.record.episode_source import open_source
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import Ablation
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.simulation.scenario.splits import EpisodeIdentity, Split, split_of, split_rule

_LEVELS: Final = ("", "L0", "", "L1", "", "L0", "", "L2", "", "L3")
"""Half of the training episodes at the template's own level, a fifth without emergency driving."""


FIRST_SEED: Final = {Split.TRAIN: 100, Split.VAL: 900, Split.TEST_SEED: 1000, Split.TEST_MAP: 1000}
"""From here on, each template and map has its seeds where ``split_of`` says so."""


@dataclass(frozen=True)
class PlannedEpisode:
    """One episode of the data: to be simulated, or recorded."""

    split: Split
    request: EpisodeRequest
    bag: Path | None = None
    """Of a recorded episode."""
    label: str = ""
    """Name of a recorded episode."""

    @property
    def identity(self) -> EpisodeIdentity:
        """What fixes its split."""
        return EpisodeIdentity.of_request(self.request)

    @property
    def name(self) -> str:
        """Name of its file."""
        request = self.request
        return self.label or f"{request.template}_{request.level or 'own'}_{_map_name(request.map)}_seed{request.seed}"


def _map_name(file: str) -> str:
    return Path(file).name.split(".")[0] if file else _TOWN


_TOWN: Final = "town"


@dataclass(frozen=True)
class PlanSize:
    """Seeds of each template and map in each split."""

    train: int = 8
    validation: int = 1
    test: int = 3


def plan_episodes(maps: Sequence[str], held_out: Sequence[str], size: PlanSize) -> tuple[PlannedEpisode, ...]:
    """All episodes, so that any first part of the training episodes has all templates, maps and levels.

    Maps to train on and held-out maps, which only judge, are files; "" is the built-in town. The seeds of a template on
    a map are the first ones that are fixed for the split.

    Raises:
        InputError: A map to train on is one that never trains, or also held out.
    """
    for file in maps:
        if _map_name(file) in split_rule().test_maps or file in held_out:
            raise InputError("maps", file, "maps that are not held out, here and in params/splits.yaml")
    episodes = []
    for split, files, turns in (
        (Split.TRAIN, maps, size.train),
        (Split.VAL, maps, size.validation),
        (Split.TEST_SEED, maps, size.test),
        (Split.TEST_MAP, held_out, size.test),
    ):
        for turn, (place, file), (number, template) in product(range(turns), enumerate(files), enumerate(TEMPLATES)):
            seed = _seed(split, _map_name(file), template, turn)
            level = _LEVELS[(turn + 3 * number + 7 * place) % len(_LEVELS)] if split is Split.TRAIN else ""
            episodes.append(PlannedEpisode(split, EpisodeRequest(template, level, seed, file, sensors="none")))
    return tuple(episodes)


def _seed(split: Split, map_name: str, template: str, turn: int) -> int:
    """The seed with the number ``turn``; those of maps that are held out for one training alone are consecutive."""
    if split is Split.TEST_MAP:
        return FIRST_SEED[split] + turn
    fixed = (seed for seed in count(FIRST_SEED[split]) if split_of(EpisodeIdentity(map_name, template, seed)) is split)
    return next(islice(fixed, turn, None))


def plan_bags(bags: Sequence[Path]) -> tuple[PlannedEpisode, ...]:
    """Recorded episodes, each in the split that is fixed for it.

    Raises:
        BagError: One is no recorded episode.
    """
    episodes = []
    for bag in bags:
        with open_source(bag) as source:
            about = source.description
        name = f"{episode_name(about.template, about.level.name, about.seed, about.map_name)}-{bag_sha256(bag)[:8]}"
        request = EpisodeRequest(about.template, about.level.name, about.seed, about.map_name, values=about.draw)
        episodes.append(PlannedEpisode(split_of(EpisodeIdentity.of(about)), request, bag, name))
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
