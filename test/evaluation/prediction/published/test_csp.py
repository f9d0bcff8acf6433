"""CSP of drawn parameters against the same written out for one sample at a time."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from plain_networks import drawn, plain_csp

from siren_ros.evaluation.prediction.published.csp import Csp, CspInput
from siren_ros.evaluation.prediction.published.layers import Neighbours


def test_samples_together_are_answered_as_each_alone() -> None:
    """Neighbours at both ends of the grid, in all columns; the second of three samples has none."""
    network, generator = drawn(Csp()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 2), generator=generator) for count in (3, 5))
    sample, cell = torch.tensor([0, 0, 2, 2, 2]), torch.tensor([0, 21, 12, 14, 38])
    with torch.inference_mode():
        modes, lateral, longitudinal = network(CspInput(past, others, Neighbours(sample, cell, 3)))
        assert modes.shape == (6, 25, 3, 5)
        for number in range(3):
            around = {int(cell[row]): others[:, row] for row in range(5) if sample[row] == number}
            known = plain_csp(network, past[:, number], around)
            found = modes[:, :, number], lateral[number], longitudinal[number]
            for one, other in zip(found, known, strict=True):
                torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


def test_nobody_has_a_neighbour() -> None:
    network = drawn(Csp())
    past = torch.randn((16, 2, 2), generator=torch.Generator().manual_seed(2))
    nobody = Neighbours(torch.zeros(0, dtype=torch.long), torch.zeros(0, dtype=torch.long), 2)
    with torch.inference_mode():
        modes, _, _ = network(CspInput(past, torch.zeros((16, 0, 2)), nobody))
        for number in range(2):
            known, _, _ = plain_csp(network, past[:, number], {})
            torch.testing.assert_close(modes[:, :, number], known, atol=1e-4, rtol=1e-4)
