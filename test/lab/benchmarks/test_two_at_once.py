import json
import time

import pytest
from recorded_episode import quick_template

from siren_ros.errors import EXIT_OK
from siren_ros.lab.benchmarks import two_at_once


def test_work_that_only_waits_is_twice_as_fast_at_once():
    seen = []
    assert two_at_once.speed_up(lambda n: (seen.append(n), time.sleep(0.1))) > 1.4
    assert sorted(seen) == [0, 1, 2]


def test_two_episodes_are_compared_with_two_loops(tmp_path, monkeypatch):
    monkeypatch.setattr(two_at_once, "_LOOP", "pass")
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    file, short = tmp_path / "figures.json", ("duration_s:=0.5", f"template:={quick_template('S2')}")
    assert two_at_once.main([*short, "--suites", "none", "--json", str(file)]) == EXIT_OK
    figures = json.loads(file.read_text())
    assert figures["none"]["to_loop"] == pytest.approx(figures["none"]["speed_up"] / figures["loop"]["speed_up"])
