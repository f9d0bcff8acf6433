import json

import pytest
from dds_domains import own_domain
from preloaded_programs import PRELOADING
from recorded_episode import quick_template

from siren_ros.errors import EXIT_OK
from siren_ros.lab.benchmarks import episode, live_view


def test_a_client_reads_a_whole_episode_and_the_ratios_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    for module in (episode, live_view):
        monkeypatch.setattr(module, "subprocess", PRELOADING)
    file = tmp_path / "figures.json"
    assert (
        live_view.main(["duration_s:=2.0", f"template:={quick_template('S2')}", "--rounds", "1", "--json", str(file)])
        == EXIT_OK
    )
    figures = json.loads(file.read_text())["live_view"]
    round_, ratios = capsys.readouterr().out.splitlines()[-2:]
    assert float(round_.split("read ")[1].split()[0]) > 0.1
    assert f"wall {figures['wall']:.3f}" in ratios
    assert figures["processor"] == pytest.approx(float(ratios.split()[-1]), abs=5e-4)
