"""The arguments of `PPO`, in the order of Stable-Baselines3; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from flockstep.learning.sb3_models import Schedule


class Arguments:
    """Takes the arguments of `PPO`.

    Parameters
    ----------
    learning_rate
        Step size of Adam. A number, or a function of the remaining share of the training, which falls from 1 to 0.
    n_steps
        Steps of each row between two updates.
    batch_size
        Steps in a minibatch. A rollout has n_steps of each agent.
    n_epochs
        Passes over the rollout.
    gamma
        Discount factor of rewards per step.
    gae_lambda
        Weight of long against short estimates of the advantage.
    clip_range
        The ratio of probabilities is clipped to [1 - clip_range, 1 + clip_range]. A number, or a function of the
        remaining share of the training, which falls from 1 to 0.
    clip_range_vf
        Largest change of the value by an update, in the unit of the returns. None: not clipped. A number, or a function
        of the remaining share of the training, which falls from 1 to 0.
    normalize_advantage
        Shift and scale the advantages of each minibatch to mean 0 and standard deviation 1.
    ent_coef
        Weight of the entropy bonus.
    vf_coef
        Weight of the squared error of the value.
    max_grad_norm
        Greatest norm of the gradient.
    target_kl
        An update stops when a minibatch's approximate KL divergence exceeds 1.5 times this. None: never.
    critic_only
        Numbers at the end of an observation that only the critic gets, as they are, past the features. The policy acts
        without them.
    normalize_observations
        Shift and scale each number of the observations to mean 0 and variance 1, both estimated from all observations
        so far that were flown from, and clip the results to +-10, as `VecNormalize` of Stable-Baselines3.
    normalize_rewards
        Divide rewards by the standard deviation of the discounted returns so far and clip the results to +-10, as
        `VecNormalize` of Stable-Baselines3.
    """

    learning_rate: Schedule
    n_steps: int
    batch_size: int
    n_epochs: int
    gamma: float
    gae_lambda: float
    clip_range: Schedule
    clip_range_vf: Schedule | None
    normalize_advantage: bool
    ent_coef: float
    vf_coef: float
    max_grad_norm: float
    target_kl: float | None
    critic_only: int
    normalize_observations: bool
    normalize_rewards: bool

    def __init__(
        self,
        policy: str,
        env: Any,
        learning_rate: Schedule = 0.0003,
        n_steps: int = 2048,
        batch_size: int = 64,
        n_epochs: int = 10,
        gamma: float = 0.99,
        gae_lambda: float = 0.95,
        clip_range: Schedule = 0.2,
        clip_range_vf: Schedule | None = None,
        normalize_advantage: bool = True,
        ent_coef: float = 0.0,
        vf_coef: float = 0.5,
        max_grad_norm: float = 0.5,
        use_sde: bool = False,
        sde_sample_freq: int = -1,
        rollout_buffer_class: Any = None,
        rollout_buffer_kwargs: Mapping[str, Any] | None = None,
        target_kl: float | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | PathLike[str] | None = None,
        policy_kwargs: Mapping[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: Any = "auto",
        _init_setup_model: bool = True,
        *,
        num_threads: int = 0,
        critic_only: int = 0,
        normalize_observations: bool = False,
        normalize_rewards: bool = False,
        **unknown: NoReturn,
    ) -> None:
        self._set_up(
            policy=policy,
            env=env,
            learning_rate=learning_rate,
            n_steps=n_steps,
            batch_size=batch_size,
            n_epochs=n_epochs,
            gamma=gamma,
            gae_lambda=gae_lambda,
            clip_range=clip_range,
            clip_range_vf=clip_range_vf,
            normalize_advantage=normalize_advantage,
            ent_coef=ent_coef,
            vf_coef=vf_coef,
            max_grad_norm=max_grad_norm,
            use_sde=use_sde,
            sde_sample_freq=sde_sample_freq,
            rollout_buffer_class=rollout_buffer_class,
            rollout_buffer_kwargs=rollout_buffer_kwargs,
            target_kl=target_kl,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            policy_kwargs=policy_kwargs,
            verbose=verbose,
            seed=seed,
            device=device,
            _init_setup_model=_init_setup_model,
            num_threads=num_threads,
            critic_only=critic_only,
            normalize_observations=normalize_observations,
            normalize_rewards=normalize_rewards,
            **unknown,
        )

    def _set_up(self, policy: str, env: Any, **others: Any) -> None:
        raise NotImplementedError

    __init__.__qualname__ = "PPO.__init__"
