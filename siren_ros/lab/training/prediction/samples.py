"""Samples for the predictor: planned, simulated in processes without ROS, stored in files, and read into memory.

``siren_ros.simulation.scenario.episode`` fixes the split of each episode. A plan has the episodes for training,
validation and test, and variants of the inputs.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import count, islice, product
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros import __version__
from siren_ros.base.numerics.arrays import Flags, Floats32, Rows, random_stream
from siren_ros.data.episode_source import bag_sha256, episode_name, open_source
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles, make_files, read_arrays, write_arrays
from siren_ros.running.generation.closed_loop import simulated
from siren_ros.scoring.evaluation.prediction.baselines import ConstantVelocity, IdmPredictor
from siren_ros.scoring.evaluation.prediction.predictors import Predictor
from siren_ros.scoring.evaluation.prediction.reported_tracks import TrackNoise, with_noise
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    ScoredSamples,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.siren_model.columns import in_frame_of
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import (
    FEATURES_VERSION,
    LAMP_COLUMNS,
    Ablation,
    FeatureNames,
    Features,
    features_and_names,
    without,
    without_columns,
)
from siren_ros.simulation.scenario.episode import EpisodeIdentity, EpisodeRequest, Split, split_of, split_rule
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel

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


REGION_SAMPLES: Final = 400
"""Number of drawn samples per training episode in the interaction region; further ones would overlap with them."""
OTHER_SAMPLES: Final = 100
"""Number of drawn samples per training episode from the whole map."""
TRACKERS: Final = 3
"""Number of simulated trackers; each training sample is used without errors and with one tracker's errors."""
WORST_TRACKER: Final = 1.5
"""A tracker's errors are up to this many times those of ``TrackNoise``, so that those are not the limit."""
_REFERENCES: Final[dict[str, Predictor]] = {"cv": ConstantVelocity(), "idm": IdmPredictor()}


@dataclass(frozen=True)
class EpisodeKey:
    """Identifies the episode of samples."""

    template: str
    level: str
    seed: int
    map_name: str
    content: str = ""
    """``EpisodeIdentity.content``; empty in files of earlier versions."""


@dataclass(frozen=True)
class EpisodeFeatures:
    """Samples of one episode in stored form."""

    episode: EpisodeKey
    split: Split
    names: FeatureNames
    features: Features
    truth_m: Floats32
    """True future in the frames of the samples, shape ``(N, FUTURE_POINTS, 2)``."""
    reference_ade_m: dict[str, Floats32]
    """Error of the reference models on each sample, shape ``(N,)``; empty for training episodes."""

    def __len__(self) -> int:
        return len(self.truth_m)


_FORM: Final = 3
"""Version of drawing and files; it is raised when either changes."""


def features_path(folder: Path, planned: PlannedEpisode) -> Path:
    """Path of an episode's features; it differs between versions of features, samples and package."""
    return folder / f"v{FEATURES_VERSION}_{_FORM}_{__version__}" / planned.split.value / f"{planned.name}.npz"


def make_samples(
    plan: Sequence[PlannedEpisode], folder: Path, jobs: int, done: Callable[[], None]
) -> MadeFiles[PlannedEpisode]:
    """Make samples for episodes without a file; arguments as of ``make_files``."""
    return make_files({planned: features_path(folder, planned) for planned in plan}, _make, jobs, done)


def _make(planned: PlannedEpisode, path: Path) -> None:
    """Read or simulate an episode (without ROS and sensors), and store its samples.

    Raises:
        SirenError: The map has no site for the template, the episode fails, or the bag cannot be read.
    """
    write_features(path, features_of_record(_record_of(planned), planned.split))


def _record_of(planned: PlannedEpisode) -> EpisodeRecord:
    if planned.bag is not None:
        with open_source(planned.bag) as source:
            return source.tracks()
    return simulated(planned.request)


def features_of_record(record: EpisodeRecord, split: Split) -> EpisodeFeatures:
    """Samples of a record: a random draw for training episodes, otherwise all of the interaction region.

    Each drawn sample comes twice: without errors, and as a tracker of random quality would report it (``TrackNoise``),
    with the truth from the reported pose on.
    """
    episode, record = record.description, record.right_hand
    region = samples_of(record, HistoryWindow(), Population.REGION)
    parts, references = [_seen(region.batch, region)], _REFERENCES
    if split is Split.TRAIN:
        random = random_stream(episode.seed, f"training/{episode.template}/{episode.level.name}")
        parts, references = [], {}
        for population, most in ((Population.REGION, REGION_SAMPLES), (Population.ALL, OTHER_SAMPLES)):
            logged = samples_of(record, HistoryWindow(), population)
            rows = random.permutation(len(logged))[:most]
            chosen = logged.select(np.sort(rows))
            parts.append(_seen(chosen.batch, chosen))
            for draw, factor in enumerate(random.uniform(0.0, WORST_TRACKER, TRACKERS).tolist()):
                tracks = samples_of(
                    record, HistoryWindow(), population, reporter=with_noise(TrackNoise().scaled(factor, draw))
                )
                of_tracker = np.sort(rows[draw::TRACKERS])
                parts.append(_seen(tracks.select(of_tracker).batch, logged.select(of_tracker)))
    return EpisodeFeatures(
        EpisodeKey(
            episode.template, episode.level.name, episode.seed, episode.map_name, EpisodeIdentity.of(episode).content
        ),
        split,
        names=parts[0][1],
        features=joined([features for features, _, _ in parts]),
        truth_m=np.concatenate([truth_m for _, _, truth_m in parts]),
        reference_ade_m={name: _ade(model, region) for name, model in references.items()},
    )


def _seen(batch: SampleBatch, samples: ScoredSamples) -> tuple[Features, FeatureNames, Floats32]:
    """Features of a batch, and the true future of the same samples in its frames."""
    features, names = features_and_names(batch)
    truth_m = in_frame_of(batch, samples.future_xy_m - batch.xy_m[:, None])
    return features, names, truth_m.astype(np.float32)


def joined(parts: Sequence[Features]) -> Features:
    """Join the samples of all parts."""
    names = [field.name for field in fields(Features)]
    return Features(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _ade(model: Predictor, samples: ScoredSamples) -> Floats32:
    miss = model.predict(samples.batch).xy_m[:, 0] - samples.future_xy_m
    return np.hypot(miss[..., 0], miss[..., 1]).mean(axis=-1).astype(np.float32)


def write_features(path: Path, episode: EpisodeFeatures) -> None:
    """Write a file completely or not at all."""
    about = {**asdict(episode.episode), "split": episode.split, "names": asdict(episode.names)}
    arrays = {f"features.{field.name}": getattr(episode.features, field.name) for field in fields(Features)}
    arrays |= {f"reference.{name}": values for name, values in episode.reference_ade_m.items()}
    write_arrays(path, {"about": np.array(json.dumps(about)), "truth_m": episode.truth_m, **arrays})


def read_features(path: Path) -> EpisodeFeatures:
    """Read a file of ``write_features``."""
    about, file = read_arrays(path, "about")
    features = Features(**{field.name: file[f"features.{field.name}"] for field in fields(Features)})
    references = {key.removeprefix("reference."): file[key] for key in file if key.startswith("reference.")}
    truth = file["truth_m"]
    names = FeatureNames(**{kind: tuple(values) for kind, values in about.pop("names").items()})
    split = Split(about.pop("split"))
    return EpisodeFeatures(EpisodeKey(**about), split, names, features, truth, references)


@dataclass(frozen=True)
class SampleStore:
    """Samples of several episodes."""

    features: Features
    """Features in half precision, which halves the memory; speed and spacing are single precision."""
    truth_m: Floats32
    episode: npt.NDArray[np.int32]
    """Index of each sample's episode in ``episodes``."""
    episodes: tuple[EpisodeKey, ...]
    names: FeatureNames
    reference_ade_m: Mapping[str, Floats32]
    """Errors of the reference models, shape ``(N,)``; empty for training episodes."""

    def __len__(self) -> int:
        return len(self.truth_m)

    def batch(self, rows: Rows | slice) -> Features:
        """Select some samples, in single precision."""
        part = self.features.select(rows)
        return Features(**{field.name: _as(getattr(part, field.name), np.float32) for field in fields(Features)})


def without_lamps(store: SampleStore, rows: Flags) -> SampleStore:
    """The samples with all brake lamps and indicators switched off in some of them, given by shape ``(N,)``."""
    return replace(store, features=without_columns(store.features, store.names, LAMP_COLUMNS, rows))


def read_store(paths: Sequence[Path], ablation: Ablation = Ablation.NONE) -> SampleStore:
    """Read files of ``write_features`` in order; files without samples are left out, but one must have some."""
    episodes = [episode for episode in map(read_features, paths) if len(episode)]
    names = episodes[0].names
    columns: dict[str, Any] = {}
    for field in fields(Features):
        kind = np.float32 if field.name in {"speed_mps", "path_spacing_m"} else np.float16
        parts = [getattr(without(episode.features, names, ablation), field.name) for episode in episodes]
        columns[field.name] = np.concatenate([_as(part, kind) for part in parts])
    errors = [episode.reference_ade_m for episode in episodes]
    references = sorted(set.intersection(*map(set, errors)))
    return SampleStore(
        features=Features(**columns),
        truth_m=np.concatenate([episode.truth_m for episode in episodes]),
        episode=np.repeat(np.arange(len(episodes), dtype=np.int32), [len(episode) for episode in episodes]),
        episodes=tuple(episode.episode for episode in episodes),
        names=names,
        reference_ade_m={name: np.concatenate([each[name] for each in errors]) for name in references},
    )


def _as(values: npt.NDArray[Any], kind: type[np.floating[Any]]) -> npt.NDArray[Any]:
    return values if values.dtype == np.bool_ else values.astype(kind)
