import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reader_environments import read_with

from siren_ros.data.datasets.trajectory_csv import COLUMNS, trajectory_csv, type_id_of
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.scenario.interaction_region import region_members
from siren_ros.simulation.world.actors import ActorClass


@pytest.fixture(scope="module")
def record(record_of: Callable[..., EpisodeRecord]) -> EpisodeRecord:
    return record_of(duration_s=4.0)


def _rows(record: EpisodeRecord) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(trajectory_csv(record))))


def test_the_columns_are_the_papers():
    expected = "step,timestamp,actor_id,type_id,x,y,z,yaw,vx,vy,speed_mps,is_emv"
    assert ",".join(COLUMNS) == expected


def test_one_row_per_actor_at_10_hz(record):
    rows = _rows(record)
    assert len(rows) == 40 * 5
    assert sorted({float(row["timestamp"]) for row in rows})[:3] == [0.0, 0.1, 0.2]
    assert [row["actor_id"] for row in rows[:5]] == ["1", "2", "3", "4", "5"]
    assert [row["is_emv"] for row in rows[:2]] == ["1", "0"]
    assert rows[0]["type_id"] == "vehicle.siren.ambulance"


def test_the_frame_is_carlas(record):
    track = record.track(2)
    rows = [row for row in _rows(record) if row["actor_id"] == "2"]
    for row in rows:
        step = int(row["step"])
        assert float(row["x"]) == pytest.approx(track.x_m[step], abs=1e-4)
        assert float(row["y"]) == pytest.approx(-track.y_m[step], abs=1e-4)
        assert float(row["vy"]) == pytest.approx(-track.vy_mps[step], abs=1e-4)
        assert float(row["yaw"]) == pytest.approx(-np.degrees(track.yaw_rad[step]), abs=1e-3)
        assert float(row["speed_mps"]) == pytest.approx(np.hypot(float(row["vx"]), float(row["vy"])), abs=2e-4)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(yaw_rad=st.floats(-20.0, 20.0))
def test_yaw_stays_within_half_a_turn(record, yaw_rad):
    state = replace(record.states[0], yaw_rad=np.full(5, yaw_rad))
    yaw = float(_rows(replace(record, states=(state,)))[0]["yaw"])
    assert -180.0 <= yaw <= 180.0
    assert np.cos(np.radians(yaw)) == pytest.approx(np.cos(yaw_rad), abs=1e-5)
    assert np.sin(np.radians(yaw)) == pytest.approx(-np.sin(yaw_rad), abs=1e-5)


@pytest.mark.parametrize("beyond_rad", [0.0, 1e-12, -1e-12, 4e-7, -4e-7])
@pytest.mark.parametrize("turns_rad", [-3.0 * np.pi, -np.pi, np.pi, 3.0 * np.pi])
def test_half_a_turn_is_plus_180_degrees(record, turns_rad, beyond_rad):
    state = replace(record.states[0], yaw_rad=np.full(5, turns_rad + beyond_rad))
    assert _rows(replace(record, states=(state,)))[0]["yaw"] == "180.0000"


@pytest.mark.parametrize(("yaw_rad", "text"), [(-np.pi / 2, "90.0000"), (3.1, "-177.6169"), (-3.1, "177.6169")])
def test_yaw_is_clockwise(record, yaw_rad, text):
    state = replace(record.states[0], yaw_rad=np.full(5, yaw_rad))
    assert _rows(replace(record, states=(state,)))[0]["yaw"] == text


def test_no_negative_zeros(record):
    assert "-0.0000" not in trajectory_csv(record)


def test_every_class_has_a_type_id():
    assert len({type_id_of(member) for member in ActorClass}) == len(ActorClass)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """The bag of the record."""
    return write_bag(tmp_path_factory.mktemp("csv") / "bag", duration_s=4.0)


def test_the_export_is_the_record(exported, bag, record):
    assert (exported("csv", bag) / "trajectory.csv").read_text(encoding="utf-8") == trajectory_csv(record)


def test_the_region_holds_whoever_is_near_the_emv(exported, bag, record):
    lines = (exported("csv", bag, "--region") / "trajectory.csv").read_text(encoding="utf-8").splitlines()[1:]
    there = {(int(row[0]), int(row[2])) for row in (line.split(",") for line in lines)}
    members, expected = np.empty(0, dtype=np.uint32), set()
    for state in record.states:
        members = region_members(members, state, record.emv_ids)
        expected |= {(state.step, key) for key in members.tolist() if state.step % 2 == 0}
    assert there == expected
    assert len(lines) < 40 * 5


def test_pandas_reads_numbers_and_tracks(exported, bag, record):
    read = read_with("av2", "read_csv.py", exported("csv", bag) / "trajectory.csv")
    kinds = dict.fromkeys(COLUMNS, "f") | {"step": "i", "actor_id": "i", "is_emv": "i", "type_id": "O"}
    assert read["types"] == kinds
    assert (read["missing"], read["speed_error_mps"]) == (0, pytest.approx(0.0, abs=2e-4))
    assert list(read["tracks"]) == [str(actor_id) for actor_id in sorted(record.actors)]
    for name, read_track in read["tracks"].items():
        track = record.track(int(name))
        assert read_track["period_s"] == [0.1]
        assert read_track["is_emv"] == (int(name) in record.emv_ids)
        assert read_track["steps"] == track.step[::2].tolist()
        assert read_track["x"] == pytest.approx(track.x_m[::2].tolist(), abs=1e-4)
        assert read_track["y"] == pytest.approx((-track.y_m[::2]).tolist(), abs=1e-4)
