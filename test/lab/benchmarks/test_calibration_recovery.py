"""The benchmark's own arithmetic; its episodes and its search have tests of their own."""

import pytest

from siren_ros.lab.benchmarks import calibration_recovery
from siren_ros.lab.benchmarks.calibration_recovery import TOLERANCE, drawn_truth, main, recovery_table
from siren_ros.lab.calibration.fit import Fitted
from siren_ros.lab.calibration.problem import WHOLE, parameters_named

SPEED, ACCEL = parameters_named(["emv.speed_mps", "emv_driver.driving.comfort_accel_mps2"])


def fitted(speed: float, accel: float) -> Fitted:
    values = {SPEED.name: speed, ACCEL.name: accel}
    return Fitted(values, {SPEED.name: 0.6, ACCEL.name: 3.2}, (ACCEL.name,), 0.15, 9.0, 120, (9.0, 0.15), agreed=True)


def test_the_table_gives_differences_and_spreads_as_shares_of_the_ranges() -> None:
    truth = {SPEED.name: 12.0, ACCEL.name: 2.0}
    table = recovery_table((SPEED, ACCEL), truth, fitted(12.3, 1.68))
    assert table.rows[1][3] == pytest.approx(0.32 / 3.2)
    lines = table.text()
    assert lines[1].split() == [SPEED.name, "12.000", "12.300", "2.5%", "5.0%"]
    assert lines[2].split() == [ACCEL.name, "2.000", "1.680", "10.0%", "100.0%"]


@pytest.mark.parametrize(("off_share", "code"), [(0.9 * TOLERANCE, 0), (1.1 * TOLERANCE, 1)])
def test_a_parameter_beyond_the_tolerance_fails_the_command(off_share, code, monkeypatch, capsys) -> None:
    truth = drawn_truth((SPEED, ACCEL), 1)
    off = off_share * (ACCEL.maximum - ACCEL.minimum)
    result = fitted(truth[SPEED.name], truth[ACCEL.name] - off)
    monkeypatch.setattr(calibration_recovery, "fit", lambda *_, **__: result)
    monkeypatch.setattr(calibration_recovery, "target_with", lambda *_: None)
    monkeypatch.setattr(calibration_recovery, "horizons_of", lambda _: (WHOLE,))
    arguments = ["--parameters", f"{SPEED.name},{ACCEL.name}", "--jobs", "1", "--templates", "S3", "S4"]
    assert main(arguments) == code
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"not determined by these trajectories: {ACCEL.name}"


def test_true_values_are_within_the_ranges_and_the_same_again() -> None:
    for seed in range(20):
        truth = drawn_truth((SPEED, ACCEL), seed)
        assert all(0.15 <= each.share_of(truth[each.name]) <= 0.85 for each in (SPEED, ACCEL))
        assert truth == drawn_truth((SPEED, ACCEL), seed)
    assert drawn_truth((SPEED, ACCEL), 0) != drawn_truth((SPEED, ACCEL), 1)
