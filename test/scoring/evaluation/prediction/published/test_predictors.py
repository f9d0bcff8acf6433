"""CSP, STDAN and BAT as predictors: on the map, and by the command; feet, sides, the order of modes and points."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from made_records import Track, moving, samples_in
from plain_networks import drawn, drawn_weights
from published_files import WEIGHTS, weights

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, Predictor, checked, predictors_named
from siren_ros.scoring.evaluation.prediction.published import predictors
from siren_ros.scoring.evaluation.prediction.published.inputs import (
    NgsimView,
    bat_features,
    behaviour_tensor,
    csp_features,
    ngsim_view,
    polar,
    positions_ft,
    stdan_features,
)
from siren_ros.scoring.evaluation.prediction.published.layers import Neighbours, NetworkInput
from siren_ros.scoring.evaluation.prediction.published.networks import Bat, BatInput, Csp, Stdan
from siren_ros.scoring.evaluation.prediction.published.predictors import (
    PublishedPredictor,
    make_bat,
    make_csp,
    make_stdan,
)
from siren_ros.scoring.evaluation.prediction.samples import SampleBatch
from siren_ros.simulation.roads.road_network import RoadNetwork

MODES = {"csp": 6, "stdan": 1, "bat": 9}


@pytest.fixture(params=WEIGHTS)
def model(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def predictor(model: str, tmp_path: Path) -> Predictor:
    return predictors_named([model], drawn_weights(model, tmp_path))[model]


def turned(places: np.ndarray, angle_rad: float) -> np.ndarray:
    """Places turned around (0, 500)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = places[..., 0], places[..., 1] - 500.0
    return np.stack((cos * x - sin * y, sin * x + cos * y + 500.0), axis=-1)


def batch_of(tracks: dict[int, Track], network: RoadNetwork) -> SampleBatch:
    return samples_in(tracks, network).batch


def off_the_lanes(yaw_rad: float = 0.0) -> dict[int, Track]:
    """Three vehicles in a row at highway speed, and one in the lane to their left, all turned around (0, 500)."""
    places = turned(np.array([(0.0, 500.0), (26.0, 500.0), (52.0, 500.0), (12.0, 503.5)]), yaw_rad)
    vehicles = enumerate(zip(places, (22.0, 22.0, 21.0, 24.0), strict=True), start=1)
    return {key: moving(*place, speed, accel_mps2=0.1, yaw_rad=yaw_rad) for key, (place, speed) in vehicles}


def test_steady_traffic_is_predicted_to_go_on(model, straight_road) -> None:
    predictor = predictors_named([model], {model: weights(model)})[model]
    tracks = {key: moving(-25.0 + 25.0 * key, -5.25 + 3.5 * (key % 2), 15.0) for key in range(1, 7)}
    scored = samples_in(tracks, straight_road, predictor.window)
    hypotheses = checked(model, predictor.predict(scored.batch), len(scored))
    assert hypotheses.xy_m.shape == (len(scored), MODES[model], 25, 2)
    miss = np.linalg.norm(hypotheses.xy_m[:, 0] - scored.future_xy_m, axis=-1)
    # The vehicles go 75 m in that time; BAT is the worst of the three.
    assert miss.mean() < (4.0 if model == "bat" else 2.0)
    first = np.linalg.norm(hypotheses.xy_m[:, 0, 0] - scored.batch.xy_m, axis=-1)
    assert first == pytest.approx(3.0, abs=0.8)


@pytest.mark.parametrize("angle_rad", [0.5, np.pi / 2, -2.5])
def test_a_turned_world_is_predicted_turned(angle_rad, predictor, straight_road) -> None:
    straight = predictor.predict(batch_of(off_the_lanes(), straight_road))
    hypotheses = predictor.predict(batch_of(off_the_lanes(angle_rad), straight_road))
    assert np.abs(hypotheses.xy_m - turned(straight.xy_m, angle_rad)).max() < 0.02
    assert np.abs(hypotheses.probability - straight.probability).max() < 1e-3


def test_frames_are_predicted_one_by_one(predictor, straight_road, monkeypatch) -> None:
    batch = batch_of(off_the_lanes(), straight_road)
    whole = predictor.predict(batch)
    monkeypatch.setattr(predictors, "MOST_SAMPLES", 1)
    single = predictor.predict(batch)
    assert np.abs(whole.xy_m - single.xy_m).max() < 1e-3
    assert np.abs(whole.probability - single.probability).max() < 1e-5


def test_the_most_probable_manoeuvres_are_the_answer(predictor, straight_road) -> None:
    hypotheses = predictor.predict(batch_of(off_the_lanes(), straight_road))
    assert (np.diff(hypotheses.probability, axis=1) <= 0.0).all()
    assert hypotheses.probability.sum(axis=1) == pytest.approx(1.0)


def test_without_samples_there_is_no_hypothesis(predictor, straight_road) -> None:
    hypotheses: Hypotheses = predictor.predict(batch_of({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road))
    assert len(hypotheses) == 0


def test_one_vehicle_alone_has_a_prediction(model, predictor, straight_road) -> None:
    batch = batch_of({1: moving(0.0, 500.0, 22.0)}, straight_road)
    checked(model, predictor.predict(batch), len(batch))


FOOT_M = 0.3048


@pytest.fixture
def batch(straight_road: RoadNetwork) -> SampleBatch:
    """Three vehicles eastwards at 10, 12 and 14 m/s, side by side and one behind."""
    places = [(20.0, -5.25, 10.0), (26.0, -1.75, 12.0), (8.0, -5.25, 14.0)]
    tracks = {key: moving(*place, accel_mps2=0.2) for key, place in enumerate(places, start=1)}
    return batch_of(tracks, straight_road)


def test_feet_to_the_right_and_ahead_are_metres_on_the_map(batch) -> None:
    """Two modes: 10 feet to the right, 100 ahead; 5 to the left, 200 ahead. The second is the likelier one."""

    def answer(view: NgsimView) -> Any:
        modes = np.broadcast_to(np.array([[10.0, 100.0], [-5.0, 200.0]])[None, :, None], (len(view), 2, 25, 2))
        return modes, np.tile([0.3, 0.7], (len(view), 1))

    hypotheses = PublishedPredictor(answer).predict(batch)
    assert hypotheses.probability[0].tolist() == [0.7, 0.3]
    # The road goes eastwards: ahead is +x, and the right is −y.
    for mode, (right_ft, ahead_ft) in enumerate([(-5.0, 200.0), (10.0, 100.0)]):
        expected = batch.xy_m + np.array([ahead_ft * FOOT_M, -right_ft * FOOT_M])
        assert hypotheses.xy_m[:, mode] == pytest.approx(np.repeat(expected[:, None], 25, axis=1))


def on_the_road(batch: SampleBatch, right_ahead_ft: Any) -> Any:
    """Places on the map of what a network says in feet, along a road that goes eastwards."""
    metres = np.asarray(right_ahead_ft, dtype=np.float64) * FOOT_M
    return batch.xy_m[:, None, None] + np.stack((metres[..., 1], -metres[..., 0]), axis=-1)


def saved(network: Any, path: Path) -> Path:
    torch.save(network.state_dict(), path / "weights.pt")
    return path / "weights.pt"


def tensors(features: Any, view: NgsimView) -> tuple[Any, Any, Neighbours]:
    around = Neighbours(torch.from_numpy(view.sample), torch.from_numpy(view.cell), len(view))
    return *(torch.from_numpy(values) for values in features), around


def assert_ranked(hypotheses: Any, batch: SampleBatch, modes_ft: Any, lateral: Any, longitudinal: Any) -> None:
    """Mode l + 3 k is that of the lateral manoeuvre l and the longitudinal manoeuvre k; the likeliest comes first."""
    places = on_the_road(batch, modes_ft)
    for sample in range(len(batch)):
        modes = range(len(modes_ft[0]))
        likely = np.array([float(lateral[sample, mode % 3] * longitudinal[sample, mode // 3]) for mode in modes])
        order = np.argsort(likely)[::-1]
        assert hypotheses.probability[sample] == pytest.approx(likely[order], abs=1e-6)
        assert hypotheses.xy_m[sample] == pytest.approx(places[sample, order], abs=1e-4)


def test_csp_on_the_map(batch, tmp_path) -> None:
    network, view = drawn(Csp()), ngsim_view(batch)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(NetworkInput(*tensors(csp_features(view), view)))
    hypotheses = make_csp(saved(network, tmp_path)).predict(batch)
    modes_ft = np.array([[modes[mode, :, sample, :2].numpy() for mode in range(6)] for sample in range(len(batch))])
    assert_ranked(hypotheses, batch, modes_ft, lateral, longitudinal)


def test_stdan_on_the_map(batch, tmp_path) -> None:
    network, view = drawn(Stdan()), ngsim_view(batch)
    with torch.inference_mode():
        path, _, _ = network(NetworkInput(*tensors(stdan_features(view), view)))
    hypotheses = make_stdan(saved(network, tmp_path)).predict(batch)
    assert (hypotheses.probability == 1.0).all()
    assert hypotheses.probability.shape == (len(batch), 1)
    places = on_the_road(batch, path[..., :2].permute(1, 0, 2)[:, None].numpy())
    assert hypotheses.xy_m == pytest.approx(places, abs=1e-4)


def test_bat_on_the_map(batch, tmp_path) -> None:
    network, view = drawn(Bat()), ngsim_view(batch)
    targets, others = (polar(places) for places in positions_ft(view))
    behaviour = torch.from_numpy(behaviour_tensor(targets, others, view.sample, view.cell))
    past, around, neighbours = tensors(bat_features(view), view)
    with torch.inference_mode():
        scene = torch.from_numpy(view.scene)
        modes, lateral, longitudinal = network(BatInput(past, around, neighbours, behaviour, scene))
    hypotheses = make_bat(saved(network, tmp_path)).predict(batch)
    # Its means are a distance and an angle from the right towards ahead.
    r, phi = (modes[..., column].double().numpy().transpose(2, 0, 1) for column in (0, 1))
    assert_ranked(hypotheses, batch, np.stack((r * np.cos(phi), r * np.sin(phi)), axis=-1), lateral, longitudinal)


@pytest.mark.parametrize("make", [make_csp, make_stdan, make_bat])
def test_without_weights_the_models_are_none(make) -> None:
    with pytest.raises(InputError, match="checkpoint"):
        make(None)


def evaluate(bag: Path, *more: str) -> int:
    return main(["evaluate", "prediction", str(bag), "--models", "csp", *more])


def test_a_wrong_checkpoint_ends_the_command_with_one_line(tmp_path, capsys) -> None:
    torch.save({"op.weight": torch.zeros(5, 128)}, tmp_path / "other.pt")
    assert evaluate(tmp_path, "--checkpoint", f"csp={tmp_path / 'other.pt'}") == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert "other.pt" in error
    assert "21 of 22 missing, first ip_emb.weight" in error


def test_without_a_checkpoint_the_command_says_how_to_give_one(tmp_path, capsys) -> None:
    assert evaluate(tmp_path) == 2
    assert "--checkpoint csp=PATH" in capsys.readouterr().err


WITHOUT_TORCH = """
import sys
from siren_ros.cli.main import main

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
sys.exit(main(sys.argv[1:]))
"""


def run_without_torch(*arguments: Any) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", WITHOUT_TORCH, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_without_torch_the_command_says_how_to_get_it(tmp_path) -> None:
    models = "--models", "csp", "--checkpoint", f"csp={tmp_path / 'x.pt'}"
    ended = run_without_torch("evaluate", "prediction", tmp_path, *models)
    assert ended.returncode == 2
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "./env --with models siren evaluate" in ended.stderr


def test_without_torch_the_help_names_the_models() -> None:
    ended = run_without_torch("evaluate", "prediction", "--help")
    assert ended.returncode == 0
    assert "csp, stdan, bat" in " ".join(ended.stdout.split())
