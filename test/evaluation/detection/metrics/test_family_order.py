"""Shares of resamples in the paper's order, by hand."""

import numpy as np
import pytest

from siren_ros.evaluation.detection.metrics.family_order import FAMILIES, FamilyOrder


def test_shares_of_four_resamples() -> None:
    values = {
        "clearance": np.array([0.1, 0.1, 0.5, 0.1]),
        "stop sign": np.array([0.2, 0.2, 0.4, 0.2]),
        "shoulder": np.array([0.3, 0.1, 0.6, 0.3]),
        "red light": np.array([0.4, 0.4, 0.7, 0.3]),
    }
    order = FamilyOrder.of(values)
    assert order is not None
    assert list(order.steps.values()) == pytest.approx([0.75, 0.75, 0.75]), "equal is not below"
    assert order.whole == pytest.approx(0.25)
    assert "whole order in 25%" in order.told()
    # The order of the dictionary says nothing.
    assert FamilyOrder.of(dict(reversed(values.items()))) == order


def test_a_missing_family_has_no_order() -> None:
    assert FamilyOrder.of({name: np.ones(3) for name in list(FAMILIES)[:3]}) is None
    assert len([one for members in FAMILIES.values() for one in members]) == 7
