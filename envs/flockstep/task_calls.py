"""The engine's calls into a `Task`."""

from __future__ import annotations

import io
import warnings
import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import Batch, Field, PythonTask, TaskSpec
from flockstep.errors import did_you_mean, refuse_masked
from flockstep.rotations import Array
from flockstep.task import _NOT_STATE, MARKERS, BoolArray, Task, _constant, _name
from flockstep.task_declarations import names_in, refuse_misspelt

_SUCCESS, _INFO, _STATE = "success", "info.", "state."
#: Infos of every task, including the names that Stable-Baselines3 uses.
_INFOS_OF_ALL = (
    "episode_return",
    "episode_length",
    "success",
    "crashed",
    "bad_state",
    "episode_end",
    "episode_terms",
    "episode",
    "is_success",
    "terminal_observation",
)


def native_task(task: Task) -> tuple[PythonTask, TaskCalls]:
    """Return the task wrapped for `Batch`, and its `TaskCalls`, which must be attached to the new batch."""
    limit = task.max_episode_steps
    if not isinstance(limit, (int, np.integer)) or isinstance(limit, bool) or not 0 <= limit < 1 << 31:
        raise ValueError(f"max_episode_steps: expected an integer in [0, {(1 << 31) - 1}], got {limit!r}")
    calls = TaskCalls(task)
    observation = [_field(name, space) for name, space in calls.observation_spaces.items()]
    spec = TaskSpec(_action_field(task), observation, list(task.reward_terms), task.row_kind, task.records_path)
    return PythonTask(spec, _identity(task), int(limit), calls), calls


class TaskCalls:
    """The engine's calls into a Python task while it steps a batch; each method checks the task's results."""

    def __init__(self, task: Task) -> None:
        refuse_misspelt(task)
        _check_actions_of_default_act(task)
        space = getattr(task, "observation_space", None)
        parts: dict[str, Any] = dict(space.spaces) if isinstance(space, spaces.Dict) else {"observation": space}
        boxes = {name: part for name, part in parts.items() if isinstance(part, spaces.Box)}
        if not boxes or len(boxes) < len(parts):
            raise TypeError(
                f"{_name(task)}.observation_space: expected a gymnasium.spaces.Box or a Dict of them, got {space!r}"
            )
        if not names_in(task, "reward_terms"):
            raise ValueError(f"{_name(task)}.reward_terms: expected at least one name, got {task.reward_terms!r}")
        for name in names_in(task, "markers"):
            if name not in MARKERS:
                hint = did_you_mean(name, MARKERS)
                raise ValueError(
                    f"{_name(task)}.markers: expected names among {', '.join(MARKERS)}, got {name!r}{hint}"
                )
        for name in names_in(task, "info_names"):
            if not name.isidentifier() or name.startswith("_") or name in _INFOS_OF_ALL:
                taken = ", ".join(_INFOS_OF_ALL)
                raise ValueError(f"{_name(task)}.info_names: expected names that are not taken ({taken}), got {name!r}")
        self.observation_spaces = boxes
        self._has_curriculum = type(task).curriculum is not Task.curriculum
        self._has_scored = False  # the curriculum has not been called since
        self._unchecked = 2  # observations to compare with their space: those of the first reset and the first step
        self._is_dict = isinstance(space, spaces.Dict)
        self._task = task

    def attach(self, batch: Batch) -> None:
        """Attach the task to its batch and run its setup."""
        if self._task._batch is not None and self._task._batch() is not None:
            raise ValueError(
                f"task: this {_name(self._task)} object belongs to another environment: give each env its own object, "
                "or pass the class"
            )
        control = batch.dynamics.control
        if type(self._task).act is Task.act and control != "pose":
            raise TypeError(
                f"{_name(self._task)}.act: the default act returns positions, but control={control!r} needs commands "
                "(N, 4): override act"
            )
        self._takes_poses = control == "pose"
        poses = "positions (N, 3), or a pair of positions and quaternions (N, 4)"
        self._expected_target = poses if self._takes_poses else "commands (N, 4)"
        self._num_drones = batch.num_drones
        self._rows = (batch.num_drones if self._task.row_kind == "drone" else batch.num_envs,)
        self._task._batch = weakref.ref(batch)
        self._task.success, self._task.truncated, self._task.left_area = np.zeros((3, *self._rows), bool)
        self._task.info = _Info({name: np.zeros(self._rows) for name in self._task.info_names})
        self._reported = {name: np.zeros(self._rows) for name in self._task.info_names}
        self._task.setup(batch)
        own = {name: value for name, value in vars(self._task).items() if name not in _NOT_STATE}
        self._task._constants = {name: _constant(value) for name, value in own.items()}

    def begin(self, rows: npt.NDArray[np.int64]) -> None:
        """Begin an episode in each of these rows."""
        batch = self._task._own_batch()
        mask = np.zeros(self._rows, bool)
        mask[rows] = True
        for array in (self._task.success, *self._task.info.values()):
            array[mask] = 0
        self._task.reset(batch, mask)

    def command(self, actions: Array) -> tuple[Array, Array | None]:
        """Return each drone's target: positions, and quaternions or None to keep them."""
        target = self._task.act(self._task._own_batch(), actions)
        pair = target if isinstance(target, tuple) else (target, None)
        if len(pair) != 2 or pair[0] is None:
            raise ValueError(f"{_name(self._task)}.act: expected {self._expected_target}, got {_counted(target)}")
        for part in pair:
            self._refuse_masked("act", part)
        if self._takes_poses and pair[1] is None and np.shape(pair[0]) == (self._num_drones, 4):
            raise ValueError(
                f"{_name(self._task)}.act: expected {self._expected_target}, got shape {np.shape(pair[0])}: control is "
                "'pose'; for commands (N, 4) declare dynamics = flockstep.DynamicsConfig(motion='rotors', control=...)"
            )
        return pair

    def score(self) -> tuple[Array, ...]:
        """Return the reward terms (terms, N) and the flags (N,): terminated, truncated, success, left_area."""
        self._task.truncated[:] = self._task.left_area[:] = False
        batch = self._task._own_batch()
        scored: Any = self._task.step(batch)
        if not isinstance(scored, tuple) or len(scored) != 2:
            expected = "a pair (reward, terminated)"
            raise ValueError(f"{_name(self._task)}.step: expected {expected}, got {_counted(scored)}")
        reward, terminated = scored
        if set(self._task.info) != set(self._reported):
            expected, got = ", ".join(self._reported) or "nothing", ", ".join(self._task.info)
            raise ValueError(f"{_name(self._task)}.info: expected {expected}, as info_names says, got {got}")
        for name, reported in self._reported.items():
            given = self._row(f"info {name!r}", self._task.info[name])
            np.copyto(reported, given, where=self._task.flying)
            self._task.info[name] = np.array(given, np.float64)  # a copy, in case the task assigned an array of its own
        names = self._task.reward_terms
        if isinstance(reward, Mapping):
            if set(reward) != set(names):
                expected, got = ", ".join(names), ", ".join(reward)
                raise ValueError(f"{_name(self._task)}.step: expected the reward terms {expected}, got {got}")
            columns = [self._row(f"reward term {name!r}", reward[name]) for name in names]
        elif len(names) == 1:
            columns = [self._row("reward", reward)]
        else:
            raise ValueError(f"{_name(self._task)}.step: expected a mapping of the reward terms {', '.join(names)}")
        self._has_scored = True
        terms = np.array(columns, np.float64)
        flags = {"terminated": terminated}
        flags |= {name: getattr(self._task, name) for name in ("truncated", "success", "left_area")}
        return terms, *(self._flags(name, flag) for name, flag in flags.items())

    def infos(self) -> dict[str, npt.NDArray[np.float64]]:
        """Return copies of the task's reported values, (N,) by name; for ended episodes, the values at the end."""
        return {name: reported.copy() for name, reported in self._reported.items()}

    def report(self, what: str, row: int, value: float) -> None:
        """Warn that the task returned a number that is not finite."""
        warnings.warn(
            f"{_name(self._task)}.{what} is {value} in env {row}; its episode ends here as a bad state",
            RuntimeWarning,
            stacklevel=2,
        )

    def observe(self) -> tuple[Array, ...]:
        """Return the observation of all envs, field by field, contiguous and of the declared types.

        The first observation after a step is followed by the curriculum.
        """
        observation = self._observed()
        if self._has_scored and self._has_curriculum:
            batch = self._task._own_batch()
            rows = np.flatnonzero(self._task.flying & (batch.terminated | batch.truncated))
            if rows.size:
                observation = tuple(part.copy() for part in observation)  # the task may have returned its state
                self._task.curriculum(batch, rows)
        self._has_scored = False
        return observation

    def _observed(self) -> tuple[Array, ...]:
        observed = self._parts_of(self._task.observe(self._task._own_batch()))
        if self._unchecked > 0:
            self._unchecked -= 1
            for (name, space), part in zip(self.observation_spaces.items(), observed, strict=True):
                self._warn_beyond(f"observe: {name}" if self._is_dict else "observe", space, part)
        return observed

    def _parts_of(self, observation: Any) -> tuple[Array, ...]:
        if not self._is_dict:
            return (self._checked("observe", observation, self.observation_spaces["observation"]),)
        if not isinstance(observation, Mapping) or set(observation) != set(self.observation_spaces):
            got = ", ".join(observation) if isinstance(observation, Mapping) else type(observation).__name__
            expected = ", ".join(self.observation_spaces)
            raise ValueError(f"{_name(self._task)}.observe: expected a mapping of {expected}, got {got}")
        return tuple(
            self._checked(f"observe: {name}", observation[name], part) for name, part in self.observation_spaces.items()
        )

    def _warn_beyond(self, what: str, space: spaces.Box, part: Array) -> None:
        """Warn of the first number outside its space. Numbers that are not finite are reported by `report`."""
        beyond = np.argwhere((part < space.low) | (part > space.high))
        beyond = beyond[np.isfinite(part[tuple(beyond.T)])]
        if len(beyond):
            env, *at = beyond[0].tolist()
            low, high = space.low[tuple(at)], space.high[tuple(at)]
            warnings.warn(
                f"{_name(self._task)}.{what}: expected numbers in [{low}, {high}], as the space says, got "
                f"{part[tuple(beyond[0])]} in env {env}" + (f" at index {at}" if at else ""),
                RuntimeWarning,
                stacklevel=2,
            )
            self._unchecked = 0

    def state(self) -> bytes:
        """Return the task's part of a snapshot: names and arrays, one after another in NumPy's own format."""
        file = io.BytesIO()
        for name, array in self._arrays().items():
            np.lib.format.write_array(file, np.frombuffer(name.encode(), np.uint8), allow_pickle=False)
            np.lib.format.write_array(file, array, allow_pickle=False)
        return file.getvalue()

    def load(self, blob: bytes) -> None:
        """Restore the result of `state`. A rejected snapshot changes nothing."""
        file = io.BytesIO(blob)
        arrays = {}
        for name, present in self._arrays().items():
            try:
                found = np.lib.format.read_array(file, allow_pickle=False).tobytes().decode()
                array = np.lib.format.read_array(file, allow_pickle=False)
            except (ValueError, OSError, MemoryError, OverflowError) as error:
                raise ValueError(
                    f"snapshot: expected the array {name!r} of {_name(self._task)}, got no array"
                ) from error
            if found != name or array.shape != present.shape:
                expected = f"the array {name!r} of {_name(self._task)}, of shape {present.shape}"
                raise ValueError(f"snapshot: expected {expected}, got {found!r} of shape {array.shape}")
            arrays[name] = array
        if file.read(1):
            raise ValueError(f"snapshot: expected nothing after the arrays of {_name(self._task)}, got more")
        self._task.success[:] = arrays.pop(_SUCCESS)
        for name, reported in self._reported.items():
            self._task.info[name], reported[:] = arrays.pop(_INFO + name)
        self._task.load({name.removeprefix(_STATE): array for name, array in arrays.items()})

    def _arrays(self) -> dict[str, Array]:
        state = {_STATE + name: np.asarray(value) for name, value in self._task.state().items()}
        infos = {_INFO + name: np.stack([self._task.info[name], self._reported[name]]) for name in self._reported}
        return {_SUCCESS: self._task.success, **infos, **state}

    def _row(self, name: str, value: Any) -> Array:
        self._refuse_masked(f"step: {name}", value)
        array = np.asarray(value)
        if array.shape != self._rows:
            raise ValueError(f"{_name(self._task)}.step: expected a {name} of shape {self._rows}, got {array.shape}")
        if array.dtype.kind not in "biuf":
            raise ValueError(f"{_name(self._task)}.step: expected a {name} of real numbers, got dtype {array.dtype}")
        return array

    def _flags(self, name: str, value: Any) -> BoolArray:
        array = self._row(name, value)
        if array.dtype != np.bool_:
            raise ValueError(f"{_name(self._task)}.step: expected {name} to be bool, got {array.dtype}")
        return array

    def _refuse_masked(self, what: str, value: Any) -> None:
        refuse_masked(f"{_name(self._task)}.{what}", value)

    def _checked(self, what: str, value: Any, space: spaces.Box) -> Array:
        self._refuse_masked(what, value)
        given = np.asarray(value)
        if not np.can_cast(given.dtype, space.dtype, "same_kind"):
            raise ValueError(
                f"{_name(self._task)}.{what}: expected {space.dtype}, as the space says, got {given.dtype}"
            )
        expected = (*self._rows, *space.shape)
        if given.shape != expected:
            raise ValueError(f"{_name(self._task)}.{what}: expected shape {expected}, got {given.shape}")
        if given.dtype.kind in "iu" and space.dtype.kind in "iu" and not np.can_cast(given.dtype, space.dtype):
            limits = np.iinfo(space.dtype.name)
            for value in (int(given.min()), int(given.max())):
                if not limits.min <= value <= limits.max:
                    raise ValueError(
                        f"{_name(self._task)}.{what}: expected integers that fit {space.dtype}, got {value}"
                    )
        return np.ascontiguousarray(given, dtype=space.dtype)


class _Info(dict[str, Any]):
    """A task's reported values; an unknown name raises an error that lists the declared names."""

    def __missing__(self, name: str) -> Any:
        declared = ", ".join(map(repr, self)) or "none"
        raise KeyError(f"{name!r} is not among the task's info_names ({declared}){did_you_mean(name, self)}")


def _counted(value: Any) -> str:
    """Describe a value by its type, and a tuple also by its length."""
    if value is None:
        return "None"
    return f"a tuple of {len(value)}" if isinstance(value, tuple) else type(value).__name__


def _check_actions_of_default_act(task: Task) -> None:
    space = task.action_space
    if type(task).act is Task.act and not (isinstance(space, spaces.Box) and space.shape == (3,)):
        raise TypeError(f"{_name(task)}.action_space: the default act takes a Box (3,), got {space!r}: override act")


def _identity(task: Task) -> str:
    """Return the identity of a task in snapshots; the batch adds the task's declarations."""
    return f"{type(task).__module__}.{type(task).__qualname__}, step_m={task.step_m}"


def _require_values(field: str, space: spaces.Box) -> None:
    if 0 in space.shape:
        raise ValueError(f"{field}: expected a Box with at least one value, got the shape {space.shape}")


def _field(name: str, space: spaces.Box) -> Field:
    _require_values(f"observation_space: {name}", space)
    dtype = str(np.dtype(space.dtype))
    known = ("bool", "uint8", "int32", "int64", "float32", "float64")
    if dtype not in known:
        raise TypeError(f"observation_space: {name}: expected one of the types {', '.join(known)}, got {dtype}")
    return Field(name, dtype, space.shape, float(np.min(space.low)), float(np.max(space.high)))


def _action_field(task: Task) -> Field:
    space = task.action_space
    if isinstance(space, spaces.Discrete):
        return Field("action", "int64", (), float(space.start), float(space.start + space.n - 1))
    if isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating):
        _require_values(f"{_name(task)}.action_space", space)
        return Field("action", "float32", space.shape, float(np.min(space.low)), float(np.max(space.high)))
    raise TypeError(f"{_name(task)}.action_space: expected a Discrete or a Box of floats, got {space!r}")
