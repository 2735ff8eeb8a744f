"""Networks from the arguments of Stable-Baselines3's policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from flockstep._core import NetworkConfig
from flockstep.nearest_name import did_you_mean

#: Names of the features extractors that the learner has.
FEATURES = {
    "FlattenExtractor": "flat",
    "CombinedExtractor": "flat",
    "GoalFeatures": "goal",
    "BlobFeatures": "blob",
    "PointFeatures": "point",
}
_ARGUMENTS = ("net_arch", "activation_fn", "log_std_init", "features_extractor_class")
_USE_SB3 = "train with Stable-Baselines3"


def network_config(
    policy: Any, observation_space: spaces.Space[Any], action_space: spaces.Space[Any], arguments: Mapping[str, Any]
) -> tuple[NetworkConfig, float]:
    """Return the configuration of the networks, and the initial logarithm of the actions' standard deviations.

    Raises
    ------
    ValueError, TypeError
        The learner lacks what the arguments ask for; the message names it.
    """
    if policy not in ("MlpPolicy", "MultiInputPolicy"):
        raise ValueError(
            f"policy: expected 'MlpPolicy' or 'MultiInputPolicy', got {policy!r}: for images or memory, {_USE_SB3}"
        )
    for name in arguments:
        if name not in _ARGUMENTS:
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
        if len(part.shape) in (2, 3) and part.dtype == np.uint8:
            raise ValueError(f"{where}: it is an image, which the learner's networks do not take: {_USE_SB3}")
        total += int(np.prod(part.shape))
    return total


def _action_size(space: spaces.Space[Any]) -> tuple[int, bool]:
    if isinstance(space, spaces.Discrete):
        return int(space.n), True
    if isinstance(space, spaces.Box):
        return int(np.prod(space.shape)), False
    raise ValueError(f"actions: expected numbers (a Box) or a choice (Discrete), got {space}: {_USE_SB3}")


def _layers(given: Any) -> tuple[list[int], list[int]]:
    if given is None:
        return [64, 64], [64, 64]
    if isinstance(given, Mapping):
        if set(given) - {"pi", "vf"}:
            raise ValueError(f"net_arch: expected the keys 'pi' and 'vf', got {sorted(given)}")
        return _sizes(given.get("pi", [])), _sizes(given.get("vf", []))
    return _sizes(given), _sizes(given)


def _sizes(given: Any) -> list[int]:
    sizes = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [None]
    if not all(isinstance(size, (int, np.integer)) and size >= 1 for size in sizes):
        raise ValueError(f"net_arch: expected a list of sizes >= 1, or a dict of them, got {given!r}")
    return [int(size) for size in sizes]


def _activation(given: Any) -> str:
    name = given if isinstance(given, str) else getattr(given, "__name__", repr(given))
    if name.lower() not in ("tanh", "relu"):
        raise ValueError(f"activation_fn: expected 'tanh' or 'relu', got {given!r}: for others, {_USE_SB3}")
    return name.lower()


def _features(given: Any) -> str:
    name = given if isinstance(given, str) else getattr(given, "__name__", repr(given))
    if name not in FEATURES:
        raise ValueError(
            f"features_extractor_class: expected {', '.join(FEATURES)}, got {given!r}: for others, {_USE_SB3}"
        )
    return FEATURES[name]
