"""The fit to published figures: its lines, its distance, the preset that it writes, and a fit with a known answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.lab.calibration.ledger_fit import FARTHEST, PRIORS, distance, draw_of, fit_to_ledger, halves, preset_text
from siren_ros.scoring.evaluation.realism.ledger import LedgerLine, compare, read_ledger
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, RealismEpisode
from siren_ros.simulation.scenario.presets import load_preset

LINE = LedgerLine("X1", "a gap", 2.0, "m", 10, 1.5, 2.5, "here", 2020, "somebody", "abstract", "standing_gap_m", "mean")
MIDDLE = {name: 0.5 * (low + high) for name, (low, high) in PRIORS.items()}


def episode(gap_m: float, samples: int = 8) -> RealismEpisode:
    values = {name: np.full(samples if name == "standing_gap_m" else 0, gap_m) for name in SAMPLES}
    return RealismEpisode("L1", True, ("S1", "town", "0", ""), values)


def test_halves_share_no_line_and_hold_out_what_a_try_cannot_show() -> None:
    lines = read_ledger()
    fitted, held_out = halves(lines)
    assert {line.line_id for line in (*fitted, *held_out)} == {line.line_id for line in lines if not line.cannot}
    assert not {line.line_id for line in fitted} & {line.line_id for line in held_out}
    assert not any(line.statistic == "share" or line.samples.startswith("rescue_lane") for line in fitted)
    assert len(fitted) >= 12


def test_distance_counts_half_widths_up_to_the_farthest_and_a_missing_prediction_as_the_farthest() -> None:
    assert distance(compare([LINE], [episode(2.25)])) == pytest.approx(0.5)
    assert distance(compare([LINE], [episode(1.5)])) == pytest.approx(1.0)
    assert distance(compare([LINE], [episode(200.0)])) == FARTHEST
    assert distance(compare([LINE], [episode(2.0, samples=0)])) == FARTHEST
    assert distance(compare([LINE, LINE], [episode(3.0)])) == pytest.approx(2.0)
    told = compare([LINE], [episode(2.0 + far) for far in (0.1, 0.4, 0.7)])
    width = told[0].predicted.high - told[0].predicted.low
    assert distance(told) == pytest.approx(0.4 / (0.5 * np.hypot(1.0, width))), "of what a few episodes do not tell"


def test_preset_has_the_values_of_its_tries_and_the_seed_chooses_one(tmp_path) -> None:
    tries = [MIDDLE, {**MIDDLE, "never": 0.4, "traffic.gap_factor": 0.75, "response_distance_m": 12.0}]
    file = tmp_path / "fitted.yaml"
    file.write_text(preset_text("fitted", [*map(draw_of, tries)], "realistic", ["R01"]), encoding="utf-8")
    drawn = [load_preset(str(file), seed=seed) for seed in range(20)]
    assert {preset.response_distance_m.mean for preset in drawn} == {MIDDLE["response_distance_m"], 12.0}
    (second,) = {preset.compliance for preset in drawn if preset.response_distance_m.mean == 12.0}
    assert (second.complies, second.late, second.never) == pytest.approx((0.54, 0.06, 0.4))
    assert {preset.drivers["traffic.gap_factor"] for preset in drawn} == {1.0, 0.75}
    assert {preset.fitted_to for preset in drawn} == {("R01",)}
    assert {preset.rescue_late for preset in drawn} == {load_preset("realistic").rescue_late}


@given(st.floats(0.0, 1.0))
def test_every_try_is_a_preset(tmp_path_factory, share) -> None:
    file = tmp_path_factory.mktemp("tries") / "try.yaml"
    values = {name: low + share * (high - low) for name, (low, high) in PRIORS.items()}
    file.write_text(preset_text("a try", [draw_of(values)], "realistic"), encoding="utf-8")
    assert load_preset(str(file)).reaction_delay_s.mean == pytest.approx(values["reaction_delay_s"], abs=1e-4)


def test_fit_finds_the_value_that_gives_the_published_figure(tmp_path) -> None:
    pytest.importorskip("pyabc", reason="the extra realism")

    def simulate(values, _):
        return [episode(4.0 * values["traffic.gap_factor"])]

    draws, limits = fit_to_ledger([LINE], simulate, 4, 30, 0, 10_000, tmp_path / "fit.db")
    found = np.array([draw["traffic.gap_factor"] for draw in draws])
    assert len(draws) == 30
    assert np.abs(found - 0.5).max() < 0.2
    assert limits == sorted(limits, reverse=True)
    assert np.ptp([draw["never"] for draw in draws]) > 0.2, "what no line asks for stays open"


def test_without_pyabc_the_error_says_how_to_get_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyabc", None)
    with pytest.raises(InputError, match="--with realism"):
        fit_to_ledger([LINE], lambda *_: [], 1, 2, 0, 2, tmp_path / "fit.db")
