import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.params.folders import params_dir
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.scenario import (
    PEOPLE,
    VARIETY,
    GroupAnchor,
    PeopleDemand,
    StartReference,
    ValueRange,
    VarietyDemand,
)
from siren_ros.simulation.scenario.templates import (
    available_templates,
    draw_values,
    load_template,
    own_level,
    read_template,
    realised,
)
from siren_ros.simulation.world.actors import ActorClass

S2_TEXT = (params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8")


def refused(tmp_path, old, new, name="S2"):
    """The error for a template with a part replaced, and the line where the replacement begins."""
    text = (params_dir() / "templates" / f"{name}.yaml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    file = tmp_path / "changed.yaml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_template(file)
    return caught.value, text[: text.index(old)].count("\n") + 1


def test_a_range_may_be_a_single_value(tmp_path):
    old = "default: 45.0, range: [25.0, 45.0]"
    assert S2_TEXT.count(old) == 1
    file = tmp_path / "changed.yaml"
    file.write_text(S2_TEXT.replace(old, "default: 45.0, range: [45.0, 45.0]"), encoding="utf-8")
    limits = read_template(file).ranges["duration_s"]
    assert (limits.minimum, limits.maximum) == (45.0, 45.0)


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        ("warm_up_s: 30.0", "warm_up: 20.0", "warm_up_s", "missing"),
        *[("level: L2", "level: L7", "level", "L0, L1, L2, L3"), ("level: L2", "level: L2\nspeed: 3", "speed", "keys")],
        ("site: multi_lane_road", "site: motorway", "site", "multi_lane_road"),
        ("default: 45.0, range: [25.0, 45.0]", "default: 50.0, range: [25.0, 45.0]", "duration_s.default", "25 to 45"),
        ("default: 45.0, range: [25.0, 45.0]", "default: 30.0, range: [45.0, 25.0]", "duration_s.range", "order"),
        ("default: 45.0, range: [25.0, 45.0]", "default: 45.0", "duration_s.range", "missing"),
        ("default: 45.0, range: [25.0, 45.0]", "default: -1, range: [-1, 45]", "duration_s.range", "1 to 3600"),
        ("warm_up_s: 30.0", "warm_up_s: soon", "warm_up_s", "a number"),
        ("warm_up_s: 30.0", "warm_up_s: .nan", "warm_up_s", "a number"),
        ("default: 20, range: [15, 28]", "default: 20.5, range: [15, 28]", "background_vehicles.default", "whole"),
        ("default: 20, range: [15, 28]", "default: 20, range: [6, 28]", "background_vehicles", "10 vehicles"),
        ("class: ambulance", "class: sedan", "emv.class", "ambulance"),
        ("hatchback: 0.26", "hatchback: 0.36", "demand.classes", "add up to 1"),
        ("placement: emv_lane", "placement: roof", "platoon.placement", "emv_lane"),
        ("placement: emv_lane", "placement: emv_lane\n      optional: true", "platoon.optional", "false"),
        ("name: lane_cleared", "name: all_well", "predicate.name", "lane_cleared"),
        ("lane_changes_min: 3", "lane_changes_min: 0", "predicate.lane_changes_min", "1 to 50"),
        ("passed_min: 3", "overtaken_min: 3", "predicate.passed_min", "missing"),
        ("shoulders: in_use", "spaces: [shoulder, lawn]", "spaces", "cycle_lane"),
        ("shoulders: in_use", "shoulders: closed", "shoulders", "free, in_use"),
        ("draw: [9.0, 13.0]", "draw: [9.0, 23.0]", "depart_speed_mps.draw", ""),
    ],
)
def test_mistakes_are_refused_with_line_key_and_what_is_allowed(tmp_path, old, new, key, allowed):
    error, line = refused(tmp_path, old, new)
    assert key in error.parameter
    assert "changed.yaml" in error.parameter
    assert allowed in error.allowed
    at_line = int(error.parameter.split("changed.yaml:")[1].split(":")[0])
    if "missing" not in allowed:
        assert at_line == line + new.count("\n")


@pytest.mark.parametrize(
    ("name", "level", "background", "site", "predicate"),
    [
        *[("S1", "L3", 30, "queued_approach", "queues_split"), ("S2", "L2", 20, "multi_lane_road", "lane_cleared")],
        ("S3", "L1", 20, "signal_junction", "red_same_direction"),
        ("S4", "L1", 20, "signal_junction", "red_crossing"),
        *[("S5", "L1", 20, "stop_junction", "stop_same_direction"), ("S6", "L1", 30, "stop_junction", "stop_crossing")],
        ("S7", "L3", 20, "shoulder_right_turn", "shoulder_turn"),
    ],
)
def test_the_seven_templates_are_the_papers(name, level, background, site, predicate):
    template = load_template(name)
    assert (template.template_id, template.level.name) == (name, level)
    assert (template.demand.background_vehicles, template.site_kind.value) == (background, site)
    assert template.predicate.name == predicate
    assert template.emv.actor_class is ActorClass.AMBULANCE
    assert 25.0 <= template.duration_s <= (60.0 if name == "S1" else 45.0), "S1 lasts until the EMV is through"
    assert template.emv.speed_mps == pytest.approx(50.0 / 3.6, abs=0.01)
    assert (template.signal is None) == (site == "stop_junction")


def test_signal_and_group_anchors_are_read():
    template = load_template("S4")
    assert template.signal is not None
    assert template.value("signal.red_before_arrival_s") == template.signal.red_before_arrival_s
    drawn = template.with_values({"signal.red_before_arrival_s": 8.0})
    assert drawn.signal is not None
    assert drawn.signal.red_before_arrival_s == 8.0
    crossing = template.demand.groups[0]
    assert (crossing.anchor, crossing.standing) == (GroupAnchor.STOP_LINE, True)
    assert load_template("S3").demand.groups[0].anchor is GroupAnchor.ARRIVAL
    assert load_template("S2").demand.groups[0].anchor is GroupAnchor.EMV
    assert load_template("S2").emv.start_from is StartReference.SITE_START
    assert template.emv.start_from is StartReference.STOP_LINE


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        ("placement: crossing", "placement: crossing\n      from: emv", "crossing.from", "stop_line"),
        ("site: signal_junction", "site: multi_lane_road", "site", "emv.start_from"),
        ("red_before_arrival_s: {", "red_after_s: {", "signal.red_before_arrival_s", "missing"),
        ("start_from: stop_line", "start_from: kerb", "emv.start_from", "site_start, stop_line"),
    ],
)
def test_mistakes_about_the_stop_line_are_refused(tmp_path, old, new, key, allowed):
    error, _ = refused(tmp_path, old, new, "S4")
    assert key in error.parameter
    assert allowed in error.allowed


def test_missing_predicate_is_refused(tmp_path):
    file = tmp_path / "none.yaml"
    file.write_text(S2_TEXT[: S2_TEXT.index("predicate:")], encoding="utf-8")
    with pytest.raises(InputError, match=r"predicate: None cannot be used; allowed: a mapping"):
        read_template(file)


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "a: 1\na: 2"])
def test_files_that_are_no_template_are_refused(tmp_path, text):
    file = tmp_path / "bad.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"bad\.yaml"):
        read_template(file)


def test_unknown_name_lists_the_templates():
    with pytest.raises(InputError, match="S2"):
        load_template("S99")


@given(st.integers(0, 2**32 - 1), st.sampled_from(["S1", "S2", "S3", "S4", "S5", "S6", "S7"]))
def test_draws_lie_within_their_ranges_and_can_be_applied(seed, name):
    template = load_template(name)
    values = draw_values(template, np.random.default_rng(seed))
    drawn = template.with_values(values)
    assert drawn.values() == values
    assert draw_values(template, np.random.default_rng(seed)) == values
    group = drawn.demand.groups[0]
    assert group.vehicles == values[f"demand.{group.name}.vehicles"]
    assert drawn.predicate == template.predicate


def test_values_outside_their_range_and_unknown_ones_are_refused():
    template = load_template("S2")
    with pytest.raises(InputError, match=r"emv\.speed_mps.*11 to 16\.7"):
        template.with_values({"emv.speed_mps": 40.0})
    with pytest.raises(InputError, match="whole number"):
        template.with_values({"demand.platoon.vehicles": 4.5})
    with pytest.raises(InputError, match=r"emv\.colour"):
        template.with_values({"emv.colour": 1.0})


@pytest.mark.parametrize("name", available_templates())
def test_every_seed_has_values_of_its_own_within_what_is_drawn(name):
    template = load_template(name)
    seeds = [realised(template, np.random.default_rng(seed)).values() for seed in range(40)]
    assert template.drawn
    for path, limits in template.drawn.items():
        drawn = [values[path] for values in seeds]
        assert all(limits.minimum <= value <= limits.maximum for value in drawn)
        assert len(set(drawn)) > 1
        assert template.ranges[path].minimum <= limits.minimum
        assert limits.maximum <= template.ranges[path].maximum
    fixed = set(template.ranges) - set(template.drawn)
    assert all(values[path] == template.value(path) for values in seeds for path in fixed)
    assert seeds[3] == realised(template, np.random.default_rng(3)).values()


def test_the_duration_is_not_drawn(tmp_path):
    duration, _ = refused(tmp_path, "range: [25.0, 45.0]}", "range: [25.0, 45.0], draw: [30.0, 40.0]}")
    assert "duration_s.draw" in duration.parameter


def test_templates_of_earlier_versions_say_only_how_many_emvs_come(tmp_path):
    """Bags hold such templates, and are read and repeated."""
    keys = "  count: {default: 1, range: [1, 3]}", "  crossing: {default: 0, range: [0, 1]}"
    after = "  crossing_after_s: {default: 1.0, range: [-10.0, 20.0]}"
    old = S2_TEXT.replace(keys[0], "  count: 2").replace(f"{keys[1]}\n", "").replace(f"{after}\n", "")
    file = tmp_path / "old.yaml"
    file.write_text("\n".join(line for line in old.splitlines() if not line.startswith("  # s from the first EMV's")))
    template = read_template(file)
    assert (template.emv.count, template.emv.crossing, template.emv.crossing_after_s) == (2, 0, 0.0)
    assert not {"emv.count", "emv.crossing", "emv.crossing_after_s"} & set(template.ranges)


@pytest.mark.parametrize("name", [name for name in available_templates() if name != "S8"])
def test_every_template_but_that_of_the_motorway_takes_one_emv_to_three_and_one_that_crosses(name):
    template = load_template(name)
    assert (template.emv.count, template.emv.crossing) == (1, 0)
    more = template.with_values(
        {"emv.count": 3, "emv.crossing": 1, "emv.crossing_after_s": -4.0, "emv.headway_s": 15.0}
    )
    assert (more.emv.count, more.emv.crossing, more.emv.crossing_after_s) == (3, 1, -4.0)
    assert (template.lasting_s, more.lasting_s) == (template.duration_s, template.duration_s + 2 * 15.0)
    for path, value in (("emv.count", 4), ("emv.count", 0), ("emv.count", 1.5), ("emv.crossing", 2)):
        with pytest.raises(InputError, match=path):
            template.with_values({path: value})


def test_one_template_has_space_next_to_its_queue_and_two_have_shoulders_in_use():
    """There a free shoulder would be the way past everybody."""
    assert {name for name in available_templates() if load_template(name).spaces} == {"S7"}
    assert {name for name in available_templates() if load_template(name).shoulders_in_use} == {"S1", "S2"}


@pytest.mark.parametrize("name", available_templates())
def test_every_template_can_have_people_and_has_none_by_itself(name):
    template = load_template(name)
    assert template.demand.people == PeopleDemand(0, 0, 0)
    assert not set(PEOPLE) & template.drawn.keys()
    for path in PEOPLE:
        with pytest.raises(InputError, match="a whole number"):
            template.with_values({path: 2.5})
    changed = template.with_values({"demand.people.cyclists": 12.0})
    assert changed.demand.people == PeopleDemand(cyclists=12, motorcycles=0)
    assert changed.value("demand.people.cyclists") == 12.0
    assert changed.demand.groups == template.demand.groups


def test_people_are_read_from_the_file(tmp_path):
    file = tmp_path / "people.yaml"
    people = "  people:\n    cyclists: {default: 7, range: [2, 9], draw: [4, 8]}\n  groups:"
    file.write_text(S2_TEXT.replace("  groups:", people), encoding="utf-8")
    template = read_template(file)
    assert template.demand.people == PeopleDemand(cyclists=7, motorcycles=0)
    path = "demand.people.cyclists"
    assert template.drawn[path] == ValueRange(4, 8, integer=True)
    assert {realised(template, np.random.default_rng(seed)).value(path) for seed in range(60)} == {4, 5, 6, 7, 8}
    assert template.ranges["demand.people.motorcycles"].minimum == 0
    assert "another name for a group" in refused(tmp_path, "    platoon:", "    people:")[0].allowed


@pytest.mark.parametrize("name", available_templates())
def test_variety_is_nothing_and_not_recorded_until_a_study_asks_for_it(name):
    template = load_template(name)
    assert template.demand.variety == VarietyDemand(0.0, 0.0, 0.0, 0.0)
    assert not set(VARIETY) & {*template.drawn}
    others = {path: value for path, value in template.values().items() if path not in VARIETY}
    assert template.recorded_values() == others
    changed = template.with_values({"demand.variety.size_spread": 0.1})
    assert changed.demand.variety == VarietyDemand(size_spread=0.1)
    assert changed.recorded_values() == {**others, "demand.variety.size_spread": 0.1}


def test_variety_is_read_from_the_file(tmp_path):
    file = tmp_path / "varied.yaml"
    section = "  variety:\n    parked_share: {default: 0.4, range: [0.2, 0.6]}\n  groups:"
    file.write_text(S2_TEXT.replace("  groups:", section), encoding="utf-8")
    assert read_template(file).demand.variety == VarietyDemand(parked_share=0.4)
    assert read_template(file).ranges["demand.variety.parked_share"] == ValueRange(0.2, 0.6)
    assert "another name for a group" in refused(tmp_path, "    platoon:", "    variety:")[0].allowed


NARROW, HEADWAY = "emv_driver.corridor.narrow_mps", "emv_driver.approach.headway_s"


@pytest.mark.parametrize("name", available_templates())
def test_parameters_of_drivers_are_recorded_only_where_they_were_set(name):
    template = load_template(name)
    assert template.drivers == {}
    changed = template.with_values({NARROW: 4.0})
    assert (changed.value(NARROW), changed.drivers) == (4.0, {NARROW: 4.0})
    assert changed.recorded_values() == {**template.recorded_values(), NARROW: 4.0}
    assert changed.with_values({HEADWAY: 1.0}).drivers == {NARROW: 4.0, HEADWAY: 1.0}
    with pytest.raises(InputError, match="narrow_mps"):
        template.with_values({NARROW: 99.0})
    with pytest.raises(InputError) as refused:
        template.with_values({"emv_driver.mood": 1.0})
    assert {NARROW, "emv.speed_mps"} <= set(re.split(r"[, ]+", refused.value.allowed))


def test_a_template_gives_drivers_values_of_their_own_and_draws_them(tmp_path):
    file = tmp_path / "own.yaml"
    entry = "{default: 1.2, range: [0.8, 2.0], draw: [0.9, 1.5]}"
    file.write_text(f"{S2_TEXT}\ndrivers:\n  {HEADWAY}: {entry}\n", encoding="utf-8")
    template = read_template(file)
    assert template.drivers == {HEADWAY: 1.2}
    assert template.recorded_values()[HEADWAY] == 1.2
    drawn = {realised(template, np.random.default_rng(seed)).value(HEADWAY) for seed in range(4)}
    assert len(drawn) == 4
    assert all(0.9 <= value <= 1.5 for value in drawn)
    with pytest.raises(InputError, match=r"number from 0\.8 to 2"):
        template.with_values({HEADWAY: 2.2})
    file.write_text(f"{S2_TEXT}\ndrivers:\n  emv_driver.mood: {entry}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"own\.yaml:\d+: emv_driver\.mood"):
        read_template(file)


@pytest.mark.parametrize(("template", "level"), [("S2", "L2"), ("S1", "L3"), ("mine", "")])
def test_own_levels(template, level):
    assert own_level(template) == level
