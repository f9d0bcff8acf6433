"""Distributions of ordinary traffic next to real ones: quantiles and distances that are worked out by hand."""

import numpy as np
import pytest

from siren_ros.scoring.evaluation.realism.distributions import distribution_table, distributions, distributions_as_json
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, TRAFFIC, RealismEpisode


def test_quantiles_and_distances_are_those_of_all_samples_of_each_side() -> None:
    """The shares of 1 to 5 m and of 3 and 5 m are apart by at most 0.4, and by 1 m in all."""

    def episode(gaps_m: list[float]) -> RealismEpisode:
        samples = {name: np.array(gaps_m if name == "standing_gap_m" else []) for name in SAMPLES}
        return RealismEpisode("L1", True, ("S3", "town", "0", ""), samples | {"start_mps2": np.array([1.5])})

    real = [
        {name: np.array([value]) if name == "standing_gap_m" else np.empty(0) for name in TRAFFIC} for value in (5, 3)
    ]
    real[1]["start_mps2"] = np.array([2.5])
    found = distributions([episode([4.0, 2.0]), episode([1.0, 5.0, 3.0])], real)
    rows = {row[0]: row[1:] for row in distribution_table(found).rows}
    quantiles = [(1.4, 3.2), (2.0, 3.5), (3.0, 4.0), (4.0, 4.5), (4.6, 4.8)]
    assert [*rows] == [*TRAFFIC]
    assert np.array(rows["standing_gap_m"][:5]) == pytest.approx(np.array(quantiles))
    assert rows["standing_gap_m"][5:7] == pytest.approx((0.4, 1.0))
    assert rows["standing_gap_m"][7] == (5, 2)
    assert rows["start_mps2"] == (*[(1.5, 2.5)] * 5, None, None, (2, 1)), "one sample has no distance"
    assert rows["jerk_mps3"] == (*[(None, None)] * 5, None, None, (0, 0))
    by_name = {row["quantity"]: row for row in distributions_as_json(found)}
    shares = ("p10", "p25", "p50", "p75", "p90")
    for name, row in rows.items():
        sides = by_name[name]["simulated"], by_name[name]["real"]
        assert [tuple(side[share] for side in sides) for share in shares] == list(row[:5])
        assert (by_name[name]["kolmogorov_smirnov"], by_name[name]["wasserstein"]) == row[5:7]
        assert tuple(side["samples"] for side in sides) == row[7]
