"""The complete training of the sequence model: films, fitting, figures, files."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from siren_ros.base.params.network_file import write_network
from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.risk.batches import LabelledFilm, labelled, validation_clips
from siren_ros.lab.training.risk.samples import FIRST_SEED, PlannedFilm, read_film
from siren_ros.lab.training.settings import FilmFitConfig, FittedNetwork
from siren_ros.scoring.evaluation.risk.labels import TITLES, RiskClass
from siren_ros.scoring.evaluation.risk.scoring import accuracy, confusion, macro_f1
from siren_ros.scoring.evaluation.risk.sequence_model import FRAMES_VERSION, SequenceModel, load_sequence_model
from siren_ros.simulation.scenario.splits import EpisodeIdentity, Split

Fitter = Callable[[Sequence[LabelledFilm], Sequence[LabelledFilm], FilmFitConfig, Callable[[str], None]], FittedNetwork]


def train_sequence_model(
    films: MadeFiles[PlannedFilm], path: Path, config: FilmFitConfig, fitter: Fitter, report: Callable[[str], None]
) -> SequenceModel:
    """Train the model on the films of both splits, and write it as an ONNX file with its card.

    ``report`` is called with lines on the progress.

    Raises:
        InputError: No film of a split, or the folder cannot be written.
    """
    splits = {
        split: [labelled(read_film(file), config) for planned, file in films.files if planned.split is split]
        for split in (Split.TRAIN, Split.VAL)
    }
    for split, part in splits.items():
        if not part:
            raise InputError("films", split.value, "at least one that could be made")
        report(f"{split.value}: {len(part)} films, pictures of {' / '.join(TITLES)}: {_pictures(part)}")
    wall, processor = time.monotonic(), time.process_time()
    fitted = fitter(splits[Split.TRAIN], splits[Split.VAL], config, report)
    card = fitted.card(config, model="sequence", task="risk", frames_version=FRAMES_VERSION)
    card["films"] = {split.value: _split_json(part, films, split) for split, part in splits.items()}
    card["data"] = {split.value: {"keys": _keys(films, split)} for split in splits}
    card["fitting_wall_s"] = round(time.monotonic() - wall)
    card["fitting_processor_s"] = round(time.process_time() - processor)
    write_network(path, fitted.onnx, card)
    model = load_sequence_model(path)
    card["validation"] = _figures(model, splits[Split.VAL], config)
    write_network(path, fitted.onnx, card)
    return load_sequence_model(path)


def _pictures(films: Sequence[LabelledFilm]) -> list[int]:
    counts: list[int] = np.bincount(
        np.concatenate([film.severity for film in films]), minlength=len(RiskClass)
    ).tolist()
    return counts


def _keys(films: MadeFiles[PlannedFilm], split: Split) -> list[str]:
    requests = [planned.request for planned, _ in films.files if planned.split is split]
    return sorted(EpisodeIdentity.of_request(request).text for request in requests)


def _split_json(part: Sequence[LabelledFilm], films: MadeFiles[PlannedFilm], split: Split) -> dict[str, Any]:
    episodes = [labelled_film.film.episode.label.risk for labelled_film in part]
    return {
        "films": len(part),
        "seed": FIRST_SEED[split],
        "episodes": [episodes.count(risk) for risk in RiskClass],
        "pictures": _pictures(part),
        "left_out": sorted(f"{planned.name}: {why}" for planned, why in films.missing if planned.split is split),
    }


def _figures(model: SequenceModel, films: Sequence[LabelledFilm], config: FilmFitConfig) -> dict[str, Any]:
    """Figures on the clips that decided the operating point; they are better than those of a test set."""
    clips = validation_clips(films, config.thresholds)
    counts = confusion([clip.label for clip in clips], [model.answer(clip.frames) for clip in clips])
    return {
        "clips": len(clips),
        "confusion": counts[:, : len(RiskClass)].tolist(),
        "accuracy": round(accuracy(counts).value, 4),
        "macro_f1": round(macro_f1(counts).value, 4),
    }
