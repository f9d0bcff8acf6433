"""Which rules an episode has, by its plan and level, and when they act."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from traffic_helpers import load_map, plan_s2

from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.jam import JamHead
from siren_ros.simulation.traffic.demand.plan import SignalTiming
from siren_ros.simulation.traffic.sumo.rules import RULES, Moment, Rule, Setting, acts_of

EVERYWHERE = {"caution", "stand-offs", "sideways", "bends", "continuity"}
TIMING = SignalTiming(signal_id="s", link=1, red_from_s=5.0, crossing=(0,), platoon=("a",), emv="emv0")


@pytest.fixture(scope="module")
def setting() -> Setting:
    """A plan without signal, jam, riders and rescue lane."""
    _, network = load_map(None)
    plan, _ = plan_s2(network)
    plan = replace(plan, signal=None, jam=None, riders=(), duty=False)
    return Setting(network, plan, EmergencyLevel.L1)


def rules_of(setting: Setting) -> set[str]:
    return {rule.name for rule in RULES if rule.make(setting) is not None}


@pytest.mark.parametrize(
    ("level", "more"),
    [(EmergencyLevel.L0, {"route ends"}), (EmergencyLevel.L1, set()), (EmergencyLevel.L3, {"oncoming"})],
)
def test_levels_have_the_rules_of_their_privileges(setting: Setting, level: EmergencyLevel, more: set[str]) -> None:
    """Without a siren nobody notices an EMV, and only EMVs at L0 are driven by SUMO to the end of their route."""
    assert rules_of(replace(setting, level=level)) == EVERYWHERE | more


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"signal": TIMING}, "gap out"),
        ({"jam": JamHead(names=("a",), moves=False, roll_s=0.0, roll_mps=0.0, stand_s=1.0)}, "jam"),
        ({"duty": True}, "rescue lane"),
    ],
)
def test_a_plan_has_the_rules_of_what_it_holds(setting: Setting, change: Mapping[str, Any], rule: str) -> None:
    assert rules_of(replace(setting, plan=replace(setting.plan, **change))) == EVERYWHERE | {rule}


def test_cyclists_have_their_rule(setting: Setting) -> None:
    riders = setting.plan.background[:1]
    assert rules_of(replace(setting, plan=replace(setting.plan, riders=riders))) == EVERYWHERE | {"cyclists"}


def test_rules_act_in_the_order_of_the_table_within_their_moment(setting: Setting) -> None:
    done: list[str] = []

    def rule(name: str, moment: Moment, *, there: bool = True) -> Rule:
        return Rule(name, moment, lambda _: (lambda _: done.append(name)) if there else None, "")

    rules = rule("a", Moment.MOTION), rule("b", Moment.ORDERS), rule("c", Moment.MOTION, there=False)
    acts = acts_of(setting, (*rules, rule("d", Moment.MOTION)))
    for moment in (Moment.CAUTION, Moment.MOTION, Moment.ORDERS):
        for act in acts[moment]:
            act(None)  # type: ignore[arg-type] # these rules look at nothing
    assert done == ["a", "d", "b"]
