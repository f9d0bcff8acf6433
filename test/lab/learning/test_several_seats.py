"""The environment of PettingZoo's parallel API, on short episodes."""

import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("pettingzoo", reason="the extra learn is not installed")

import numpy as np
from recorded_episode import quick_template

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.lab.learning import parallel_env, several_seats
from siren_ros.lab.learning.environment import SeatResult
from siren_ros.lab.learning.rollout import Seat
from siren_ros.running.generation.replay_check import repeat_episode

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it imports environments of its own that are out of date
    from pettingzoo.test import parallel_api_test
    from pettingzoo.utils import BaseParallelWrapper

SHORT = {"template": quick_template("S2"), "level": 2, "duration_s": 3.0}


class WithoutOptions(BaseParallelWrapper):
    """Drops the option ``options`` of PettingZoo's check, which is none of ours and is refused."""

    def reset(self, seed=None, options=None):  # noqa: ARG002 - the interface's
        return super().reset(seed=seed)


def test_pettingzoo_finds_nothing_wrong() -> None:
    env = WithoutOptions(parallel_env(**SHORT))
    parallel_api_test(env, num_cycles=20)
    env.close()


def test_each_driver_has_an_end_of_its_own() -> None:
    env = parallel_env(**{**SHORT, "duration_s": 20.0}, action="continuous")
    env.reset(seed=8)
    full, still = np.array([1.0, 0.0, 0.0], np.float32), np.array([-1.0, 0.0, 0.0], np.float32)
    ends = {}
    while env.agents:
        actions = {"emv": full, "civilian": still}
        _, _, terminated, truncated, infos = env.step({agent: actions[agent] for agent in env.agents})
        ends |= {agent: (infos[agent]["ended"], infos[agent]["time_s"]) for agent in infos if "ended" in infos[agent]}
        assert all(terminated[agent] or truncated[agent] for agent in set(infos) - set(env.agents))
    env.close()
    assert set(ends) == {"emv", "civilian"}
    assert ends["emv"][0] == "contact"


def test_the_seats_are_the_actors_of_the_episode_and_its_bag_repeats(tmp_path: Path) -> None:
    env = parallel_env(**SHORT, render_mode="rgb_array")
    _, infos = env.reset(seed=4)
    first = env.render()
    for _ in range(5):
        env.step(dict.fromkeys(env.agents, 0))
    assert (first.shape, bool((env.render() == first).all())) == ((400, 640, 3), False), "it shows the present step"
    env.save(tmp_path / "bag")
    env.close()
    record = read_episode(tmp_path / "bag")
    assert infos["emv"]["actor_id"] == record.description.emv_ids[0]
    assert infos["civilian"]["actor_id"] == record.description.av_id
    assert repeat_episode(record) is None


def test_each_result_goes_to_its_driver_and_who_ends_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    """The basis of the environment is made here: it says what it was asked for, and three results of each driver."""
    asked: list[Any] = []

    def result(number: float, **ends: bool) -> SeatResult:
        return SeatResult(np.array([number]), 10.0 * number, info={"time_s": number}, **ends)

    first = {Seat.CIVILIAN: result(1.0), Seat.EMV: result(2.0)}
    rest = iter(
        [
            {Seat.CIVILIAN: result(3.0), Seat.EMV: result(4.0, truncated=True)},
            {Seat.CIVILIAN: result(5.0, terminated=True)},
        ]
    )
    basis = SimpleNamespace(
        reset=lambda seed, _random, options: asked.append((seed, options)) or first,
        step=lambda actions: asked.append(actions) or next(rest),
    )
    monkeypatch.setattr(several_seats, "BaseEnv", lambda *_: basis)
    env = parallel_env(**SHORT, drivers=("civilian", "emv"))
    assert env.reset(seed=7, options={"map": "a"}) == (
        {"civilian": [1.0], "emv": [2.0]},
        {"civilian": {"time_s": 1.0}, "emv": {"time_s": 2.0}},
    )
    assert (env.agents, asked.pop()) == (["civilian", "emv"], (7, {"map": "a"}))
    assert env.step({"emv": 3, "civilian": 1}) == (
        {"civilian": [3.0], "emv": [4.0]},
        {"civilian": 30.0, "emv": 40.0},
        {"civilian": False, "emv": False},
        {"civilian": False, "emv": True},
        {"civilian": {"time_s": 3.0}, "emv": {"time_s": 4.0}},
    )
    assert (env.agents, asked.pop()) == (["civilian"], {Seat.EMV: 3, Seat.CIVILIAN: 1})
    assert env.step({"civilian": 2}) == tuple(
        {"civilian": value} for value in ([5.0], 50.0, True, False, {"time_s": 5.0})
    )
    assert env.agents == []


def test_actions_and_seats_that_cannot_be_used_change_nothing() -> None:
    env = parallel_env(**SHORT)
    env.reset(seed=7)
    for actions, names in (
        ({"emv": 0}, "actions: 'emv'"),
        ({"emv": 0, "civilian": 0, "pilot": 0}, "actions: 'pilot'"),
        ({"emv": 0, "civilian": 9}, "action: 9"),
    ):
        with pytest.raises(InputError, match=names):
            env.step(actions)
    infos = env.step({"emv": 0, "civilian": 0})[4]
    assert infos["emv"]["time_s"] == pytest.approx(0.2)
    env.reset(seed=7, options={"decision_s": 0.5})
    infos = env.step({"emv": 0, "civilian": 0})[4]
    env.close()
    assert infos["emv"]["time_s"] == pytest.approx(0.5), "options hold for one episode"
    for seats in ((), ("emv", "emv"), ("pilot",)):
        with pytest.raises(InputError, match="drivers"):
            parallel_env(drivers=seats)
