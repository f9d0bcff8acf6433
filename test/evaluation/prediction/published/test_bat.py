"""BAT of drawn parameters against the same written out: scenes, who attends to whom, how behaviours run on."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from plain_networks import chosen, drawn, plain_bat_encoder, plain_generator
from torch import Tensor

from siren_ros.evaluation.prediction.published.bat import Bat, BatInput
from siren_ros.evaluation.prediction.published.layers import Neighbours


def assert_as_written_out(scene: list[int], sample: list[int], cell: list[int]) -> None:
    """Modes and probabilities of made samples, scene by scene."""
    network, generator = drawn(Bat()), torch.Generator().manual_seed(1)

    def made(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator)

    past, others, behaviour = made(16, len(scene), 8), made(16, len(sample), 8), made(16, len(scene), 39, 6)
    given = Neighbours(torch.tensor(sample, dtype=torch.long), torch.tensor(cell, dtype=torch.long), len(scene))
    with torch.inference_mode():
        modes, lateral, longitudinal = network(BatInput(past, others, behaviour, given, torch.tensor(scene)))
        assert modes.shape == (9, 25, len(scene), 5)
        around = [
            {place: others[:, row] for row, place in enumerate(cell) if sample[row] == number}
            for number in range(len(scene))
        ]
        for number in sorted(set(scene)):
            own = [place for place, one in enumerate(scene) if one == number]
            parts = [(past[:, place], around[place], behaviour[:, place]) for place in own]
            for place, encoded in zip(own, plain_bat_encoder(network, parts), strict=True):
                for mode in (5, 7):
                    known = plain_generator(network.g, encoded, (chosen(mode % 3, 3), chosen(mode // 3, 3)))
                    found = modes[mode, :, place], lateral[place], longitudinal[place]
                    for one, other in zip(found, known, strict=True):
                        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)


def test_scenes_of_different_sizes() -> None:
    """The first sample has three neighbours, the second of its scene one; the sample of the second scene has none."""
    assert_as_written_out(scene=[0, 0, 1, 2], sample=[0, 0, 0, 1, 3], cell=[3, 19, 30, 21, 38])


def test_nobody_has_a_neighbour() -> None:
    assert_as_written_out(scene=[0, 0], sample=[], cell=[])
