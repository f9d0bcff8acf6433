from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_records import moving, record_with
from published_files import weights

from siren_ros.evaluation.prediction.episode_scores import Category, EpisodeScores, categories_of, score_episode
from siren_ros.evaluation.prediction.metrics import METRICS
from siren_ros.evaluation.prediction.predictors import PREDICTORS, Checkpoint, predictors_named
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.closed_loop import record_of as record_of_loop
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.recording.bag_reader import read_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.world.actors import ActorStates, Mode


def with_modes(record: EpisodeRecord, actor_id: int, modes: dict[Mode, range]) -> EpisodeRecord:
    """The record with an actor's modes at some steps."""
    states = []
    for state in record.states:
        mode = state.mode.copy()
        for one, steps in modes.items():
            if state.step in steps:
                mode[state.actor_id == actor_id] = one
        states.append(replace(state, mode=mode))
    return replace(record, states=tuple(states))


def categories(record: EpisodeRecord) -> np.ndarray:
    return categories_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch)


def test_a_window_that_holds_a_yield_is_yielding(straight_road: RoadNetwork) -> None:
    """Presents at steps 60 to 98; the yield lasts from 180 to 189, and the window reaches 100 steps ahead."""
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=199), 2: moving(30.0, -5.25, 5.0, steps=199)}, straight_road)
    record = with_modes(record, 2, {Mode.YIELD_LANE_CHANGE: range(180, 190)})
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    category = categories_of(record, batch)
    step, actor = batch.sample_step, batch.actor_id
    assert set(category[actor == 1]) == {Category.OTHER}
    assert np.array_equal(category[actor == 2] == Category.YIELDING, step[actor == 2] >= 80)


def test_held_is_who_stands_in_the_hold_now(straight_road: RoadNetwork) -> None:
    modes = {Mode.YIELD_PULL_OVER: range(60, 70), Mode.YIELD_HOLD: range(70, 80), Mode.REJOIN: range(80, 300)}
    record = with_modes(record_with({1: moving(0.0, -5.25, 5.0, steps=199)}, straight_road), 1, modes)
    assert categories(record).tolist() == [Category.YIELDING] * 5 + [Category.HELD] * 5 + [Category.OTHER] * 10


def test_each_vehicles_window_is_its_own(straight_road: RoadNetwork) -> None:
    """Every vehicle yields over another span; the categories are those that a loop over its own steps finds."""
    spans = {1: range(0), 2: range(60, 65), 3: range(150, 153), 5: range(198, 199), 9: range(3)}
    record = record_with({actor: moving(30.0 * actor, -5.25, 5.0, steps=199) for actor in spans}, straight_road)
    for actor, span in spans.items():
        record = with_modes(record, actor, {Mode.YIELD_PULL_OVER: span})
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    samples = list(zip(batch.sample_step.tolist(), batch.actor_id.tolist(), strict=True))
    yields = [bool(set(range(step, step + 101)) & set(spans[actor])) for step, actor in samples]
    assert categories_of(record, batch).tolist() == [Category.YIELDING if each else Category.OTHER for each in yields]
    assert {actor for (_, actor), each in zip(samples, yields, strict=True) if each} == {2, 3, 5}


def test_an_emv_is_an_emv_whatever_it_does(straight_road: RoadNetwork) -> None:
    record = record_with({1: replace(moving(0.0, -5.25, 5.0, steps=199), is_emv=True)}, straight_road)
    record = with_modes(record, 1, {Mode.YIELD_HOLD: range(300)})
    assert set(categories(record)) == {Category.EMV}


def test_no_sample_no_category(straight_road: RoadNetwork) -> None:
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road)
    assert categories(record).shape == (0,)


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


def same(one: EpisodeScores, two: EpisodeScores) -> bool:
    """Whether all values of all samples are equal."""
    return list(one.models) == list(two.models) and all(
        np.array_equal(one.models[model].values[metric], values, equal_nan=True)
        for model, scores in two.models.items()
        for metric, values in scores.values.items()
    )


@pytest.mark.parametrize("model", PREDICTORS)
def test_predictions_do_not_depend_on_the_logged_future(model: str, episode: EpisodeRecord) -> None:
    checkpoints = {}
    if PREDICTORS[model].checkpoint is Checkpoint.REQUIRED:
        pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")
        checkpoints = {model: weights(model)}
    predictor = predictors_named([model], checkpoints)[model]
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


def test_a_real_episode_is_scored(episode: EpisodeRecord) -> None:
    scores = score_episode("live", episode, predictors_named(["cv", "idm"]), Population.ALL)
    there = [len(episode.track(key)) for key in episode.actors]
    assert scores.samples >= 10 * sum(count == STEPS for count in there) > 0
    assert (scores.template, scores.map_name) == ("S2", "town")
    for metrics in scores.models.values():
        assert list(metrics.values) == [metric.name for metric in METRICS]
        assert all(values.shape == metrics.step.shape for values in metrics.values.values())
        assert 0.0 < metrics["ade_m"].value < metrics["fde_m"].value < metrics["rmse_5s_m"].value < 40.0
        assert metrics["min_ade_6_m"] == metrics["ade_m"], "one hypothesis"
        assert not metrics["brier_score"].valid, "one hypothesis states no probability"
        assert np.allclose(metrics.distance_sum_m.mean() / len(metrics), metrics["ade_m"].value)
    assert scores.parameters["emv.speed_mps"] > 0.0


def test_scores_of_a_bag_are_those_of_its_record(
    tmp_path: Path, write_bag: Callable[..., Path], record_of: Callable[..., EpisodeRecord]
) -> None:
    bag = write_bag(tmp_path / "bag", duration_s=9.0)
    models = predictors_named(["cv", "idm"])
    from_bag = score_episode("bag", read_episode(bag), models, Population.ALL)
    assert same(from_bag, score_episode("bag", record_of(duration_s=9.0), models, Population.ALL))
    assert from_bag.samples == 5 * (90 - 80)


def test_models_with_other_histories_have_their_own_samples(straight_road: RoadNetwork) -> None:
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=2 * 120 - 1)}, straight_road)
    long = replace(predictors_named(["cv"])["cv"], window=HistoryWindow(points=50, stride_frames=1))
    scores = score_episode("two", record, {"cv": predictors_named(["cv"])["cv"], "long": long}, Population.ALL)
    assert {model: values["ade_m"].samples for model, values in scores.models.items()} == {"cv": 40, "long": 21}
    assert scores.samples == 21


def test_a_shaken_order_of_rows_gives_the_same_scores(episode: EpisodeRecord) -> None:
    models = predictors_named(["cv", "idm"])
    backwards = replace(episode, states=tuple(reversed(episode.states)))
    assert same(score_episode("a", episode, models), score_episode("a", backwards, models))


def test_by_default_the_region_is_scored(straight_road: RoadNetwork) -> None:
    """100 frames, 20 windows each: the second always near, the third always far, the fourth gone after half of it."""
    tracks = {
        1: replace(moving(0.0, -5.25, 10.0, steps=199), is_emv=True),
        2: moving(20.0, -5.25, 10.0, steps=199),
        3: moving(60.0, -5.25, 10.0, steps=199),
        4: moving(0.0, -1.75, 0.0, steps=199),
    }
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


def test_what_is_kept_of_each_sample(straight_road: RoadNetwork) -> None:
    """Two samples each of a vehicle that gains speed, one that stands, and an EMV at constant speed."""
    tracks = {
        3: moving(0.0, -5.25, 5.0, accel_mps2=0.4, steps=163),
        4: moving(60.0, -5.25, 0.0, steps=163),
        9: replace(moving(0.0, 500.0, 6.0, yaw_rad=2.0, steps=163), is_emv=True),
    }
    record = record_with(tracks, straight_road)
    found = score_episode("kept", record, predictors_named(["cv"]), Population.ALL).models["cv"]
    assert found.step.tolist() == [60, 60, 60, 62, 62, 62]
    assert found.actor_id.tolist() == [3, 4, 9] * 2
    assert found.category.tolist() == [Category.OTHER, Category.OTHER, Category.EMV] * 2
    # The first drives 6.2 m/s at 3 s: 5 s of that, and 0.2 times 25.
    assert found.moved_m[:3] == pytest.approx([5.0 * 6.2 + 5.0, 0.0, 30.0])
    assert found.population_size == len(found) == 6
    # Constant velocity is off by 0.2 t², for each of the first one's two samples.
    assert found.distance_sum_m == pytest.approx(2.0 * 0.2 * (0.2 * np.arange(1, 26)) ** 2)
    assert found.values["fde_m"] == pytest.approx([5.0, 0.0, 0.0] * 2)
