import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.evaluation.prediction.baselines.constant_velocity import ConstantVelocity
from siren_ros.evaluation.prediction.metrics import ade, fde
from siren_ros.evaluation.prediction.samples import Population, samples_of
from siren_ros.roads.road_network import RoadNetwork


def test_no_error_at_constant_velocity_whatever_the_heading(straight_road: RoadNetwork) -> None:
    tracks = {1: moving(0.0, 0.0, 9.0, yaw_rad=0.7), 2: moving(30.0, 0.0, 0.0), 3: moving(0.0, 5.0, 14.0, yaw_rad=-2.5)}
    model = ConstantVelocity()
    scored = samples_of(record_with(tracks, straight_road), model.window, Population.ALL)
    answer = model.predict(scored.batch)
    assert answer.xy_m.shape == (63, 1, 25, 2)
    assert fde(answer, scored.future_xy_m) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("accel_mps2", [1.2, -0.8])
def test_error_at_constant_acceleration(accel_mps2: float, straight_road: RoadNetwork) -> None:
    model = ConstantVelocity()
    record = record_with({1: moving(0.0, -5.25, 10.0, accel_mps2=accel_mps2)}, straight_road)
    scored = samples_of(record, model.window, Population.ALL)
    answer = model.predict(scored.batch)
    # The miss after t is |a| t² / 2; the mean of t² over 0.2 s … 5 s is 0.04 · (26 · 51 / 6) = 8.84 s².
    assert ade(answer, scored.future_xy_m) == pytest.approx(abs(accel_mps2) / 2.0 * 8.84)
    assert fde(answer, scored.future_xy_m) == pytest.approx(abs(accel_mps2) / 2.0 * 25.0)
    assert np.ptp(answer.xy_m[:, 0, :, 1]) == pytest.approx(0.0, abs=1e-9)
