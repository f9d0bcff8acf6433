import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from busy_record import busy_record
from known_outputs import assert_known
from made_records import moving, record_with

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.closed_loop import record_of as record_of_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.evaluation.prediction.metrics import METRICS
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, predictors_named
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, ScoredSamples, samples_of
from siren_ros.scoring.evaluation.prediction.scoring import (
    Category,
    EpisodeScores,
    ModelScores,
    ScoringJob,
    Trait,
    answers_for,
    categories_of,
    score_bags,
    score_episode,
    traits_of,
)
from siren_ros.scoring.evaluation.prediction.submission import EpisodePredictions, Submission
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import ActorClass, ActorStates, Mode


def with_modes(record: EpisodeRecord, actor_id: int, modes: dict[Mode, range]) -> EpisodeRecord:
    """The record with an actor's modes at some steps."""
    states = []
    for state in record.states:
        mode = state.mode.copy()
        for changed, steps in modes.items():
            if state.step in steps:
                mode[state.actor_id == actor_id] = changed
        states.append(replace(state, mode=mode))
    return replace(record, states=tuple(states))


def categories(record: EpisodeRecord) -> np.ndarray:
    return categories_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch)


def traits(record: EpisodeRecord) -> np.ndarray:
    return traits_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch)


def test_held_vehicles_stand_in_the_hold_at_the_present(straight_road) -> None:
    modes = {Mode.YIELD_PULL_OVER: range(60, 70), Mode.YIELD_HOLD: range(70, 80), Mode.REJOIN: range(80, 300)}
    record = with_modes(record_with({1: moving(0.0, -5.25, 5.0, steps=199)}, straight_road), 1, modes)
    assert categories(record).tolist() == [Category.YIELDING] * 5 + [Category.HELD] * 5 + [Category.OTHER] * 10
    emv = replace(record, actors={1: replace(record.actors[1], is_emv=True)})
    assert set(categories(emv)) == {Category.EMV}, "whatever it does"
    short = record_with({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road)
    assert categories(short).shape == traits(short).shape == (0,)


def test_each_vehicles_window_is_its_own(straight_road) -> None:
    """Every vehicle yields over another span; the categories are those that a loop over its own steps finds."""
    spans = {1: range(0), 2: range(60, 65), 3: range(150, 153), 5: range(198, 199), 9: range(3)}
    record = record_with({actor: moving(30.0 * actor, -5.25, 5.0, steps=199) for actor in spans}, straight_road)
    for actor, span in spans.items():
        record = with_modes(record, actor, {Mode.YIELD_PULL_OVER: span})
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    samples = list(zip(batch.sample_step.tolist(), batch.actor_id.tolist(), strict=True))
    yields = [bool(set(range(step, step + 101)) & set(spans[actor])) for step, actor in samples]
    expected = [Category.YIELDING if is_yield else Category.OTHER for is_yield in yields]
    assert categories_of(record, batch).tolist() == expected
    assert {actor for (_, actor), is_yield in zip(samples, yields, strict=True) if is_yield} == {2, 3, 5}


def test_manoeuvres_begin_within_the_horizon(straight_road) -> None:
    """Presents at steps 60 to 98. A yield from 60 to 69 has begun; the way back begins at 70 and a yield at 180."""
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=199), 2: moving(30.0, -5.25, 5.0, steps=199)}, straight_road)
    back = {Mode.YIELD_PULL_OVER: range(50, 70), Mode.REJOIN: range(70, 80)}
    for modes, steps in ((back, range(60, 70)), ({Mode.YIELD_REACTING: range(180, 190)}, range(80, 99))):
        changed = with_modes(record, 2, modes)
        batch = samples_of(changed, HistoryWindow(), Population.ALL).batch
        begins = traits_of(changed, batch) & Trait.BEGINS > 0
        assert not begins[batch.actor_id == 1].any()
        own = batch.actor_id == 2
        assert batch.sample_step[own & begins].tolist() == [step for step in range(60, 100, 2) if step in steps]


def test_vehicles_that_stand_or_creep_do_not_move(straight_road) -> None:
    speeds_mps = {1: 0.0, 2: 0.9, 3: 1.1, 4: 8.0}
    tracks = {actor: moving(30.0 * actor, -5.25, speed, steps=163) for actor, speed in speeds_mps.items()}
    assert (traits(record_with(tracks, straight_road)) & Trait.MOVING > 0).tolist() == [False, False, True, True] * 2


STEPS = 180
"""9 s: 90 frames, of which ten begin a whole window."""


@pytest.fixture(scope="module")
def episode() -> EpisodeRecord:
    setup = set_up_episode(EpisodeRequest("S2", sensors="none"))
    return record_of_loop(setup, list(closed_loop(setup, STEPS)))


def shaken(states: ActorStates, rng: np.random.Generator) -> ActorStates:
    """The same actors elsewhere, with other velocities."""
    changed = {
        name: getattr(states, name) + rng.normal(scale=20.0, size=len(states))
        for name in ("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad")
    }
    return replace(states, **changed)


def same(first: EpisodeScores, second: EpisodeScores) -> bool:
    """Whether all values of all samples are equal."""
    return list(first.models) == list(second.models) and all(
        np.array_equal(first.models[model].values[metric], values, equal_nan=True)
        for model, scores in second.models.items()
        for metric, values in scores.values.items()
    )


@pytest.mark.parametrize("model", ["idm_stop", "siren"])
def test_predictions_do_not_depend_on_the_logged_future(model, episode) -> None:
    predictor = predictors_named([model])[model]
    now = 70
    rng = np.random.default_rng(3)
    states = tuple(state if state.step <= now else shaken(state, rng) for state in episode.states)
    traffic = tuple(
        item if item.step <= now else replace(item, lane=np.full_like(item.lane, -1), lane_position_m=0.0 * item.x_m)
        for item in episode.traffic
    )
    before, after = (
        samples_of(record, predictor.window, Population.ALL)
        for record in (episode, replace(episode, states=states, traffic=traffic, events=(), commands={}))
    )
    present = before.batch.step[before.batch.actors.frame[before.batch.target]] <= now
    assert present.sum() > 50
    assert not np.allclose(before.future_xy_m[present], after.future_xy_m[present])
    known, answered = (predictor.predict(samples.batch).xy_m[present] for samples in (before, after))
    # Networks handle many samples at once, and round a little differently with others.
    assert np.abs(known - answered).max() < 1e-3


def test_a_real_episode_is_scored(episode) -> None:
    scores = score_episode("live", episode, predictors_named(["cv", "idm"]), Population.ALL)
    there = [len(episode.track(key)) for key in episode.actors]
    assert scores.samples >= 10 * sum(count == STEPS for count in there) > 0
    assert (scores.template, scores.map_name) == ("S2", "town")
    for metrics in scores.models.values():
        assert list(metrics.values) == [metric.name for metric in METRICS]
        assert all(values.shape == metrics.step.shape for values in metrics.values.values())
        assert 0.0 < metrics["ade_m"].value < metrics["fde_m"].value < metrics["rmse_5s_m"].value < 40.0
        assert metrics["min_ade_6_m"] == metrics["ade_m"], "one hypothesis"
        assert metrics["brier_score"].value is None, "one hypothesis states no probability"
        assert np.allclose(metrics.distance_sum_m.mean() / len(metrics), metrics["ade_m"].value)
    assert scores.parameters["emv.speed_mps"] > 0.0
    backwards = replace(episode, states=tuple(reversed(episode.states)))
    assert same(scores, score_episode("live", backwards, predictors_named(["cv", "idm"]), Population.ALL))


def test_scores_of_a_bag_are_those_of_its_record(bags, record_of) -> None:
    models = predictors_named(["cv", "idm"])
    from_bag = score_episode("bag", read_episode(bags[0]), models, Population.ALL)
    assert same(from_bag, score_episode("bag", record_of(duration_s=8.5), models, Population.ALL))
    assert from_bag.samples == 5 * (85 - 80)


def test_people_are_scored_apart(straight_road) -> None:
    """The car keeps its speed; the walker gains 0.1 m/s in each second, 1.25 m in five."""
    car = moving(0.0, -5.25, 5.0)
    walker = moving(9.0, -9.0, 1.0, accel_mps2=0.1, actor_class=ActorClass.PEDESTRIAN)
    models = predictors_named(["cv"])
    alone = score_episode("alone", record_with({1: car}, straight_road), models, Population.ALL)
    scores = score_episode("both", record_with({1: car, 2: walker}, straight_road), models, Population.ALL)
    assert alone.people == {}
    assert same(alone, scores)
    assert scores.people["cv"]["fde_m"].value == pytest.approx(1.25)
    assert set(scores.people["cv"].category.tolist()) == {ActorClass.PEDESTRIAN}


@pytest.mark.parametrize("of_walker", [True, False])
def test_a_submission_may_leave_people_out(straight_road, of_walker) -> None:
    walker = moving(9.0, -9.0, 1.0, actor_class=ActorClass.PEDESTRIAN)
    record = record_with({1: moving(0.0, -5.25, 5.0), 2: walker}, straight_road)
    both = [samples_of(record, HistoryWindow(), Population.ALL, people=people) for people in (False, True)]
    given = both if of_walker else both[:1]
    actor = np.concatenate([samples.batch.actor_id for samples in given])
    step = np.concatenate([samples.batch.sample_step for samples in given])
    order = np.lexsort((actor, step))
    paths = Hypotheses.certain(np.concatenate([samples.future_xy_m for samples in given])[order])
    submitted = {"mine": EpisodePredictions("file", HistoryWindow(), actor[order], step[order], paths)}
    scores = score_episode("both", record, {}, Population.ALL, submitted)
    assert scores.models["mine"]["fde_m"].value == 0.0
    assert len(scores.people["mine"]) == len(both[1]) * of_walker
    assert scores.people["mine"].population_size == len(both[1])


def test_models_with_other_histories_have_their_own_samples(straight_road) -> None:
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=2 * 120 - 1)}, straight_road)
    long = replace(predictors_named(["cv"])["cv"], window=HistoryWindow(points=50, stride_frames=1))
    scores = score_episode("two", record, {"cv": predictors_named(["cv"])["cv"], "long": long}, Population.ALL)
    assert {model: values["ade_m"].samples for model, values in scores.models.items()} == {"cv": 40, "long": 21}
    assert scores.samples == 21


def test_by_default_the_region_is_scored(straight_road) -> None:
    """100 frames, 20 windows each: the second always near, the third always far, the fourth gone after half of it."""
    places = [(0.0, -5.25, 10.0), (20.0, -5.25, 10.0), (60.0, -5.25, 10.0), (0.0, -1.75, 0.0)]
    tracks = {actor: moving(*place, steps=199, is_emv=actor == 1) for actor, place in enumerate(places, start=1)}
    record = record_with(tracks, straight_road)
    models = predictors_named(["cv"])
    scores = score_episode("region", record, models)
    assert (scores.population, scores.samples) == (Population.REGION, 40)
    assert score_episode("all", record, models, Population.ALL).samples == 80
    batch = samples_of(record, HistoryWindow(), Population.REGION).batch
    assert set(batch.actor_id.tolist()) == {1, 2}
    # The fourth is 50 m behind the EMV after 5 s: a neighbour in the samples of frames 30 to 49 up to then.
    assert set(batch.actors.actor_id.tolist()) == {1, 2, 4}
    assert not batch.actors.observed[batch.actors.frame == 0].sum(axis=1).tolist().count(0)


def test_what_is_kept_of_each_sample(straight_road) -> None:
    """Two samples each of a vehicle that gains speed, one that stands, and an EMV at constant speed."""
    faster, emv = moving(0.0, -5.25, 5.0, 0.4, steps=163), moving(0.0, 500.0, 6.0, 0.0, 2.0, 163, is_emv=True)
    record = record_with({3: faster, 4: moving(60.0, -5.25, 0.0, steps=163), 9: emv}, straight_road)
    scores = score_episode("kept", record, predictors_named(["cv"]), Population.ALL).models["cv"]
    assert scores.step.tolist() == [60, 60, 60, 62, 62, 62]
    assert scores.actor_id.tolist() == [3, 4, 9] * 2
    assert scores.category.tolist() == [Category.OTHER, Category.OTHER, Category.EMV] * 2
    # The first drives 6.2 m/s at 3 s: 5 s of that, and 0.2 times 25.
    assert scores.moved_m[:3] == pytest.approx([5.0 * 6.2 + 5.0, 0.0, 30.0])
    assert scores.population_size == len(scores) == 6
    # Constant velocity is off by 0.2 t², for each of the first one's two samples.
    assert scores.distance_sum_m == pytest.approx(2.0 * 0.2 * (0.2 * np.arange(1, 26)) ** 2)
    assert scores.values["fde_m"] == pytest.approx([5.0, 0.0, 0.0] * 2)


JOB = ScoringJob(("cv",), population=Population.ALL)
NAMES = ("near", "broken", "far")


@pytest.fixture(scope="module", name="bags")
def _bags(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> list[Path]:
    """Two bags of one synthetic episode, and between them a folder that is none."""
    folder = tmp_path_factory.mktemp("bags")
    bags = [folder / name for name in NAMES]
    write_bag(bags[0], duration_s=8.5)
    bags[1].mkdir()
    shutil.copytree(bags[0], bags[2])
    return bags


@pytest.fixture(scope="module", name="samples")
def _samples(bags: list[Path]) -> ScoredSamples:
    return samples_of(read_episode(bags[0]), HistoryWindow(), Population.ALL)


def off_by(metres: Mapping[str, float], samples: ScoredSamples) -> Submission:
    """The truth of each episode, moved aside."""
    batch = samples.batch
    order = np.lexsort((batch.actor_id, batch.sample_step))

    def part(rows: np.ndarray, aside_m: float) -> EpisodePredictions:
        hypotheses = Hypotheses.certain(samples.future_xy_m[rows] + np.array([0.0, aside_m]))
        return EpisodePredictions("made", HistoryWindow(), batch.actor_id[rows], batch.sample_step[rows], hypotheses)

    return Submission({name: part(order, aside_m) for name, aside_m in metres.items()}, part(order[:0], 0.0))


def test_every_bag_gets_its_result_in_order_and_one_that_cannot_be_read_does_not_stop_the_others(bags) -> None:
    seen: list[int] = []
    results = score_bags(JOB, bags, lambda: seen.append(1))
    assert [result.bag for result in results] == bags
    assert [result.error is None for result in results] == [True, False, True]
    assert results[1].scores is None
    assert str(bags[1]) in str(results[1].error)
    assert len(seen) == len(bags)
    first, last = (result.scores for result in results if result.scores is not None)
    assert (first.name, last.name) == (str(bags[0]), str(bags[2]))
    assert first.models["cv"]["ade_m"] == last.models["cv"]["ade_m"]


def test_each_bag_meets_the_predictions_of_its_name(bags, samples) -> None:
    job = replace(JOB, models=(), submissions={"mine": off_by({"far": 2.0, "near": 0.5}, samples)})
    results = score_bags(job, [bags[0], bags[2]])
    near, far = (result.scores for result in results if result.scores is not None)
    assert list(near.models) == ["mine"]
    assert near.models["mine"]["ade_m"].value == pytest.approx(0.5)
    assert far.models["mine"]["fde_m"].value == pytest.approx(2.0)
    assert near.models["mine"]["ade_m"].samples == len(samples.future_xy_m)


def test_predictions_of_bags_that_are_not_scored_and_models_that_are_none_are_refused_first(bags, samples) -> None:
    job = replace(JOB, submissions={"mine": off_by({"elsewhere": 0.0}, samples)})
    with pytest.raises(InputError, match="elsewhere"):
        score_bags(job, [bags[0]])
    with pytest.raises(InputError, match="nobody"):
        score_bags(replace(JOB, models=("nobody",)), [bags[1]])
    (result,) = score_bags(ScoringJob(()), [bags[0]])
    assert result.scores.models == {}, "without any model there is nothing to score"


def test_answers_are_those_of_the_given_models(bags, samples) -> None:
    job = replace(JOB, models=("cv", "idm"), submissions={"mine": off_by({"near": 1.0}, samples)})
    record, answers = answers_for(job, bags[0], ("idm", "mine"))
    assert record.steps == 170
    assert set(answers) == {"idm", "mine"}
    mine = answers["mine"]
    off_m = mine.hypotheses.xy_m[:, 0] - mine.samples.future_xy_m
    assert np.allclose(off_m, [0.0, 1.0])
    assert set(answers_for(job, bags[0], ("cv",))[1]) == {"cv"}


@pytest.mark.parametrize("noise", ["", "tracker"])
def test_every_score_of_three_models_with_and_without_errors_of_tracks(noise: str) -> None:
    """Vehicles and people; the submission has some of both."""
    record = busy_record()
    models = predictors_named(["cv", "idm_stop", "imm"][: 1 if noise else 3])
    samples = [samples_of(record, HistoryWindow(), Population.ALL, people=people) for people in (False, True)]
    keys = [(one.batch.sample_step[::3], one.batch.actor_id[::3], one.future_xy_m[::3, None] + 1.0) for one in samples]
    step, actor, xy_m = (np.concatenate(parts) for parts in zip(*keys, strict=True))
    order = np.lexsort((actor, step))
    answers = Hypotheses(xy_m[order], np.ones((len(order), 1)))
    submitted = EpisodePredictions("told", HistoryWindow(), actor[order], step[order], answers, allow_missing=True)
    scores = score_episode("busy", record, models, Population.ALL, {"told": submitted}, noise)
    about = {name: value for name, value in vars(scores).items() if name not in {"models", "people"}}
    parts = {"models": scores.models, "people": scores.people}
    found = {name: {model: _summary(one) for model, one in of.items()} for name, of in parts.items()}
    assert_known(Path(__file__).parent / "known" / f"scores{noise}.json", {**about, **found}, digits=5)


def _summary(scores: ModelScores) -> dict[str, Any]:
    """Sums over the samples."""
    return {
        "samples": (len(scores), scores.population_size),
        "steps and actors": (int(scores.step.sum()), int(scores.actor_id.sum())),
        "category": np.bincount(scores.category),
        "traits": np.bincount(scores.traits),
        "moved_m": float(scores.moved_m.sum()),
        "values": {
            name: [np.isfinite(of).sum(), np.nansum(of), np.nanmax(of, initial=0.0)]
            for name, of in scores.values.items()
        },
        "distance_sum_m": scores.distance_sum_m[::6],
        "reliability": scores.reliability[:, scores.reliability[0] > 0.0],
    }
