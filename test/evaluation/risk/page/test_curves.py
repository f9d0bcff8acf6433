"""Measures over the time of a video."""

import numpy as np
import pytest
from evaluation.made_video_sets import evidence

from siren_ros.evaluation.risk.evidence import Evidence, Moments
from siren_ros.evaluation.risk.labels import RiskThresholds, label_of
from siren_ros.evaluation.risk.page.charts import HEIGHT, WIDTH, charts_of
from siren_ros.evaluation.risk.page.curves import curves_of
from siren_ros.evaluation.risk.video_set import RiskVideo

LIMITS = RiskThresholds()


def video_of(found: Evidence, first_step: int = 20) -> RiskVideo:
    return RiskVideo("S4_000", "S4", "a.mp4", 190, first_step, label_of(found, LIMITS), found, {})


def moments(*rows: tuple[int, int, float, float, float, float]) -> Evidence:
    step, actor, *values = (np.array(column) for column in zip(*rows, strict=True))
    return Evidence(Moments(step, actor.astype(np.uint32), *values), (), ())


def test_time_begins_with_the_first_frame() -> None:
    curves = curves_of(video_of(evidence("Collision")), LIMITS)
    assert (len(curves.time_s), curves.time_s[0], curves.time_s[-1]) == (380, 0.0, pytest.approx(18.95))
    assert np.flatnonzero(np.isfinite(curves.time_to_collision_s)).tolist() == list(range(20, 28))
    assert curves.moment_s == pytest.approx((48 - 20) * 0.05)
    assert [(dot.at_s, dot.value) for dot in curves.contacts] == [(pytest.approx(1.4), 3.5)]
    assert [(dot.at_s, dot.value) for dot in curves.encroachments] == [(pytest.approx(2.0), 2.5)]


def test_the_most_critical_of_those_who_count_is_drawn() -> None:
    found = moments(
        # step, actor, TTC, closing, DRAC, gap: one closes too slowly, one is too far for its deceleration to count
        (30, 1, 0.5, 0.9, 2.0, 5.0),
        (30, 2, 2.0, 3.0, 1.0, 6.0),
        (30, 3, 1.8, 9.0, 8.0, 10.0),
    )
    curves = curves_of(video_of(found), LIMITS)
    assert curves.time_to_collision_s[10] == 1.8
    assert curves.required_deceleration_mps2[10] == 2.0
    assert curves.moment_s is None


def test_what_lies_outside_the_window_is_left_out() -> None:
    found = moments(*((step, 1, 1.0, 3.0, 1.0, 5.0) for step in (19, 20, 399, 400)))
    known = np.flatnonzero(np.isfinite(curves_of(video_of(found), LIMITS).time_to_collision_s))
    assert known.tolist() == [0, 379]


def test_charts_keep_their_scale_and_lift_the_pen() -> None:
    found = moments(*((step, 1, value, 3.0, 20.0, 5.0) for step, value in ((20, 5.0), (21, 2.5), (210, 9.0))))
    ttc, pet, drac = charts_of(curves_of(video_of(found), LIMITS), LIMITS)
    assert ttc.path == f"M0.0 0.0h0.6L1.0 {HEIGHT / 2:.1f}M{WIDTH / 2:.1f} 0.0h0.6"
    assert ttc.limit_y == pytest.approx(HEIGHT * 0.7)
    assert ttc.extreme == "2.50 s at 0.1 s"
    assert (pet.path, pet.dots, pet.extreme) == ("", (), "")
    assert drac.extreme == "20.00 m/s² at 0.0 s"
    assert drac.path.startswith("M0.0 0.0")
