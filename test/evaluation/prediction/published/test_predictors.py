"""From a view to the map: feet, sides, the order of modes and points, polar answers; with networks of drawn weights."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from made_records import moving, record_with
from plain_networks import drawn

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.published.bat import Bat, BatInput
from siren_ros.evaluation.prediction.published.csp import Csp
from siren_ros.evaluation.prediction.published.inputs import (
    NgsimView,
    bat_features,
    behaviour_tensor,
    csp_features,
    ngsim_view,
    polar,
    positions_ft,
    stdan_features,
)
from siren_ros.evaluation.prediction.published.layers import Neighbours, NetworkInput
from siren_ros.evaluation.prediction.published.predictors import (
    PublishedPredictor,
    make_bat,
    make_csp,
    make_stdan,
)
from siren_ros.evaluation.prediction.published.stdan import Stdan
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, SampleBatch, samples_of
from siren_ros.roads.road_network import RoadNetwork

FOOT_M = 0.3048


@pytest.fixture
def batch(straight_road: RoadNetwork) -> SampleBatch:
    """Three vehicles eastwards at 10, 12 and 14 m/s, side by side and one behind."""
    places = [(20.0, -5.25, 10.0), (26.0, -1.75, 12.0), (8.0, -5.25, 14.0)]
    tracks = {key: moving(*place, accel_mps2=0.2) for key, place in enumerate(places, start=1)}
    return samples_of(record_with(tracks, straight_road), HistoryWindow(), Population.ALL).batch


def test_feet_to_the_right_and_ahead_are_metres_on_the_map(batch: SampleBatch) -> None:
    """Two modes: 10 feet to the right, 100 ahead; 5 to the left, 200 ahead. The second is the likelier one."""

    def answer(view: NgsimView) -> Any:
        modes = np.broadcast_to(np.array([[10.0, 100.0], [-5.0, 200.0]])[None, :, None], (len(view), 2, 25, 2))
        return modes, np.tile([0.3, 0.7], (len(view), 1))

    found = PublishedPredictor(answer).predict(batch)
    assert found.probability[0].tolist() == [0.7, 0.3]
    # The road goes eastwards: ahead is +x, and the right is −y.
    for mode, (right_ft, ahead_ft) in enumerate([(-5.0, 200.0), (10.0, 100.0)]):
        expected = batch.xy_m + np.array([ahead_ft * FOOT_M, -right_ft * FOOT_M])
        assert found.xy_m[:, mode] == pytest.approx(np.repeat(expected[:, None], 25, axis=1))


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


def assert_ranked(found: Any, batch: SampleBatch, modes_ft: Any, lateral: Any, longitudinal: Any) -> None:
    """Mode l + 3 k is that of the lateral manoeuvre l and the longitudinal manoeuvre k; the likeliest comes first."""
    places = on_the_road(batch, modes_ft)
    for sample in range(len(batch)):
        likely = [
            float(lateral[sample, mode % 3] * longitudinal[sample, mode // 3]) for mode in range(len(modes_ft[0]))
        ]
        order = np.argsort(likely)[::-1]
        assert found.probability[sample] == pytest.approx(np.array(likely)[order], abs=1e-6)
        assert found.xy_m[sample] == pytest.approx(places[sample, order], abs=1e-4)


def test_csp_on_the_map(batch: SampleBatch, tmp_path: Path) -> None:
    network, view = drawn(Csp()), ngsim_view(batch)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(NetworkInput(*tensors(csp_features(view), view)))
    found = make_csp(saved(network, tmp_path)).predict(batch)
    modes_ft = np.array([[modes[mode, :, sample, :2].numpy() for mode in range(6)] for sample in range(len(batch))])
    assert_ranked(found, batch, modes_ft, lateral, longitudinal)


def test_stdan_on_the_map(batch: SampleBatch, tmp_path: Path) -> None:
    network, view = drawn(Stdan()), ngsim_view(batch)
    with torch.inference_mode():
        path, _, _ = network(NetworkInput(*tensors(stdan_features(view), view)))
    found = make_stdan(saved(network, tmp_path)).predict(batch)
    assert (found.probability == 1.0).all()
    assert found.probability.shape == (len(batch), 1)
    assert found.xy_m == pytest.approx(on_the_road(batch, path[..., :2].permute(1, 0, 2)[:, None].numpy()), abs=1e-4)


def test_bat_on_the_map(batch: SampleBatch, tmp_path: Path) -> None:
    network, view = drawn(Bat()), ngsim_view(batch)
    own, others = (polar(places) for places in positions_ft(view))
    behaviour = torch.from_numpy(behaviour_tensor(own, others, view.sample, view.cell))
    past, around, neighbours = tensors(bat_features(view), view)
    with torch.inference_mode():
        scene = torch.from_numpy(view.scene)
        modes, lateral, longitudinal = network(BatInput(past, around, neighbours, behaviour, scene))
    found = make_bat(saved(network, tmp_path)).predict(batch)
    # Its means are a distance and an angle from the right towards ahead.
    r, phi = (modes[..., column].double().numpy().transpose(2, 0, 1) for column in (0, 1))
    assert_ranked(found, batch, np.stack((r * np.cos(phi), r * np.sin(phi)), axis=-1), lateral, longitudinal)


@pytest.mark.parametrize("make", [make_csp, make_stdan, make_bat])
def test_without_weights_the_models_are_none(make: Any) -> None:
    with pytest.raises(InputError, match="checkpoint"):
        make(None)
