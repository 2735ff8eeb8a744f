"""Conversions between the learner's models and those of Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import numpy as np

from flockstep.learning.networks import FEATURES

_SHARED = (
    "n_steps",
    "batch_size",
    "n_epochs",
    "gamma",
    "gae_lambda",
    "normalize_advantage",
    "ent_coef",
    "vf_coef",
    "max_grad_norm",
    "target_kl",
)


def to_sb3(model: Any) -> Any:
    """Return a ``PPO`` of Stable-Baselines3 with the network and hyperparameters of a model."""
    import torch
    from gymnasium import spaces
    from stable_baselines3 import PPO

    import flockstep.sb3

    config = model.learner.config
    arguments: dict[str, Any] = {
        "net_arch": {"pi": config.actor_layers, "vf": config.critic_layers},
        "activation_fn": torch.nn.Tanh if config.activation == "tanh" else torch.nn.ReLU,
    }
    names = {features: name for name, features in FEATURES.items() if name.endswith("Features")}
    if config.features in names:
        arguments["features_extractor_class"] = getattr(flockstep.sb3, names[config.features])
    if model.normalize_observations:
        mean, variance, _ = model.learner.observation_moments
        inner = arguments.get("features_extractor_class")
        arguments["features_extractor_class"] = flockstep.sb3.NormalizedFeatures
        arguments["features_extractor_kwargs"] = {
            "mean": mean.tolist(),
            "variance": variance.tolist(),
            "inner": inner,
        }
    made = PPO(
        "MultiInputPolicy" if isinstance(model.observation_space, spaces.Dict) else "MlpPolicy",
        None,
        learning_rate=model.learning_rate,
        clip_range=model.clip_range,
        clip_range_vf=model.clip_range_vf,
        policy_kwargs=arguments,
        device="cpu",
        _init_setup_model=False,
        **{name: getattr(model, name) for name in _SHARED},
    )
    made.observation_space, made.action_space = model.observation_space, model.action_space
    made.n_envs = model.n_envs
    made._setup_model()
    made.num_timesteps, made._n_updates = model.num_timesteps, model._n_updates
    state = made.policy.state_dict()
    parameters = model.learner.parameters
    for name, shape, first in model.learner.layout:
        values = parameters[first : first + int(np.prod(shape))].reshape(shape)
        state[name] = torch.as_tensor(values.copy())
    made.policy.load_state_dict(state)
    return made


def from_sb3(cls: Any, model: Any, env: Any) -> Any:
    """Return a model of ``cls`` with the network and hyperparameters of a ``PPO`` of Stable-Baselines3."""
    policy = model.policy
    if type(model).__name__ != "PPO":
        raise ValueError(f"model: expected a PPO of Stable-Baselines3, got {type(model).__name__}")
    if model.use_sde:
        raise ValueError("model: expected use_sde=False, got state-dependent exploration, which the learner lacks")
    extractor = type(policy.features_extractor).__name__
    if extractor not in FEATURES:
        raise ValueError(f"model: expected features of {', '.join(FEATURES)}, got {extractor}")
    arguments = {
        "net_arch": _net_arch(policy.net_arch),
        "activation_fn": policy.activation_fn,
        "features_extractor_class": extractor,
    }
    source = model.get_env() if env is None else env
    made = cls._without_env(
        "MultiInputPolicy" if extractor == "CombinedExtractor" else "MlpPolicy",
        model.observation_space,
        model.action_space,
        arguments,
        {
            **{name: getattr(model, name) for name in _SHARED},
            "learning_rate": model.learning_rate,
            "clip_range": _plain_schedule(model.clip_range),
            "clip_range_vf": None if model.clip_range_vf is None else _plain_schedule(model.clip_range_vf),
            "seed": model.seed,
        },
    )
    if source is not None:
        made.set_env(source)
    state = policy.state_dict()
    named = {name: value.detach().cpu().numpy() for name, value in state.items()}
    parameters = np.zeros(len(made.learner.parameters), np.float32)
    for name, shape, first in made.learner.layout:
        if name not in named or named[name].shape != tuple(shape):
            raise ValueError(f"model: expected the parameter {name} of shape {tuple(shape)}")
        parameters[first : first + int(np.prod(shape))] = named[name].ravel()
    made.learner.parameters = parameters
    made.num_timesteps, made._n_updates = model.num_timesteps, model._n_updates
    return made


def _net_arch(given: Any) -> Any:
    return given if isinstance(given, dict) else list(given)


def _plain_schedule(schedule: Any) -> Any:
    """Return the number behind a constant schedule of Stable-Baselines3, or the schedule."""
    values = {float(schedule(share)) for share in (0.0, 0.25, 0.5, 1.0)}
    return values.pop() if len(values) == 1 else schedule
