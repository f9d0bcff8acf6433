"""The training of a driver, with a tiny budget."""

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the extra rl is not installed")
pytest.importorskip("stable_baselines3", reason="the extra rl is not installed")

import numpy as np

from siren_ros.learning.environment import YieldEnv
from siren_ros.learning.manoeuvres import Manoeuvre
from siren_ros.learning.policy import open_policy
from siren_ros.learning.task import Task
from siren_ros.learning.trial import makes_way
from siren_ros.training.fitting.driver import trained_driver
from siren_ros.training.settings import DriverFit

TASK = {"template": "S2", "level": 2, "decision_s": 0.5, "duration_s": 12.0}
CONFIG = DriverFit(minutes=0.1, environments=1, decisions=8, batch=8, imitated=2, imitation_passes=150, task=TASK)


def test_it_imitates_the_rule_and_is_tried_next_to_others(tmp_path: Path) -> None:
    lines: list[str] = []
    card = trained_driver(tmp_path / "driver.onnx", CONFIG, {"": [1000]}, lines.append)
    assert set(card["trials"]["town"]) == {"learned", "rule", "idm", "paper"}
    assert card["trial_seeds"] == {"town": [1000]}
    assert "2 episodes imitated" in lines[0]
    policy = open_policy(tmp_path / "driver.onnx")
    assert policy.task == Task(**TASK)
    env, same, pulled = YieldEnv(**TASK), [], []
    observation, _ = env.reset(seed=0)
    over = False
    while not over:
        action = makes_way(observation, env.moment)
        same.append(policy(observation, env.moment) == action)
        pulled.append(action == Manoeuvre.PULL_OVER)
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
    env.close()
    assert np.mean(same) > 0.85
    assert any(pulled), "the rule does not always do the same"
