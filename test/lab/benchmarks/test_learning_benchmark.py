import json
from types import SimpleNamespace

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")

from siren_ros.errors import EXIT_OK
from siren_ros.lab.benchmarks import learning


def test_the_ratios_are_those_of_the_rates(tmp_path, monkeypatch):
    ended = lambda: sum(range(20_000)) < 0  # noqa: E731 - it takes its time
    others = SimpleNamespace(reset=lambda seed: seed, step=lambda action: (action, 0.0, ended(), False, {}))
    asked = []
    monkeypatch.setattr(learning, "highway_environment", lambda vehicles: asked.append(vehicles) or others)
    file = tmp_path / "speed.json"
    assert learning.main(["--background", "12", "--steps", "8", "--rounds", "1", "--json", str(file)]) == EXIT_OK
    row = json.loads(file.read_text())["12"]
    assert row["to_highway"] == pytest.approx(row["siren"] / row["highway"])
    assert row["to_sumo"] == pytest.approx(row["siren"] / row["sumo"])
    assert row["reset_to_warm_up"] == pytest.approx(row["reset_s"] / row["warm_up_s"])
    assert asked == [round(row["vehicles"])]
    assert row["vehicles"] > 12


def test_steps_of_an_episode_that_ends_are_those_until_then():
    ends = iter([False, False, True])
    environment = SimpleNamespace(step=lambda _: (None, 0.0, next(ends), sum(range(100_000)) < 0, {}))
    assert learning.run(environment, 0, 100) > 0.0
    assert next(ends, None) is None
