"""Plans the episodes for training, validation and test of a predictor, and variants of its inputs.

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
"""Levels of training episodes: half at the template's own level (''), a fifth at L0 without emergency driving."""


FIRST_SEED: Final = {Split.TRAIN: 100, Split.VAL: 900, Split.TEST_SEED: 1000, Split.TEST_MAP: 1000}
"""First seed of each split; from there each template and map takes the seeds that ``split_of`` assigns to it."""


@dataclass(frozen=True)
class PlannedEpisode:
    """One planned episode: to be simulated, or recorded already."""

    split: Split
    request: EpisodeRequest
    bag: Path | None = None
    """Path of the bag of a recorded episode."""
    label: str = ""
    """Name of a recorded episode."""

    @property
    def identity(self) -> EpisodeIdentity:
        """Values that decide its split."""
        return EpisodeIdentity.of_request(self.request)

    @property
    def name(self) -> str:
        """Name of its file of samples."""
        request = self.request
        return self.label or f"{request.template}_{request.level or 'own'}_{_map_name(request.map)}_seed{request.seed}"


def _map_name(file: str) -> str:
    return Path(file).name.split(".")[0] if file else _TOWN


_TOWN: Final = "town"


@dataclass(frozen=True)
class PlanSize:
    """Number of seeds per template and map in each split."""

    train: int = 8
    validation: int = 1
    test: int = 3


def plan_episodes(maps: Sequence[str], held_out: Sequence[str], size: PlanSize) -> tuple[PlannedEpisode, ...]:
    """Plan all episodes, in an order whose beginning already has all templates, maps and levels.

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
    """Seed number ``turn`` of a split; for maps held out by this training alone, seeds are consecutive."""
    if split is Split.TEST_MAP:
        return FIRST_SEED[split] + turn
    fixed = (seed for seed in count(FIRST_SEED[split]) if split_of(EpisodeIdentity(map_name, template, seed)) is split)
    return next(islice(fixed, turn, None))


def plan_bags(bags: Sequence[Path]) -> tuple[PlannedEpisode, ...]:
    """Plan recorded episodes, each in its fixed split.

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
    """Whether the episode has no emergency driving."""
    return request.level == EmergencyLevel.L0.name


@dataclass(frozen=True)
class Variant:
    """One variant of the training."""

    summary: str
    ablation: Ablation = Ablation.NONE
    ordinary_only: bool = False
    """Whether training uses only episodes without emergency driving (L0)."""
    as_few_as_ordinary: bool = False
    """Whether the number of training episodes is limited to that of ordinary ones."""


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
"""Variants by name. ``few`` separates the effect of fewer episodes from that of ``ordinary``."""
