from dataclasses import replace
from pathlib import Path

import pytest
from made_training_data import hand_made_film

torch = pytest.importorskip("torch", reason="the extra models is not installed")
pytest.importorskip("onnx", reason="the extra models is not installed")

from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.fitting.risk import FilmNetwork, fitted_film_network
from siren_ros.lab.training.risk import PlannedFilm, labelled, train_sequence_model, write_film
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.sequence_model import HEIGHT, WIDTH
from siren_ros.simulation.scenario.episode import EpisodeIdentity, Split

CONFIG = FilmFitConfig(epochs=1, steps=2, batch=3, clip_frames=12)


def test_a_moment_is_found_wherever_it_is() -> None:
    torch.manual_seed(0)
    network = FilmNetwork().eval()
    frames = torch.full((1, 30, HEIGHT, WIDTH), 100, dtype=torch.uint8)
    flash = frames.clone()
    flash[0, 12, 20:40, 60:100] = 250
    with torch.no_grad():
        (calm, _), (seen, whole) = network(frames), network(flash)
    assert seen.shape == (1, 2, 30)
    changed = torch.nonzero((calm - seen).abs().amax(dim=(0, 1)) > 1e-6).flatten()
    assert changed.min() >= 12 - 6
    assert changed.max() <= 14 + 6
    assert (whole <= seen.amax(dim=2) + 1e-6).all()


def test_a_model_is_trained_and_written_with_its_card(tmp_path: Path) -> None:
    plan = [PlannedFilm(split, "S4", kind) for split in (Split.TRAIN, Split.VAL) for kind in RiskClass]
    files = [(planned, tmp_path / f"{planned.name}.npz") for planned in plan]
    for planned, path in files:
        write_film(path, hand_made_film(RiskClass(planned.number), seed=planned.number))
    lines: list[str] = []
    films = MadeFiles(tuple(files), ((PlannedFilm(Split.TRAIN, "S4", 9), "no site"),))
    model = train_sequence_model(films, tmp_path / "sequence.onnx", CONFIG, fitted_film_network, lines.append)
    assert lines[0].startswith("train: 3 films")
    card = model.network.card
    assert card["films"]["train"] == {
        "films": 3, "seed": 500, "episodes": [1, 1, 1], "pictures": card["films"]["train"]["pictures"],
        "left_out": ["train_S4_009: no site"],
    }  # fmt: skip
    assert card["data"] == {
        split.value: {
            "keys": sorted(EpisodeIdentity.of_request(one.request).text for one in plan if one.split is split)
        }
        for split in (Split.TRAIN, Split.VAL)
    }
    assert sum(map(sum, card["validation"]["confusion"])) == card["validation"]["clips"] == 9
    near, hit = model.probabilities(hand_made_film(RiskClass.COLLISION).frames[:95])
    assert 0.0 < min(near, hit) <= max(near, hit) < 1.0


def test_the_same_seed_gives_the_same_weights() -> None:
    films = [labelled(hand_made_film(kind), CONFIG) for kind in RiskClass]
    first, same = (fitted_film_network(films, films, CONFIG, lambda _: None).onnx for _ in range(2))
    other = fitted_film_network(films, films, replace(CONFIG, seed=1), lambda _: None).onnx
    assert first == same
    assert first != other
    normal = [film for film in films if film.film.episode.label.risk is RiskClass.NORMAL]
    assert fitted_film_network(normal, normal, CONFIG, lambda _: None).parameters > 0, "without a collision, too"
