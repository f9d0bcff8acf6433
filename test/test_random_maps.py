"""Random road networks give maps, sites and episodes, or errors of the project's own."""

import random_maps


def test_random_nets_are_read_and_their_episodes_end_without_a_crash(tmp_path):
    nets = {seed: random_maps.random_net(seed, tmp_path) for seed in range(5)}
    there = {seed: net for seed, net in nets.items() if net.is_file()}
    outcomes = list(random_maps.try_nets(there, ["S2"], 5, 2))
    ends = [outcome.end for outcome in outcomes]
    assert ends.count("read") >= 3
    assert set(ends) <= {"read", "MapError", "sound", "unsound"}, outcomes


def test_a_seed_makes_the_same_net_again(tmp_path):
    nets = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        nets.append(random_maps.random_net(3, folder).read_text().partition("-->")[2])
    assert nets[0] == nets[1]
