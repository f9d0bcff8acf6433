from dataclasses import replace

import numpy as np
from made_records import moving, record_with

from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.scoring.categories import Category, categories_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import Mode


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


def test_a_window_that_holds_a_yield_is_yielding(straight_road: RoadNetwork) -> None:
    """Presents at steps 60 to 98; the yield lasts from 180 to 189, and the window reaches 100 steps ahead."""
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=199), 2: moving(30.0, -5.25, 5.0, steps=199)}, straight_road)
    record = with_modes(record, 2, {Mode.YIELD_LANE_CHANGE: range(180, 190)})
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    category = categories_of(record, batch)
    step, actor = batch.step[batch.actors.frame[batch.target]], batch.actors.actor_id[batch.target]
    assert set(category[actor == 1]) == {Category.OTHER}
    assert np.array_equal(category[actor == 2] == Category.YIELDING, step[actor == 2] >= 80)


def test_held_is_who_stands_in_the_hold_now(straight_road: RoadNetwork) -> None:
    modes = {Mode.YIELD_PULL_OVER: range(60, 70), Mode.YIELD_HOLD: range(70, 80), Mode.REJOIN: range(80, 300)}
    record = with_modes(record_with({1: moving(0.0, -5.25, 5.0, steps=199)}, straight_road), 1, modes)
    category = categories_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch)
    assert category.tolist() == [Category.YIELDING] * 5 + [Category.HELD] * 5 + [Category.OTHER] * 10


def test_each_vehicles_window_is_its_own(straight_road: RoadNetwork) -> None:
    """Every vehicle yields over another span; the categories are those that a loop over its own steps finds."""
    spans = {1: range(0), 2: range(60, 65), 3: range(150, 153), 5: range(198, 199), 9: range(3)}
    record = record_with({actor: moving(30.0 * actor, -5.25, 5.0, steps=199) for actor in spans}, straight_road)
    for actor, span in spans.items():
        record = with_modes(record, actor, {Mode.YIELD_PULL_OVER: span})
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    steps = batch.step[batch.actors.frame[batch.target]].tolist()
    actors = batch.actors.actor_id[batch.target].tolist()
    expected = [
        Category.YIELDING if set(range(step, step + 101)) & set(spans[actor]) else Category.OTHER
        for step, actor in zip(steps, actors, strict=True)
    ]
    assert categories_of(record, batch).tolist() == expected
    assert {actor for actor, category in zip(actors, expected, strict=True) if category is Category.YIELDING} == {
        2,
        3,
        5,
    }


def test_an_emv_is_an_emv_whatever_it_does(straight_road: RoadNetwork) -> None:
    record = record_with({1: replace(moving(0.0, -5.25, 5.0, steps=199), is_emv=True)}, straight_road)
    record = with_modes(record, 1, {Mode.YIELD_HOLD: range(300)})
    assert set(categories_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch)) == {Category.EMV}


def test_no_sample_no_category(straight_road: RoadNetwork) -> None:
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=20)}, straight_road)
    assert categories_of(record, samples_of(record, HistoryWindow(), Population.ALL).batch).shape == (0,)
