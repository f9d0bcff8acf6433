import json
import signal
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="the extra models is not installed")
pytest.importorskip("onnx", reason="the extra models is not installed")

from known_outputs import assert_known
from made_training_data import made_record

from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.fitting import prediction
from siren_ros.lab.training.fitting.networks import MODES, NetworkSize, PathNetwork
from siren_ros.lab.training.fitting.prediction import (
    NETWORKS,
    export,
    fit,
    fitted_network,
    losses,
    tensors,
)
from siren_ros.lab.training.prediction.samples import PlannedEpisode, read_store
from siren_ros.lab.training.prediction.training import train_variant, with_ablations
from siren_ros.lab.training.settings import ARCHITECTURES, FitConfig
from siren_ros.scoring.evaluation.prediction.predictors import checked
from siren_ros.scoring.evaluation.prediction.samples import (
    FUTURE_POINTS,
    HistoryWindow,
    Population,
    future_times_s,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import OUTPUTS, Features, TrainedNetwork, make
from siren_ros.simulation.scenario.episode import EpisodeRequest, Split

IS_THERE = ("neighbour_there", "path_there")
CONFIG = FitConfig(epochs=3, batch=64, width=16, layers=1)


@pytest.fixture(scope="module")
def store(episode_files):
    return read_store(episode_files[Split.TRAIN])


@pytest.fixture(scope="module")
def network(store):
    torch.manual_seed(1)
    features = store.features
    size = NetworkSize(features.target.shape[1], features.neighbours.shape[2], features.paths.shape[2], 16, 4, 1)
    network = PathNetwork(size).eval()
    with torch.no_grad():
        for weights in network.drive.parameters():
            weights.normal_(0.0, 0.1)
    return network


def answers(network, features):
    with torch.no_grad():
        return [value.numpy() for value in network(*tensors(features))]


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_a_network_keeps_the_velocity_before_training_and_learns(episode_files, name, tmp_path) -> None:
    logged = read_store(episode_files[Split.TEST_SEED])
    size = NetworkSize(*(getattr(logged.features, part).shape[-1] for part in ("target", "neighbours", "paths")))
    xy_m, _ = answers(NETWORKS[name](size).eval(), logged.batch(slice(0, 40)))
    assert xy_m.shape == (40, MODES, FUTURE_POINTS, 2)
    expected = logged.features.speed_mps[:40, None] * future_times_s()
    assert xy_m[..., 0] == pytest.approx(np.repeat(expected[:, None], MODES, axis=1), abs=0.05)
    assert xy_m[..., 1] == pytest.approx(0.0, abs=0.05)
    store, reports = read_store(episode_files[Split.TRAIN]), []
    run = fit(store, replace(CONFIG, epochs=4, architecture=name), reports.append)
    assert reports[-1].loss < 0.9 * reports[0].loss
    path = tmp_path / "one.onnx"
    path.write_bytes(export(run.network).onnx)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    for rows in (slice(0, 1), slice(0, 130)):
        features = store.batch(rows)
        answered, _ = TrainedNetwork(session, {}).run(features)
        assert answered == pytest.approx(answers(run.network, features)[0], abs=1e-4)


def test_who_rolls_back_goes_straight_on_behind_the_begin_of_its_paths(store, network) -> None:
    back = PathNetwork(network.size).eval()
    with torch.no_grad():
        back.drive[-1].bias[:FUTURE_POINTS] = -20.0  # 60 m/s
    features = store.batch(slice(0, 40))
    expected = (features.speed_mps[:, None] - 60.0) * future_times_s()
    assert answers(back, features)[0][..., 0] == pytest.approx(np.repeat(expected[:, None], MODES, axis=1), rel=0.03)


@pytest.mark.parametrize(("name", "alone"), [("lstm", True), ("transformer", False), ("paths", False)])
def test_the_lstm_alone_does_not_see_the_neighbours(store, name, alone) -> None:
    torch.manual_seed(2)
    size = NetworkSize(*(getattr(store.features, part).shape[-1] for part in ("target", "neighbours", "paths")))
    network = NETWORKS[name](size).eval()
    with torch.no_grad():
        for weights in network.drive.parameters():
            weights.normal_(0.0, 0.1)
    features = store.batch(slice(0, 20))
    away = replace(features, neighbours=features.neighbours + 1.0)
    assert np.allclose(*(answers(network, each)[0] for each in (features, away)), atol=1e-6) is alone


def test_what_is_not_there_and_the_order_do_not_change_the_answer(store, network) -> None:
    features = store.batch(slice(0, 40))
    assert not features.neighbour_there.all()
    random = np.random.default_rng(0)

    def filled(values, there):
        noise = random.normal(size=values.shape).astype(np.float32)
        return np.where(there.reshape(*there.shape, *(1,) * (values.ndim - there.ndim)), values, noise)

    there = {"neighbours": features.neighbour_there, "paths": features.path_there, "path_points_m": features.path_there}
    noisy = replace(features, **{name: filled(getattr(features, name), known) for name, known in there.items()})
    turned = {name: np.ascontiguousarray(getattr(noisy, name)[:, ::-1]) for name in (*there, *IS_THERE)}
    for answer, other in zip(answers(network, features), answers(network, replace(noisy, **turned)), strict=True):
        assert answer == pytest.approx(other, abs=1e-4)


def test_onnx_answers_as_torch_does(store, network) -> None:
    session = onnxruntime.InferenceSession(export(network).onnx, providers=["CPUExecutionProvider"])
    for rows in (slice(0, 1), slice(0, 130)):
        features = store.batch(rows)
        inputs = {field.name: getattr(features, field.name) for field in fields(Features)}
        xy_m, probability = session.run(OUTPUTS, inputs)
        expected_xy_m, logits = answers(network, features)
        assert xy_m == pytest.approx(expected_xy_m, abs=1e-5, rel=1e-5)
        assert probability == pytest.approx(torch.softmax(torch.from_numpy(logits), dim=-1).numpy(), abs=1e-5)


def test_the_same_seed_gives_the_same_weights(store) -> None:
    reports, again = [], []
    first = fit(store, replace(CONFIG, epochs=2), reports.append).network
    second = fit(store, replace(CONFIG, epochs=2), again.append).network
    assert [progress.loss for progress in reports] == [progress.loss for progress in again]
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    different = fit(store, replace(CONFIG, epochs=1, seed=5), lambda _: None).network
    assert not all(torch.equal(a, b) for a, b in zip(first.parameters(), different.parameters(), strict=True))


def test_an_interrupted_training_goes_on_and_gives_the_same_weights(store, tmp_path, monkeypatch) -> None:
    """The signal comes within the second epoch."""
    checkpoint, steps = tmp_path / "new" / "one.pt", []
    taken = prediction.Descent.step

    def step(descent, loss) -> None:
        taken(descent, loss)
        steps.append(loss)
        if len(steps) == batches + 1:
            signal.raise_signal(signal.SIGINT)

    batches = len(store) // CONFIG.batch
    assert batches > 2
    whole = fit(store, CONFIG, lambda _: None)
    monkeypatch.setattr(prediction.Descent, "step", step)
    with pytest.raises(KeyboardInterrupt):
        fit(store, CONFIG, lambda _: None, checkpoint)
    assert len(steps) == batches + 1
    assert checkpoint.exists()
    reports = []
    rest = fit(store, CONFIG, reports.append, checkpoint)
    assert len(steps) == CONFIG.epochs * batches, "no step is taken twice"
    assert [progress.epoch for progress in reports] == [1, 2]
    assert all(torch.equal(a, b) for a, b in zip(whole.network.parameters(), rest.network.parameters(), strict=True))
    assert rest.processor_s > 0.0
    assert not checkpoint.exists()


def test_a_training_whose_interrupt_does_nothing_does_not_end_as_if_it_were_whole(store, tmp_path, monkeypatch) -> None:
    @contextmanager
    def at_once():
        yield lambda: True

    monkeypatch.setattr(prediction, "deferred_interrupts", at_once)
    with pytest.raises(KeyboardInterrupt):
        fit(store, CONFIG, lambda _: None, tmp_path / "one.pt")


def test_a_checkpoint_of_another_training_is_refused(store, tmp_path, monkeypatch) -> None:
    checkpoint = tmp_path / "one.pt"
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)
    fit(store, replace(CONFIG, epochs=1), lambda _: None, checkpoint)
    with pytest.raises(InputError, match="same samples, settings and seed"):
        fit(store, replace(CONFIG, epochs=1, seed=2), lambda _: None, checkpoint)
    checkpoint.write_bytes(b"nothing")
    with pytest.raises(InputError, match="a checkpoint of this training"):
        fit(store, replace(CONFIG, epochs=1), lambda _: None, checkpoint)


def test_the_loss_counts_the_nearest_and_the_most_probable_hypothesis() -> None:
    truth = torch.zeros(1, FUTURE_POINTS, 2)
    paths = torch.zeros(1, MODES, FUTURE_POINTS, 2)
    paths[0, :, :, 0] = torch.arange(1.0, MODES + 1.0)[:, None]
    logits = torch.zeros(1, MODES)
    logits[0, 2] = 2.0
    config = FitConfig(share_of_all=0.0, first_weight=1.0, probability_weight=0.5)
    loss, first, least = losses((paths, logits), truth, config)
    surprise = np.log(MODES - 1 + np.exp(2.0))
    assert first.item() == pytest.approx(3.0, abs=1e-4)
    assert least.item() == pytest.approx(1.0, abs=1e-4)
    assert loss.item() == pytest.approx(1.0 + 3.0 + 0.5 * surprise, abs=1e-3)


SMALL = replace(CONFIG, epochs=1)


@pytest.fixture(scope="module")
def data(episode_files):
    planned = [
        (PlannedEpisode(split, EpisodeRequest(seed=number, level="L0" if number % 2 else "")), path)
        for split, paths in episode_files.items()
        for number, path in enumerate(paths)
    ]
    return MadeFiles(tuple(planned), ((PlannedEpisode(Split.TRAIN, EpisodeRequest(seed=99)), "map: no site"),))


def test_variants_train_on_what_they_say_and_can_be_used_as_predictors(data, tmp_path) -> None:
    lines = []
    trained = train_variant("full", data, tmp_path, SMALL, fitted_network, lines.append)
    assert len(lines) == 1 + SMALL.epochs
    card = json.loads((tmp_path / "full.json").read_text())
    assert card["figures"]["test-seed"]["samples"] > 0
    assert card["training"]["episodes"] == 6
    assert card["data"]["train"]["left_out"] == ["S2_own_town_seed99: map: no site"]
    batch = samples_of(made_record(30), HistoryWindow(), Population.REGION).batch
    predicted = make(trained.path).predict(batch)
    checked("siren", predicted, len(batch))
    assert predicted.xy_m.shape[1] == 6
    names = ("ordinary", "few")
    others = [train_variant(name, data, tmp_path, SMALL, fitted_network, lambda _: None) for name in names]
    assert [other.card["training"]["episodes"] for other in others] == [3, 3]
    with_ablations(trained, others)
    ablations = json.loads((tmp_path / "full.json").read_text())["ablations"]
    assert set(ablations) == {"ordinary", "few"}
    assert np.isfinite(ablations["few"]["test-seed"]["mean"]["siren"])
    with pytest.raises(InputError, match="at least one"):
        train_variant("full", replace(data, files=()), tmp_path, SMALL, fitted_network, lambda _: None)


def test_losses_and_weights_of_a_short_training(store) -> None:
    reports: list[prediction.EpochMeans] = []
    run = fit(store, CONFIG, reports.append)
    weights = {name: [values.mean().item(), values.norm().item()] for name, values in run.network.named_parameters()}
    found = {"means": [list(vars(one).values())[:-1] for one in reports], "weights": weights}
    assert_known(Path(__file__).parent / "known" / "prediction.json", found, digits=2, decimals=2)
