"""The training of a driver, with a tiny budget."""

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the extra rl is not installed")
pytest.importorskip("gymnasium", reason="the extra rl is not installed")

import numpy as np
from recorded_episode import quick_template

from siren_ros.errors import InputError
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.imitation import pulls_over
from siren_ros.lab.training.fitting.driver import trained_driver
from siren_ros.lab.training.settings import DriverFit
from siren_ros.running.seat.drivers.learned import INPUT, OUTPUT, open_driver
from siren_ros.running.seat.features import SIZE
from siren_ros.running.seat.manoeuvres import Manoeuvre

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
    assert driver.network.card["task"]["duration_s"] == 3.0
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
        (logits,) = driver.network.session.run([OUTPUT], {INPUT: observation[None]})
        assert observation.shape == (SIZE,)
        same.append(int(np.argmax(logits[0])) == action)
        pulled.append(action == Manoeuvre.PULL_OVER)
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
    env.close()
    assert np.mean(same) > 0.85
    assert any(pulled), "the rule does not always do the same"


def test_a_template_that_does_not_exist_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="an episode can be made"):
        trained_driver(tmp_path / "driver.onnx", DriverFit(episodes=(1,), templates=("S99",)), 1, lambda _: None)
