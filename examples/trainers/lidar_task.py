"""What the trainers in this folder share: the task, what a network sees of it, and when it is learned.

The settings are those of the README's first training. The policy flies the seven playgrounds before every update; once
it flies six of them, the run ends.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import torch
from torch import nn

import flockstep

ID, NUM_ENVS, ENOUGH = "flockstep/LidarNavigation-v0", 256, 6
REWARD = flockstep.NavigationReward(goal_reward=100)  # the default, 10,000, drowns all else
SETTINGS = {"random_world": True, "max_episode_steps": 400, "reward": REWARD, "reward_scale": 0.1}
Policy = Callable[[np.ndarray], np.ndarray]  # from observations (N, 38) to actions (N,)


@dataclass
class Options:
    """Learn to fly by LiDAR until the policy flies six of the seven playgrounds."""

    updates: int = 60
    """Give up after so many updates."""
    seed: int = 0
    """Of the envs, the network and the actions."""


class GoalFeatures(nn.Module):
    """The direction to the goal, doubled, and how near the obstacles are: `flockstep.sb3.GoalFeatures` without SB3."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Turn observations (..., 38) into features (..., 38)."""
        return torch.cat([2 * observation[..., :3], -torch.log(observation[..., 3:] + 0.05)], dim=-1)


def network(outputs: int, gain: float) -> nn.Sequential:
    """Return the usual network of PPO; its outputs are about ``gain`` at first."""
    layers = [nn.Linear(38, 64), nn.Linear(64, 64), nn.Linear(64, outputs)]
    for layer, size in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, size)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(GoalFeatures(), layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


def playgrounds_flown(policy: Policy) -> int:
    """Fly the five playgrounds of "train" and the two of "validation" once; return in how many the goal was reached."""
    envs = flockstep.DroneVectorEnv(7, worlds=("train", "validation"), max_episode_steps=400, autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    over = np.zeros(7, bool)
    while not over.all():  # an env whose episode is over stays as it is
        observation, _, terminated, truncated, infos = envs.step(policy(observation))
        over = terminated | truncated
    return int(infos["success"].sum())


class Run:
    """Tells a trainer when to stop, and prints at the end how it went. Flights of the playgrounds are not timed."""

    def __init__(self, package: str, autoreset_mode: str, options: Options) -> None:
        torch.set_num_threads(1)  # the networks are small
        torch.manual_seed(options.seed)
        self.trainer, self.updates = f"{package} {version(package)}, {autoreset_mode}", options.updates
        self.count, self.seconds, self.began = 0, 0.0, 0.0

    def goes_on(self, steps: int, policy: Policy) -> bool:
        """Return whether another update is due. To be called before each, with the steps flown so far."""
        self.seconds += time.perf_counter() - self.began if self.count else 0.0
        flown = playgrounds_flown(policy)
        if flown >= ENOUGH or self.count == self.updates:
            rate = steps / self.seconds if self.count else 0.0
            print(f"{self.trainer}: {flown} of 7 playgrounds after {steps:,} steps, {rate:,.0f} steps/s")
            return False
        self.count, self.began = self.count + 1, time.perf_counter()
        return True
