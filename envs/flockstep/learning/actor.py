"""The network that chooses the actions of a trained model, as arrays: what `flockstep.export` writes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep.learning.networks import FEATURES, actor_space
from flockstep.learning.ppo import PPO

Array = npt.NDArray[Any]

#: Functions between layers, by the names of PyTorch's modules.
ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}
_MIN_VARIANCE = 1e-8
_EXPECTED = "expected a model of flockstep.PPO, flockstep.APG or Stable-Baselines3"


@dataclass(frozen=True)
class Layer:
    """A fully connected layer: ``activation(weight @ inputs + bias)``."""

    weight: npt.NDArray[np.float32]  # (outputs, inputs)
    bias: npt.NDArray[np.float32]
    activation: str  # a value of ACTIVATIONS, or "" for none


@dataclass(frozen=True)
class Normalization:
    """Observations are shifted by the center, divided by the deviation, and clipped to +-limit."""

    center: npt.NDArray[np.float64]
    deviation: npt.NDArray[np.float64]
    limit: float


@dataclass(frozen=True)
class Actor:
    """A deterministic policy: normalization, features and layers, then a choice, or numbers within bounds."""

    model: Any
    observation_space: spaces.Space[Any]  # without what only the critic gets
    action_space: spaces.Box | spaces.Discrete
    normalization: Normalization | None
    features: str  # a value of FEATURES
    layers: list[Layer]
    is_squashed: bool  # the last layer's outputs in [-1, 1] are scaled to the bounds, not clipped
    first_choice: int = 0  # number of the first of several choices
    vec_normalize: Any = None  # the VecNormalize that normalizes before `predict`, which expects it done

    @property
    def observation_size(self) -> int:
        """Numbers of an observation."""
        return sum(size_of(part) for _, part in parts_of(self.observation_space))

    @property
    def action_size(self) -> int:
        """Numbers of an action; a choice is one number."""
        return size_of(self.action_space)  # () of a Discrete

    def predict(self, rows: npt.NDArray[np.float32]) -> Array:
        """Return what the model itself predicts: actions (R, action_size) of observations (R, observation_size)."""
        observation: Any = {}
        first = 0
        for name, part in parts_of(self.observation_space):
            size = size_of(part)
            observation[name] = rows[:, first : first + size].reshape(len(rows), *(part.shape or ()))
            first += size
        if not isinstance(self.observation_space, spaces.Dict):
            observation = observation[""]
        if self.vec_normalize is not None:
            observation = self.vec_normalize.normalize_obs(observation)
        actions: Array = np.asarray(self.model.predict(observation, deterministic=True)[0])
        return actions.reshape(len(rows), -1)


def actor_of(model: Any, env: Any = None) -> Actor:
    """Return the actor of a model of `PPO`, `APG` or Stable-Baselines3; env: with the ``VecNormalize`` of its training.

    Raises
    ------
    ValueError, TypeError
        The model has a part that is not made of fully connected layers; the message names it.
    """
    if isinstance(model, PPO):
        made = _of_ppo(model, env)
    elif hasattr(getattr(model, "policy", None), "state_dict"):
        made = _of_sb3(model, env)
    else:
        raise TypeError(f"model: {_EXPECTED}, got {model!r}")
    numbers: list[Array] = [array for layer in made.layers for array in (layer.weight, layer.bias)]
    if made.normalization is not None:
        numbers += [made.normalization.center, made.normalization.deviation]
    if not all(np.isfinite(array).all() for array in numbers):
        raise ValueError("model: expected finite weights, got NaN or infinity")
    return made


def parts_of(space: spaces.Space[Any]) -> list[tuple[str, spaces.Space[Any]]]:
    """Return the parts of observations by name, in the order of their numbers; one without parts has the name ""."""
    return list(space.spaces.items()) if isinstance(space, spaces.Dict) else [("", space)]


def size_of(space: spaces.Space[Any]) -> int:
    """Return how many numbers a value of a space has."""
    return math.prod(space.shape or ())


def _of_ppo(model: PPO, env: Any) -> Actor:
    config, values = model.learner.config, model.learner.parameters
    arrays = {
        name: values[first : first + int(np.prod(shape))].reshape(shape) for name, shape, first in model.learner.layout
    }
    hidden = [f"mlp_extractor.policy_net.{2 * i}" for i in range(len(config.actor_layers))]
    activations = [str(config.activation)] * len(hidden) + [""]
    layers = [
        Layer(arrays[f"{name}.weight"], arrays[f"{name}.bias"], activation)
        for name, activation in zip([*hidden, "action_net"], activations, strict=True)
    ]
    observation_space = actor_space(model.observation_space, config.critic_only)
    normalization = None
    if model.normalize_observations:
        mean, variance, _ = model.learner.observation_moments
        size = config.observation_size - config.critic_only
        normalization = _normalization(mean[:size], variance[:size])
    features = str(config.features)
    return _finished(model, env, observation_space, normalization, features, layers, is_squashed=False)


def _of_sb3(model: Any, env: Any) -> Actor:
    policy: Any = model.policy
    if hasattr(policy, "lstm_actor"):
        raise ValueError(f"model: expected a policy without memory, got {type(policy).__name__}")
    actor: Any = getattr(policy, "actor", None)
    is_squashed = True
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C
        extractor = getattr(policy, "pi_features_extractor", policy.features_extractor)
        modules, is_squashed = [policy.mlp_extractor.policy_net, policy.action_net], bool(policy.squash_output)
    elif hasattr(actor, "latent_pi"):  # SAC
        extractor, modules = actor.features_extractor, [actor.latent_pi, actor.mu]
    elif hasattr(actor, "mu"):  # TD3, DDPG
        extractor, modules = actor.features_extractor, [actor.mu]
    elif hasattr(getattr(policy, "q_net", None), "q_net"):  # DQN
        extractor, modules, is_squashed = policy.q_net.features_extractor, [policy.q_net.q_net], False
    else:
        raise ValueError(f"model: {_EXPECTED} with fully connected layers, got a policy {type(policy).__name__}")
    normalization = None
    if type(extractor).__name__ == "NormalizedFeatures":
        normalization = _normalization(extractor.mean.cpu().numpy(), extractor.variance.cpu().numpy())
        extractor = extractor.inner
    name = type(extractor).__name__
    features = "flat" if normalization is not None and name == "Identity" else FEATURES.get(name)
    others = [kind for kind in map(_kind, getattr(extractor, "extractors", {}).values()) if kind != "Flatten"]
    if features is None or others:
        raise ValueError(f"model: expected features of {', '.join(FEATURES)}, got {(others or [name])[0]}")
    layers = [*_layers(modules)]
    if is_squashed and not layers[-1].activation:  # the distribution applies it
        layers[-1] = Layer(layers[-1].weight, layers[-1].bias, "tanh")
    return _finished(model, env, model.observation_space, normalization, features, layers, is_squashed)


def _layers(modules: list[Any]) -> list[Layer]:
    layers: list[Layer] = []
    for module in (each for parent in modules for each in parent.modules() if not [*each.children()]):
        kind, waits = _kind(module), bool(layers) and not layers[-1].activation
        if kind == "Linear":
            bias = np.zeros(module.out_features) if module.bias is None else module.bias.detach().cpu().numpy()
            layers.append(Layer(_float32(module.weight.detach().cpu().numpy()), _float32(bias), ""))
        elif kind in ACTIVATIONS and waits and getattr(module, "alpha", 1.0) == 1.0:
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, ACTIVATIONS[kind])
        elif kind not in ("Flatten", "Identity", "Sequential"):
            raise ValueError(f"model: expected fully connected layers with {', '.join(ACTIVATIONS)}, got {module}")
    return layers


def _finished(
    model: Any,
    env: Any,
    observation_space: spaces.Space[Any],
    normalization: Normalization | None,
    features: str,
    layers: list[Layer],
    is_squashed: bool,
) -> Actor:
    for name, part in parts_of(observation_space):
        where = f"observation {name!r}" if name else "observation"
        if not isinstance(part, spaces.Box):
            raise ValueError(f"{where}: expected numbers (a Box), got {part}")
        if len(part.shape) in (2, 3) and part.dtype == np.uint8:
            raise ValueError(f"{where}: expected numbers, got an image, which export does not write")
    if not isinstance(model.action_space, (spaces.Box, spaces.Discrete)):
        raise ValueError(f"actions: expected numbers (a Box) or a choice (Discrete), got {model.action_space}")
    around = model.env if env is None else env
    while around is not None and type(around).__name__ != "VecNormalize":
        around = getattr(around, "venv", None)
    if around is not None and around.norm_obs:
        if normalization is not None or isinstance(observation_space, spaces.Dict):
            raise ValueError(
                "model: expected a VecNormalize around observations of one array that the model does not normalize, "
                f"got {'a dict' if normalization is None else 'a model that does'}"
            )
        normalization = _normalization(
            around.obs_rms.mean.ravel(), around.obs_rms.var.ravel(), around.epsilon, around.clip_obs
        )
    else:
        around = None
    # Stable-Baselines3 ignores where choices start.
    first = int(model.action_space.start) if isinstance(model, PPO) and hasattr(model.action_space, "start") else 0
    return Actor(
        model, observation_space, model.action_space, normalization, features, layers, is_squashed, first, around
    )


def _normalization(
    center: Array, variance: Array, epsilon: float = _MIN_VARIANCE, limit: float = 10.0
) -> Normalization:
    return Normalization(np.asarray(center, float), np.sqrt(np.asarray(variance, float) + epsilon), float(limit))


def _float32(values: Any) -> npt.NDArray[np.float32]:
    return np.asarray(values, np.float32)


def _kind(module: Any) -> str:
    return type(module).__name__
