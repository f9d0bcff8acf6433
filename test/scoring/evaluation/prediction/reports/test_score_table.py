from dataclasses import replace

import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.scoring.evaluation.prediction.metrics import BINS
from siren_ros.scoring.evaluation.prediction.reports.paper_results import compare_with_paper
from siren_ros.scoring.evaluation.prediction.reports.score_table import (
    GroupKind,
    beaten,
    calibration_interval,
    common_rows,
    differences,
    groups_of,
    sample_table,
    score_table,
)
from siren_ros.scoring.evaluation.prediction.scoring import Category, EpisodeScores, Trait
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import ActorClass

ONE = {"cv": model_scores(np.ones(3))}


def names(scores: list[EpisodeScores], kind: GroupKind) -> dict[str, list[bool]]:
    return {group.name: group.episodes.tolist() for group in groups_of(scores) if group.kind is kind}


def test_subsets_are_those_of_civilians() -> None:
    """Samples: an EMV, a civilian that holds, one that moves and begins to yield, one that stands."""
    scores = replace(
        model_scores(np.array([1.0, 2.0, 4.0, 8.0])),
        category=np.array([Category.EMV, Category.HELD, Category.YIELDING, Category.OTHER], dtype=np.uint8),
        traits=np.array([Trait.MOVING | Trait.BEGINS, 0, Trait.MOVING | Trait.BEGINS, 0], dtype=np.uint8),
    )
    table = score_table([episode_scores("S1", {"cv": scores})])
    found = {group.name: table.value("cv", group.name, "ade_m") for group in table.of_kind(GroupKind.SUBSET)}
    assert found == {
        "civilians": pytest.approx(14.0 / 3.0),
        "moving civilians": 4.0,
        "yield or hold": 3.0,
        "manoeuvre begins": 4.0,
    }


def test_templates_and_levels_part_the_episodes() -> None:
    scores = [
        episode_scores("S2", ONE, level=EmergencyLevel.L2),
        episode_scores("S1", ONE, level=EmergencyLevel.L3),
        episode_scores("S2", ONE, 1, EmergencyLevel.L1),
    ]
    assert names(scores, GroupKind.TEMPLATE) == {"S1": [False, True, False], "S2": [True, False, True]}
    assert list(names(scores, GroupKind.LEVEL)) == ["L1", "L2", "L3"]
    assert list(names(scores, GroupKind.CATEGORY)) == ["emv", "yielding", "held", "other"]


def test_a_parameter_that_varies_has_a_row_for_each_of_few_values_or_three_ranges() -> None:
    scores = [episode_scores("S2", ONE, seed, vehicles=value, x=1.0) for seed, value in enumerate((3.0, 4.0, 3.0))]
    scores.append(episode_scores("S1", ONE, vehicles=9.0))
    assert names(scores, GroupKind.PARAMETER) == {
        "S2 vehicles 3": [True, False, True, False],
        "S2 vehicles 4": [False, True, False, False],
    }
    groups = names([episode_scores("S2", ONE, seed, speed_mps=float(seed)) for seed in range(9)], GroupKind.PARAMETER)
    assert list(groups) == ["S2 speed_mps 0 to 2", "S2 speed_mps 3 to 5", "S2 speed_mps 6 to 8"]
    assert np.sum(list(groups.values()), axis=0).tolist() == [1] * 9


def with_ade(template: str, *values: float, seed: int = 0) -> EpisodeScores:
    """An episode with a sample for each value."""
    return episode_scores(template, {"cv": model_scores(np.array(values))}, seed)


def test_samples_are_pooled_within_templates_and_templates_count_once() -> None:
    table = score_table([with_ade("S1", 1.0, 1.0, 1.0), with_ade("S1", 5.0, seed=1), with_ade("S2", 10.0)])
    assert table.value("cv", "S1", "ade_m") == pytest.approx(2.0)
    assert table.value("cv", "S2", "ade_m") == pytest.approx(10.0)
    assert table.value("cv", "all", "ade_m") == pytest.approx(6.0)
    cell = table.cells["cv", "all", "ade_m"]
    assert (cell.samples, cell.interval.blocks) == (5, 3)
    assert not cell.interval.bounded, "S2 has one episode"
    assert not table.cells["cv", "S2", "ade_m"].interval.bounded, "one episode"
    roots = score_table([with_ade("S1", 9.0), with_ade("S2", 1.0, 31.0)])
    assert roots.value("cv", "all", "rmse_5s_m") == pytest.approx(3.5), "roots are taken by template"
    lacking = score_table([with_ade("S1"), with_ade("S2", 2.0)])
    assert [lacking.value("cv", group, "ade_m") for group in ("S1", "all")] == [None, 2.0]


def test_categories_count_their_samples_alone() -> None:
    models = [{"cv": model_scores(np.array([value]), category)} for value, category in ((1.0, 1), (4.0, 2), (8.0, 2))]
    table = score_table([episode_scores("S1", of_seed, seed) for seed, of_seed in enumerate(models)])
    assert table.value("cv", Category.YIELDING.name.lower(), "ade_m") == 1.0
    assert table.value("cv", Category.HELD.name.lower(), "ade_m") == 6.0
    assert table.value("cv", Category.EMV.name.lower(), "ade_m") is None


def with_models(**errors: float) -> list[EpisodeScores]:
    """Six episodes of S1 and of S2, with a sample each: of S2 the errors are all 1 m more and those of ``idm`` 5 m."""
    episodes = []
    for template, more in (("S1", 0.0), ("S2", 1.0)):
        for seed in range(6):
            of_model = {name: error + more + 0.1 * seed for name, error in errors.items()}
            of_model["idm"] += 4.0 * more
            scores = {name: model_scores(np.array([error])) for name, error in of_model.items()}
            episodes.append(episode_scores(template, scores, seed))
    return episodes


def test_claims_are_against_the_best_simple_baseline_of_each_template() -> None:
    table = score_table(with_models(cv=3.0, idm=2.0, siren=1.0, csp=0.5))
    claims = {(claim.model, claim.group): claim for claim in table.claims if claim.metric == "ade_m"}
    assert set(claims) == {(model, group) for model in ("siren", "csp") for group in ("all", "S1", "S2")}
    assert {group: claims["siren", group].against for group in ("all", "S1", "S2")} == {
        "all": "cv", "S1": "idm", "S2": "cv"
    }  # fmt: skip
    of_s1 = claims["siren", "S1"]
    assert of_s1.value == pytest.approx(-1.0)
    assert beaten(table, of_s1) == pytest.approx((2.25, -1.0 / 2.25))
    # The errors of six episodes can be exchanged in 64 ways, of which two are as far apart; three groups are tested.
    assert of_s1.p_value == pytest.approx(2.0 / 64.0)
    assert of_s1.p_adjusted == pytest.approx(2.0 * 2.0 / 64.0)
    assert of_s1.samples == 6
    assert claims["siren", "all"].value == pytest.approx(-2.0)


def test_simple_models_claim_nothing_and_nothing_is_claimed_without_them() -> None:
    assert score_table(with_models(cv=3.0, idm=2.0)).claims == ()
    table = score_table([episode_scores("S1", {"siren": model_scores(np.ones(2)), "csp": model_scores(np.ones(2))})])
    assert table.claims == ()
    worse = score_table(with_models(idm=2.0, siren=6.0))
    assert worse.claims[0].group == "all"
    assert beaten(worse, worse.claims[0])[1] > 0.0


def test_templates_that_the_paper_does_not_have() -> None:
    table = score_table([with_ade("S1", 2.0), with_ade("S2", 5.0), with_ade("mine", 9.0)])
    comparison = compare_with_paper(table, "cv", "ade_m")
    assert comparison.deviation == pytest.approx(16.0 / 3.0 / 1.44 - 1.0)
    assert comparison.paper_mean_same_templates == pytest.approx(1.40)
    assert comparison.deviation_same_templates == pytest.approx(3.5 / 1.4 - 1.0)
    assert comparison.ranking is None, "two templates in common are no ranking"
    assert compare_with_paper(table, "cv", "miss_rate_6") is None


def test_three_models_are_three_tests() -> None:
    shifts = {"a": 0.0, "b": 1.0, "c": 2.0}
    models = [{name: model_scores(np.array([base + shift])) for name, shift in shifts.items()} for base in range(10)]
    pairs = differences(score_table([episode_scores("S1", one, seed) for seed, one in enumerate(models)]))
    pairs = [pair for pair in pairs if (pair.metric, pair.group) == ("ade_m", "all")]
    assert [(pair.model, pair.against) for pair in pairs] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert all(pair.p_adjusted == pytest.approx(3.0 * pair.p_value) for pair in pairs)


def test_rows_of_common_samples_are_in_the_same_order() -> None:
    counts = ({"a": 3, "b": 2}, {"a": 1, "b": 4})
    models = [{model: model_scores(np.arange(float(count))) for model, count in pair.items()} for pair in counts]
    first, second = (
        sample_table({place: of_seed[name] for place, of_seed in enumerate(models)}) for name in ("a", "b")
    )
    of_first, of_second = common_rows(first, second)
    assert (of_first.tolist(), of_second.tolist()) == ([0, 1, 3], [0, 1, 2])
    assert np.array_equal(first.step[of_first], second.step[of_second])


def test_people_have_rows_of_their_own_and_count_nowhere_else() -> None:
    """Two episodes; the second has two walkers and a cyclist."""
    ridden = model_scores(np.array([9.0]), category=ActorClass.BICYCLE)
    people = model_scores(np.array([2.0, 4.0]), category=ActorClass.PEDESTRIAN)
    joined = replace(
        people,
        **{name: np.append(getattr(people, name), getattr(ridden, name)) for name in ("step", "actor_id", "category")},
        values={metric: np.append(values, ridden.values[metric]) for metric, values in people.values.items()},
    )
    alone = episode_scores("S1", {"a": model_scores(np.array([1.0]))}, 0)
    with_people = replace(episode_scores("S1", {"a": model_scores(np.array([3.0]))}, 1), people={"a": joined})
    table = score_table([alone, with_people])
    assert [group.name for group in table.of_kind(GroupKind.PEOPLE)] == ["pedestrians", "cyclists", "motorcycles"]
    names = ("pedestrians", "cyclists", "motorcycles", "all", "S1", "other")
    assert [table.value("a", name, "ade_m") for name in names] == [3.0, 9.0, None, 2.0, 2.0, 2.0]
    assert table.cells["a", "pedestrians", "ade_m"].samples == 2
    assert score_table([alone]).of_kind(GroupKind.PEOPLE) == ()


def test_the_calibration_error_has_an_interval_over_the_episodes() -> None:
    """Ten hypotheses of 0.25 in each episode, of which 1 to 5 are the best: the error is |0.25 − 0.3|."""
    episodes = []
    for seed, best in enumerate((1, 2, 3, 4, 5)):
        reliability = np.zeros((3, BINS))
        reliability[:, 2] = (10.0, 2.5, best)
        episodes.append(episode_scores("S1", {"net": replace(model_scores(np.ones(2)), reliability=reliability)}, seed))
    interval = calibration_interval(score_table(episodes), "net")
    # The mean of 0.1 to 0.5 has the standard error 0.0707, and Student's t of 4 degrees of freedom is 2.7764.
    assert (interval.value, interval.high - interval.value) == pytest.approx((0.05, 2.7764 * 0.0707), abs=1e-4)
    single = score_table([episode_scores("S1", {"cv": model_scores(np.ones(2))})])
    assert not calibration_interval(single, "cv").valid
