"""Yield metrics of episodes and drivers, their means, and levels compared in pairs."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from busy_record import busy_record
from evaluation.made_records import moving, record_with
from hand_made_record import EMV, Driven, crossing, line
from known_outputs import assert_known
from made_encounters import CAR, IN_LANE, PULLS_RIGHT, arc, blocking, line_of, passing, record_of
from scipy import stats

from siren_ros.base.tables import Measure, text_of
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.statistics import holm
from siren_ros.scoring.evaluation.yielding import metrics as marks
from siren_ros.scoring.evaluation.yielding.encounters import (
    YieldThresholds,
    corridor_continuity,
    corridor_width_m,
)
from siren_ros.scoring.evaluation.yielding.metrics import (
    EPISODE_METRICS,
    PEOPLE_METRICS,
    YieldScene,
    of_drivers,
)
from siren_ros.scoring.evaluation.yielding.scoring import (
    ALL,
    ScoredEpisode,
    YieldScores,
    effect_tables,
    effects,
    pairs_of,
    score_yielding,
    situation_sha256,
    under_test_tables,
    yield_tables,
)
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind


def test_all_marks_of_two_drivers_and_what_follows_for_their_episode() -> None:
    """2 pulls to the right in time; 3 brakes at 9 s, pulls to the left late, and is slow until the end at 22 s.

    The EMV drives at 10 m/s for 12 s, and at 6 m/s then. Arc lengths on the EMV's line: 2 is at 46 m + 5 m/s, later
    0.33 m less for its bend; 3 is at 90 m + 4 m/s, from 9 s on at 108 m + 2 m/s, later 0.77 m less.
    """
    left = line((5.25, -120.0), (5.25, 9.0), (2.65, 13.0), (2.65, 110.0))
    ways = {2: (PULLS_RIGHT, arc((5.0, 22.0), start_m=46.0)), 3: (left, arc((4.0, 9.0), (2.0, 13.0), start_m=90.0))}
    record = record_of(arc((10.0, 12.0), (6.0, 10.0)), {key: Driven(*way) for key, way in ways.items()})
    touches = tuple(
        Event(30, EventKind.COLLISION, *pair, detail={"impact_speed_mps": 1.0}) for pair in ((3, 2), (1, 3))
    )
    about = replace(record.description, parameters={"av": {"actor_id": 3}})
    scores = score_yielding(replace(record, events=touches, description=about))
    bent_m, turned_m = np.hypot(10.0, 2.6), np.hypot(4.0, 2.6)
    out_m = 0.5 * 2.1 + 0.5 * (4.0 * 2.6 + 1.8 * 10.0) / bent_m  # half of the EMV and of the turned car
    passed_s = (46.0 - 0.33 + 5.0) / 5.0, (108.0 - 0.77 + 5.0 - 48.0) / 4.0
    out_s = 2.8 + out_m / 2.6 * bent_m / 5.0 - 0.2, 10.5 + turned_m / 2.0 - 7.5
    responds_s = 2.8 + 0.3 / 2.6 * bent_m / 5.0 - 0.2, 9.0 - 7.5
    table = {
        "actor_id": (2, 3),
        "in_the_way": (True, True),
        "with_siren": (True, True),
        "under_test": (False, True),
        "response_time_s": responds_s,
        "clearance_time_s": out_s,
        "compliance": (1.0, 0.0),
        "held_up_s": (0.0, 0.0),
        "made_way_m": (2.6, 2.6),
        "passing_gap_m": (2.6 - 0.5 * (2.1 + 1.8),) * 2,
        "recovery_time_s": ((90.0 + bent_m * (1.0 + 2.1 / 2.6) - 46.0) / 5.0 - passed_s[0], 22.0 - passed_s[1]),
        "collisions": (1.0, 2.0),
    }
    safety = "min_ttc_s", "min_pet_s"
    rows = scores.driver_rows()
    assert [row.pop("began_s") for row in rows] == pytest.approx([0.2, 7.5]), "40 m between the bodies"
    least = [{name: row.pop(name) for name in safety} for row in rows]
    assert rows == [{name: pytest.approx(values[k], abs=0.07) for name, values in table.items()} for k in (0, 1)]
    assert [mark.at_least for mark in (one.marks["recovery_time_s"] for one in scores.drivers)] == [False, True]
    assert least[0]["min_ttc_s"] is None
    lost_s = 0.05 * (441 - (240 * 10.0 + 8.0 + 200 * 6.0) / (50.0 / 3.6))
    expected = {
        "site_time_s": None,
        "emv_delay_s": lost_s,
        "emv_stops": 0.0,
        "emv_standstill_s": 0.0,
        "emv_gap_escape_s": 0.0,
        "drivers_in_the_way": 2.0,
        "response_time_s": np.mean(responds_s),
        "clearance_time_s": np.mean(out_s),
        "compliance": 0.5,
        "held_up_s": 0.0,
        "wake_duration_s": 22.0 - passed_s[1],
        "wake_length_m": 180.0 - (108.0 + 44.0 - 0.77),
        "civilian_delay_s": None,
        **{name: least[1][name] for name in safety},
        "collisions": 2.0,
        **{metric.name: None for metric in PEOPLE_METRICS},
    }
    found = {name: mark.value if mark.valid else None for name, mark in scores.metrics.items()}
    assert list(found) == [metric.name for metric in EPISODE_METRICS]
    assert 3.5 < found.pop("corridor_width_m") < 7.0
    assert 0.5 < found.pop("corridor_continuity") < 1.0
    assert found == {name: pytest.approx(value, abs=0.07) for name, value in expected.items()}
    assert [name for name, mark in scores.metrics.items() if mark.at_least] == ["wake_duration_s"]


def test_nobody_passed_leaves_no_wake_and_an_emv_that_stands_has_no_scores() -> None:
    scores = score_yielding(blocking())
    assert scores.metrics["wake_duration_s"].lack == scores.metrics["wake_length_m"].lack == "the EMV passed nobody"
    assert scores.metrics["held_up_s"].value > 5.0
    stands = score_yielding(record_of(arc((0.0, 2.0)), {}))
    assert all(measure.lack == "the EMV did not move" for measure in stands.metrics.values())
    assert stands.drivers == ()


def test_some_metrics_alone_are_the_same_and_need_no_drivers() -> None:
    whole, some = score_yielding(passing()), score_yielding(passing(), names=("emv_stops", "civilian_delay_s"))
    assert some.metrics == {name: whole.metrics[name] for name in ("emv_stops", "civilian_delay_s")}
    assert some.drivers == ()
    standing = score_yielding(record_of(arc((0.0, 2.0)), {}), names=("emv_stops",))
    assert list(standing.metrics) == ["emv_stops"]


def test_a_statistic_is_over_the_drivers_that_have_a_value() -> None:
    marks = {1: Measure(2.0), 2: Measure.lacking("not asked"), 3: Measure(7.0), 4: Measure(3.0)}
    scene: Any = SimpleNamespace(encounters=(1, 2, 3, 4), limits=None)

    def mark(encounter: Any, _: object) -> Measure:
        return marks[encounter]

    assert of_drivers(scene, mark, max) == Measure(7.0)
    assert of_drivers(scene, mark, sum) == Measure(12.0)
    marks[3] = Measure(7.0, at_least=True)
    assert of_drivers(scene, mark, min) == Measure(2.0, at_least=True)
    nobody: Any = SimpleNamespace(encounters=(2,), limits=None)
    assert of_drivers(nobody, mark, max).lack == "no driver had to make way"


def test_a_situation_is_everybodys_place_and_the_civilians_speed() -> None:
    record = passing()
    told = situation_sha256(record)
    first = record.states[0]

    def changed(column: str, row: int) -> str:
        values = getattr(first, column).copy()
        values[row] += 0.5
        return situation_sha256(replace(record, states=(replace(first, **{column: values}), *record.states[1:])))

    emv, civilian = (int(np.flatnonzero((first.actor_id == EMV) == is_emv)[0]) for is_emv in (True, False))
    for column in ("x_m", "y_m", "yaw_rad"):
        assert told not in {changed(column, emv), changed(column, civilian)}
    for column in ("vx_mps", "vy_mps"):
        assert changed(column, civilian) != told
        assert changed(column, emv) == told
    assert situation_sha256(replace(record, states=(first,))) == told, "what comes later is not the situation"
    assert situation_sha256(passing(siren=False)) == told
    for name, value in (("map_sha256", "1"), ("preset", "other"), ("duration_s", 1.0), ("site", {"junction": "J"})):
        described = replace(record.description, **{name: value})
        assert situation_sha256(replace(record, description=described)) != told


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


def test_the_emv_stands_and_is_held_up_by_all_drivers_together(scene: YieldScene) -> None:
    found = {metric.name: metric.compute(scene) for metric in EPISODE_METRICS}
    held_s = [marks.held_up_s(one, LIMITS).value for one in scene.encounters if one.was_in_the_way]
    assert sum(value > 0.0 for value in held_s) >= 1
    assert found["held_up_s"].value == pytest.approx(sum(held_s))
    assert (found["emv_stops"], found["drivers_in_the_way"]) == (Measure(1.0), Measure(3.0))
    assert found["emv_standstill_s"].value == pytest.approx(7.0, abs=0.06)
    assert found["corridor_width_m"] == corridor_width_m(scene.corridor)
    assert found["corridor_continuity"] == corridor_continuity(scene.corridor)


def test_safety_with_people_is_measured_by_class() -> None:
    """An EMV at 10 m/s comes up to a standing cyclist; a walker was in its way before it, a motorcycle is far."""
    walks = {"yaw_rad": np.pi / 2.0, "length_m": 0.6, "actor_class": ActorClass.PEDESTRIAN}
    tracks = {
        EMV: moving(0.0, 0.0, 10.0, steps=61, is_emv=True),
        2: moving(44.6, 0.0, 0.0, steps=61, actor_class=ActorClass.BICYCLE),
        3: moving(20.0, -1.0, 3.0, steps=61, **walks),
        4: moving(0.0, 50.0, 0.0, steps=61, actor_class=ActorClass.MOTORCYCLE),
    }
    record = record_with(tracks, crossing())
    record = replace(record, description=replace(record.description, emv_ids=(EMV,)))
    scores = score_yielding(record)
    found = {metric.name: scores.metrics[metric.name] for metric in PEOPLE_METRICS}
    # 10 m are left at the end: 1 s, and 10 / (2 · 1) m/s².
    assert found["min_ttc_s_cyclists"].value == pytest.approx(1.0)
    assert found["max_drac_mps2_cyclists"].value == pytest.approx(5.0)
    assert found["min_pet_s_pedestrians"].valid
    assert not found["min_pet_s_cyclists"].valid
    assert not any(found[f"{name}_motorcycles"].valid for name in ("min_ttc_s", "max_drac_mps2", "min_pet_s"))
    (table,) = yield_tables([ScoredEpisode.of("bag", record, scores)])
    shown = {str(row[0]) for row in table.rows}
    assert {"min_ttc_s_cyclists", "min_pet_s_pedestrians"} <= shown
    assert "min_ttc_s_motorcycles" not in shown
    touching = {**tracks, 2: moving(30.0, 0.0, 0.0, steps=61, actor_class=ActorClass.BICYCLE)}
    touched = score_yielding(replace(record_with(touching, crossing()), description=record.description))
    assert touched.metrics["max_drac_mps2_cyclists"].lack == "they touched"


def test_the_scene_is_worked_out_once(scene: YieldScene) -> None:
    assert scene.conflicts_of() is scene.conflicts_of(EMV)
    assert scene.conflicts_of(CAR) is scene.conflicts_of(CAR)
    assert scene.conflicts_of(CAR) is not scene.conflicts_of()


NOTHING = {metric.name: Measure.lacking("not measured") for metric in EPISODE_METRICS}


def episode(template: str, level: str, seed: int, site_time: Measure, situation: str = "") -> ScoredEpisode:
    scores = YieldScores({**NOTHING, "site_time_s": site_time}, ())
    name = f"{template}_{level}_seed{seed}"
    return ScoredEpisode(name, template, level, seed, "town", "", situation or f"{template}{seed}", scores)


def test_effects_are_the_differences_of_pairs_with_all_exchanges_of_signs() -> None:
    """Two outcomes at three levels of two templates; two episodes have no partner, and two values are cut off."""
    gains = {"S1": np.array([3.0, 2.5, 3.5, 2.75, 4.0]), "S2": np.array([-1.0, 0.5, 0.25, 1.5])}
    made = [episode("S1", "L1", 99, Measure(1.0)), episode("S3", "L2", 0, Measure(1.0))]
    for template, of_seeds in gains.items():
        for seed, gain in enumerate(of_seeds.tolist()):
            for level, site_s, delay_s in (("L0", 30.0, 9.0), ("L1", 30.0 - gain, 9.0 + gain**2), ("L2", 20.0, 8.0)):
                cut = (template, seed, level) in {("S1", 0, "L0"), ("S1", 0, "L1"), ("S2", 3, "L1")}
                one = episode(template, level, seed, Measure(site_s + 10.0 * seed, at_least=cut))
                metrics = {**one.scores.metrics, "emv_delay_s": Measure(delay_s)}
                made.append(replace(one, scores=YieldScores(metrics, ())))
    differences = {
        ("site_time_s", "L1", "L0"): {name: -of_seeds for name, of_seeds in gains.items()},
        ("site_time_s", "L2", "L1"): {name: of_seeds - 10.0 for name, of_seeds in gains.items()},
        ("emv_delay_s", "L1", "L0"): {name: of_seeds**2 for name, of_seeds in gains.items()},
        ("emv_delay_s", "L2", "L1"): {name: -1.0 - of_seeds**2 for name, of_seeds in gains.items()},
    }
    cut_off = {("site_time_s", "S1"): 1, ("site_time_s", "S2"): 1, ("site_time_s", ALL): 2}

    def mean(parts: Sequence[np.ndarray], signs: Sequence[float]) -> float:
        each = np.split(np.array(signs), np.cumsum([len(part) for part in parts])[:-1])
        return float(np.mean([(part * sign).mean() for part, sign in zip(parts, each, strict=True)]))

    expected = []
    for (outcome, level, against), of_templates in differences.items():
        for group in ("S1", "S2", ALL):
            parts = [values for name, values in of_templates.items() if group in {name, ALL}]
            count = sum(map(len, parts))
            value = mean(parts, [1.0] * count)
            far = [abs(mean(parts, signs)) >= abs(value) - 1e-9 for signs in product((1.0, -1.0), repeat=count)]
            cut = cut_off.get((outcome, group), 0)
            expected.append((outcome, level, against, group, value, count, np.mean(far), cut))
    found = effects(made, contrasts=[("L1", "L0"), ("L2", "L1")], outcomes=["site_time_s", "emv_delay_s"])
    assert [
        (one.metric, one.model, one.against, one.group, one.value, one.samples, one.p_value, one.cut_off)
        for one in found
    ] == [(*row[:4], pytest.approx(row[4]), row[5], pytest.approx(row[6]), row[7]) for row in expected]
    assert {one.kind for one in found} == {"template"}
    for rows in (found[:6], found[6:]):
        assert [one.p_adjusted for one in rows] == pytest.approx(holm([one.p_value for one in rows]))
    first, half_s = found[0].interval, stats.t.ppf(0.975, 4) * gains["S1"].std(ddof=1) / np.sqrt(5.0)
    assert (first.low, first.high, first.blocks) == (pytest.approx(-3.15 - half_s), pytest.approx(-3.15 + half_s), 5)
    assert [(table.key, table.rows[0]) for table in effect_tables(found)] == [
        (one.metric, ("L1 − L0", "S1", one.interval, one.p_value, one.p_adjusted, 5, one.cut_off))
        for one in (found[0], found[6])
    ]


def test_levels_of_different_situations_are_refused() -> None:
    made = [episode("S1", "L0", 0, Measure(1.0), "one"), episode("S1", "L1", 0, Measure(1.0), "other")]
    with pytest.raises(InputError, match="situation"):
        pairs_of(made)
    with pytest.raises(InputError, match="one episode of each level"):
        pairs_of([made[0], made[0]])


def test_every_number_of_three_emvs_and_of_four_levels() -> None:
    """The levels of six seeds have the marks of the record, the higher level and the higher seed the larger ones."""
    known = ScoredEpisode.of_each_emv("bag", busy_record())
    levels = [
        replace(one, level=f"L{level}", seed=seed, scores=_scaled(one.scores, 1.0 + 0.1 * level + 0.03 * level * seed))
        for one, seed, level in product(known, range(6), range(4))
    ]
    compared = effects(levels)
    found = {
        "episodes": [_compact(one.row()) for one in known],
        "drivers": [list(row.values())[4:] for one in known for row in one.driver_rows()],
        "effects": [list(effect.json().values()) for effect in compared if effect.metric == "site_time_s"],
        "tables": text_of([*yield_tables(levels), *effect_tables(compared), *under_test_tables(known)]),
    }
    assert_known(Path(__file__).parent / "known" / "yielding.json", found)


def _compact(row: dict[str, Any]) -> dict[str, Any]:
    """A value, whether it is a bound, and why it lacks, in one entry."""
    names = [name for name in row if not name.endswith(("_at_least", "_lack"))]
    return {name: [row.get(f"{name}{end}") for end in ("", "_at_least", "_lack")] for name in names}


def _scaled(scores: YieldScores, by: float) -> YieldScores:
    return replace(scores, metrics={name: replace(one, value=one.value * by) for name, one in scores.metrics.items()})
