"""Paths of every known length on the common grid, and rows in words."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_records import moving, samples_in

from siren_ros.data.interfaces.conversions import to_predicted_paths
from siren_ros.data.record.episode_source import EpisodeSource
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.evaluation.prediction.predictors import checked
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, SampleBatch, future_times_s
from siren_ros.scoring.evaluation.prediction.submission import (
    Submission,
    SubmittedRows,
    on_grid,
    read_recorded_predictions,
    refuse,
    submission,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.carrier import PredictedPaths


@pytest.mark.parametrize(("points", "period_s"), [(25, 0.2), (30, 0.2), (50, 0.1), (60, 0.1), (80, 0.1)])
def test_the_grid_holds_the_places_at_its_own_times(points, period_s) -> None:
    """Two vehicles at 10 m/s eastwards and 5 m/s southwards."""
    time = period_s * np.arange(1, points + 1)
    paths = np.stack((np.stack((10.0 * time, 0.0 * time), -1), np.stack((0.0 * time, -5.0 * time), -1)))
    grid = 0.2 * np.arange(1, 26)
    on_common_grid = on_grid(paths)
    assert on_common_grid.shape == (2, 25, 2)
    assert on_common_grid[0] == pytest.approx(np.stack((10.0 * grid, 0.0 * grid), -1))
    assert on_common_grid[1] == pytest.approx(np.stack((0.0 * grid, -5.0 * grid), -1))


def rows() -> SubmittedRows:
    names = np.array(["a", "b", "c"], dtype=object)
    numbers = np.array([4, 5, 6])
    return SubmittedRows(
        "file", names, numbers, 10 * numbers, np.arange(3), 0.1 * numbers, np.zeros((3, 25, 2)), HistoryWindow()
    )


def test_some_rows_keep_their_columns() -> None:
    some = rows().select(np.array([True, False, True]))
    assert (len(some), some.source, some.window) == (2, "file", HistoryWindow())
    assert some.named(1) == "episode c, actor 6, step 60, mode 2"
    assert some.probability == pytest.approx([0.4, 0.6])
    assert some.xy_m.shape == (2, 25, 2)


def test_the_first_wrong_row_is_named_with_their_number() -> None:
    refuse("file", np.zeros(3, dtype=np.bool_), "rows", rows().named, "none")
    with pytest.raises(InputError, match="file: 2 of 3 rows; the first is episode b, actor 5, step 50, mode 1"):
        refuse("file", np.array([False, True, True]), "rows", rows().named, "none")


def rows_for(batch: SampleBatch, modes: int = 2, episode: str = "made") -> SubmittedRows:
    """Hypotheses of constant velocity for all samples, the later ones further to the left; shuffled."""
    actor, step = np.repeat(batch.actor_id, modes), np.repeat(batch.sample_step, modes)
    mode = np.tile(np.arange(modes), len(batch))
    path = batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None]
    xy_m = np.repeat(path, modes, axis=0)
    xy_m[..., 1] += mode[:, None]
    probability = np.tile(np.arange(1.0, modes + 1.0) / np.arange(1.0, modes + 1.0).sum(), len(batch))
    names = np.full(len(actor), episode, dtype=object)
    rows = SubmittedRows("mine.parquet", names, actor, step, mode, probability, xy_m, HistoryWindow())
    return rows.select(np.random.default_rng(0).permutation(len(rows)))


@pytest.fixture(scope="module")
def batch(straight_road: RoadNetwork) -> SampleBatch:
    tracks = {1: moving(0.0, -5.25, 5.0, steps=199), 12: moving(30.0, -1.75, 6.0, steps=199)}
    return samples_in(tracks, straight_road).batch


def test_every_sample_meets_its_hypotheses(batch) -> None:
    part = submission(rows_for(batch)).of_episode(["made"])
    rows, hypotheses = part.meet(batch)
    assert rows.tolist() == list(range(len(batch)))
    assert np.allclose(hypotheses.xy_m[:, 0, 0], batch.xy_m + 0.2 * batch.velocity_mps + [0.0, 1.0])
    assert np.allclose(hypotheses.probability, [2.0 / 3.0, 1.0 / 3.0]), "the most probable first"


def test_samples_may_have_fewer_hypotheses(batch) -> None:
    rows = rows_for(batch)
    first = (rows.actor_id == 12) & (rows.step == 60)
    fewer = replace(rows, probability=np.where(first, 1.0, rows.probability)).select(~(first & (rows.mode == 0)))
    _, hypotheses = submission(fewer).of_episode(["made"]).meet(batch)
    assert hypotheses.probability[1].tolist() == [1.0, 0.0]
    assert np.array_equal(hypotheses.xy_m[1, 0], hypotheses.xy_m[1, 1])


def test_missing_samples_are_refused_or_left_out(batch) -> None:
    rows = rows_for(batch)
    part = submission(rows.select((rows.step > 62) | (rows.actor_id == 1))).of_episode(["made"])
    with pytest.raises(InputError, match="2 of 40 samples have no prediction; the first is actor 12 at step 60"):
        part.meet(batch)
    answered, hypotheses = replace(part, allow_missing=True).meet(batch)
    assert len(answered) == len(hypotheses) == 38
    assert {1, 3}.isdisjoint(answered.tolist())


@pytest.mark.parametrize("allow_missing", [False, True])
def test_unknown_samples_are_refused(batch, allow_missing) -> None:
    rows = rows_for(batch)
    moved = replace(rows, step=np.where((rows.actor_id == 12) & (rows.step == 98), 61, rows.step))
    with pytest.raises(InputError, match=r"1 of 40 predicted samples are not in .*; the first is actor 12 at step 61"):
        submission(moved, allow_missing).of_episode(["made"]).meet(batch)


def test_positions_in_a_vehicles_frame_are_refused(batch) -> None:
    rows = replace(rows_for(batch), xy_m=rows_for(batch).xy_m + 4000.0)
    with pytest.raises(InputError, match="positions in metres in the frame map"):
        submission(rows).of_episode(["made"]).meet(batch)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("probability", np.nan, "1 of 80 probabilities are not finite; the first is episode made, actor"),
        ("probability", -0.1, "1 of 80 probabilities are negative"),
        ("probability", 0.9, "1 of 40 samples have probabilities of another sum; the first is .* with 1"),
        ("xy_m", np.inf, "1 of 80 paths are not finite"),
        ("step", -2, "1 of 80 actors or steps are negative"),
    ],
)
def test_wrong_values_are_refused_with_their_number(batch, column, value, message) -> None:
    rows = rows_for(batch)
    values = getattr(rows, column).copy()
    values[5] = value
    with pytest.raises(InputError, match=message):
        submission(replace(rows, **{column: values}))


def test_hypotheses_given_twice_are_refused(batch) -> None:
    rows = rows_for(batch)
    with pytest.raises(InputError, match="1 of 81 hypotheses are given twice; the first is episode made, actor"):
        submission(rows.select(np.append(np.arange(len(rows)), 3)))


def both(batch: SampleBatch, allow_missing: bool = False) -> Submission:
    rows = rows_for(batch)
    twice = rows.select(np.tile(np.arange(len(rows)), 2))
    names = np.repeat(np.array(["one", "two"], dtype=object), len(rows))
    return submission(replace(twice, episode=names), allow_missing)


def test_episodes_go_by_any_of_their_names(batch) -> None:
    submitted = both(batch)
    assert len(submitted.of_episode(["folder", "two"])) == 40
    nothing = submitted.of_episode(["folder"])
    assert len(nothing) == 0
    assert len(checked("mine", nothing.hypotheses, 0)) == 0
    submitted.check_episodes([("one",), ("folder", "two")])


def test_episodes_that_are_not_scored_are_refused(batch) -> None:
    with pytest.raises(InputError, match="1 of 2 episodes are not among the bags; the first is two"):
        both(batch).check_episodes([("one",)])
    both(batch, allow_missing=True).check_episodes([("one",)])
    with pytest.raises(InputError, match=r"episode one.*a name that one bag alone has"):
        both(batch, allow_missing=True).check_episodes([("a", "one"), ("b", "one"), ("two",)])


@pytest.mark.parametrize(
    ("speed_mps", "away_m", "refused"), [(30.0, 0.0, False), (5.0, 90.0, False), (5.0, 110.0, True)]
)
def test_paths_begin_near_their_vehicle_and_may_end_anywhere(straight_road, speed_mps, away_m, refused) -> None:
    """At 30 m/s they end 150 m away."""
    tracks = {1: moving(0.0, -5.25, speed_mps, steps=199)}
    batch = samples_in(tracks, straight_road).batch
    rows = rows_for(batch, modes=1)
    part = submission(replace(rows, xy_m=rows.xy_m + np.array([0.0, away_m]))).of_episode(["made"])
    if refused:
        with pytest.raises(InputError, match="begin farther than 110 m"):
            part.meet(batch)
    else:
        assert len(part.meet(batch)[0]) == len(batch)


def test_actor_0_and_step_0_may_be_predicted(batch) -> None:
    rows = rows_for(batch, modes=1)
    zero = submission(replace(rows, actor_id=np.where(rows.actor_id == 1, 0, rows.actor_id))).of_episode(["made"])
    assert set(zero.actor_id.tolist()) == {0, 12}
    first = rows.step == rows.step.min()
    submission(replace(rows, step=np.where(first, 0, rows.step)))


def bag_of(said: list[PredictedPaths], topic: str = "/predictions") -> EpisodeSource:
    """A bag that holds predictions alone."""

    def messages(topics: set[str]) -> list[Any]:
        assert topics == {topic}
        return [SimpleNamespace(read=partial(to_predicted_paths, paths)) for paths in said]

    bag = SimpleNamespace(type_names={topic: "siren_msgs/msg/PredictedPaths"}, messages=messages)
    return cast("EpisodeSource", SimpleNamespace(bag=bag, path=Path("bags/judged")))


def everything_said(points: int = 60) -> list[PredictedPaths]:
    """Two paths for each vehicle at each frame of the episode, those without a whole window included."""
    times = 0.1 * np.arange(1, points + 1)
    messages = []
    for step in range(0, 200, 2):
        now = 0.05 * step
        start = np.array([[5.0 * now, -5.25], [30.0 + 6.0 * now, -1.75]])
        velocity = np.array([[5.0, 0.0], [6.0, 0.0]])
        path = start[:, None] + times[:, None] * velocity[:, None]
        xy_m = np.repeat(path, 2, axis=0)
        xy_m[1::2, :, 1] += 1.0
        ids = np.array([1, 1, 12, 12], dtype=np.uint32)
        messages.append(PredictedPaths(step, ids, np.array([0.25, 0.75, 0.5, 0.5]), xy_m))
    return messages


def read(said: list[PredictedPaths], allow_missing: bool = False) -> Any:
    return read_recorded_predictions(bag_of(said), allow_missing)


def test_samples_are_taken_and_others_left_out(batch) -> None:
    rows, hypotheses = read(everything_said()).meet(batch)
    assert rows.tolist() == list(range(len(batch)))
    first = hypotheses.select(batch.actor_id == 1)
    assert np.allclose(first.probability, [0.75, 0.25])
    assert np.allclose(first.xy_m[:, 0, :, 1], -4.25)
    assert np.allclose(first.xy_m[:, 0, -1, 0] - batch.xy_m[batch.actor_id == 1, 0], 25.0)


def test_a_frame_without_predictions_is_missing(batch) -> None:
    said = everything_said()
    at = next(number for number, paths in enumerate(said) if paths.step == 70)
    said[at] = replace(said[at], actor_id=said[at].actor_id[:0], probability=np.zeros(0), xy_m=np.zeros((0, 60, 2)))
    with pytest.raises(InputError, match=r"/predictions of bags/judged: 2 of 40 samples .* is actor 1 at step 70"):
        read(said).meet(batch)
    assert len(read(said, allow_missing=True).meet(batch)[0]) == 38


def test_a_program_that_said_nothing(batch) -> None:
    with pytest.raises(InputError, match="40 of 40 samples have no prediction"):
        read([]).meet(batch)
    assert len(read([], allow_missing=True).meet(batch)[0]) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"probability": np.array([0.25, 0.25, 0.5, 0.5])}, "1 of 200 samples have probabilities of another sum"),
        ({"probability": np.array([np.nan, 0.75, 0.5, 0.5])}, "1 of 400 probabilities are not finite"),
        ({"xy_m": np.full((4, 60, 2), np.inf)}, "4 of 400 paths are not finite.* actor 1, step 6"),
        ({"xy_m": np.zeros((4, 31, 2))}, "4 of 400 paths of another horizon; .* actor 1 at step 6 with 31 points"),
    ],
)
def test_wrong_messages_are_refused_with_their_number(change, message) -> None:
    said = everything_said()
    said[3] = replace(said[3], **change)
    with pytest.raises(InputError, match=message):
        read(said)


def test_a_bag_without_the_topic() -> None:
    with pytest.raises(BagError, match="a bag with the topic /predictions"):
        read_recorded_predictions(bag_of(everything_said(), topic="/other"), allow_missing=False)
