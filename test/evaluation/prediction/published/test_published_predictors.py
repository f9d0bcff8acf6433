import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from made_records import Track, moving, record_with
from plain_networks import drawn
from published_files import WEIGHTS, weights

from siren_ros.cli.main import main
from siren_ros.evaluation.prediction.predictors import Hypotheses, Predictor, checked, predictors_named
from siren_ros.evaluation.prediction.published import predictors
from siren_ros.evaluation.prediction.published.bat import Bat
from siren_ros.evaluation.prediction.published.csp import Csp
from siren_ros.evaluation.prediction.published.stdan import Stdan
from siren_ros.evaluation.prediction.samples import Population, SampleBatch, samples_of
from siren_ros.roads.road_network import RoadNetwork

MODES = {"csp": 6, "stdan": 1, "bat": 9}
NETWORKS = {"csp": Csp, "stdan": Stdan, "bat": Bat}


@pytest.fixture(params=WEIGHTS)
def model(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def drawn_weights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Files of weights that nobody trained: what does not depend on the weights holds for them too."""
    paths = {model: tmp_path_factory.mktemp("drawn") / f"{model}.pt" for model in NETWORKS}
    for model, path in paths.items():
        torch.save(drawn(NETWORKS[model]()).state_dict(), path)
    return paths


@pytest.fixture
def predictor(model: str, drawn_weights: dict[str, Path]) -> Predictor:
    return predictors_named([model], {model: drawn_weights[model]})[model]


def turned(tracks: dict[int, Track], angle_rad: float) -> dict[int, Track]:
    """The tracks, turned around (0, 500)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    found = {}
    for key, track in tracks.items():
        x, y, vx, vy, yaw = track.states.T
        y = y - 500.0
        columns = (cos * x - sin * y, sin * x + cos * y + 500.0, cos * vx - sin * vy, sin * vx + cos * vy)
        found[key] = Track(np.stack((*columns, yaw + angle_rad), axis=1), accel_mps2=track.accel_mps2)
    return found


def batch_of(tracks: dict[int, Track], network: RoadNetwork) -> SampleBatch:
    return samples_of(record_with(tracks, network), predictors.HistoryWindow(), Population.ALL).batch


def off_the_lanes() -> dict[int, Track]:
    """Three vehicles in a row at highway speed, and one in the lane to their left."""
    places = [(0.0, 500.0, 22.0), (26.0, 500.0, 22.0), (52.0, 500.0, 21.0), (12.0, 503.5, 24.0)]
    return {key: moving(x, y, speed, accel_mps2=0.1) for key, (x, y, speed) in enumerate(places, start=1)}


def test_steady_traffic_is_predicted_to_go_on(model: str, straight_road: RoadNetwork) -> None:
    predictor = predictors_named([model], {model: weights(model)})[model]
    tracks = {key: moving(-25.0 + 25.0 * key, -5.25 + 3.5 * (key % 2), 15.0) for key in range(1, 7)}
    scored = samples_of(record_with(tracks, straight_road), predictor.window, Population.ALL)
    found = checked(model, predictor.predict(scored.batch), len(scored))
    assert found.xy_m.shape == (len(scored), MODES[model], 25, 2)
    miss = np.linalg.norm(found.xy_m[:, 0] - scored.future_xy_m, axis=-1)
    # The vehicles go 75 m in that time; BAT is the worst of the three.
    assert miss.mean() < (4.0 if model == "bat" else 2.0)
    first = np.linalg.norm(found.xy_m[:, 0, 0] - scored.batch.xy_m, axis=-1)
    assert first == pytest.approx(3.0, abs=0.8)


@pytest.mark.parametrize("angle_rad", [0.5, np.pi / 2, -2.5])
def test_a_turned_world_is_predicted_turned(angle_rad: float, predictor: Predictor, straight_road: RoadNetwork) -> None:
    straight = predictor.predict(batch_of(off_the_lanes(), straight_road))
    found = predictor.predict(batch_of(turned(off_the_lanes(), angle_rad), straight_road))
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = straight.xy_m[..., 0], straight.xy_m[..., 1] - 500.0
    expected = np.stack((cos * x - sin * y, sin * x + cos * y + 500.0), axis=-1)
    assert np.abs(found.xy_m - expected).max() < 0.02
    assert np.abs(found.probability - straight.probability).max() < 1e-3


def test_frames_are_predicted_one_by_one(
    predictor: Predictor, straight_road: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch = batch_of(off_the_lanes(), straight_road)
    whole = predictor.predict(batch)
    monkeypatch.setattr(predictors, "_PART", 1)
    single = predictor.predict(batch)
    assert np.abs(whole.xy_m - single.xy_m).max() < 1e-3
    assert np.abs(whole.probability - single.probability).max() < 1e-5


def test_the_most_probable_manoeuvres_are_the_answer(predictor: Predictor, straight_road: RoadNetwork) -> None:
    found = predictor.predict(batch_of(off_the_lanes(), straight_road))
    assert (np.diff(found.probability, axis=1) <= 0.0).all()
    assert found.probability.sum(axis=1) == pytest.approx(1.0)


def test_without_samples_there_is_no_hypothesis(predictor: Predictor, straight_road: RoadNetwork) -> None:
    found: Hypotheses = predictor.predict(batch_of({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road))
    assert len(found) == 0


def test_one_vehicle_alone_has_a_prediction(model: str, predictor: Predictor, straight_road: RoadNetwork) -> None:
    batch = batch_of({1: moving(0.0, 500.0, 22.0)}, straight_road)
    checked(model, predictor.predict(batch), len(batch))


def evaluate(bag: Path, *more: str) -> int:
    return main(["evaluate", "prediction", str(bag), "--models", "csp", *more])


def test_a_wrong_checkpoint_ends_the_command_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch.save({"op.weight": torch.zeros(5, 128)}, tmp_path / "other.pt")
    assert evaluate(tmp_path, "--checkpoint", f"csp={tmp_path / 'other.pt'}") == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert "other.pt" in error
    assert "21 of 22 missing, first ip_emb.weight" in error


def test_without_a_checkpoint_the_command_says_how_to_give_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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


def test_without_torch_the_command_says_how_to_get_it(tmp_path: Path) -> None:
    ended = run_without_torch(
        "evaluate", "prediction", tmp_path, "--models", "csp", "--checkpoint", f"csp={tmp_path / 'x.pt'}"
    )
    assert ended.returncode == 2
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "./env --with models siren evaluate" in ended.stderr


def test_without_torch_the_help_names_the_models() -> None:
    ended = run_without_torch("evaluate", "prediction", "--help")
    assert ended.returncode == 0
    assert "csp, stdan, bat" in " ".join(ended.stdout.split())
