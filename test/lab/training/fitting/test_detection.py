"""A small network learns made frames, goes on from its checkpoint, and answers the same as ONNX."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra models is not installed")

from pathlib import Path

from known_outputs import assert_known
from made_training_data import SMALL_GRID, made_episode

from siren_ros.errors import InputError
from siren_ros.lab.training.detection.samples import FrameDraws
from siren_ros.lab.training.fitting.detection import BoxesOf, box_loss, export, fit, heat_loss, pillar_tensors
from siren_ros.lab.training.settings import DetectionFit, NetworkSize
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.scoring.evaluation.detection.pillar_detector import FORM_VERSION, load_detector, pillars_of

SIZE = NetworkSize(pillar=8, stages=(8, 12, 12), layers=1, neck=8, head=12)
CONFIG = DetectionFit(steps=4, checkpoint_steps=2, averaging=0.5, half=False)


@pytest.fixture(autouse=True)
def one_thread():
    """More threads only wait for each other on layers as small as these."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def draws() -> FrameDraws:
    return FrameDraws([made_episode(1), made_episode(2)], SMALL_GRID, 0, 2)


def test_it_learns_where_vehicles_are(draws) -> None:
    reports = []
    config = replace(CONFIG, steps=18, checkpoint_steps=6, learning_rate=1e-2)
    fit(draws, SIZE, config, None, lambda progress: reports.append(progress) or True)
    assert [progress.step for progress in reports] == [6, 12, 18]
    assert reports[-1].heat < 0.8 * reports[0].heat
    assert reports[-1].box < reports[0].box


def test_a_stopped_training_ends_with_the_same_weights(draws, tmp_path) -> None:
    whole = fit(draws, SIZE, CONFIG, None, lambda _: True)
    checkpoint = tmp_path / "checkpoint.pt"
    assert fit(draws, SIZE, CONFIG, checkpoint, lambda _: False) is None
    steps = []
    rest = fit(draws, SIZE, CONFIG, checkpoint, lambda progress: steps.append(progress.step) or True)
    assert steps == [4]
    for name, values in whole.network.state_dict().items():
        assert torch.equal(values, rest.network.state_dict()[name]), name
    assert whole.plans == rest.plans == [(0, 4, 12)]


def test_a_training_that_was_made_longer_says_so_and_is_repeated_by_the_same_calls(draws, tmp_path) -> None:
    runs = []
    for folder in ("a", "b"):
        checkpoint = tmp_path / folder / "checkpoint.pt"
        fit(draws, SIZE, CONFIG, checkpoint, lambda _: True)
        runs.append(fit(draws, SIZE, replace(CONFIG, steps=6), checkpoint, lambda _: True))
    assert runs[0].plans == runs[1].plans == [(0, 4, 12), (4, 6, 12)]
    for name, values in runs[0].network.state_dict().items():
        assert torch.equal(values, runs[1].network.state_dict()[name]), name


def test_a_checkpoint_of_another_training_is_refused(draws, tmp_path) -> None:
    checkpoint = tmp_path / "checkpoint.pt"
    fit(draws, SIZE, CONFIG, checkpoint, lambda _: False)
    with pytest.raises(InputError, match="same grid, size, seed"):
        fit(draws, replace(SIZE, head=16), CONFIG, checkpoint, lambda _: True)
    checkpoint.write_bytes(b"nothing")
    with pytest.raises(InputError, match="checkpoint of this training"):
        fit(draws, SIZE, CONFIG, checkpoint, lambda _: True)


def test_onnx_answers_as_torch_does(draws, tmp_path) -> None:
    network = fit(draws, SIZE, CONFIG, None, lambda _: True).network
    with torch.no_grad():
        network.heat[-1].weight[0] *= 30.0  # so that neighbours differ by more than rounding
    weights = export(network).onnx
    path = tmp_path / "made.onnx"
    path.write_bytes(weights)
    card = {"form_version": FORM_VERSION, "sha256": hashlib.sha256(weights).hexdigest()}
    card |= {"grid": SMALL_GRID.to_json(), "class_names": list(CLASS_NAMES)}
    path.with_suffix(".json").write_text(json.dumps(card))
    detector = load_detector(path)
    for number in range(2):
        pillars = pillars_of(made_episode(3).frame(number).points, SMALL_GRID)
        with torch.no_grad():
            expected = BoxesOf(network)(*pillar_tensors([pillars], network))
        of_torch = _by_place(*(part.numpy() for part in expected))
        for answer, other in zip(_by_place(*detector.run(pillars)), of_torch, strict=True):
            assert answer == pytest.approx(other, abs=1e-4)
    assert [len(part) for part in detector.run(pillars_of(np.zeros((0, 5), np.float32), SMALL_GRID))] == [0, 0, 0]
    path.with_suffix(".json").write_text(json.dumps({**card, "sha256": "0"}))
    with pytest.raises(InputError, match="another hash"):
        load_detector(path)


def _by_place(box: np.ndarray, score: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, ...]:
    """Only peaks, sorted by x."""
    rows = np.flatnonzero(score > 0.0)
    rows = rows[np.argsort(box[rows, 0])]
    return box[rows], score[rows], share[rows]


def test_the_heat_loss_of_known_answers() -> None:
    """One centre with a share of 1/2, one other cell with 1/2 and a target of 0.5."""
    logit, heat = torch.zeros(1, 1, 2), torch.tensor([[[1.0, 0.5]]])
    centre, other = 0.25 * np.log(2.0), 0.5**4 * 0.25 * np.log(2.0)
    assert heat_loss(logit, heat, torch.ones(1, 1, 2)).item() == pytest.approx(centre + other)
    assert heat_loss(logit, heat, torch.tensor([[[1.0, 0.0]]])).item() == pytest.approx(centre)


def test_the_box_loss_weighs_cells_and_channels() -> None:
    answer, box = torch.zeros(2, 10), torch.zeros(2, 10)
    box[0, 0], box[1, 9] = 3.0, 10.0
    assert box_loss(answer, box, torch.tensor([1.0, 0.5])).item() == pytest.approx((3.0 + 0.5 * 0.2 * 10.0) / 1.5)


def test_losses_and_weights_of_a_short_training(draws) -> None:
    reports = []
    config = replace(CONFIG, learning_rate=2e-2, averaging=0.9)
    run = fit(draws, SIZE, config, None, lambda progress: reports.append(progress) or True)
    weights = {name: [values.mean().item(), values.std().item()] for name, values in run.network.named_parameters()}
    found = {"losses": [(one.step, one.heat, one.box) for one in reports], "weights": weights}
    assert_known(Path(__file__).parent / "known" / "detection.json", found, digits=2, decimals=3)
