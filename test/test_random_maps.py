"""Random road networks give maps, sites and episodes, or errors of the project's own."""

import random_maps

from siren_ros.base.processes.process_pool import ProcessPool


def test_random_nets_are_read_and_their_episodes_end_without_a_crash(tmp_path, monkeypatch):
    monkeypatch.setattr(random_maps, "DURATION_S", 3.0)
    nets = {seed: random_maps.random_net(seed, tmp_path) for seed in (2, 3)}
    with ProcessPool(1) as pool:
        outcomes = list(random_maps.try_nets(nets, ["S2", "S6"], 3, pool))
    ends = [outcome.end for outcome in outcomes]
    assert ends[:2] == ["read", "read"]
    assert set(ends[2:]) in ({"sound"}, {"unsound"}, {"sound", "unsound"}), outcomes
