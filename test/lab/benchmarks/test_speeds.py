"""Benchmarks of speed and cost: what they measure, and what they print and write."""

import argparse
import itertools
import json
import math
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from dds_domains import own_domain
from made_scores import scored
from preloaded_programs import PRELOADING
from recorded_episode import quick_template

from siren_ros.errors import EXIT_OK, InputError
from siren_ros.lab.benchmarks import episode, live_view, steps, two_at_once
from siren_ros.lab.benchmarks.episode import main as episode_main
from siren_ros.lab.benchmarks.episode import shares_of
from siren_ros.lab.benchmarks.evaluation import main as evaluation_main
from siren_ros.lab.benchmarks.exports import export_time_s
from siren_ros.lab.benchmarks.exports import main as exports_main
from siren_ros.lab.benchmarks.prediction import SAMPLES, Taken, predicting
from siren_ros.lab.benchmarks.prediction import main as prediction_main
from siren_ros.lab.benchmarks.steps import GRIDS, street_grid, with_vehicles
from siren_ros.lab.benchmarks.steps import main as steps_main
from siren_ros.lab.benchmarks.study_sizes import sizes_of
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.ros.programs.episode_program import time_table
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.templates import load_template


def test_shares_are_those_of_the_summary():
    busy_s = {"sumo_bridge": 1.0, "emv_controller": 0.5, "yield_manager": 1.5, "sensor_sim": 4.0, "somebody": 2.0}
    shares = shares_of("\n".join(["real-time factor 2.00 (20.0 s of wall time)", *time_table(busy_s, 20.0)]))
    expected = {"sumo": 0.05, "drivers": 0.1, "dynamics": 0.0, "sensors": 0.2, "recorder": 0.0, "transport": 0.55}
    assert shares == pytest.approx(expected)


def test_an_episode_is_measured_from_outside(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    file = tmp_path / "episode.json"
    assert episode_main(["duration_s:=0.5", "--suites", "none", "--json", str(file)]) == EXIT_OK
    row = json.loads(file.read_text())["none"]
    assert row["real_time_factor"] > 0.0
    assert row["bag_mb"] > 0.1
    assert row["memory_mb"] > 50.0
    assert "none" in capsys.readouterr().out


def test_it_prints_each_model_and_the_whole(tmp_path, write_bag, capsys) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    assert evaluation_main([str(bag), "--population=all", "--samples=70", "--jobs=1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[:3]] == ["read 1 bags", "cv", "idm"]
    assert lines[3].startswith("100 samples of 2 bags with cv, idm: ")
    assert evaluation_main([str(write_bag(tmp_path / "short", duration_s=1.0)), "--jobs=1"]) == 2, "without samples"


def test_an_export_is_timed_with_one_row_for_each_format(write_bag, tmp_path, capsys) -> None:
    bags = [write_bag(tmp_path / f"{number}", duration_s=1.0, civilians=number, lidar=True) for number in (2, 3)]
    wall_s, simulated_s = export_time_s("openpcdet", bags, 1)
    assert (wall_s > 0.0, simulated_s) == (True, 2.0)
    assert exports_main([*map(str, bags), "--formats", "openpcdet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["format", "one", "bag", "two", "bags", "loops", "share"]
    assert lines[1].split()[0] == "openpcdet"
    assert len(lines[1].split()) == 5


def test_figures_are_written_where_the_option_is_given(tmp_path: Path) -> None:
    line = argparse.ArgumentParser()
    add_json(line)
    write_json(line.parse_args([]).json, {"a": 1})
    write_json(line.parse_args(["--json", str(tmp_path / "a.json")]).json, {"a": [1.5, math.nan, (math.inf, "x")]})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"a": [1.5, None, [None, "x"]]}
    with pytest.raises(InputError, match="a file that can be written"):
        write_json(tmp_path / "none" / "a.json", {})


def test_a_client_reads_a_whole_episode_and_the_ratios_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    for module in (episode, live_view):
        monkeypatch.setattr(module, "subprocess", PRELOADING)
    file = tmp_path / "figures.json"
    words = ["duration_s:=1.0", f"template:={quick_template('S2')}", "--rounds", "1", "--json", str(file)]
    assert live_view.main(words) == EXIT_OK
    figures = json.loads(file.read_text())["live_view"]
    round_, ratios = capsys.readouterr().out.splitlines()[-2:]
    assert float(round_.split("read ")[1].split()[0]) > 0.1
    assert f"wall {figures['wall']:.3f}" in ratios
    assert figures["processor"] == pytest.approx(float(ratios.split()[-1]), abs=5e-4)


def test_bags_are_predicted_until_there_were_enough_samples(tmp_path, write_bag, capsys) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    assert prediction_main([str(bag), "--models", "cv,idm", "--samples", "120"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    (_, there, *_), *models = rows
    rounds = -(-120 // int(there))
    assert rounds > 1
    assert [row[:2] for row in models] == [[name, str(rounds * int(there))] for name in ("cv", "idm")]
    assert all(len(row) == 6 for row in rows)
    cells = Taken(SAMPLES // 4, 2.0, 3.0).row("cv").split()
    assert cells == ["cv", str(SAMPLES // 4), "2.0", "3.0", "8.0", "12.0"]


def test_each_time_is_that_of_its_clock(monkeypatch) -> None:
    """Whenever it is read, the clock of the wall has gone on by 3 s and that of the processors by 5 ms."""
    monkeypatch.setattr(time, "perf_counter", itertools.count(0.0, 3.0).__next__)
    monkeypatch.setattr(time, "process_time", itertools.count(0.0, 0.005).__next__)
    monkeypatch.setattr(steps, "closed_loop", lambda _, count: range(count))
    assert steps.step_times_ms(None, 4) == pytest.approx([5.0, 5.0, 5.0])
    whole = scored(np.zeros((2, 25, 2)))
    assert predicting(SimpleNamespace(predict=len), [whole, whole], 5) == Taken(8, 3.0, pytest.approx(0.005))
    seen = []
    assert (two_at_once.speed_up(seen.append), sorted(seen)) == (2.0, [0, 1, 2]), "two calls took as long as one"


def test_a_template_with_more_vehicles_is_the_same_otherwise(tmp_path):
    own, many = load_template("S4"), load_template(with_vehicles("S4", 200, tmp_path))
    assert with_vehicles("S4", 0, tmp_path) == "S4"
    assert many.demand.background_vehicles == 200
    assert own.demand.background_vehicles < 200
    assert (many.emv, many.demand.groups, many.predicate) == (own.emv, own.demand.groups, own.predicate)


def test_grids_have_streets_for_their_vehicles(tmp_path):
    length_m = {}
    for vehicles, streets in GRIDS.items():
        if vehicles <= 100:
            network = parse_road_network(street_grid(streets, tmp_path).read_bytes())
            length_m[vehicles] = sum(lane.length_m for lane in network.lanes)
    few, many = length_m.values()
    assert many / few == pytest.approx(5.0, rel=0.1)


def test_the_parts_of_a_step_add_up(tmp_path, capsys):
    file = tmp_path / "steps.json"
    arguments = "--templates S2 --background 0 --grids --steps 20 --rounds 1 --json"
    assert steps_main([*arguments.split(), str(file)]) == EXIT_OK
    row = json.loads(file.read_text())["S2.own"]
    assert row["step_ms"] == pytest.approx(row["sumo_ms"] + row["beyond_sumo_ms"])
    assert row["to_sumo"] == pytest.approx(row["step_ms"] / row["sumo_ms"])
    assert row["vehicles"] > load_template("S2").demand.background_vehicles
    assert np.isfinite(list(row.values())).all()
    assert "S2.own" in capsys.readouterr().out


_EPISODE = ("S1_seed0", "own", "S1", "L3", 0, "town", "paper", "none", "clear", 0, "", "", Status.COMPLETE)
RECORDED = EpisodeRow(*_EPISODE, bag="episodes/S1_seed0", bag_bytes=2_000_000, cpu_s=3.6)


def test_sizes_are_means_over_the_episodes_that_were_made() -> None:
    changes = ({}, {"bag_bytes": 4_000_000, "cpu_s": 7.2}, {"bag": "", "cpu_s": 100.0})
    rows = [replace(RECORDED, **changed) for changed in changes]
    sizes = sizes_of(rows)
    assert sizes == pytest.approx(
        {"episodes": 2, "processor_s": 5.4, "bag_mb": 3.0, "core_hours_of_10000": 15.0, "gb_of_10000": 30.0}
    )
    with pytest.raises(InputError, match="episodes that were made"):
        sizes_of(rows[2:])


def test_two_episodes_are_compared_with_two_loops(tmp_path, monkeypatch):
    monkeypatch.setattr(two_at_once, "LOOP", "pass")
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    file, short = tmp_path / "figures.json", ("duration_s:=0.5", f"template:={quick_template('S2')}")
    assert two_at_once.main([*short, "--suites", "none", "--json", str(file)]) == EXIT_OK
    figures = json.loads(file.read_text())
    assert figures["none"]["to_loop"] == pytest.approx(figures["none"]["speed_up"] / figures["loop"]["speed_up"])
