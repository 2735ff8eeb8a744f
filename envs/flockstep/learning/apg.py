"""Analytic policy gradients: training by the derivatives of the flight itself."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from flockstep._core import GradientConfig, _unexpected_keyword
from flockstep.keywords import add_fields
from flockstep.learning import loop
from flockstep.learning.callbacks import Callbacks
from flockstep.learning.ppo import PPO
from flockstep.learning.sb3_models import HYPERPARAMETERS, Schedule
from flockstep.learning.sources import EngineSource, Source, Stepped

_LOG_STD = -2.0


class APG(PPO):
    """Analytic policy gradients in C++: flight policies in seconds, for the engine's tasks whose loss has derivatives.

    Each update flies ``horizon`` steps with the mean actions and backpropagates a loss of the task through the flight,
    the observations and the network. Rewards are not used: the task has a loss of its own, with
    smooth terms in place of contacts. Networks, files, `predict`, callbacks and logs are those of `PPO`, and
    ``PPO.load(path, envs, learning_rate=...)`` goes on with rewards. Callbacks are called after each update.

    >>> race = flockstep.presets["race_apg"]
    >>> model = flockstep.APG("MlpPolicy", race.make_envs(), **race)
    >>> model.learn(race.steps)

    Parameters
    ----------
    policy
        ``"MlpPolicy"``.
    env
        A `DroneVectorEnv` with such a task and quadrotors, whose control is ``rotor_speeds``, ``rotor_thrusts``,
        ``body_rates``, ``velocity`` or ``heading_velocity``. Observations have no history, and ``autoreset_mode`` is
        not ``"disabled"``.
    learning_rate
        Step size of Adam. A number falls to 0 along a cosine; a function takes the remaining share of the training,
        which falls from 1 to 0.
    policy_kwargs
        As for `PPO`, with ``"FlattenExtractor"`` or ``"PointFeatures"``. ``log_std_init``, -2 by default, matters
        only if `PPO` goes on.
    **others
        ``stats_window_size``, ``tensorboard_log``, ``verbose``, ``seed`` and the number of threads, as for `PPO`.

    Raises
    ------
    ValueError, TypeError
        A value is not allowed, or a part of the environment has no derivative; the message names it.
    """

    def __init__(
        self,
        policy: str,
        env: Any,
        learning_rate: Schedule = 1e-2,
        horizon: int = 32,
        gamma: float = 0.99,
        max_grad_norm: float = 1.0,
        ticks: int = 1,
        *,
        policy_kwargs: Mapping[str, Any] | None = None,
        **others: Any,
    ) -> None:
        for name in others:
            if name in HYPERPARAMETERS:  # of PPO alone
                raise TypeError(f"APG.__init__: expected no {name}, which belongs to PPO")
            if name not in inspect.signature(PPO).parameters:
                raise TypeError(_unexpected_keyword("APG.__init__", name, [*inspect.signature(APG).parameters]))
        self.horizon, self.ticks = horizon, ticks
        super().__init__(
            policy,
            env,
            learning_rate=learning_rate,
            gamma=gamma,
            max_grad_norm=max_grad_norm,
            policy_kwargs={"log_std_init": _LOG_STD, **(policy_kwargs or {})},
            batch_size=2,  # of a later training by PPO, which sets its own
            **others,
        )

    horizon: int = 32
    ticks: int = 1

    def _make_learner(self, *arguments: Any, **named: Any) -> None:
        super()._make_learner(*arguments, **named)
        self._check(self.source)  # with the networks

    def _check(self, source: Source | None = None) -> None:
        super()._check()
        config = self._gradient_config(1.0)
        if source is None:
            return
        if not isinstance(source, EngineSource):
            raise ValueError(
                f"env: expected a DroneVectorEnv with a task of the engine, got {getattr(source, 'env', None)!r}"
            )
        if source.env.autoreset_mode is AutoresetMode.DISABLED:
            raise ValueError("autoreset_mode: expected 'next_step' or 'same_step', got 'disabled'")
        self.learner.require_derivatives(config, source.env.batch)

    def _gradient_config(self, remaining: float) -> GradientConfig:
        rate = self.learning_rate
        rate = rate(remaining) if callable(rate) else rate * 0.5 * (1.0 - math.cos(math.pi * remaining))
        return GradientConfig(
            horizon=self.horizon,
            learning_rate=float(rate),
            gamma=self.gamma,
            max_grad_norm=self.max_grad_norm,
            ticks=self.ticks,
        )

    def _collect(self, callbacks: Callbacks, bar: Any) -> bool:
        """Fly a window and learn from it; return False if a callback stops the training."""
        assert isinstance(self.source, EngineSource)
        batch = self.source.env.batch
        callbacks.start_rollout()
        with loop.naming_step(self.num_timesteps):
            report = self.learner.learn_window(self._gradient_config(self._current_progress_remaining), batch)
            if not report.is_finite:
                raise FloatingPointError("the gradient is not finite: learning_rate or horizon are too large")
        self.source.env._flown(steps=self.horizon)
        steps = self.source.rows * self.horizon
        self.num_timesteps += steps
        self._n_updates += 1
        self.ep_success_buffer.extend([1.0] * report.successes + [0.0] * (report.episodes - report.successes))
        for name in report.__match_args__:
            if isinstance(value := getattr(report, name), float):
                self.logger.record(f"train/{name}", value)
        if bar is not None:
            bar.update(steps)
        done = (batch.terminated | batch.truncated) & batch.flying
        goes_on = callbacks.step(Stepped(np.array(batch.reward), done, [{} for _ in range(self.source.rows)]))
        callbacks.end_rollout()
        return goes_on

    def _train(self) -> None:
        """Do nothing: a window is learned from as soon as it was flown."""


add_fields(APG, GradientConfig, before="policy_kwargs")
