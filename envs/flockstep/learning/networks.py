"""Networks from the arguments of Stable-Baselines3's policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from flockstep._core import NetworkConfig
from flockstep.errors import did_you_mean

#: Names of the features extractors that the learner has.
FEATURES = {
    "FlattenExtractor": "flat",
    "CombinedExtractor": "flat",
    "GoalFeatures": "goal",
    "BlobFeatures": "blob",
    "PointFeatures": "point",
}
# Constants of these features, which engine/src/learning/network.cpp has, too.
DIRECTION_SIZE = 3
DIRECTION_GAIN = 2.0
NEAREST = 0.05  # fraction of the maximum range: keeps the logarithm finite, and flat at ranges of contact with the hull
BLOB_SIZE = 2
OFFSET_GAIN = 3.0
WIDTH_GAIN = 5.0  # for the root of the blob's area: one or two hundredths across the playground, one half at the goal
NEAR_POINT_M = 0.1
_ARGUMENTS = ("net_arch", "activation_fn", "log_std_init", "features_extractor_class")
_USE_SB3 = "train with Stable-Baselines3"

#: Arguments of Stable-Baselines3's policies that the learner accepts only with their defaults, which are its behaviour.
_FIXED: dict[str, tuple[Any, ...]] = {
    "use_sde": (False,),
    "squash_output": (False,),
    "ortho_init": (True,),
    "optimizer_kwargs": (None, {}, {"eps": 1e-5}),
    "features_extractor_kwargs": (None, {}),
    # Without effect here: the features have no parameters, images are refused, and the rest belongs to use_sde.
    "share_features_extractor": (True, False),
    "normalize_images": (True, False),
    "full_std": (True, False),
    "use_expln": (True, False),
}
_POLICIES = {
    "MlpPolicy": "MlpPolicy",
    "MultiInputPolicy": "MultiInputPolicy",
    "ActorCriticPolicy": "MlpPolicy",
    "MultiInputActorCriticPolicy": "MultiInputPolicy",
}


def network_config(
    policy: Any,
    observation_space: spaces.Space[Any],
    action_space: spaces.Space[Any],
    arguments: Mapping[str, Any],
    last: int,
) -> tuple[NetworkConfig, float]:
    """Return the configuration of the networks, and the initial logarithm of the actions' standard deviations.

    Raises
    ------
    ValueError, TypeError
        The learner lacks what the arguments ask for; the message names it.
    """
    named = policy if isinstance(policy, str) else getattr(policy, "__name__", None)
    if named not in _POLICIES:
        raise ValueError(
            f"policy: expected 'MlpPolicy' or 'MultiInputPolicy', got {policy!r}: for images or memory, {_USE_SB3}"
        )
    needed = "MultiInputPolicy" if isinstance(observation_space, spaces.Dict) else "MlpPolicy"
    if _POLICIES[named] != needed:
        kind = type(observation_space).__name__
        raise ValueError(f"policy: expected {needed!r} for observations in a {kind}, got {policy!r}")
    for name, value in arguments.items():
        if name in _FIXED:
            if not any(value is allowed or value == allowed for allowed in _FIXED[name]):
                raise ValueError(
                    f"policy_kwargs: expected {name}={_FIXED[name][0]!r}, got {value!r}: for others, {_USE_SB3}"
                )
        elif name == "optimizer_class":
            if getattr(value, "__name__", None) != "Adam":
                raise ValueError(f"policy_kwargs: expected optimizer_class=Adam, got {value!r}: for others, {_USE_SB3}")
        elif name not in _ARGUMENTS:
            raise ValueError(
                f"policy_kwargs: expected {', '.join(_ARGUMENTS)}, got {name!r}{did_you_mean(name, _ARGUMENTS)}; "
                f"for other networks, {_USE_SB3}"
            )
    actor, critic = _layers(arguments.get("net_arch"))
    action_size, is_discrete = _action_size(action_space)
    config = NetworkConfig(
        observation_size=observation_size(observation_space),
        action_size=action_size,
        is_discrete=is_discrete,
        actor_layers=actor,
        critic_layers=critic,
        activation=_activation(arguments.get("activation_fn", "tanh")),
        features=_features(arguments.get("features_extractor_class", "FlattenExtractor")),
        critic_only=last,
    )
    if config.features != "flat" and isinstance(observation_space, spaces.Dict):
        raise ValueError("features_extractor_class: these features take an observation of one array, got a dict")
    log_std = float(arguments.get("log_std_init", 0.0))
    if not np.isfinite(log_std):
        raise ValueError(f"log_std_init: expected a finite number, got {log_std}")
    return config, log_std


def observation_size(space: spaces.Space[Any]) -> int:
    """Return the numbers of an observation.

    Raises
    ------
    ValueError
        It is an image, or not made of numbers.
    """
    parts = dict(space.spaces) if isinstance(space, spaces.Dict) else {"": space}
    total = 0
    for name, part in parts.items():
        where = f"observation {name!r}" if name else "observation"
        if not isinstance(part, spaces.Box):
            raise ValueError(f"{where}: expected numbers (a Box), got {part}: {_USE_SB3}")
        assert part.shape is not None
        if len(part.shape) in (2, 3) and part.dtype == np.uint8:
            raise ValueError(f"{where}: it is an image, which the learner's networks do not take: {_USE_SB3}")
        total += int(np.prod(part.shape))
    return total


def actor_space(space: spaces.Space[Any], last: int) -> spaces.Space[Any]:
    """Return the space of observations without the numbers at their end that only the critic gets."""
    if isinstance(space, spaces.Dict):
        parts: list[tuple[str, spaces.Space[Any]]] = []
        for name, part in reversed(space.spaces.items()):
            size = int(np.prod(part.shape or ()))
            if not last or size > last:
                parts.insert(0, (name, actor_space(part, last)))
            last -= min(size, last)
        return spaces.Dict(parts)
    assert isinstance(space, spaces.Box)
    size = int(np.prod(space.shape)) - last
    if not last:
        return space
    return spaces.Box(space.low.ravel()[:size], space.high.ravel()[:size], dtype=space.dtype.type)


def ends_in(space: spaces.Space[Any], observation: Any) -> bool:
    """Return True if the last dimensions of an observation, or those of all its parts, are those of a space."""
    if isinstance(space, spaces.Dict):
        return isinstance(observation, Mapping) and all(
            name in observation and ends_in(part, observation[name]) for name, part in space.spaces.items()
        )
    dimensions = len(space.shape or ())
    return dimensions == 0 or np.shape(observation)[-dimensions:] == space.shape


def require_fits(config: NetworkConfig, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> None:
    """Raise ValueError if networks do not take the observations or return the actions of spaces."""
    expected = (config.observation_size, (config.action_size, config.is_discrete))
    got = (observation_size(observation_space), _action_size(action_space))
    if expected != got:
        raise ValueError(f"spaces: expected sizes {expected} of observation and action, got {got}")


def count_parameters(config: NetworkConfig) -> int:
    """Return the number of weights, biases and standard deviations."""
    more_inputs = {"flat": 0, "goal": 0, "blob": 1, "point": 3}[config.features]
    count = 0 if config.is_discrete else config.action_size
    every_input = config.observation_size + more_inputs
    for inputs, hidden, outputs in (
        (every_input - config.critic_only, config.actor_layers, config.action_size),
        (every_input, config.critic_layers, 1),
    ):
        for size in [*hidden, outputs]:
            count += (inputs + 1) * size
            inputs = size
    return count


def _action_size(space: spaces.Space[Any]) -> tuple[int, bool]:
    if isinstance(space, spaces.Discrete):
        return int(space.n), True
    if isinstance(space, spaces.Box):
        return int(np.prod(space.shape)), False
    raise ValueError(f"actions: expected numbers (a Box) or a choice (Discrete), got {space}: {_USE_SB3}")


def _layers(given: Any) -> tuple[list[int], list[int]]:
    if given is None:
        return [64, 64], [64, 64]
    if isinstance(given, (list, tuple)) and len(given) == 1 and isinstance(given[0], Mapping):
        given = given[0]  # as Stable-Baselines3 took it before 1.8
    if isinstance(given, Mapping):
        if set(given) - {"pi", "vf"}:
            raise ValueError(f"net_arch: expected the keys 'pi' and 'vf', got {sorted(given)}")
        return _sizes(given.get("pi", [])), _sizes(given.get("vf", []))
    return _sizes(given), _sizes(given)


def _sizes(given: Any) -> list[int]:
    sizes: list[Any] = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [None]
    if not all(isinstance(size, (int, np.integer)) and size >= 1 for size in sizes):
        raise ValueError(f"net_arch: expected a list of sizes >= 1, or a dict of them, got {given!r}")
    return [int(size) for size in sizes]


def _activation(given: Any) -> Any:
    name = given if isinstance(given, str) else getattr(given, "__name__", repr(given))
    if name.lower() not in ("tanh", "relu"):
        raise ValueError(f"activation_fn: expected 'tanh' or 'relu', got {given!r}: for others, {_USE_SB3}")
    return name.lower()


def _features(given: Any) -> Any:
    name = given if isinstance(given, str) else getattr(given, "__name__", repr(given))
    if name not in FEATURES:
        raise ValueError(
            f"features_extractor_class: expected {', '.join(FEATURES)}, got {given!r}: for others, {_USE_SB3}"
        )
    return FEATURES[name]
