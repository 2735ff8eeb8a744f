"""Shared code of the trainers in this folder: the task, the network's features, and the stopping rule.

All trainers use the same settings. The policy flies the seven playgrounds before every update; the
run ends when it reaches the goal in six of them.
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
REWARD = flockstep.NavigationReward(goal_reward=100)  # the default, 10,000, dwarfs every other term
SETTINGS = {"random_world": True, "max_episode_steps": 400, "reward": REWARD, "reward_scale": 0.1}
Policy = Callable[[np.ndarray], np.ndarray]  # from observations (N, 38) to actions (N,)


@dataclass
class Options:
    """Learn to fly by LiDAR until the policy flies six of the seven playgrounds."""

    updates: int = 60
    """Maximum number of updates."""
    seed: int = 0
    """Seed of the envs, the network and the actions."""


class GoalFeatures(nn.Module):
    """The doubled direction to the goal and the nearness of obstacles: `flockstep.sb3.GoalFeatures` without SB3."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Convert observations (..., 38) into features (..., 38)."""
        return torch.cat([2 * observation[..., :3], -torch.log(observation[..., 3:] + 0.05)], dim=-1)


def network(outputs: int, gain: float) -> nn.Sequential:
    """Return the usual PPO network, with initial outputs of about ``gain``."""
    layers = [nn.Linear(38, 64), nn.Linear(64, 64), nn.Linear(64, outputs)]
    for layer, size in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, size)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(GoalFeatures(), layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


def playgrounds_flown(policy: Policy) -> int:
    """Fly the five playgrounds of "train" and the two of "validation" once; return the number of goals reached."""
    envs = flockstep.DroneVectorEnv(7, worlds=("train", "validation"), max_episode_steps=400, autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    over = np.zeros(7, bool)
    while not over.all():  # finished envs stay unchanged
        observation, _, terminated, truncated, infos = envs.step(policy(observation))
        over = terminated | truncated
    return int(infos["success"].sum())


class Run:
    """Decides when a trainer stops, and prints the result at the end. Flights of the playgrounds are not timed."""

    def __init__(self, package: str, autoreset_mode: str, options: Options) -> None:
        if options.updates < 0:
            raise SystemExit(f"--updates: expected at least 0, got {options.updates}")
        torch.set_num_threads(1)  # the networks are small
        torch.manual_seed(options.seed)
        self.trainer, self.updates = f"{package} {version(package)}, {autoreset_mode}", options.updates
        self.count, self.seconds, self.began = 0, 0.0, 0.0

    def goes_on(self, steps: int, policy: Policy) -> bool:
        """Return True if another update is due. Call it before each update with the steps flown so far."""
        self.seconds += time.perf_counter() - self.began if self.count else 0.0
        flown = playgrounds_flown(policy)
        if flown >= ENOUGH or self.count == self.updates:
            rate = steps / self.seconds if self.count else 0.0
            print(f"{self.trainer}: {flown} of 7 playgrounds after {steps:,} steps, {rate:,.0f} steps/s")
            return False
        self.count, self.began = self.count + 1, time.perf_counter()
        return True
