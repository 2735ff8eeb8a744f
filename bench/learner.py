"""Measure the learner: one update beside Stable-Baselines3's, and drawing actions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import configure

import flockstep
from flockstep import _core
from timing import RUNS, Measured, Median, in_turns, median_ratio, timed

Array = npt.NDArray[Any]

INPUTS, ACTIONS, STEPS, ROWS, EPOCHS = 38, 3, 32, 512, 3
MINIBATCHES = (4096, 1024)


def measure(runs: int = RUNS) -> Iterator[Measured]:
    """Measure microseconds per step of the rollout, and their ratios."""
    torch.set_num_threads(1)
    ours, rollout = ours_and_its_rollout()
    walled = partial(timed, clock=time.perf_counter)
    timers = {"act": walled(partial(collect, ours, rollout))}
    for size in MINIBATCHES:
        config, model = _core.UpdateConfig(batch_size=size, n_epochs=EPOCHS), sb3(size)
        timers[f"flockstep{size}"] = walled(partial(ours.update, config))
        timers[f"sb3{size}"] = walled(model.train, before=partial(fill, model, rollout))
    times = in_turns(timers, runs)
    us = {name: 1e6 * Median(seconds) / (STEPS * ROWS) for name, seconds in times.items()}
    yield "learner/act/microseconds", us["act"], "us", runs
    for size in MINIBATCHES:
        name, both = f"learner/update/minibatch{size}", (f"flockstep{size}", f"sb3{size}")
        yield f"{name}/flockstep_microseconds", us[both[0]], "us", runs
        yield f"{name}/sb3_microseconds", us[both[1]], "us", runs
        yield f"{name}/ratio", median_ratio(times[both[0]], times[both[1]]), "1", runs


def ours_and_its_rollout() -> tuple[Any, dict[str, Array]]:
    """Return a learner, and random observations, rewards and ends of episodes."""
    random = np.random.default_rng(0)
    rollout = {
        "observation": random.normal(size=(STEPS + 1, ROWS, INPUTS)).astype(np.float32),
        "reward": random.normal(size=(STEPS, ROWS)).astype(np.float32),
        "done": random.random((STEPS, ROWS)) < 0.01,
    }
    return _core.Learner(_core.NetworkConfig(observation_size=INPUTS, action_size=ACTIONS), 1, 0), rollout


def collect(learner: Any, rollout: dict[str, Array]) -> None:
    """Draw actions for the observations, and keep the results."""
    learner.begin(_core.RolloutConfig(n_steps=STEPS), ROWS)
    never = np.zeros(ROWS, bool)
    for t in range(STEPS):
        learner.act(t, rollout["observation"][t])
        learner.record(t, rollout["reward"][t], rollout["done"][t], never)
    learner.finish(rollout["observation"][STEPS])


class Spaces(flockstep.Task):
    """Declares the spaces; its envs are never stepped."""

    worlds = flockstep.World.from_dict({"flockstep_scene": 1, "name": "room", "room": {"min": [0] * 3, "max": [1] * 3}})
    observation_space = spaces.Box(-10, 10, (INPUTS,), np.float32)
    action_space = spaces.Box(-1, 1, (ACTIONS,), np.float32)


def sb3(batch_size: int) -> PPO:
    """Return a PPO of Stable-Baselines3 with the same networks."""
    envs = flockstep.sb3.make_vec(Spaces, ROWS)
    model = PPO("MlpPolicy", envs, n_steps=STEPS, batch_size=batch_size, n_epochs=EPOCHS, device="cpu", seed=0)
    model.set_logger(configure(format_strings=[]))
    return model


def fill(model: PPO, rollout: dict[str, Array]) -> None:
    """Fill the buffer of a model with the rollout, with the model's actions, values and log probabilities."""
    buffer = model.rollout_buffer
    assert isinstance(buffer, RolloutBuffer)
    buffer.reset()
    starts = np.zeros(ROWS, bool)
    with torch.no_grad():
        for t in range(STEPS):
            observation = rollout["observation"][t]
            actions, values, log_probs = model.policy(torch.as_tensor(observation))
            buffer.add(observation, actions.numpy(), rollout["reward"][t], starts, values, log_probs)
            starts = rollout["done"][t]
        last = model.policy.predict_values(torch.as_tensor(rollout["observation"][STEPS]))
    buffer.compute_returns_and_advantage(last, starts)
