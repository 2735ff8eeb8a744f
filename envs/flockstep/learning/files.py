"""Files of models: JSON and raw arrays in a zip archive, with checksums. Nothing in them is run."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import zipfile
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import Learner, NetworkConfig
from flockstep.learning.networks import FEATURES, count_parameters, require_fits
from flockstep.learning.sb3_models import HYPERPARAMETERS, SCHEDULES

if TYPE_CHECKING:
    from flockstep.learning.ppo import PPO

_Model = TypeVar("_Model", bound="PPO")

#: Hyperparameters that files have, apart from the schedules.
NUMBERS = ("stats_window_size", "seed", *(name for name in HYPERPARAMETERS if name not in SCHEDULES))
FORMAT = "flockstep model 1"
_TEXT = "model.json"
_TYPES = {"parameters": "<f4", "adam_first": "<f4", "adam_second": "<f4"}  # others are <f8
_MOST_NUMBERS = 1 << 16  # of an observation or an action
_DTYPES = [np.dtype(code).name for code in "?bBhHiIlLefdg"]


def save(path: str | PathLike[str], model: PPO) -> None:
    """Write a model. An earlier file of the name stays whole until the new one is complete."""
    state, arrays = _state(model), _arrays(model.learner)
    target = _with_suffix(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    members = {name: np.ascontiguousarray(array, _type_of(name)).tobytes() for name, array in arrays.items()}
    sums = {name: hashlib.sha256(member).hexdigest() for name, member in members.items()}
    text = json.dumps({"format": FORMAT, **state, "sha256": sums}, indent=1, allow_nan=False, default=_plain_number)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_TEXT, text)
        for name, member in members.items():
            archive.writestr(name, member)
    written = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        written.write_bytes(content.getvalue())
        written.replace(target)
    finally:
        written.unlink(missing_ok=True)


def load(path: str | PathLike[str], cls: type[_Model], threads: int, seeds: Mapping[str, int]) -> _Model:
    """Read a model; ``seeds`` replace the state of its random numbers.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        The file is of another kind or damaged.
    """
    source = Path(fspath(path))
    source = source if source.is_file() else _with_suffix(path)
    if not source.is_file():
        raise FileNotFoundError(f"no such model file: {source}")
    content = source.read_bytes()
    if _is_of_sb3(content):
        raise ValueError(
            f"{source} is a model of Stable-Baselines3. Load it by "
            f"flockstep.PPO.from_sb3(stable_baselines3.PPO.load({fspath(source)!r})), which runs code from the file"
        )
    try:
        state, arrays = _read(content)
    except Exception as error:  # a damaged archive makes zipfile raise errors of many kinds
        raise ValueError(
            f"{source}: expected a model that PPO.save wrote, got another or a damaged file ({error})"
        ) from error
    try:
        return _model(cls, {**state, **seeds}, arrays, threads)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, AssertionError, RecursionError) as error:
        raise ValueError(f"{path}: expected a model that PPO.save wrote, got other values ({error})") from error


def _state(model: PPO) -> dict[str, Any]:
    config, learner = model.learner.config, model.learner
    schedules = {name: getattr(model, name) for name in SCHEDULES}
    functions = [name for name, value in schedules.items() if callable(value)]
    return {
        "network": {name: getattr(config, name) for name in config.__match_args__},
        "observation_space": plain_space(model.observation_space),
        "action_space": plain_space(model.action_space),
        "hyperparameters": {name: getattr(model, name) for name in NUMBERS},
        "schedules": schedules | dict.fromkeys(functions),
        "callable_schedules": [name for name in SCHEDULES if name in (*functions, *model._missing)],
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "adam_steps": learner.adam[2],
        "learner_seed": learner.seed,
        "draws": learner.draws,
        "observation_count": learner.observation_moments[2],
        "return_count": learner.return_moments[2],
    }


def _arrays(learner: Learner) -> dict[str, npt.NDArray[Any]]:
    first, second, _ = learner.adam
    return {
        "parameters": learner.parameters,
        "adam_first": first,
        "adam_second": second,
        "observation_mean": learner.observation_moments[0],
        "observation_variance": learner.observation_moments[1],
        "return_mean": learner.return_moments[0],
        "return_variance": learner.return_moments[1],
        "discounted_returns": learner.discounted_returns,
    }


def _model(cls: type[_Model], state: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]], threads: int) -> _Model:
    """Return the model that `_state` and `_arrays` described."""
    functions = tuple(name for name in SCHEDULES if name in state["callable_schedules"])
    numbers = {name: state["hyperparameters"][name] for name in NUMBERS}
    model = cls._blank(numbers | {name: state["schedules"][name] for name in SCHEDULES if name not in functions})
    model._missing = functions
    model._check()
    model.observation_space = space_from(state["observation_space"])
    model.action_space = space_from(state["action_space"])
    config = NetworkConfig(**state["network"])  # a file from before a field has none, and its default
    model.critic_only = config.critic_only
    require_fits(config, model.observation_space, model.action_space)
    expected = count_parameters(config)
    if arrays["parameters"].size != expected:
        raise ValueError(f"parameters: expected {expected} numbers, got {arrays['parameters'].size}")
    features = {name: extractor for extractor, name in FEATURES.items() if extractor.endswith("Features")}
    model.policy_kwargs = {
        "net_arch": {"pi": config.actor_layers, "vf": config.critic_layers},
        "activation_fn": config.activation,
        **({"features_extractor_class": features[config.features]} if config.features in features else {}),
    }
    model.learner = learner = Learner(config, threads, state["learner_seed"])
    learner.parameters = arrays["parameters"]
    learner.set_adam(arrays["adam_first"], arrays["adam_second"], state["adam_steps"])
    learner.set_moments(
        (arrays["observation_mean"], arrays["observation_variance"], state["observation_count"]),
        (arrays["return_mean"], arrays["return_variance"], state["return_count"]),
    )
    model._set_normalization(arrays["discounted_returns"].size)
    learner.discounted_returns = arrays["discounted_returns"]
    learner.draws = state["draws"]
    model._begin_counts()
    for name in ("num_timesteps", "n_updates"):
        if _integer(state[name]) < 0:
            raise ValueError(f"{name}: expected an integer >= 0, got {state[name]!r}")
    model.num_timesteps, model._n_updates = state["num_timesteps"], state["n_updates"]
    return model


def _read(content: bytes) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        state = json.loads(_member(archive, _TEXT).decode())
        if not isinstance(state, dict) or state.get("format") != FORMAT:
            raise ValueError(f"expected the format {FORMAT!r}")
        arrays = {}
        for name in state["sha256"]:
            member = _member(archive, name)
            if hashlib.sha256(member).hexdigest() != state["sha256"][name]:
                raise ValueError(f"{name}: the checksum differs")
            array = np.frombuffer(member, _type_of(name))
            arrays[name] = array.astype(array.dtype.newbyteorder("="))
    return state, arrays


def _is_of_sb3(content: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return "data" in archive.namelist()
    except Exception:  # a damaged archive makes zipfile raise errors of many kinds
        return False


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    info = archive.getinfo(name)
    if info.compress_type != zipfile.ZIP_STORED:  # a small file could become large
        raise ValueError(f"{name}: expected no compression")
    return archive.read(info)


def _type_of(name: str) -> str:
    return _TYPES.get(name, "<f8")


def _with_suffix(path: str | PathLike[str]) -> Path:
    plain = Path(fspath(path))
    return plain if plain.suffix == ".zip" else plain.with_name(plain.name + ".zip")


def _plain_number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"expected a number, got {value!r}")


def plain_space(space: spaces.Space[Any]) -> dict[str, Any]:
    """Return a space for JSON."""
    if isinstance(space, spaces.Dict):
        return {"dict": [[name, plain_space(part)] for name, part in space.spaces.items()]}
    if isinstance(space, spaces.Discrete):
        return {"discrete": int(space.n), "start": int(space.start)}
    assert isinstance(space, spaces.Box)
    return {
        "box": list(space.shape),
        "dtype": np.dtype(space.dtype).name,
        "low": _plain_bounds(space.low),
        "high": _plain_bounds(space.high),
    }


def _plain_bounds(values: npt.NDArray[Any]) -> list[float | str]:
    flat = values.ravel()
    if flat.size and (flat == flat[0]).all():
        flat = flat[:1]
    return [value if math.isfinite(value) else str(value) for value in flat.tolist()]  # JSON has no infinity


def space_from(plain: Any) -> spaces.Space[Any]:
    """Return the space that `plain_space` described, once its numbers are counted.

    Raises
    ------
    ValueError
        It is not a space, or too large for a model.
    """
    count = _count(plain)
    if count > _MOST_NUMBERS:
        raise ValueError(f"space: expected at most {_MOST_NUMBERS} numbers, got {count}")
    return _space(plain)


def _count(plain: Any) -> int:
    """Return how many numbers a value of the space has; an empty box counts as one."""
    if "dict" in plain:
        return sum(_count(part) for _, part in plain["dict"])
    shape = [] if "discrete" in plain else [_integer(size) for size in plain["box"]]
    if min(shape, default=1) < 0:
        raise ValueError(f"shape: expected sizes of at least 0, got {shape}")
    return max(1, math.prod(shape))


def _space(plain: Any) -> spaces.Space[Any]:
    if "dict" in plain:
        parts = [(_text(name), _space(part)) for name, part in plain["dict"]]
        return spaces.Dict(parts)  # in this order: Gymnasium sorts the names of a dict
    if "discrete" in plain:
        return spaces.Discrete(_integer(plain["discrete"]), start=_integer(plain["start"]))
    shape = tuple(_integer(size) for size in plain["box"])
    name = _text(plain["dtype"])
    if name not in _DTYPES:  # not NumPy's parser, which also reads programs
        raise ValueError(f"dtype: expected one of {', '.join(_DTYPES)}, got {name[:40]!r}")
    dtype = np.dtype(name)
    low, high = (_bounds(plain[side], dtype, shape) for side in ("low", "high"))
    return spaces.Box(low, high, shape, dtype.type)


def _bounds(values: Any, dtype: np.dtype[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    numbers = np.array([float(value) if isinstance(value, str) else value for value in values], dtype)
    return np.broadcast_to(numbers, math.prod(shape)).reshape(shape)


def _integer(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"expected an integer, got {value!r}")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a text, got {value!r}")
    return value
