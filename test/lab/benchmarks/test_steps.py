import json

import numpy as np
import pytest

from siren_ros.errors import EXIT_OK
from siren_ros.lab.benchmarks.steps import GRIDS, main, street_grid, with_vehicles
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.templates import load_template


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
    assert main([*arguments.split(), str(file)]) == EXIT_OK
    row = json.loads(file.read_text())["S2.own"]
    assert row["step_ms"] == pytest.approx(row["sumo_ms"] + row["beyond_sumo_ms"])
    assert row["to_sumo"] == pytest.approx(row["step_ms"] / row["sumo_ms"])
    assert row["vehicles"] > load_template("S2").demand.background_vehicles
    assert np.isfinite(list(row.values())).all()
    assert "S2.own" in capsys.readouterr().out
