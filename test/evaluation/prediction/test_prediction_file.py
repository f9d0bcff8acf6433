from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.prediction_file import read_prediction_file
from siren_ros.evaluation.prediction.samples import ARGOVERSE_WINDOW, HistoryWindow

ROWS = 4


def path_of(points: int, period_s: float) -> list[float]:
    """Positions at 3 m/s: the value says the time."""
    return [3.0 * period_s * (point + 1) for point in range(points)]


def columns(points: int = 25, period_s: float = 0.2, **changed: Any) -> dict[str, Any]:
    """Two hypotheses for each of two samples."""
    x = path_of(points, period_s)
    made = {
        "episode": ["S2_L2_seed0"] * ROWS,
        "actor": [7, 7, 8, 8],
        "step": [60, 60, 60, 60],
        "mode": [0, 1, 0, 1],
        "probability": [0.75, 0.25, 0.5, 0.5],
        "x": [x] * ROWS,
        "y": [[-1.0] * points] * ROWS,
    }
    return {**made, **changed}


def written(path: Path, content: dict[str, Any], metadata: dict[str, str] | None = None) -> Path:
    table = pa.table(content)
    pq.write_table(table.replace_schema_metadata(metadata) if metadata else table, path)
    return path


@pytest.mark.parametrize(("points", "period_s"), [(25, 0.2), (30, 0.2), (50, 0.1), (60, 0.1), (80, 0.1)])
def test_paths_are_taken_at_the_times_of_the_grid(points: int, period_s: float, tmp_path: Path) -> None:
    rows = read_prediction_file(written(tmp_path / "a.parquet", columns(points, period_s)))
    assert rows.xy_m.shape == (ROWS, 25, 2)
    assert np.allclose(rows.xy_m[0, :, 0], path_of(25, 0.2))
    assert rows.window == HistoryWindow()
    assert rows.actor_id.tolist() == [7, 7, 8, 8]


def test_the_file_may_say_which_samples_it_answers(tmp_path: Path) -> None:
    rows = read_prediction_file(written(tmp_path / "a.parquet", columns(), {"window": "argoverse2"}))
    assert rows.window == ARGOVERSE_WINDOW
    with pytest.raises(InputError, match="window nuscenes' cannot be used; allowed: one of ngsim, argoverse2"):
        read_prediction_file(written(tmp_path / "b.parquet", columns(), {"window": "nuscenes"}))


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.large_list(pa.float64()), pa.list_(pa.float64(), 25)])
def test_any_list_of_numbers_is_a_path(kind: pa.DataType, tmp_path: Path) -> None:
    made = columns()
    changed = {name: pa.array(made[name], kind) for name in ("x", "y")}
    rows = read_prediction_file(written(tmp_path / "a.parquet", {**made, **changed}))
    assert np.allclose(rows.xy_m[2, :, 0], path_of(25, 0.2), atol=1e-6)


def test_names_may_be_dictionaries(tmp_path: Path) -> None:
    made = columns(episode=pa.array(["a"] * ROWS).dictionary_encode())
    assert read_prediction_file(written(tmp_path / "a.parquet", made)).episode.tolist() == ["a"] * ROWS


def test_argoverse_submissions_are_read(tmp_path: Path) -> None:
    """Focal tracks alone: the EMV as AV in its own scenario, vehicle 12 in its own one."""
    emv, other = "S2-L2-seed0-town-v1-f000049", "S2-L2-seed0-town-v12-f000051"
    made = {
        "scenario_id": [emv, emv, other, other, other],
        "track_id": ["AV", "AV", "12", "12", "AV"],
        "probability": [0.25, 0.75, 1.0, 0.0, 1.0],
        "predicted_trajectory_x": [path_of(60, 0.1)] * 5,
        "predicted_trajectory_y": [[0.0] * 60] * 5,
    }
    rows = read_prediction_file(written(tmp_path / "a.parquet", made))
    assert rows.episode.tolist() == ["S2-L2-seed0-town"] * 4
    assert rows.actor_id.tolist() == [1, 1, 12, 12]
    assert rows.step.tolist() == [98, 98, 102, 102]
    assert rows.mode.tolist() == [0, 1, 0, 1]
    assert rows.window == ARGOVERSE_WINDOW
    assert np.allclose(rows.xy_m[0, :, 0], path_of(25, 0.2))


def test_scenarios_of_another_origin_are_refused(tmp_path: Path) -> None:
    made = {
        "scenario_id": ["0a1e6f0a-1817-4a98-b02e-db8c9327d151"],
        "track_id": ["AV"],
        "probability": [1.0],
        "predicted_trajectory_x": [path_of(60, 0.1)],
        "predicted_trajectory_y": [[0.0] * 60],
    }
    with pytest.raises(InputError, match=r"1 of 1 rows with a scenario_id of another origin; the first is 0a1e6f0a"):
        read_prediction_file(written(tmp_path / "a.parquet", made))


@pytest.mark.parametrize(
    ("changed", "told"),
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
def test_what_cannot_be_scored_is_refused_with_the_first(changed: dict[str, Any], told: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=told):
        read_prediction_file(written(tmp_path / "a.parquet", columns(**changed)))


def test_other_files_are_refused(tmp_path: Path) -> None:
    text = tmp_path / "a.csv"
    text.write_text("episode,actor\n", encoding="utf-8")
    with pytest.raises(InputError, match="a Parquet file"):
        read_prediction_file(text)
    with pytest.raises(InputError, match="a Parquet file"):
        read_prediction_file(tmp_path / "none.parquet")
    incomplete = columns()
    del incomplete["mode"]
    with pytest.raises(InputError, match="columns episode, actor, step, mode, probability, x, y or scenario_id"):
        read_prediction_file(written(tmp_path / "b.parquet", incomplete))
    empty = {name: values[:0] for name, values in columns().items()}
    typed = {**empty, "x": pa.array([], pa.list_(pa.float64())), "y": pa.array([], pa.list_(pa.float64()))}
    typed |= {name: pa.array([], pa.int64()) for name in ("actor", "step", "mode")}
    typed |= {"probability": pa.array([], pa.float64()), "episode": pa.array([], pa.string())}
    with pytest.raises(InputError, match="without rows"):
        read_prediction_file(written(tmp_path / "c.parquet", typed))
