"""A driver in the civilian's seat: it imitates a rule first, then learns by PPO of Stable-Baselines3."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import SubprocVecEnv
from torch import Tensor, nn

from siren_ros.evaluation.network_file import write_network
from siren_ros.learning.environment import YieldEnv
from siren_ros.learning.features import SIZE
from siren_ros.learning.policy import INPUT, OUTPUT, open_policy
from siren_ros.learning.task import Task
from siren_ros.learning.trial import Outcome, driven, keeps_lane, makes_way, means, of_the_model
from siren_ros.training.fitting.descent import exported
from siren_ros.training.settings import DriverFit, FittedNetwork


class _Logits(nn.Module):
    """The policy's network, to the logits of the manoeuvres."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor) -> Tensor:
        features = self.policy.extract_features(observation, self.policy.pi_features_extractor)
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))


class _Clock(BaseCallback):
    """Ends a training when its wall time is over, and says how it does."""

    def __init__(self, minutes: float, report: Callable[[str], None]) -> None:
        super().__init__()
        self._end_s, self._report = time.monotonic() + 60.0 * minutes, report

    def _on_step(self) -> bool:
        return time.monotonic() < self._end_s

    def _on_rollout_end(self) -> None:
        rewards = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        mean = f"{np.mean(rewards):.2f}" if rewards else "none yet"
        self._report(f"{self.num_timesteps} decisions, mean reward of the last episodes {mean}")


def fitted_driver(config: DriverFit, report: Callable[[str], None]) -> FittedNetwork:
    """Fits a driver and exports it.

    Args:
        config: The settings; the same ones give other weights on a faster machine, because time ends the training.
        report: Takes a line about the progress.
    """
    torch.set_num_threads(1)
    task = Task(**config.task)
    made = partial(_environment, dict(config.task))
    environments = SubprocVecEnv([made] * config.environments, start_method="forkserver")
    try:
        model = PPO(
            "MlpPolicy",
            environments,
            learning_rate=config.learning_rate,
            n_steps=config.decisions,
            batch_size=config.batch,
            gamma=config.gamma,
            ent_coef=config.entropy,
            seed=config.seed,
            device="cpu",
            policy_kwargs={"net_arch": list(config.widths)},
        )
        began_s = time.monotonic()
        _imitate(model, task, config, report)
        left = config.minutes - (time.monotonic() - began_s) / 60.0
        if left > 0.0:
            model.learn(10**9, callback=_Clock(left, report))
    finally:
        environments.close()
    answer = _Logits(model.policy)
    free = {INPUT: "episodes", OUTPUT: "episodes"}
    return exported(model.policy, answer, (torch.zeros(1, SIZE),), [INPUT], [OUTPUT], free)


def trained_driver(
    path: Path, config: DriverFit, trials: Mapping[str, Sequence[int]], report: Callable[[str], None]
) -> Mapping[str, Any]:
    """Fits a driver, tries it next to others on seeds that the training did not draw, and writes it with its card.

    Args:
        path: The ONNX file; its card is next to it.
        config: The settings.
        trials: Seeds by the map.
        report: Takes lines about the progress.

    Returns:
        The card.

    Raises:
        InputError: The folder cannot be written, or a map has no place for the template.
    """
    began_s = time.monotonic()
    network = fitted_driver(config, report)
    task = Task(**config.task)
    fitted = network.card(config, kind="driver", task=asdict(task), minutes=(time.monotonic() - began_s) / 60.0)
    write_network(path, network.onnx, fitted)
    drivers: dict[str, Callable[[Task, int], Outcome]] = {
        "learned": partial(driven, choose=open_policy(path)),
        "rule": partial(driven, choose=makes_way),
        "idm": partial(driven, choose=keeps_lane),
        "paper": of_the_model,
    }
    figures: dict[str, Any] = {}
    for place, seeds in trials.items():
        there = replace(task, map=place)
        for name, drive in drivers.items():
            outcomes = [drive(there, seed) for seed in seeds]
            row = figures.setdefault(place or "town", {})[name] = means(outcomes)
            report(f"{place or 'town'}, {name}: " + ", ".join(f"{key} {value:.2f}" for key, value in row.items()))
    card = {
        **fitted,
        "trials": figures,
        "trial_seeds": {place or "town": list(seeds) for place, seeds in trials.items()},
    }
    write_network(path, network.onnx, card)
    return card


def _environment(options: dict[str, Any]) -> Any:
    return Monitor(YieldEnv(**options))


def _imitate(model: Any, task: Task, config: DriverFit, report: Callable[[str], None]) -> None:
    """Fits the policy to what the rule ``makes_way`` does."""
    seen, done = [], []
    environment = YieldEnv(**{**vars(task), "rulebook": ""})
    for seed in range(task.seeds[0], task.seeds[0] + config.imitated):
        observation, _ = environment.reset(seed=seed)
        over = False
        while not over:
            action = makes_way(observation, environment.moment)
            seen.append(observation)
            done.append(action)
            observation, _, terminated, truncated, _ = environment.step(action)
            over = terminated or truncated
    environment.close()
    if not seen:
        return
    observations, actions = torch.as_tensor(np.array(seen)), torch.as_tensor(np.array(done))
    rare = torch.bincount(actions, minlength=int(model.action_space.n)).clamp(min=1).float()
    weights = (len(actions) / rare)[actions]
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=config.imitation_rate)
    for _ in range(config.imitation_passes):
        _, likelihood, _ = model.policy.evaluate_actions(observations, actions)
        loss = -(weights * likelihood).sum() / weights.sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    report(f"{config.imitated} episodes imitated, {len(actions)} decisions, loss {loss.item():.3f}")
