"""Trains a driver that makes way by PPO: ./env --with rl python examples/train_driver.py --out driver.zip."""

import argparse

import siren_ros.learning  # noqa: F401 - registers the environments; it stands before what loads numpy

# isort: split
import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv

NAME = "siren_ros.learning:siren/Yield-v0"  # processes of the training import the part before the colon

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=50_000, help="decisions of the training")
    parser.add_argument("--rollout", type=int, default=512, help="decisions of an environment between two updates")
    parser.add_argument("--out", required=True, help="file of the trained policy")
    arguments = parser.parse_args()
    task = {"template": "S2", "level": 2, "decision_s": 0.5}
    environments = make_vec_env(NAME, n_envs=2, seed=0, env_kwargs=task, vec_env_cls=SubprocVecEnv)
    model = PPO("MlpPolicy", environments, n_steps=arguments.rollout, gamma=0.98, verbose=1, device="cpu", seed=0)
    model.learn(arguments.steps)
    model.save(arguments.out)
    environments.close()
    env = gymnasium.make(NAME, **task)
    observation, info = env.reset(seed=1000)  # the training draws seeds below 1000
    total, over = 0.0, False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, info = env.step(int(action))
        total, over = total + reward, terminated or truncated
    print(f"seed {info['seed']}: reward {total:.1f}, ended by {info['ended']}", info["clauses"])
    env.close()
