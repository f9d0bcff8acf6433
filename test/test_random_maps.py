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


def test_a_seed_makes_the_same_net_again(tmp_path):
    nets = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        nets.append(random_maps.random_net(3, folder).read_text().partition("-->")[2])
    assert nets[0] == nets[1]
