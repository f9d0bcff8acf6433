"""CSP, STDAN and BAT of drawn parameters against the same networks written out for one sample at a time."""

from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from plain_networks import chosen, drawn, plain_bat_encoder, plain_csp, plain_generator, plain_stdan
from torch import Tensor

from siren_ros.evaluation.prediction.published.bat import Bat, BatInput
from siren_ros.evaluation.prediction.published.csp import Csp
from siren_ros.evaluation.prediction.published.layers import Neighbours, NetworkInput
from siren_ros.evaluation.prediction.published.stdan import Stdan


def neighbours_of(samples: int, sample: list[int], cell: list[int]) -> Neighbours:
    return Neighbours(torch.tensor(sample, dtype=torch.long), torch.tensor(cell, dtype=torch.long), samples)


def around(others: Tensor, given: Neighbours, number: int) -> dict[int, Tensor]:
    """The neighbours of one sample by their cell."""
    return {int(given.cell[row]): others[:, row] for row in torch.nonzero(given.sample == number).flatten().tolist()}


def assert_close(found: Any, known: Any) -> None:
    for value, expected in zip(found, known, strict=True):
        torch.testing.assert_close(value, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize(
    ("sample", "cell"), [([0, 0, 2, 2, 2], [0, 21, 12, 14, 38]), ([], [])], ids=["some neighbours", "nobody"]
)
def test_csp_answers_samples_together_as_each_alone(sample: list[int], cell: list[int]) -> None:
    """Neighbours at both ends of the grid, in all columns; the second of three samples has none."""
    network, generator = drawn(Csp()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 2), generator=generator) for count in (3, len(sample)))
    given = neighbours_of(3, sample, cell)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(NetworkInput(past, others, given))
        assert modes.shape == (6, 25, 3, 5)
        for number in range(3):
            known = plain_csp(network, past[:, number], around(others, given, number))
            assert_close((modes[:, :, number], lateral[number], longitudinal[number]), known)


@pytest.mark.parametrize(("sample", "cell"), [([0, 0, 0, 2], [0, 20, 38, 7]), ([], [])])
def test_stdan_attends_to_empty_cells_too(sample: list[int], cell: list[int]) -> None:
    """A cell without a vehicle is a vector of zeros, whose key and value are the biases: it draws attention."""
    network, generator = drawn(Stdan()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 5), generator=generator) for count in (3, len(sample)))
    given = neighbours_of(3, sample, cell)
    with torch.inference_mode():
        path, lateral, longitudinal = network(NetworkInput(past, others, given))
        assert path.shape == (25, 3, 5)
        for number in range(3):
            known = plain_stdan(network, past[:, number], around(others, given, number))
            assert_close((path[:, number], lateral[number], longitudinal[number]), known)


@pytest.mark.parametrize(
    ("scene", "sample", "cell"),
    [([0, 0, 1, 2], [0, 0, 0, 1, 3], [3, 19, 30, 21, 38]), ([0, 0], [], [])],
    ids=["scenes of different sizes", "nobody has a neighbour"],
)
def test_bat_attends_within_scenes_and_runs_on_from_sample_to_sample(
    scene: list[int], sample: list[int], cell: list[int]
) -> None:
    """The first sample has three neighbours, the second of its scene one; the sample of the second scene has none."""
    network, generator = drawn(Bat()), torch.Generator().manual_seed(1)
    shapes = (16, len(scene), 8), (16, len(sample), 8), (16, len(scene), 39, 6)
    past, others, behaviour = (torch.randn(shape, generator=generator) for shape in shapes)
    given = neighbours_of(len(scene), sample, cell)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(BatInput(past, others, given, behaviour, torch.tensor(scene)))
        assert modes.shape == (9, 25, len(scene), 5)
        for number in sorted(set(scene)):
            members = [place for place, of_scene in enumerate(scene) if of_scene == number]
            parts = [(past[:, place], around(others, given, place), behaviour[:, place]) for place in members]
            for place, encoded in zip(members, plain_bat_encoder(network, parts), strict=True):
                for mode in (5, 7):
                    known = plain_generator(network.g, encoded, (chosen(mode % 3, 3), chosen(mode // 3, 3)))
                    assert_close((modes[mode, :, place], lateral[place], longitudinal[place]), known)
