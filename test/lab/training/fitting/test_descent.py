"""Steps down a loss: the rate, the running mean, and going on from a state."""

import pytest

torch = pytest.importorskip("torch", reason="the extra models is not installed")

from siren_ros.lab.training.fitting.descent import Descent
from siren_ros.lab.training.settings import DetectionFit

CONFIG = DetectionFit(learning_rate=0.1, weight_decay=0.0)


def descent_of(steps, **options):
    torch.manual_seed(3)
    return Descent(torch.nn.Linear(1, 1), CONFIG, steps, rising=0.25, gradient_max=5.0, **options)


def go(descent, steps):
    rates = []
    for _ in range(steps):
        rates.append(descent.rate)
        descent.step((descent.network(torch.ones(4, 1)) ** 2).mean())
    return rates


def test_the_rate_rises_and_falls() -> None:
    descent = descent_of(40)
    rates = go(descent, 40)
    assert rates[9] == pytest.approx(0.1)
    assert rates[:10] == sorted(rates[:10])
    assert rates[9:] == sorted(rates[9:], reverse=True)
    assert rates[0] == pytest.approx(0.1 / 25.0)
    assert rates[-1] < 1e-3 * 0.1
    short, longer = descent_of(12), descent_of(40)
    go(short, 12)
    longer.go_on(short.state(), 12)
    assert go(longer, 28) == rates[12:], "a longer one goes on at its own rate"


@pytest.mark.parametrize("averaging", [None, 0.5])
def test_a_descent_goes_on_where_another_one_stopped(averaging) -> None:
    whole, first, rest = (descent_of(12, averaging=averaging) for _ in range(3))
    rates = go(whole, 12)
    go(first, 5)
    rest.go_on(first.state(), 5)
    assert go(rest, 7) == rates[5:]
    for weights, other in zip(whole.result().parameters(), rest.result().parameters(), strict=True):
        assert torch.equal(weights, other)


def test_the_mean_follows_fast_at_first_and_slowly_later() -> None:
    descent = descent_of(3, averaging=0.15)
    weights = []
    for _ in range(3):
        go(descent, 1)
        weights.append(descent.network.weight.detach().clone())
    mean = 0.85 * weights[1] + 0.15 * weights[0]
    mean = 0.85 * weights[2] + 0.15 * mean
    assert torch.allclose(descent.result().weight, mean)
