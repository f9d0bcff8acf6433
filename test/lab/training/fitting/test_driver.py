"""Experts and the best trajectory, and the training of a driver with a tiny budget."""

import pytest

pytest.importorskip("gymnasium", reason="the extra rl is not installed")
pytest.importorskip("torch", reason="the extra rl is not installed")

from pathlib import Path

import numpy as np
from made_seat_state import state_of
from recorded_episode import quick_template

from siren_ros.errors import InputError
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.training.fitting.driver import (
    EXPERTS,
    NetworkPolicy,
    Trajectory,
    best_of,
    goes_right,
    goes_right_or_pulls_over,
    keeps_lane,
    logits_of,
    pulls_over,
    roll_out,
    trained_driver,
)
from siren_ros.lab.training.settings import DriverFit
from siren_ros.running.seat.drivers.learned import INPUT, OUTPUT, open_driver
from siren_ros.running.seat.policy import VECTOR_SIZE, Manoeuvre

SHORT_EPISODES = EnvOptions(template=quick_template("S2"), level=2, duration_s=3.0, decision_s=0.5)
NOTHING = np.zeros(0)
IN_LEFT_LANE = (3.5, 3.5)


def trajectory(reward: float, violations: int = 0) -> Trajectory:
    return Trajectory(np.zeros((0, 3), np.float32), np.zeros(0, np.int64), reward, violations)


@pytest.mark.parametrize(
    ("gap_m", "aside_m", "manoeuvre"),
    [
        (39.0, 0.0, Manoeuvre.PULL_OVER),
        (41.0, 0.0, Manoeuvre.KEEP),
        (20.0, 2.9, Manoeuvre.PULL_OVER),
        (20.0, 3.1, Manoeuvre.KEEP),
        (-25.0, 0.0, Manoeuvre.KEEP),
    ],
)
def test_an_expert_pulls_over_while_a_siren_comes_from_behind_in_line(gap_m, aside_m, manoeuvre) -> None:
    state = state_of(own_m=60.0, emv_m=60.0 - 5.0 - gap_m, aside_m=(aside_m, aside_m))
    assert pulls_over(NOTHING, state) == manoeuvre
    assert keeps_lane(NOTHING, state) == Manoeuvre.KEEP


def test_an_expert_goes_to_the_lane_on_the_right_where_there_is_one() -> None:
    near, far = {"own_m": 60.0, "emv_m": 10.0}, {"own_m": 90.0, "emv_m": 20.0}
    assert goes_right(NOTHING, state_of(**near, aside_m=IN_LEFT_LANE)) == Manoeuvre.RIGHT
    assert goes_right(NOTHING, state_of(**far, aside_m=IN_LEFT_LANE)) == Manoeuvre.KEEP
    assert goes_right(NOTHING, state_of(**near)) == Manoeuvre.KEEP, "it is in the rightmost lane"
    assert goes_right_or_pulls_over(NOTHING, state_of(**near, aside_m=IN_LEFT_LANE)) == Manoeuvre.RIGHT
    assert goes_right_or_pulls_over(NOTHING, state_of(**near)) == Manoeuvre.PULL_OVER


def test_outputs_are_those_of_the_layers_with_tanh_between_them() -> None:
    layers = (
        (np.array([[1.0, 0.0], [0.0, 2.0]], np.float32), np.array([0.5, 0.0], np.float32)),
        (np.array([[1.0, -1.0]], np.float32), np.array([0.25], np.float32)),
    )
    outputs = logits_of(layers, np.array([[0.5, 0.25], [0.0, 0.0]]))
    assert outputs[:, 0] == pytest.approx([np.tanh(1.0) - np.tanh(0.5) + 0.25, np.tanh(0.5) + 0.25])


def test_a_policy_that_learns_tries_others_as_often_as_its_outputs_say() -> None:
    layers = ((np.zeros((2, 1), np.float32), np.array([0.0, np.log(3.0)], np.float32)),)
    sure = NetworkPolicy(layers, 0.0, np.random.default_rng(0))
    assert [sure(np.zeros(1), state_of()) for _ in range(5)] == [1] * 5
    tries = NetworkPolicy(layers, 1.0, np.random.default_rng(0))
    state = state_of()
    assert np.mean([tries(np.zeros(1), state) for _ in range(4000)]) == pytest.approx(0.75, abs=0.03)


def test_the_best_is_the_first_one_that_no_later_one_beats_by_the_margin() -> None:
    first, slightly, better, lawless = trajectory(1.0), trajectory(1.2), trajectory(1.5), trajectory(3.0, violations=1)
    found = best_of([first, slightly, better, lawless], violation=3.0, margin=0.25)
    assert found is not None
    assert found[0] is better
    assert found[1].tolist() == [1.0, 1.2, 1.5, 0.0]
    assert best_of([first, slightly], violation=3.0, margin=0.25)[0] is first  # type: ignore[index]
    falls = [trajectory(5.0), trajectory(1.0), trajectory(3.0)]
    assert best_of(falls, violation=3.0, margin=0.25)[0] is falls[0]  # type: ignore[index]
    assert best_of([first, None], violation=3.0, margin=0.25) is None


def test_an_episode_is_driven_decision_by_decision(tmp_path: Path) -> None:
    kept = roll_out(SHORT_EPISODES, 7, keeps_lane)
    assert kept is not None
    assert kept.observations.shape == (6, 106)
    assert kept.actions.tolist() == [Manoeuvre.KEEP] * 6
    stopped = roll_out(SHORT_EPISODES, 7, lambda *_: Manoeuvre.STOP)
    assert stopped is not None
    assert stopped.reward < kept.reward
    assert (stopped.observations[0] == kept.observations[0]).all()
    again = roll_out(SHORT_EPISODES, 7, EXPERTS["keeps-lane"])
    assert again is not None
    assert again.reward == kept.reward
    assert roll_out(EnvOptions(template="S2", values="emv.speed_mps=-1"), 7, keeps_lane) is None, "it cannot be made"
    with pytest.raises(InputError, match="an episode can be made"):
        trained_driver(tmp_path / "driver.onnx", DriverFit(episodes=(1,), templates=("S99",)), 1, print)


TASK = {"decision_s": 0.5, "duration_s": 6.0}
SHORT = {"decision_s": 0.5, "duration_s": 3.0}
CONFIG = DriverFit(episodes=(2, 1), tries=1, passes=60, templates=(quick_template("S6"),), levels=(2,), task=SHORT)


def test_it_imitates_the_best_and_drives_too_after_the_first_round(tmp_path: Path) -> None:
    lines: list[str] = []
    card = trained_driver(tmp_path / "driver.onnx", CONFIG, 1, lines.append)
    first, second = card["rounds"]
    assert (first["episodes"], second["episodes"]) == (2, 1)
    assert "pupil" not in first
    assert {"pupil", "tries"} <= second.keys()
    for row in (first, second):
        scores = [value for name, value in row.items() if name not in {"episodes", "best"}]
        assert row["best"] >= max(scores)
    assert len(lines) == 2
    driver = open_driver(tmp_path / "driver.onnx")
    assert driver.steps_per_decision == 10
    assert driver.choose.args[0].card["task"]["duration_s"] == 3.0
    again = trained_driver(tmp_path / "again.onnx", CONFIG, 1, lines.append)
    assert again["sha256"] == card["sha256"]


def test_a_network_can_learn_what_a_rule_does(tmp_path: Path) -> None:
    s2 = quick_template("S2")
    config = DriverFit(episodes=(2,), passes=200, templates=(s2,), levels=(2,), violation=0.0, margin=1e9, task=TASK)
    trained_driver(tmp_path / "driver.onnx", config, 1, lambda _: None)  # the first expert is always the best
    driver = open_driver(tmp_path / "driver.onnx")
    env, same, pulled = YieldEnv(template=s2, level=2, **TASK), [], []
    observation, _ = env.reset(seed=0)
    over = False
    while not over:
        action = pulls_over(observation, env.moment)
        (logits,) = driver.choose.args[0].session.run([OUTPUT], {INPUT: observation[None]})
        assert observation.shape == (VECTOR_SIZE,)
        same.append(int(np.argmax(logits[0])) == action)
        pulled.append(action == Manoeuvre.PULL_OVER)
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
    env.close()
    assert np.mean(same) > 0.85
    assert any(pulled), "the rule does not always do the same"
