"""Predictions in files and in bags, and what makes a submission."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_records import moving, samples_in

from siren_ros.data.datasets.argoverse2 import OBSERVED, STEPS, scenario_id
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces.conversions import to_predicted_paths
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import tracks_of, whole_windows
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.evaluation.prediction.predictors import checked
from siren_ros.scoring.evaluation.prediction.samples import (
    ARGOVERSE_WINDOW,
    HistoryWindow,
    Population,
    SampleBatch,
    future_times_s,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.submission import (
    ROWS_OF_FRAME,
    Submission,
    SubmittedRows,
    most_rows,
    read_prediction_file,
    read_recorded_predictions,
    submission,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.carrier import PredictedPaths

ROWS = 4


def path_of(points: int, period_s: float) -> list[float]:
    """Positions at 3 m/s: the value says the time."""
    return [3.0 * period_s * (point + 1) for point in range(points)]


def columns(points: int = 25, period_s: float = 0.2, **changed: Any) -> dict[str, Any]:
    """Two hypotheses for each of two samples."""
    x = path_of(points, period_s)
    content = {
        "episode": ["S2_L2_seed0"] * ROWS,
        "actor": [7, 7, 8, 8],
        "step": [60, 60, 60, 60],
        "mode": [0, 1, 0, 1],
        "probability": [0.75, 0.25, 0.5, 0.5],
        "x": [x] * ROWS,
        "y": [[-1.0] * points] * ROWS,
    }
    return {**content, **changed}


def read(folder: Path, content: dict[str, Any], metadata: dict[str, str] | None = None) -> SubmittedRows:
    """A file with a content, read."""
    path = folder / "a.parquet"
    pq.write_table(pa.table(content).replace_schema_metadata(metadata), path)
    return read_prediction_file(path, 1_000)


def argoverse(scenarios: list[str], tracks: list[str], probability: list[float]) -> dict[str, Any]:
    """A submission at 3 m/s eastwards."""
    return {
        "scenario_id": scenarios,
        "track_id": tracks,
        "probability": probability,
        "predicted_trajectory_x": [path_of(60, 0.1)] * len(tracks),
        "predicted_trajectory_y": [[0.0] * 60] * len(tracks),
    }


@pytest.mark.parametrize(("points", "period_s"), [(25, 0.2), (30, 0.2), (50, 0.1), (60, 0.1), (80, 0.1)])
def test_paths_are_taken_at_the_times_of_the_grid(points, period_s, tmp_path) -> None:
    rows = read(tmp_path, columns(points, period_s))
    assert rows.xy_m.shape == (ROWS, 25, 2)
    assert np.allclose(rows.xy_m[0], np.stack((path_of(25, 0.2), np.full(25, -1.0)), axis=-1))
    assert rows.window == HistoryWindow()
    assert rows.actor_id.tolist() == [7, 7, 8, 8]


def test_the_file_may_say_which_samples_it_answers(tmp_path) -> None:
    rows = read(tmp_path, columns(), {"window": "argoverse2"})
    assert rows.window == ARGOVERSE_WINDOW
    with pytest.raises(InputError, match="window nuscenes' cannot be used; allowed: one of ngsim, argoverse2"):
        read(tmp_path, columns(), {"window": "nuscenes"})


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.large_list(pa.float64()), pa.list_(pa.float64(), 25)])
def test_any_list_of_numbers_is_a_path_and_names_may_be_dictionaries(kind, tmp_path) -> None:
    content = columns(episode=pa.array(["a"] * ROWS).dictionary_encode())
    rows = read(tmp_path, {**content, **{name: pa.array(content[name], kind) for name in ("x", "y")}})
    assert np.allclose(rows.xy_m[2, :, 0], path_of(25, 0.2), atol=1e-6)
    assert rows.episode.tolist() == ["a"] * ROWS


def test_argoverse_submissions_are_read(tmp_path) -> None:
    """Focal tracks alone: the EMV as AV in its own scenario, vehicle 12 in its own one."""
    emv, other = "S2-L2-seed0-town-v1-f000049", "S2-L2-seed0-town-v12-f000051"
    tracks, probability = ["AV", "AV", "12", "12", "AV"], [0.25, 0.75, 1.0, 0.0, 1.0]
    rows = read(tmp_path, argoverse([emv, emv, other, other, other], tracks, probability))
    assert rows.episode.tolist() == ["S2-L2-seed0-town"] * 4
    assert rows.actor_id.tolist() == [1, 1, 12, 12]
    assert rows.step.tolist() == [98, 98, 102, 102]
    assert rows.mode.tolist() == [0, 1, 0, 1]
    assert rows.window == ARGOVERSE_WINDOW
    assert np.allclose(rows.xy_m[0, :, 0], path_of(25, 0.2))
    with pytest.raises(InputError, match=r"1 of 1 rows with a scenario_id of another origin; the first is 0a1e6f0a"):
        read(tmp_path, argoverse(["0a1e6f0a-1817-4a98-b02e-db8c9327d151"], ["AV"], [1.0]))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"x": [[0.0] * 25, [0.0] * 25, [0.0] * 12, [0.0] * 25]}, "1 of 4 paths .* actor 8, step 60, mode 0 with 12 v"),
        ({"y": [[0.0] * 25] * 3 + [[0.0] * 24]}, "1 of 4 paths of another horizon; .* 25 values in x and 24 in y"),
        ({"x": [[0.0] * 7] * ROWS, "y": [[0.0] * 7] * ROWS}, "4 of 4 paths of another horizon.*25 points"),
        ({"probability": [0.75, None, 0.5, 0.5]}, "1 of 4 rows without probability; the first is row 1"),
        ({"x": [[0.0] * 25] * 3 + [None]}, "1 of 4 rows without x; the first is row 3"),
        ({"actor": ["a", "b", "c", "d"]}, "actor of type string.*integers"),
        ({"step": [60.0, 60.0, 60.0, 60.0]}, "step of type double.*integers"),
        ({"probability": ["a", "b", "c", "d"]}, "probability of type string.*numbers"),
        ({"x": [1.0, 2.0, 3.0, 4.0]}, "x of type double.*lists"),
    ],
)
def test_what_cannot_be_scored_is_refused_with_the_first(changed, message, tmp_path) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, columns(**changed))


NO_UTF_8 = pa.Array.from_buffers(
    pa.string(), ROWS, [None, pa.py_buffer(np.arange(ROWS + 1, dtype=np.int32).tobytes()), pa.py_buffer(b"\xed" * ROWS)]
)
HUGE = "9" * 30


@pytest.mark.parametrize(
    "content",
    [
        columns(episode=NO_UTF_8),
        columns(episode=[[1]] * ROWS),
        {**argoverse(["S2-v1-f1"] * ROWS, ["1"] * ROWS, [0.25] * ROWS), "scenario_id": NO_UTF_8},
        argoverse([f"S2-v{HUGE}-f1"], [HUGE], [1.0]),
    ],
    ids=["bytes as text", "lists as text", "bytes as ids", "numbers of any length"],
)
def test_columns_with_other_content_are_refused(content, tmp_path) -> None:
    with pytest.raises(InputError, match="a Parquet file of predictions"):
        read(tmp_path, content)


def test_a_column_twice_is_refused(tmp_path) -> None:
    names, values = zip(*columns().items(), strict=True)
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table([*map(pa.array, values), pa.array(["a"] * ROWS)], names=[*names, "episode"]), path)
    with pytest.raises(InputError, match="2 times"):
        read_prediction_file(path, ROWS)


def test_a_file_has_as_many_rows_as_the_bags_can_ask_for(write_bag, tmp_path) -> None:
    bags = [write_bag(tmp_path / name) for name in ("a", "b")]
    assert most_rows(bags[:1]) == ROWS_OF_FRAME * 160
    assert most_rows([*bags, tmp_path / "none"]) == 2 * most_rows(bags[:1])
    pq.write_table(pa.table(columns()), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=f"{ROWS} rows, more than {ROWS - 1}"):
        read_prediction_file(tmp_path / "a.parquet", ROWS - 1)


def test_other_files_are_refused(tmp_path) -> None:
    text = tmp_path / "a.csv"
    text.write_text("episode,actor\n", encoding="utf-8")
    with pytest.raises(InputError, match="a Parquet file"):
        read_prediction_file(text, ROWS)
    with pytest.raises(InputError, match="a Parquet file"):
        read_prediction_file(tmp_path / "none.parquet", ROWS)
    incomplete = columns()
    del incomplete["mode"]
    with pytest.raises(InputError, match="columns episode, actor, step, mode, probability, x, y or scenario_id"):
        read(tmp_path, incomplete)
    with pytest.raises(InputError, match="without rows"):
        read(tmp_path, {name: pa.array(values)[:0] for name, values in columns().items()})


@pytest.fixture(scope="module")
def record(record_of: Callable[..., EpisodeRecord]) -> EpisodeRecord:
    return record_of(duration_s=14.0, civilians=6)


@pytest.mark.parametrize("population", Population)
def test_every_scenario_is_a_sample_and_every_sample_a_scenario(population, record, tmp_path) -> None:
    """Samples of Argoverse 2's models and the scenarios of the export do not know each other.

    A submission as av2 writes it has every scenario: it is scored as a whole, and has the truth at every time.
    """
    rows = []
    for track in tracks_of(record):
        actor = track.actor.actor_id
        for first in whole_windows(track, STEPS, population.value).tolist():
            whole = track.window(first, STEPS)
            name = scenario_id("S2_L2_seed0_town", actor, first + OBSERVED - 1)
            track_id = "AV" if track.actor.is_emv else str(actor)
            rows.append((name, track_id, 1.0, whole.x_m[OBSERVED:], whole.y_m[OBSERVED:]))
    scenarios, tracks, probability, x, y = map(list, zip(*rows, strict=True))
    paths = {"predicted_trajectory_x": x, "predicted_trajectory_y": y}
    samples = samples_of(record, ARGOVERSE_WINDOW, population)
    submitted = submission(read(tmp_path, argoverse(scenarios, tracks, probability) | paths))
    answered, hypotheses = submitted.of_episode(["S2-L2-seed0-town"]).meet(samples.batch)
    assert len(answered) == len(samples) == len(rows) > 30
    assert np.array_equal(hypotheses.xy_m[:, 0], samples.future_xy_m)


def rows_for(batch: SampleBatch, modes: int = 2) -> SubmittedRows:
    """Hypotheses of constant velocity for all samples, the later ones further to the left; shuffled."""
    actor, step = np.repeat(batch.actor_id, modes), np.repeat(batch.sample_step, modes)
    mode = np.tile(np.arange(modes), len(batch))
    path = batch.xy_m[:, None] + future_times_s()[:, None] * batch.velocity_mps[:, None]
    xy_m = np.repeat(path, modes, axis=0)
    xy_m[..., 1] += mode[:, None]
    probability = np.tile(np.arange(1.0, modes + 1.0) / np.arange(1.0, modes + 1.0).sum(), len(batch))
    names = np.full(len(actor), "made", dtype=object)
    rows = SubmittedRows("mine.parquet", names, actor, step, mode, probability, xy_m, HistoryWindow())
    return rows.select(np.random.default_rng(0).permutation(len(rows)))


@pytest.fixture(scope="module")
def batch(straight_road: RoadNetwork) -> SampleBatch:
    tracks = {1: moving(0.0, -5.25, 5.0, steps=199), 12: moving(30.0, -1.75, 6.0, steps=199)}
    return samples_in(tracks, straight_road).batch


def test_every_sample_meets_its_hypotheses_which_may_be_fewer(batch) -> None:
    rows = rows_for(batch)
    met, hypotheses = submission(rows).of_episode(["made"]).meet(batch)
    assert met.tolist() == list(range(len(batch)))
    assert np.allclose(hypotheses.xy_m[:, 0, 0], batch.xy_m + 0.2 * batch.velocity_mps + [0.0, 1.0])
    assert np.allclose(hypotheses.probability, [2.0 / 3.0, 1.0 / 3.0]), "the most probable first"
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


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("probability", np.nan, "1 of 80 probabilities are not finite; the first is episode made, actor"),
        ("probability", -0.1, "1 of 80 probabilities are negative"),
        ("probability", 0.9, "1 of 40 samples have probabilities of another sum; the first is .* with 1"),
        ("xy_m", np.inf, "1 of 80 paths are not finite"),
        ("xy_m", 1e200, "1 of 80 paths leave the Earth"),
        ("step", -2, "1 of 80 actors or steps are negative"),
    ],
)
def test_wrong_values_are_refused_with_their_number(batch, column, value, message) -> None:
    rows = rows_for(batch)
    values = getattr(rows, column).copy()
    values[5] = value
    with pytest.raises(InputError, match=message):
        submission(replace(rows, **{column: values}))
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
    """At 30 m/s they end 150 m away; those in a vehicle's frame begin far from it."""
    batch = samples_in({1: moving(0.0, -5.25, speed_mps, steps=199)}, straight_road).batch
    rows = rows_for(batch, modes=1)
    part = submission(replace(rows, xy_m=rows.xy_m + np.array([0.0, away_m]))).of_episode(["made"])
    if refused:
        with pytest.raises(InputError, match=r"begin farther than 110 m .*positions in metres in the frame map"):
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


def read_submission(said: list[PredictedPaths], allow_missing: bool = False) -> Any:
    return read_recorded_predictions(bag_of(said), allow_missing)


def test_samples_are_taken_and_others_left_out(batch) -> None:
    rows, hypotheses = read_submission(everything_said()).meet(batch)
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
        read_submission(said).meet(batch)
    assert len(read_submission(said, allow_missing=True).meet(batch)[0]) == 38
    with pytest.raises(InputError, match="40 of 40 samples have no prediction"):
        read_submission([]).meet(batch)
    assert len(read_submission([], allow_missing=True).meet(batch)[0]) == 0, "a program that said nothing"


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
        read_submission(said)


def test_a_bag_without_the_topic() -> None:
    with pytest.raises(BagError, match="a bag with the topic /predictions"):
        read_recorded_predictions(bag_of(everything_said(), topic="/other"), allow_missing=False)
