"""Splits as data: what an episode is for follows from the episode alone, so that it stays when a study grows.

Every part that splits episodes asks this module: exports, trainings, and evaluations, which say what a model has seen.
"""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, Final

from siren_ros.base.params import plain_yaml
from siren_ros.base.params.resources import params_dir
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeRequest, text_of_values, values_of

_FILE: Final = "splits.yaml"
_PERCENT: Final = 100
_TOWN: Final = "town"


class Split(StrEnum):
    """What an episode is used for, or how it relates to the training data of a model."""

    TRAIN = "train"
    VAL = "val"
    """Episodes that were looked at during training and decided nothing."""
    TEST_SEED = "test-seed"
    """Episodes with the maps and templates of the training, but other seeds or parameters."""
    TEST_MAP = "test-map"
    """Episodes on maps that the training does not use."""
    TEST_TEMPLATE = "test-template"
    """Episodes of templates that the training does not use."""


@dataclass(frozen=True, order=True)
class EpisodeIdentity:
    """What decides an episode's split. The level does not: episodes of one seed begin alike at all levels."""

    map_name: str
    template: str
    seed: int
    values: str = ""
    """Values of parameters in place of those that the seed draws, as a request has them."""

    @staticmethod
    def of(episode: EpisodeDescription) -> "EpisodeIdentity":
        """The identity of a recorded episode."""
        return EpisodeIdentity(episode.map_name, episode.template, episode.seed, episode.draw)

    @staticmethod
    def of_request(request: EpisodeRequest, template: str = "") -> "EpisodeIdentity":
        """The identity of a requested episode; ``template`` is the id of a template that the request names by a file.

        An empty map is the town.
        """
        map_name = Path(request.map).name.split(".")[0] if request.map else _TOWN
        return EpisodeIdentity(map_name, template or request.template, request.seed, request.values)

    @property
    def text(self) -> str:
        """The identity in one line, with sorted parameters: ``town S2 103``, ``town S2 103 emv.speed_mps=12.5``."""
        return f"{self.map_name} {self.template} {self.seed} {text_of_values(values_of(self.values))}".rstrip()


@dataclass(frozen=True)
class SplitRule:
    """The content of ``params/splits.yaml``."""

    test_maps: frozenset[str]
    test_templates: frozenset[str]
    val_percent: int
    test_seed_percent: int

    def split_of(self, episode: EpisodeIdentity) -> Split:
        """The split of an episode, by its own map, template, seed and parameters alone."""
        if episode.template in self.test_templates:
            return Split.TEST_TEMPLATE
        if episode.map_name in self.test_maps:
            return Split.TEST_MAP
        place = int.from_bytes(hashlib.sha256(episode.text.encode()).digest()[:8], "big") % _PERCENT
        if place < self.val_percent:
            return Split.VAL
        return Split.TEST_SEED if place < self.val_percent + self.test_seed_percent else Split.TRAIN


@cache
def split_rule() -> SplitRule:
    """The project's own rule, read from ``params/splits.yaml``."""
    content = plain_yaml.load(plain_yaml.read_text(params_dir() / _FILE))
    return SplitRule(
        frozenset(content["test_maps"]),
        frozenset(content["test_templates"]),
        int(content["val_percent"]),
        int(content["test_seed_percent"]),
    )


def split_of(episode: EpisodeIdentity) -> Split:
    """The split of an episode by the rule of the project."""
    return split_rule().split_of(episode)


@dataclass(frozen=True)
class SeenEpisodes:
    """The episodes that a model has seen, as its card lists them."""

    trained: frozenset[str]
    """``EpisodeIdentity.text`` of the episodes on which the model was trained."""
    watched: frozenset[str] = frozenset()
    """``EpisodeIdentity.text`` of the episodes that were looked at during its training."""

    @staticmethod
    def of_card(card: Mapping[str, Any]) -> "SeenEpisodes | None":
        """What the card of a trained network lists under ``data``; None where it lists no episodes."""
        data = card.get("data", {})
        trained, watched = (data.get(split, {}).get("keys") for split in (Split.TRAIN, Split.VAL))
        return None if trained is None else SeenEpisodes(frozenset(trained), frozenset(watched or ()))

    @property
    def maps(self) -> frozenset[str]:
        """Names of the maps that it was trained on."""
        return frozenset(_words(self.trained, 0))

    def split_of(self, episode: EpisodeIdentity) -> Split:
        """How an episode relates to the model: the split that the episode would have by this model's training."""
        if episode.text in self.trained:
            return Split.TRAIN
        if episode.text in self.watched:
            return Split.VAL
        if episode.template not in _words(self.trained, 1):
            return Split.TEST_TEMPLATE
        return Split.TEST_SEED if episode.map_name in self.maps else Split.TEST_MAP


def _words(texts: Collection[str], place: int) -> set[str]:
    return {text.split()[place] for text in texts}


def counted_standings(standings: Collection[Split]) -> dict[Split, int]:
    """Number of scored episodes by their relation to the model, with every split named.

    Empty where no relation is known.
    """
    return {split: list(standings).count(split) for split in Split} if standings else {}


def overlap_warning(model: str, counts: Mapping[Split, int]) -> str:
    """A warning line where scored episodes (``counted_standings``) belong to the model's own training.

    Otherwise empty.
    """
    inside, total = counts.get(Split.TRAIN, 0), sum(counts.values())
    return f"WARNING: {model} was trained on {inside} of these {total} episodes: its scores say too much" * bool(inside)
