"""Conversions between the learner's models and those of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import RolloutConfig, UpdateConfig
from flockstep.learning.networks import FEATURES

_FLAT = "FlattenExtractor"

#: A number, or a function of the remaining share of the training, which falls from 1 to 0.
Schedule: TypeAlias = float | Callable[[float], float]
#: Hyperparameters that may be functions of the remaining training.
SCHEDULES = ("learning_rate", "clip_range", "clip_range_vf")
HYPERPARAMETERS = (*RolloutConfig.__match_args__, *UpdateConfig.__match_args__)
#: Other hyperparameters that both have under the same names.
SHARED = tuple(
    name for name in HYPERPARAMETERS if name not in (*SCHEDULES, "normalize_observations", "normalize_rewards")
)


def to_sb3(model: Any) -> Any:
    """Return a ``PPO`` of Stable-Baselines3 with the network and hyperparameters of a model."""
    import torch
    from stable_baselines3 import PPO

    import flockstep.sb3

    config = model.learner.config
    if config.critic_only:
        raise ValueError(
            f"to_sb3: expected critic_only=0, got {config.critic_only}: actor and critic of Stable-Baselines3 have the "
            "same inputs"
        )
    _require_start(model.action_space)
    arguments: dict[str, Any] = {
        "net_arch": {"pi": config.actor_layers, "vf": config.critic_layers},
        "activation_fn": torch.nn.Tanh if config.activation == "tanh" else torch.nn.ReLU,
    }
    names = {features: name for name, features in FEATURES.items() if name.endswith("Features")}
    if config.features in names:
        arguments["features_extractor_class"] = getattr(flockstep.sb3, names[config.features])
    if model.normalize_observations:
        mean, variance, count = model.learner.observation_moments
        inner = arguments.get("features_extractor_class")
        arguments["features_extractor_class"] = flockstep.sb3.NormalizedFeatures
        arguments["features_extractor_kwargs"] = {
            "mean": mean.tolist(),
            "variance": variance.tolist(),
            "inner": inner,
            "count": count,
        }
    made = PPO(
        "MultiInputPolicy" if isinstance(model.observation_space, spaces.Dict) else "MlpPolicy",
        None,  # type: ignore[arg-type] # an environment is not needed
        policy_kwargs=arguments,
        device="cpu",
        _init_setup_model=False,
        **{name: getattr(model, name) for name in (*SHARED, *SCHEDULES)},
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
    first_moments, second_moments, steps = model.learner.adam
    places = {name: (shape, first) for name, shape, first in model.learner.layout}
    for name, parameter in made.policy.named_parameters():
        if steps == 0:
            break
        shape, first = places[name]
        part = slice(first, first + int(np.prod(shape)))
        made.policy.optimizer.state[parameter] = {
            "step": torch.tensor(float(steps)),
            "exp_avg": torch.as_tensor(first_moments[part].reshape(shape)),
            "exp_avg_sq": torch.as_tensor(second_moments[part].reshape(shape)),
        }
    return made


def from_sb3(cls: Any, model: Any, env: Any) -> Any:
    """Return a model of ``cls`` with the network and hyperparameters of a ``PPO`` of Stable-Baselines3."""
    if type(model).__name__ != "PPO" or not hasattr(model, "policy"):
        raise ValueError(f"model: expected a PPO of Stable-Baselines3, got {type(model).__name__}")
    policy = model.policy
    if model.use_sde:
        raise ValueError("model: expected use_sde=False, got state-dependent exploration, which the learner lacks")
    _require_start(model.action_space)
    extractor, moments = policy.features_extractor, None
    if type(extractor).__name__ == "NormalizedFeatures":
        moments = (extractor.mean.numpy(), extractor.variance.numpy(), extractor.count)
        extractor = extractor.inner
    features = type(extractor).__name__ if moments is None or type(extractor).__name__ != "Identity" else _FLAT
    if features not in FEATURES:
        raise ValueError(f"model: expected features of {', '.join(FEATURES)}, got {features}")
    optimizer = policy.optimizer
    default = (type(optimizer).__name__, *(optimizer.defaults.get(key) for key in ("betas", "eps", "weight_decay")))
    if default != ("Adam", (0.9, 0.999), 1e-5, 0):
        raise ValueError(
            f"model: expected Adam with its betas, eps=1e-5 and no weight_decay, got {type(optimizer).__name__} with "
            f"{optimizer.defaults}"
        )
    source = model.get_env() if env is None else env
    made = cls._blank(
        {
            **{name: getattr(model, name) for name in SHARED},
            "learning_rate": model.learning_rate,
            "clip_range": _plain_schedule(model.clip_range),
            "clip_range_vf": None if model.clip_range_vf is None else _plain_schedule(model.clip_range_vf),
            "seed": model.seed,
            "normalize_observations": moments is not None,
        }
    )
    made.observation_space, made.action_space = model.observation_space, model.action_space
    made._make_learner(
        "MultiInputPolicy" if isinstance(model.observation_space, spaces.Dict) else "MlpPolicy",
        {
            "net_arch": policy.net_arch,
            "activation_fn": policy.activation_fn,
            "features_extractor_class": features,
        },
        0,
    )
    if source is not None:
        made.set_env(source)
        if env is not None:
            made._seed_env()
    learner = made.learner
    learner.parameters = _in_layout(learner, dict(policy.named_parameters()))
    if moments is not None:
        learner.set_moments(moments, learner.return_moments)
    state = {name: policy.optimizer.state.get(parameter, {}) for name, parameter in policy.named_parameters()}
    if all("exp_avg_sq" in values for values in state.values()):
        first, second = (
            _in_layout(learner, {name: values[key] for name, values in state.items()})
            for key in ("exp_avg", "exp_avg_sq")
        )
        learner.set_adam(first, second, int(next(iter(state.values()))["step"]))
    made.num_timesteps, made._n_updates = model.num_timesteps, model._n_updates
    return made


def _in_layout(learner: Any, tensors: dict[str, Any]) -> npt.NDArray[np.float32]:
    """Return tensors by name as one array in the order of the learner's parameters."""
    values = np.zeros(len(learner.parameters), np.float32)
    layout = {name: (tuple(shape), first) for name, shape, first in learner.layout}
    for name in tensors.keys() ^ layout.keys():
        raise ValueError(f"model: expected the parameters {', '.join(layout)}, got other ones ({name})")
    for name, (shape, first) in layout.items():
        if tuple(tensors[name].shape) != shape:
            raise ValueError(f"model: expected {name} of shape {shape}, got {tuple(tensors[name].shape)}")
        values[first : first + int(np.prod(shape))] = tensors[name].detach().cpu().numpy().ravel()
    return values


def _require_start(space: spaces.Space[Any]) -> None:
    if isinstance(space, spaces.Discrete) and space.start != 0:
        raise ValueError(
            f"action_space: expected a Discrete that starts at 0, got {space}: Stable-Baselines3 ignores the start"
        )


def _plain_schedule(schedule: Any) -> Any:
    """Return the number behind a constant schedule of Stable-Baselines3, or the schedule."""
    values = {float(schedule(share)) for share in (0.0, 0.25, 0.5, 1.0)}
    return values.pop() if len(values) == 1 else schedule
