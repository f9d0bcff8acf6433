"""The fit to published figures: its lines, its distance, the preset that it writes, and a fit with a known answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.lab.calibration.ledger_fit import (
    LEAST_TRIES,
    PRIORS,
    draw_of,
    fit_to_ledger,
    halves,
    likelihoods,
    preset_text,
)
from siren_ros.scoring.evaluation.realism.ledger import LedgerLine, read_ledger
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


def test_preset_has_the_values_of_its_tries_and_the_seed_chooses_one(tmp_path) -> None:
    tries = [MIDDLE, {**MIDDLE, "never": 0.4, "traffic.gap_factor": 0.75, "response_distance_m": 12.0}]
    file = tmp_path / "fitted.yaml"
    file.write_text(preset_text("fitted", [*map(draw_of, tries)], "realistic", ["R01"]), encoding="utf-8")
    drawn = [load_preset(str(file), seed=seed) for seed in range(20)]
    assert {preset.response_distance_m.mean for preset in drawn} == {MIDDLE["response_distance_m"], 12.0}
    (second,) = {preset.compliance for preset in drawn if preset.response_distance_m.mean == 12.0}
    assert (second.complies, second.late, second.never) == pytest.approx((0.54, 0.06, 0.4))
    assert {preset.drivers["traffic.gap_factor"] for preset in drawn} == {1.0, 0.75}
    assert {preset.fitted_to for preset in drawn} == {(*load_preset("realistic").fitted_to, "R01")}
    assert {preset.rescue_late for preset in drawn} == {load_preset("realistic").rescue_late}


@given(st.floats(0.0, 1.0))
def test_every_try_is_a_preset(tmp_path_factory, share) -> None:
    file = tmp_path_factory.mktemp("tries") / "try.yaml"
    values = {name: low + share * (high - low) for name, (low, high) in PRIORS.items()}
    file.write_text(preset_text("a try", [draw_of(values)], "realistic"), encoding="utf-8")
    assert load_preset(str(file)).reaction_delay_s.mean == pytest.approx(values["reaction_delay_s"], abs=1e-4)


def test_fit_finds_the_value_that_gives_the_published_figure_through_the_chance_of_few_episodes() -> None:
    pytest.importorskip("sklearn", reason="the extra realism")
    chance, tried = np.random.default_rng(3), []

    def simulate(values, seed):
        tried.append((values["traffic.gap_factor"], seed))
        return [episode(2.5 * values["traffic.gap_factor"] + chance.normal(0.0, 0.5))]

    draws, effective = fit_to_ledger([LINE], simulate, 100, 40, 0)
    found = np.array([draw["traffic.gap_factor"] for draw in draws])
    assert len(draws) == 40
    assert np.mean(found) == pytest.approx(0.8, abs=0.07), "2.0 m of 2.5 m"
    # 0.255 m of the published interval, and what 100 tries leave open of the mean
    assert 0.07 < np.std(found) < 0.16
    assert effective > 1000
    assert np.ptp([draw["never"] for draw in draws]) > 0.4, "what no line asks for stays open"
    assert np.ptp([gap for gap, _ in tried]) > 0.9, "all of the prior is tried"
    assert len({seed for _, seed in tried}) > 90
    assert all(0 <= seed < 1000 for _, seed in tried)


def weighed(lines, shown):
    """Likelihoods along the first prior, of tries along it that show something for each line."""
    places = np.full((40, len(PRIORS)), 0.5)
    places[:, 0] = np.linspace(0.0, 1.0, 40)
    candidates = np.full((101, len(PRIORS)), 0.5)
    candidates[:, 0] = np.linspace(0.0, 1.0, 101)
    return likelihoods(lines, places, np.column_stack([values(places[:, 0]) for values in shown]), candidates)


def test_likelihood_is_students_of_the_published_interval_where_tries_have_no_chance() -> None:
    pytest.importorskip("sklearn", reason="the extra realism")
    found = weighed([LINE], [lambda at: 1.0 + 2.0 * at])
    apart = (np.linspace(1.0, 3.0, 101) - 2.0) / (0.5 / 1.96)
    np.testing.assert_allclose(found, (1.0 + apart**2 / 4.0) ** -2.5, rtol=0.02, atol=1e-3)


def test_figures_that_nobody_meets_that_few_tries_show_or_that_are_chance_decide_nothing() -> None:
    pytest.importorskip("sklearn", reason="the extra realism")
    alone = weighed([LINE], [lambda at: 1.0 + 2.0 * at])
    far = weighed([LINE, LINE], [lambda at: 1.0 + 2.0 * at, lambda at: 60.0 + at])
    assert abs(int(far.argmax()) - int(alone.argmax())) <= 1
    few = [lambda at: 1.0 + 2.0 * at, lambda at: np.where(np.arange(40) < LEAST_TRIES - 1, at, np.nan)]
    np.testing.assert_array_equal(weighed([LINE, LINE], few), alone)
    np.testing.assert_array_equal(weighed([LINE], [lambda at: 7.0 + 0.0 * at]), 1.0)
    chance = np.random.default_rng(5).normal(2.0, 1.0, 40)
    np.testing.assert_array_equal(weighed([LINE, LINE], [few[0], lambda _: chance]), alone)


def test_without_scikit_learn_the_error_says_how_to_get_it_before_anything_is_simulated(monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "sklearn.gaussian_process", None)
    with pytest.raises(InputError, match="--with realism"):
        fit_to_ledger([LINE], lambda *_: pytest.fail("a try"), LEAST_TRIES, 2, 0)
