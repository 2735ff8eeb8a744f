"""Train by a row of the table, with `flockstep.PPO` or Stable-Baselines3."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Sequence
from typing import Any, Literal

from flockstep.learning import APG, PPO
from flockstep.registration import make_same_step
from flockstep.trainings.training import Training, first_env_seed

Learner = Literal["flockstep", "sb3"]


class Callback:
    """A callback of a training by either learner, with the calls of Stable-Baselines3's ``BaseCallback``."""

    model: Any

    def init_callback(self, model: Any) -> None:
        """Get the model."""
        self.model = model

    def on_training_start(self, local: Any, global_: Any) -> None:
        """Begin."""

    def on_rollout_start(self) -> None:
        """Begin a rollout."""

    def update_locals(self, local: Any) -> None:
        """Get the results of the step."""

    update_child_locals = update_locals

    def on_step(self) -> bool:
        """Return False to end the training."""
        return True

    def on_rollout_end(self) -> None:
        """End a rollout."""

    def on_training_end(self) -> None:
        """End."""


class _Schedule(Callback):
    """Lets the entropy bonus fall."""

    def __init__(self, training: Training) -> None:
        self.training = training

    def on_rollout_start(self) -> None:
        done = self.model.num_timesteps / self.training.steps
        self.model.ent_coef = self.training.entropy * max(0.0, 1.0 - done / 0.8)


def make(training: Training, num_envs: int, threads: int) -> Any:
    """Make the environments of a training: a `DroneVectorEnv`, or a ``VecEnv`` of several."""
    keywords = {"stagger_first_episode": True, "num_threads": threads, **training.learns()}
    teams = keywords.get("drones_per_env")
    if not isinstance(teams, dict):
        return make_same_step("train", training.env, num_envs, **keywords)
    from flockstep.sb3 import DroneVecEnv
    from flockstep.sb3.side_by_side import SideBySide

    made = [
        make_same_step("train", training.env, rows // drones, **{**keywords, "drones_per_env": drones})
        for drones, rows in teams.items()
    ]
    return SideBySide([DroneVecEnv(envs) for envs in made])


def train(
    training: Training, learner: Learner = "flockstep", seed: int = 0, threads: int = 0, callbacks: Sequence[Any] = ()
) -> Any:
    """Train once, and return the model.

    Parameters
    ----------
    training, learner, seed
        What to train, by which PPO, and the seed of networks and environments.
    threads
        Number of threads of environments and learner; 0: one per physical core. Stable-Baselines3 learns with one.
    callbacks
        Further callbacks: a `Callback`, or those of Stable-Baselines3.
    """
    if learner == "sb3":
        if training.learner != "PPO":
            raise ValueError(f"learner: expected 'flockstep' for a training by {training.learner}, got 'sb3'")
        _require_sb3()
    envs = make(training, training.num_envs, threads)
    first = first_env_seed(seed, training.num_envs)  # the seeds of the model are also those of other trainings
    both = [_Schedule(training), *callbacks]
    if learner == "flockstep":
        settings = {**training.settings}
        kind, rate = _learner(training)
        if training.falls:
            settings["learning_rate"] = lambda left: rate - (1.0 - left) * rate
        model = kind("MlpPolicy", envs, seed=seed, num_threads=threads, **settings)
        if hasattr(envs, "env_is_wrapped"):  # a VecEnv keeps its seed for its reset
            envs.seed(first)
        else:
            envs.reset(seed=first)
            model.set_env(envs, force_reset=False)
        model.learn(training.steps, both, log_interval=None, reset_num_timesteps=hasattr(envs, "env_is_wrapped"))
    else:
        model = _sb3(training, envs, seed, first, both)
    envs.close()
    return model


def _learner(training: Training) -> tuple[type[PPO], float]:
    """Return the class that trains, and its learning rate at the start."""
    kind = APG if training.learner == "APG" else PPO
    return kind, training.settings.get("learning_rate", inspect.signature(kind).parameters["learning_rate"].default)


def _require_sb3() -> None:
    """Raise an error that says what is missing and how to install it."""
    importlib.import_module("flockstep.sb3")


def _sb3(training: Training, envs: Any, seed: int, first: int, callbacks: list[Any]) -> Any:
    import torch
    from stable_baselines3 import PPO as SB3
    from stable_baselines3.common.utils import LinearSchedule

    from flockstep import sb3

    torch.set_num_threads(1)
    named = dict(training.settings.get("policy_kwargs", {}))
    if "activation_fn" in named:
        named["activation_fn"] = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}[named["activation_fn"]]
    if "features_extractor_class" in named:
        named["features_extractor_class"] = getattr(sb3, named["features_extractor_class"])
    # No function: the saved policy would contain its bytecode, which crashes another Python version.
    settings = {**training.settings}
    if training.falls:
        settings["learning_rate"] = LinearSchedule(_learner(training)[1], 0.0, 1.0)
    venv = envs if hasattr(envs, "env_is_wrapped") else sb3.DroneVecEnv(envs)
    model: Any = SB3("MlpPolicy", venv, seed=seed, device="cpu", **{**settings, "policy_kwargs": named})
    venv.seed(first)
    model.learn(training.steps, callbacks, log_interval=None)
    return model


def load(path: Any, learner: Learner) -> Any:
    """Load a policy; one of Stable-Baselines3 runs code from its file."""
    if learner == "flockstep":
        return PPO.load(path)
    _require_sb3()
    from stable_baselines3 import PPO as SB3

    return SB3.load(path, device="cpu")
