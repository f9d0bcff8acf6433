from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_encounters import arc, passing, record_of

from siren_ros.base.tables.interval import Measure
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.yielding.counterfactual import ALL, Effect, effects, pairs_of
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode, YieldScores, score_yielding, situation_sha256
from siren_ros.simulation.roads.road_network import NO_LANE

NOTHING = {metric.name: Measure.lacking("not measured") for metric in EPISODE_METRICS}


def episode(template: str, level: str, seed: int, site_time: Measure, situation: str = "") -> ScoredEpisode:
    scores = YieldScores({**NOTHING, "site_time_s": site_time}, ())
    name = f"{template}_{level}_seed{seed}"
    return ScoredEpisode(name, template, level, seed, "town", "", situation or f"{template}{seed}", scores)


def study(seeds: int = 8) -> list[ScoredEpisode]:
    """At L1 S1 is 3 s faster than at L0, give or take 0.5 s, and S2 is as fast; seeds differ by 10 s."""
    made = []
    for seed in range(seeds):
        for template, gain_s in (("S1", 3.0), ("S2", 0.0)):
            nominal_s = 20.0 + 10.0 * (seed % 3)
            noise_s = 0.5 * (-1) ** seed
            made.append(episode(template, "L0", seed, Measure(nominal_s)))
            made.append(episode(template, "L1", seed, Measure(nominal_s - gain_s + noise_s)))
    return made


def of(found: Sequence[Effect], template: str) -> Effect:
    (effect,) = (one for one in found if one.template == template and one.outcome == "site_time_s")
    return effect


def test_an_effect_is_found_template_by_template_and_over_all() -> None:
    found = effects(study(), contrasts=[("L1", "L0")], outcomes=["site_time_s"])
    one = of(found, "S1").paired
    assert one.difference.value == pytest.approx(-3.0)
    assert -3.5 <= one.difference.low < one.difference.value < one.difference.high <= -2.5
    assert one.p_value == pytest.approx(2.0 / 2**8)
    nothing = of(found, "S2").paired
    assert nothing.difference.low < 0.0 < nothing.difference.high
    assert nothing.p_value > 0.3
    assert of(found, ALL).paired.difference.value == pytest.approx(-1.5)
    assert of(found, ALL).paired.difference.blocks == 16
    assert all(effect.adjusted_p >= effect.paired.p_value for effect in found)


def test_pairing_takes_out_what_seeds_differ_in() -> None:
    """The seeds' own spread, 10 s, would hide a gain of 3 s."""
    one = of(effects(study(), contrasts=[("L1", "L0")]), "S1").paired.difference
    assert one.high - one.low < 1.5


def test_episodes_without_a_partner_do_not_count() -> None:
    made = [*study(4), episode("S1", "L1", 99, Measure(1.0)), episode("S3", "L2", 0, Measure(1.0))]
    found = effects(made, contrasts=[("L1", "L0")], outcomes=["site_time_s"])
    assert of(found, "S1").paired.difference.blocks == 4
    assert {effect.template for effect in found} == {"S1", "S2", ALL}


def test_values_cut_off_by_the_end_are_counted() -> None:
    made = [
        replace_time(one, Measure(45.0, at_least=True)) if one.level == "L0" and one.seed < 2 else one
        for one in study()
    ]
    assert of(effects(made, contrasts=[("L1", "L0")]), "S1").cut_off == 2


def replace_time(one: ScoredEpisode, site_time: Measure) -> ScoredEpisode:
    return episode(one.template, one.level, one.seed, site_time, one.situation_sha256)


def test_levels_of_different_situations_are_refused() -> None:
    made = [episode("S1", "L0", 0, Measure(1.0), "one"), episode("S1", "L1", 0, Measure(1.0), "other")]
    with pytest.raises(InputError, match="situation"):
        pairs_of(made)
    with pytest.raises(InputError, match="one episode of each level"):
        pairs_of([made[0], made[0]])


def test_a_situation_is_who_is_where_at_first_and_not_what_the_level_makes_of_it() -> None:
    one, other = passing(), passing(siren=False)
    assert situation_sha256(one) == situation_sha256(other)
    assert situation_sha256(one) != situation_sha256(record_of(arc((10.0, 20.0)), {}))


def test_the_civilians_delay_is_what_they_lose_against_the_limit() -> None:
    record = passing()
    lanes = {lane.lane_id: lane.index for lane in record.network.lanes}
    civilian = record.states[0].actor_id[1:2]
    traffic = tuple(
        replace(one, actor_id=civilian, lane=np.array([lanes["s_in_1"]], dtype=np.int32)) for one in record.traffic
    )
    delay = score_yielding(replace(record, traffic=traffic)).metrics["civilian_delay_s"]
    assert delay.value == pytest.approx(30.0 * (1.0 - 5.0 / 13.9), rel=0.02)
    # A while off every lane costs nothing, and leaves what the rest costs.
    half = len(traffic) // 2
    away = tuple(replace(one, lane=np.full_like(one.lane, NO_LANE)) for one in traffic[:half])
    rest = score_yielding(replace(record, traffic=(*away, *traffic[half:]))).metrics["civilian_delay_s"]
    assert rest.value == pytest.approx(delay.value * (1.0 - half / len(traffic)), rel=0.02)
    assert score_yielding(record).metrics["civilian_delay_s"].lack == "nobody was on a lane"
