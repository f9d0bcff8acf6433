"""Argoverse 2's scenarios of a drive of formulas: whose windows, which numbers, where the map is."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from datasets.made_bag import BUS, CAR, EMV
from synthetic_episode import NET_XML

from siren_ros.cli.main import main
from siren_ros.datasets.argoverse2.map_json import map_json
from siren_ros.roads.net_parser import parse_road_network

FRAMES = {EMV: (0, 131), CAR: (5, 131), BUS: (0, 129)}
"""First frame and the one after the last: 262 steps; the car comes at step 10, the bus is last seen at step 256."""
NAME = "S2-L2-seed0-straight-v{}-f{:06d}"


@pytest.fixture(scope="module")
def dataset(made_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("argoverse2") / "out"
    arguments = ["--population", "all", "--stride", "4", "--split", "val"]
    assert main(["export", "argoverse2", str(made_drive), "--out", str(out), *arguments]) == 0
    return out


def scenario(dataset: Path, name: str) -> dict[str, np.ndarray]:
    table: Any = pq.read_table(dataset / "val" / name / f"scenario_{name}.parquet")
    return {column: np.array(table[column].to_pylist()) for column in table.column_names}


def test_every_fourth_whole_window_of_each_vehicle_is_a_scenario(dataset: Path) -> None:
    """The name has the frame of the present, the 50th of its 110."""
    expected = {
        NAME.format(actor, start + 49) for actor, (first, end) in FRAMES.items() for start in range(first, end - 109, 4)
    }
    assert {path.name for path in (dataset / "val").iterdir()} == expected
    assert list((dataset / "train").iterdir()) == list((dataset / "test").iterdir()) == []
    card = json.loads((dataset / "dataset.json").read_text())
    assert card["counts"] == {"scenarios": len(expected)}
    assert card["classes"] == {"ambulance": 6, "bus": 5, "sedan": 5}


def test_each_scenario_has_the_map_of_its_episode(dataset: Path) -> None:
    for folder in (dataset / "val").iterdir():
        assert sorted(path.name for path in folder.iterdir()) == [
            f"log_map_archive_{folder.name}.json",
            f"scenario_{folder.name}.parquet",
        ]
    name = NAME.format(EMV, 49)
    archive = json.loads((dataset / "val" / name / f"log_map_archive_{name}.json").read_text())
    assert archive == json.loads(json.dumps(map_json(parse_road_network(NET_XML.encode()))))


@pytest.mark.parametrize(("focal", "start"), [(EMV, 0), (CAR, 9), (BUS, 16)])
def test_a_scenario_holds_everybodys_states(dataset: Path, focal: int, start: int) -> None:
    name = NAME.format(focal, start + 49)
    table = scenario(dataset, name)
    assert set(table["scenario_id"]) == {name}
    assert set(table["city"]) == {"straight"}
    assert set(table["focal_track_id"]) == {"AV" if focal == EMV else str(focal)}
    assert set(table["start_timestamp"]) == {start * 100_000_000}
    for actor, (first, end) in FRAMES.items():
        own = table["track_id"] == ("AV" if actor == EMV else str(actor))
        frames = np.arange(max(first, start), min(end, start + 110))
        assert table["timestep"][own].tolist() == (frames - start).tolist()
        assert table["observed"][own].tolist() == (frames - start < 50).tolist()
        assert set(table["object_type"][own]) == {"bus" if actor == BUS else "vehicle"}
        whole = len(frames) == 110
        assert set(table["object_category"][own]) == {3 if actor == focal else 2 if whole else 1}
        time = 0.1 * (frames - first)
        way = {EMV: 10.0 * time, CAR: 6.0 * time + 0.1 * time**2, BUS: 9.0 * time}[actor]
        assert table["position_x"][own] == pytest.approx({EMV: 20.0, CAR: 60.0, BUS: 40.0}[actor] + way)
        assert set(table["position_y"][own]) == {-1.75 if actor == BUS else -5.25}
        speed = {EMV: 10.0 + 0.0 * time, CAR: 6.0 + 0.2 * time, BUS: 9.0 + 0.0 * time}[actor]
        assert table["velocity_x"][own] == pytest.approx(speed)
        assert set(table["velocity_y"][own]) == set(table["heading"][own]) == {0.0}


def test_of_the_region_only_whole_windows_near_the_emv_count(made_drive: Path, tmp_path: Path) -> None:
    """The car is 40 m ahead at frame 5 and falls back by 4 m a second and less; the bus is 20 m ahead."""
    assert main(["export", "argoverse2", str(made_drive), "--out", str(tmp_path / "out")]) == 0
    found = {path.name.rsplit("-", 2)[1] for path in (tmp_path / "out" / "train").iterdir()}
    assert found == {"v1", "v5", "v9"}
    starts = sorted(int(path.name[-6:]) - 49 for path in (tmp_path / "out" / "train").glob("*-v5-*"))
    entered = next(frame for frame in range(5, 131) if abs(_gap_m(frame)) <= 40.0)
    assert starts == list(range(entered, 131 - 109))


def _gap_m(frame: int) -> float:
    time = 0.1 * (frame - 5)
    return (60.0 + 6.0 * time + 0.1 * time**2) - (20.0 + 1.0 * frame)
