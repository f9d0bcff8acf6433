from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.data.datasets.argoverse2 import OBSERVED, STEPS, scenario_id
from siren_ros.data.record.tracks import tracks_of, whole_windows
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.prediction_file import ROWS_OF_FRAME, most_rows, read_prediction_file
from siren_ros.scoring.evaluation.prediction.samples import ARGOVERSE_WINDOW, HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.submission import SubmittedRows, submission

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
    assert np.allclose(rows.xy_m[0, :, 0], path_of(25, 0.2))
    assert rows.window == HistoryWindow()
    assert rows.actor_id.tolist() == [7, 7, 8, 8]


def test_the_file_may_say_which_samples_it_answers(tmp_path) -> None:
    rows = read(tmp_path, columns(), {"window": "argoverse2"})
    assert rows.window == ARGOVERSE_WINDOW
    with pytest.raises(InputError, match="window nuscenes' cannot be used; allowed: one of ngsim, argoverse2"):
        read(tmp_path, columns(), {"window": "nuscenes"})


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.large_list(pa.float64()), pa.list_(pa.float64(), 25)])
def test_any_list_of_numbers_is_a_path(kind, tmp_path) -> None:
    content = columns()
    changed = {name: pa.array(content[name], kind) for name in ("x", "y")}
    rows = read(tmp_path, {**content, **changed})
    assert np.allclose(rows.xy_m[2, :, 0], path_of(25, 0.2), atol=1e-6)


def test_names_may_be_dictionaries(tmp_path) -> None:
    content = columns(episode=pa.array(["a"] * ROWS).dictionary_encode())
    assert read(tmp_path, content).episode.tolist() == ["a"] * ROWS


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


def test_scenarios_of_another_origin_are_refused(tmp_path) -> None:
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
    empty = {name: values[:0] for name, values in columns().items()}
    typed = {**empty, "x": pa.array([], pa.list_(pa.float64())), "y": pa.array([], pa.list_(pa.float64()))}
    typed |= {name: pa.array([], pa.int64()) for name in ("actor", "step", "mode")}
    typed |= {"probability": pa.array([], pa.float64()), "episode": pa.array([], pa.string())}
    with pytest.raises(InputError, match="without rows"):
        read(tmp_path, typed)


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
    part = submission(read(tmp_path, argoverse(scenarios, tracks, probability) | paths)).of_episode(
        ["S2-L2-seed0-town"]
    )
    answered, hypotheses = part.meet(samples.batch)
    assert len(answered) == len(samples) == len(rows) > 30
    assert np.array_equal(hypotheses.xy_m[:, 0], samples.future_xy_m)
