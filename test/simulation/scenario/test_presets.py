from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.params.folders import names_in_params, params_dir
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.presets import Attention, TruncatedNormal, load_preset
from siren_ros.simulation.scenario.templates import load_template


def test_realistic_preset_draws_its_mean_and_spread():
    preset = load_preset("realistic")
    rng = np.random.default_rng(0)
    delays = np.array([preset.reaction_delay_s.draw(rng) for _ in range(4000)])
    assert delays.mean() == pytest.approx(preset.reaction_delay_s.mean, abs=0.05)
    assert delays.std() == pytest.approx(preset.reaction_delay_s.std, rel=0.15)
    assert preset.reaction_delay_s.minimum <= delays.min() <= delays.max() <= preset.reaction_delay_s.maximum


def test_scenario_values_move_the_distributions():
    preset = load_preset("realistic")
    changed = preset.for_scenario(response_distance_m=60.0, extra_delay_s=1.0, compliance=0.5)
    assert changed.response_distance_m.mean == pytest.approx(60.0)
    assert changed.response_distance_m.std == pytest.approx(preset.response_distance_m.std * 1.5)
    assert changed.reaction_delay_s.mean == preset.reaction_delay_s.mean + 1.0
    shares = changed.compliance
    assert shares.complies == pytest.approx(preset.compliance.complies / 2.0)
    assert shares.late == pytest.approx(0.5 * preset.compliance.late)
    assert shares.complies + shares.late + shares.never == pytest.approx(1.0)
    assert preset.for_scenario(40.0, 0.0, 0.5).reaction_delay_s == preset.reaction_delay_s


@pytest.mark.parametrize(("asked_m", "mean_m"), [(40.0, 12.0), (60.0, 18.0)])
def test_drivers_of_a_preset_respond_at_its_own_distance_until_a_scenario_asks_for_another(asked_m, mean_m):
    near = replace(load_preset("realistic"), response_distance_m=TruncatedNormal(12.0, 4.0, 4.0, 30.0))
    drawn = near.for_scenario(asked_m, 0.0, 1.0).response_distance_m
    assert (drawn.mean, drawn.std / drawn.mean) == pytest.approx((mean_m, 1.0 / 3.0))
    assert {load_template(name).response.response_distance_m for name in names_in_params("templates")} == {40.0}


@given(st.floats(-5.0, 5.0), st.floats(0.0, 10.0), st.integers(0, 1000))
def test_draws_stay_within_the_limits(mean, std, seed):
    assert -5.0 <= TruncatedNormal(mean, std, -5.0, 5.0).draw(np.random.default_rng(seed)) <= 5.0


def test_drivers_differ_in_their_lane_changes_as_published_but_in_the_paper():
    assert load_preset("paper").lane_change_log_s is None
    drawn, rng = load_preset("realistic").lane_change_log_s, np.random.default_rng(0)
    assert load_preset("observed").lane_change_log_s == drawn
    free = TruncatedNormal(drawn.mean, drawn.std, -9.0, 9.0)
    times_s = np.exp([free.draw(rng) for _ in range(8000)])
    assert times_s.mean() == pytest.approx(4.6, rel=0.02)
    assert times_s.std() == pytest.approx(2.3, rel=0.06)
    assert drawn.std == pytest.approx(0.47, abs=0.005)
    assert np.exp([drawn.minimum, drawn.maximum]) == pytest.approx([2.5, 13.3])


DISTANCE = "{mean: 9.0, std: 0.0, min: 1.0, max: 90.0}"


@pytest.mark.parametrize(
    ("old", "new", "shown"),
    [
        *[("never: 0.0", "never: 0.5", "add up to 1"), ("std: 0.0", "std: x", "a number"), ("title", "name", "title")],
        ("title:", f"rescue_lane: {{at_once: 0.6, late: 0.5, near_m: {DISTANCE}}}\ntitle:", "late"),
    ],
)
def test_mistakes_name_file_and_line(tmp_path, old, new, shown):
    text = (params_dir() / "presets" / "paper.yaml").read_text(encoding="utf-8")
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml:\d+") as caught:
        load_preset(str(file))
    assert shown in str(caught.value)


def test_parameters_of_drivers_are_read_by_their_names(tmp_path):
    file, name = tmp_path / "own.yaml", "civilian_driver.driving.headway_s"
    text = (params_dir() / "presets" / "paper.yaml").read_text(encoding="utf-8")
    file.write_text(f"{text}\ndrivers: {{{name}: 1.2}}\n", encoding="utf-8")
    assert load_preset(str(file)).drivers == {name: 1.2}
    assert load_preset("paper").drivers == {}
    for wrong in (f"{name}: 9", "civilian_driver.mood: 1", "emv_driver.gap_escape.tight_gap_m: 0.5"):
        file.write_text(f"{text}\ndrivers: {{{wrong}}}\n", encoding="utf-8")
        with pytest.raises(InputError) as refused:
            load_preset(str(file))
        assert "tight_gap_m" in wrong or str(file) in refused.value.parameter


def test_unknown_preset_lists_the_presets():
    assert names_in_params("presets") == ("inattentive", "observed", "paper", "realistic", "reckless")
    with pytest.raises(InputError, match="observed, paper, realistic"):
        load_preset("angry")


def test_everybody_looks_out_unless_a_preset_says_otherwise(tmp_path):
    assert load_preset("paper").attention == Attention()
    realistic = load_preset("realistic").attention
    assert (realistic.civilians, realistic.emv_horizon_s) == (1.0, 8.0)
    assert Attention().civilians == 1.0
    text = (params_dir() / "presets" / "inattentive.yaml").read_text(encoding="utf-8")
    careful = {load_preset(name).attention.emv_pet_s for name in ("paper", "realistic")}
    assert min(careful) >= 1.0 > max(load_preset(name).attention.emv_pet_s for name in ("inattentive", "reckless"))
    inattentive = load_preset("inattentive").attention
    assert (inattentive.civilians, inattentive.emv_horizon_s) == (0.2, 1.0)
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace("civilians: 0.2", "civilians: 1.2"), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml:\d+"):
        load_preset(str(file))


def test_a_distribution_is_scaled_and_shifted_as_its_values_are():
    drawn = TruncatedNormal(4.0, 1.0, 2.0, 7.0)
    assert drawn.scaled(1.5) == TruncatedNormal(6.0, 1.5, 3.0, 10.5)
    assert drawn.shifted(0.5) == TruncatedNormal(4.5, 1.0, 2.5, 7.5)
    for seed in range(20):
        value = drawn.draw(np.random.default_rng(seed))
        assert drawn.scaled(1.5).draw(np.random.default_rng(seed)) == pytest.approx(1.5 * value)
        assert drawn.shifted(0.5).draw(np.random.default_rng(seed)) == pytest.approx(0.5 + value)


@pytest.mark.parametrize(("mean", "drawn"), [(9.0, 7.0), (-9.0, 2.0), (5.0, 5.0)])
def test_a_constant_beyond_the_limits_is_the_limit(mean, drawn):
    assert TruncatedNormal(mean, 0.0, 2.0, 7.0).draw(np.random.default_rng(0)) == drawn


@pytest.mark.parametrize(
    ("section", "least", "most"),
    [("reaction_delay_s", 0.0, 30.0), ("late_delay_s", 0.0, 60.0), ("response_distance_m", 1.0, 300.0)],
)
def test_distributions_lie_within_limits_that_are_allowed_themselves(tmp_path, section, least, most):
    content = yaml.safe_load((params_dir() / "presets" / "paper.yaml").read_text(encoding="utf-8"))
    file = tmp_path / "mine.yaml"
    for low, high, allowed in ((least, most, True), (least - 0.01, most, False), (least, most + 0.01, False)):
        content[section] = {"mean": 10.0, "std": 1.0, "min": low, "max": high}
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        if allowed:
            assert getattr(load_preset(str(file)), section) == TruncatedNormal(10.0, 1.0, low, high)
        else:
            with pytest.raises(InputError, match=section):
                load_preset(str(file))
