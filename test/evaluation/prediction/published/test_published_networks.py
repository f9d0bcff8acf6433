"""The networks against what their authors' code answers with the published weights."""

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from published_files import golden, golden_cells, weights

from siren_ros.evaluation.prediction.published.bat import Bat, BatInput
from siren_ros.evaluation.prediction.published.csp import Csp
from siren_ros.evaluation.prediction.published.layers import (
    Groups,
    Neighbours,
    NetworkInput,
    mode_probabilities,
    one_hot_modes,
)
from siren_ros.evaluation.prediction.published.predictors import load_weights
from siren_ros.evaluation.prediction.published.stdan import Stdan

TOLERANCE = 1e-4


def neighbours_of(known: dict[str, Any]) -> Neighbours:
    sample, cell = golden_cells(known)
    return Neighbours(torch.from_numpy(sample), torch.from_numpy(cell), len(known["mask"]))


def stacked(known: dict[str, Any], *names: str) -> Any:
    return torch.from_numpy(np.concatenate([known[name] for name in names], axis=-1))


def stdan_input(known: dict[str, Any]) -> NetworkInput:
    return NetworkInput(
        stacked(known, "hist", "cls", "va"), stacked(known, "nbrs", "nbrscls", "nbrsva"), neighbours_of(known)
    )


def bat_input(known: dict[str, Any], scene: Any) -> BatInput:
    return BatInput(
        stacked(known, "hist", "hist_rel", "cls", "va", "lane"),
        stacked(known, "nbrs", "feat_self", "nbrscls", "nbrsva", "nbrslane"),
        neighbours_of(known),
        stacked(known, "behaviour"),
        scene,
    )


def assert_equal(found: Any, known: Any) -> None:
    assert found.shape == known.shape
    assert np.abs(found.numpy() - known).max() <= TOLERANCE


def test_csp_answers_as_published() -> None:
    known = golden("csp")
    with torch.inference_mode():
        given = NetworkInput(stacked(known, "hist"), stacked(known, "nbrs"), neighbours_of(known))
        modes, lateral, longitudinal = load_weights(Csp(), "csp", weights("csp"))(given)
    assert_equal(modes, known["out_modes"])
    assert_equal(lateral, known["lat_prob"])
    assert_equal(longitudinal, known["lon_prob"])


def test_stdan_answers_as_published() -> None:
    known = golden("stdan")
    network = load_weights(Stdan(), "stdan", weights("stdan"))
    with torch.inference_mode():
        path, lateral, longitudinal = network(stdan_input(known))
        encoded = network.gd(stdan_input(known))
    assert_equal(encoded, known["encoded"])
    assert_equal(path, known["pred"])
    assert_equal(lateral, known["lat_prob"])
    assert_equal(longitudinal, known["lon_prob"])


def test_bat_answers_as_published_where_the_batch_is_one_scene() -> None:
    known = golden("bat")
    network = load_weights(Bat(), "bat", weights("bat"))
    given = bat_input(known, torch.zeros(24, dtype=torch.long))
    with torch.inference_mode():
        modes, lateral, longitudinal = network(given)
        encoded = network.gd(given)
    assert_equal(encoded, known["encoded"])
    assert_equal(modes, known["out_modes"])
    assert_equal(lateral, known["lat_prob"])
    assert_equal(longitudinal, known["lon_prob"])


def test_scenes_of_bat_know_nothing_of_each_other() -> None:
    known = golden("bat")
    network = load_weights(Bat(), "bat", weights("bat"))
    sample, _ = golden_cells(known)
    alone = {name: value for name, value in known.items() if name != "fut"}
    for name in ("hist", "hist_rel", "va", "lane", "cls", "behaviour"):
        alone[name] = known[name][:, :10]
    for name in ("nbrs", "nbrsva", "nbrslane", "nbrscls", "feat_self"):
        alone[name] = known[name][:, sample < 10]
    alone["mask"] = known["mask"][:10]
    scenes = torch.from_numpy(np.repeat([0, 1], [10, 14]))
    with torch.inference_mode():
        both = network(bat_input(known, scenes))[0]
        first = network(bat_input(alone, scenes[:10]))[0]
    assert torch.allclose(both[:, :, :10], first, atol=1e-4)


@pytest.mark.parametrize("network", [Csp(), Stdan()], ids=["csp", "stdan"])
def test_a_sample_is_answered_alone_as_among_others(network: Any) -> None:
    network.eval()
    generator = torch.Generator().manual_seed(3)
    width = 2 if isinstance(network, Csp) else 5
    history = torch.randn((16, 3, width), generator=generator)
    others = torch.randn((16, 2, width), generator=generator)
    both = NetworkInput(history, others, Neighbours(torch.tensor([0, 2]), torch.tensor([5, 30]), 3))
    with torch.inference_mode():
        together = network(both)[0]
        for sample, (rows, cell) in enumerate([([0], [5]), ([], []), ([1], [30])]):
            at = Neighbours(torch.zeros(len(cell), dtype=torch.long), torch.tensor(cell, dtype=torch.long), 1)
            alone = network(NetworkInput(history[:, [sample]], others[:, rows], at))[0]
            assert torch.allclose(alone[..., 0, :], together[..., sample, :], atol=1e-5)


def test_groups_spread_rows_and_gather_them() -> None:
    groups = Groups.of(torch.tensor([0, 0, 2, 2, 2]), 4)
    rows = torch.arange(10.0).view(5, 2)
    spread = groups.spread(rows)
    assert spread.shape == (4, 3, 2)
    assert groups.filled.tolist() == [[True, True, False], [False] * 3, [True] * 3, [False] * 3]
    assert spread[0, 1].tolist() == [2.0, 3.0]
    assert (spread[~groups.filled] == 0.0).all()
    assert torch.equal(groups.gather(spread), rows)
    # There is always a slot, so that attention over it has a shape.
    nobody = Groups.of(torch.zeros(0, dtype=torch.long), 0)
    assert nobody.spread(torch.zeros(0, 2)).shape == (0, 1, 2)
    assert Groups.of(torch.zeros(0, dtype=torch.long), 3).spread(torch.zeros(0, 2)).shape == (3, 1, 2)


def test_modes_count_lateral_manoeuvres_first() -> None:
    lateral = torch.tensor([[0.2, 0.7, 0.1]])
    longitudinal = torch.tensor([[0.4, 0.6]])
    probability = mode_probabilities(lateral, longitudinal)
    for mode, (across, along) in enumerate(one_hot_modes(1, 3, 2)):
        expected = (lateral * across).sum() * (longitudinal * along).sum()
        assert float(probability[0, mode]) == pytest.approx(float(expected))
    assert int(probability.argmax()) == 3 + 1
