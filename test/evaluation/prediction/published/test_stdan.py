"""STDAN of drawn parameters against the same written out for one sample at a time, with all 39 cells."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from plain_networks import drawn, plain_stdan

from siren_ros.evaluation.prediction.published.layers import Neighbours
from siren_ros.evaluation.prediction.published.stdan import Stdan, StdanInput


@pytest.mark.parametrize(("sample", "cell"), [([0, 0, 0, 2], [0, 20, 38, 7]), ([], [])])
def test_empty_cells_are_attended_too(sample: list[int], cell: list[int]) -> None:
    """A cell without a vehicle is a vector of zeros, whose key and value are the biases: it draws attention."""
    network, generator = drawn(Stdan()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 5), generator=generator) for count in (3, len(sample)))
    given = Neighbours(torch.tensor(sample, dtype=torch.long), torch.tensor(cell, dtype=torch.long), 3)
    with torch.inference_mode():
        path, lateral, longitudinal = network(StdanInput(past, others, given))
        assert path.shape == (25, 3, 5)
        for number in range(3):
            around = {place: others[:, row] for row, place in enumerate(cell) if sample[row] == number}
            known = plain_stdan(network, past[:, number], around)
            found = path[:, number], lateral[number], longitudinal[number]
            for one, other in zip(found, known, strict=True):
                torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)
