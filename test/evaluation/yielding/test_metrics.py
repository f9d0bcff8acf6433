"""Which function stands behind which name: an episode in which the numbers differ."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, Driven
from made_encounters import CAR, IN_LANE, PULLS_RIGHT, arc, line_of, record_of

from siren_ros.evaluation.yielding import metrics as marks
from siren_ros.evaluation.yielding.corridor import corridor_continuity, corridor_width_m
from siren_ros.evaluation.yielding.encounters import Encounter
from siren_ros.evaluation.yielding.metrics import DRIVER_METRICS, EPISODE_METRICS, YieldScene
from siren_ros.evaluation.yielding.thresholds import Measure, YieldThresholds
from siren_ros.world.traffic_state import Event, EventKind

LIMITS = YieldThresholds()


@pytest.fixture(scope="module")
def scene() -> YieldScene:
    """One car pulls to the right and is passed; three others stay ahead of the EMV, one of them out of its way.

    The EMV stops behind them. Two collisions: of the EMV with the first, of the first with the second.
    """
    cars = {
        CAR: Driven(PULLS_RIGHT, arc((5.0, 16.0), start_m=46.0)),
        CAR + 1: Driven(IN_LANE, arc((3.0, 8.0), (0.0, 8.0), start_m=75.0)),
        CAR + 2: Driven(IN_LANE, arc((2.0, 10.0), (0.0, 6.0), start_m=90.0)),
        CAR + 3: Driven(IN_LANE - np.array([3.5, 0.0]), arc((2.0, 16.0), start_m=60.0)),
    }
    record = record_of(arc((10.0, 9.0), (0.0, 7.0)), cars)
    events = (Event(3, EventKind.COLLISION, EMV, CAR), Event(4, EventKind.COLLISION, CAR + 1, CAR))
    record = replace(record, events=events)
    line = line_of(record)
    return YieldScene(record, line, LIMITS)


def of_driver(scene: YieldScene, one: Encounter) -> dict[str, Measure]:
    conflicts = scene.conflicts_of(one.actor_id)
    return {
        "response_time_s": marks.response_time_s(one, LIMITS),
        "clearance_time_s": marks.clearance_time_s(one, LIMITS),
        "compliance": marks.complied(one, LIMITS),
        "held_up_s": marks.held_up_s(one, LIMITS),
        "made_way_m": marks.made_way_m(one, LIMITS),
        "passing_gap_m": marks.passing_gap_m(one, LIMITS),
        "recovery_time_s": marks.recovery_time_s(one, LIMITS),
        "min_ttc_s": marks.min_ttc_s(conflicts),
        "min_pet_s": marks.min_pet_s(conflicts),
        "collisions": marks.collisions(scene.record, one.actor_id),
    }


def test_marks_of_each_driver(scene: YieldScene) -> None:
    assert [one.actor_id for one in scene.encounters] == [CAR, CAR + 1, CAR + 2, CAR + 3]
    for one in scene.encounters:
        assert {metric.name: metric.compute(scene, one) for metric in DRIVER_METRICS} == of_driver(scene, one)
    assert [of_driver(scene, one)["collisions"].value for one in scene.encounters] == [2.0, 1.0, 0.0, 0.0]


def test_metrics_of_the_episode(scene: YieldScene) -> None:
    found = {metric.name: metric.compute(scene) for metric in EPISODE_METRICS}
    record, line = scene.record, scene.line
    asked = [one for one in scene.encounters if one.was_in_the_way]
    assert len(asked) == 3
    of_drivers = [of_driver(scene, one) for one in asked]

    def values(name: str) -> list[float]:
        return [found[name].value for found in of_drivers if found[name].valid]

    expected = {
        "site_time_s": marks.site_time_s(record, line, LIMITS),
        "emv_delay_s": marks.emv_delay_s(record, line, LIMITS),
        "emv_stops": Measure(1.0),
        "emv_standstill_s": marks.emv_standstill_s(record, line, LIMITS),
        "emv_gap_escape_s": Measure(0.0),
        "corridor_width_m": corridor_width_m(scene.corridor),
        "corridor_continuity": corridor_continuity(scene.corridor),
        "drivers_in_the_way": Measure(3.0),
        "wake_duration_s": marks.wake_duration_s(scene.encounters, LIMITS),
        "wake_length_m": marks.wake_length_m(scene.encounters, LIMITS),
        "civilian_delay_s": marks.civilian_delay_s(record),
        "min_ttc_s": marks.min_ttc_s(scene.conflicts_of(EMV)),
        "min_pet_s": marks.min_pet_s(scene.conflicts_of(EMV)),
        "collisions": Measure(2.0),
    }
    assert {name: found[name] for name in expected} == expected
    assert found["response_time_s"].value == pytest.approx(np.median(values("response_time_s")))
    assert found["clearance_time_s"].value == pytest.approx(np.median(values("clearance_time_s")))
    assert found["clearance_time_s"].at_least, "two stay in the way until the end"
    assert found["compliance"].value == pytest.approx(np.mean(values("compliance")))
    assert found["held_up_s"].value == pytest.approx(sum(values("held_up_s")))
    assert set(found) == {*expected, "response_time_s", "clearance_time_s", "compliance", "held_up_s"}


def test_the_scene_is_worked_out_once(scene: YieldScene) -> None:
    assert scene.conflicts_of() is scene.conflicts_of(EMV)
    assert scene.conflicts_of(CAR) is scene.conflicts_of(CAR)
    assert scene.conflicts_of(CAR) is not scene.conflicts_of()
