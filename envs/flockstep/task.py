"""The base class for your own tasks, which define observations, rewards and the end of an episode.

A `Task` is one Python object for all N drones; its methods read and write arrays with a row per drone. The engine does
the rest, as in its built-in tasks: motion, sensing, autoreset, time limits, frame skip, episode statistics, seeding and
snapshots.
"""

from __future__ import annotations

import difflib
import inspect
import io
import pickle
import warnings
import weakref
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import (
    Batch,
    BodyConfig,
    CameraConfig,
    ClockConfig,
    DroneModel,
    DynamicsConfig,
    Field,
    LidarConfig,
    Light,
    PythonTask,
    TaskSpec,
    World,
)
from flockstep.arrays import refuse_masked
from flockstep.nearest_name import did_you_mean
from flockstep.rotations import Array, rotate

if TYPE_CHECKING:
    from flockstep.pictures.drawing import Drawing
    from flockstep.scenes import WorldsLike
    from flockstep.world_pool import WorldPool

BoolArray: TypeAlias = npt.NDArray[np.bool_]
Target: TypeAlias = Array | tuple[Array, Array]
#: A drone: the object, its name or its path.
DroneLike: TypeAlias = DroneModel | str | PathLike[str]


_SUCCESS, _INFO, _STATE = "success", "info.", "state."

#: The kinds of markers that a world may have.
MARKERS = ("start", "waypoints", "goal")


class Task:
    """Base class of tasks written in Python.

    Give the class an ``observation_space`` (a `gymnasium.spaces.Box`, or a `Dict` of them) and override `observe` and
    `step`. Everything else has defaults: actions are displacements of up to ``step_m`` metres per axis, flown with
    collision, and episodes begin at the start marker of the drone's world.

    Random numbers come from ``batch.random(stream, count)``, a row per env. They depend only on the env's seed, its
    episode and the stream, so env i behaves the same for any number of envs. Use a separate stream for each purpose.
    With several drones in an env, ``batch.random(stream, count, row_kind="drone")`` has a row per drone.

    Attributes
    ----------
    observation_space, action_space
        Spaces of one env. Actions are a `Discrete`, or a `Box` of floats.
    reward_terms
        Names of the reward terms, if `step` returns the reward as a mapping; ``batch.reward_terms`` has a column for
        each.
    lidar, camera
        The LiDAR and the camera that the task needs, if any, or a sequence of several.
    bodies, max_bodies
        Bodies in every env when an episode begins, one `BodyConfig` or a sequence, and the number of slots for bodies;
        see `Bodies`. Default: none.
    meet
        How the drones of an env interact: ``"never"``, ``"seen"``, ``"touched"`` or ``"both"``; see `Batch`.
    lights
        Lights of which each episode of an env draws one, a `Light` or a sequence. Default: the lights of the worlds.
    worlds
        Default worlds of envs with this task, in a form that `DroneVectorEnv` accepts. Default: none, so that envs need
        ``worlds``.
    drone, dynamics, clock
        Defaults of envs with this task: a `DroneModel` or an argument of `DroneModel.load`, a `DynamicsConfig` and a
        `ClockConfig`. Default: the 650-class quadrotor, kinematic, at 10 Hz.
    max_episode_steps
        Episodes are truncated after this many steps; 0 means never. The env's own limit takes precedence.
    frame_skip, random_world, episodes
        Defaults of envs with this task, as in `EpisodeConfig`.
    markers
        The world's markers that the task uses, among ``"start"``, ``"waypoints"`` and ``"goal"``. Default: all.
        Rendered pictures show only these. The drones' own cameras are not affected.
    step_m
        Length of a full displacement in the default `act`, in metres.
    row_kind
        Kind of the rows of actions, observations, rewards and flags if envs have several drones. ``"drone"``: one row
        per drone, N rows. ``"env"``: one row per env, E rows; one action commands all drones of an env. The result of
        `act` always has a row per drone. Arrays of the batch have N or E rows, as documented there.
    records_path
        True if `step` reads ``batch.path``: the positions of the drones before the step and after each of its ticks.
    steps
        (N,) int64: steps flown in the current episode; in `step`, the current step is included. Read-only.
    flying
        (N,) bool, for use in `act` and `step`: True if the row takes part in the current step. False if its episode was
        already over, as in the step that resets it. In False rows the drone does not move, the result of `step` is
        discarded, and any state of yours that affects the observation should stay unchanged. Read-only.
    success
        (N,) bool: write it in `step`; the infos of ended episodes report it.
    truncated
        (N,) bool: set it in `step` to cut an episode off for a reason other than ``max_episode_steps``, without ending
        the task. It is all False when `step` is called.
    left_area
        (N,) bool: set it in `step` if the episode ends because the drone left the allowed area. The infos then report
        `EpisodeEnd.left_area`, otherwise `EpisodeEnd.task`. It is all False when `step` is called.
    info_names
        Names of further values in the infos of ended episodes; ``info`` has an array for each.
    info
        A (N,) float64 array for each name: write it in `step`, for example ``self.info["laps"] += lap``. Every episode
        begins with 0; the value at its end is reported.
    """

    observation_space: spaces.Box | spaces.Dict
    action_space: spaces.Space[Any] = spaces.Box(-1.0, 1.0, (3,), np.float32)
    reward_terms: tuple[str, ...] = ("reward",)
    lidar: LidarConfig | Sequence[LidarConfig] | None = None
    camera: CameraConfig | Sequence[CameraConfig] | None = None
    bodies: BodyConfig | Sequence[BodyConfig] | None = None
    max_bodies: int = 0
    meet: Literal["never", "seen", "touched", "both"] = "never"
    lights: Light | Sequence[Light] | None = None
    worlds: WorldsLike | WorldPool | None = None
    drone: DroneLike | None = None
    dynamics: DynamicsConfig | None = None
    clock: ClockConfig | None = None
    max_episode_steps: int = 1000
    frame_skip: int = 1
    random_world: bool = False
    episodes: Literal["team", "each", "last"] = "team"
    info_names: tuple[str, ...] = ()
    markers: tuple[str, ...] = MARKERS
    step_m: float = 0.1
    row_kind: Literal["drone", "env"] = "drone"
    records_path: bool = False

    success: BoolArray
    truncated: BoolArray
    left_area: BoolArray
    info: dict[str, npt.NDArray[np.float64]]
    _batch: weakref.ref[Batch] | None = None  # the batch that owns this task
    _constants: dict[str, Any] | None = None  # values that other attributes than arrays and numbers had after setup

    @property
    def steps(self) -> npt.NDArray[np.int64]:
        """Steps flown in the current episode, (N,)."""
        return self._own_batch().steps

    @property
    def flying(self) -> BoolArray:
        """Mask of the drones that fly in the current step, (N,). The episodes of all others are over."""
        return self._own_batch().flying

    def _own_batch(self) -> Batch:
        batch = None if self._batch is None else self._batch()
        if batch is None:
            raise RuntimeError(
                f"{_name(self)}: this task belongs to no environment, or its environment has been closed"
            )
        return batch

    def __getstate__(self) -> dict[str, Any]:  # copies and pickles belong to no batch
        return {name: value for name, value in vars(self).items() if name not in ("_batch", "_constants")}

    def setup(self, batch: Batch) -> None:
        """Allocate state with a row per drone. Called once, before the first `reset`."""

    def reset(self, batch: Batch, mask: BoolArray) -> None:
        """Begin new episodes where ``mask`` (N,) is True: place those drones and reset their rows of your state.

        ``batch.rows`` has the indices of these rows. With ``rows=batch.rows``, `Batch.random`, `Batch.set_pose` and
        `Batch.set_velocity` take only these rows. With several drones per env, `Batch.random` takes indices of envs and
        the others take indices of drones; drone d belongs to env ``d // batch.drones_per_env``. With
        ``row_kind="drone"``, `Batch.random` takes indices of drones too.
        """
        level = np.zeros((batch.num_drones, 4), np.float32)
        level[:, 0] = 1
        drones = mask if self.row_kind == "drone" else np.repeat(mask, batch.drones_per_env)
        batch.set_pose(batch.terms.start(), level, drones)

    def curriculum(self, batch: Batch, rows: npt.NDArray[np.int64]) -> None:
        """Adapt the task to its results, for example raise the level of an env after a success.

        Called once at the end of each step in which episodes ended, with the indices of their rows, before these begin
        their next episodes. Their results are still available: ``batch.success``, ``batch.episode_end``,
        ``batch.episode_return``, ``batch.episode_length`` and your state. The last observation has already been made.
        Hold levels in arrays: snapshots contain these. An episode that the caller cuts off with a reset does not count.
        """

    def act(self, batch: Batch, actions: Array) -> Target:
        """Return a target for each drone: positions (N, 3) m, or a pair of positions and quaternions (N, 4).

        If the env's ``control`` is not ``"pose"``, return commands (N, 4), as described by `DynamicsConfig`.
        """
        displacement = np.float32(self.step_m) * np.clip(actions.astype(np.float32), -1, 1)
        return batch.position + rotate(batch.quat_wxyz, displacement)

    def step(self, batch: Batch) -> tuple[Array | Mapping[str, Array], BoolArray]:
        """Return the reward (N,) of the motion just flown and sensed, and a mask (N,) of the episodes that it ended.

        The reward may be a mapping from the names in ``reward_terms`` to arrays (N,); their sum is the reward.
        """
        raise NotImplementedError(f"{_name(self)}.step: every task has to define it")

    def observe(self, batch: Batch) -> Array | Mapping[str, Array]:
        """Return the observation of all drones, ``(N, *observation_space.shape)``, or a mapping of these."""
        raise NotImplementedError(f"{_name(self)}.observe: every task has to define it")

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env: ``drawing`` draws points, lines, spheres, cells and text, in metres.

        Called for each picture of the views ``"top"``, ``"third_person"`` and ``"fleet"``, and of the view between two
        points. It is not called for ``"camera"``, which shows the drone's own frames. Change no state here: rendering
        must have no side effects.
        """

    def state(self) -> dict[str, Array]:
        """Return all your state that affects later steps, for `DroneVectorEnv.snapshot`.

        By default this is every attribute that is a NumPy array or a number. All other attributes must stay as `setup`
        left them. A changed one raises an error, because there is no general way to save it. Hold state in arrays, draw
        random numbers from ``batch.random``, or override `state` and `load`. The arrays must keep their names and
        shapes: a snapshot with other shapes is rejected.
        """
        state = {}
        for name, value in vars(self).items():
            if name in _NOT_STATE:
                continue
            if isinstance(value, (np.ndarray, np.generic, int, float)):
                state[name] = np.asarray(value)
                if not state[name].dtype.hasobject:
                    continue
            elif self._constants is None or _is_same(self._constants.get(name, _MISSING), _constant(value)):
                continue
            raise TypeError(
                f"{_name(self)}.state: the attribute {name!r} ({type(value).__name__}) has changed since setup; a "
                "snapshot keeps only arrays and numbers: use these for state, or override state and load"
            )
        return state

    def load(self, state: Mapping[str, Array]) -> None:
        """Restore the result of `state`; by default set the attributes of these names."""
        for name, value in state.items():
            present = getattr(self, name)
            if isinstance(present, np.ndarray) and present.flags.writeable and present.dtype == value.dtype:
                present[...] = value
            else:
                setattr(self, name, value if isinstance(present, np.ndarray) else type(present)(value.item()))


_PROVIDED = ("success", "truncated", "left_area", "info")  # attributes that flockstep provides
_SPACES = ("observation_space", "action_space")  # sampling changes their random state
_NOT_STATE = ("_batch", "_constants", *_PROVIDED, "max_episode_steps", *_SPACES)
_MISSING = object()
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


def _constant(value: Any) -> Any:
    """Return a fingerprint that reveals later changes of a value: its pickled bytes, or else the value itself."""
    if value is None or isinstance(value, (str, bytes, type, World)) or callable(value):
        return value
    try:
        return pickle.dumps(value)
    except Exception:  # pickling can raise anything; then only a different object counts as a change
        return value


def _is_same(before: Any, now: Any) -> bool:
    return before is now or (isinstance(before, (str, bytes)) and bool(before == now))


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
        _refuse_misspelt(task)
        _check_actions_of_default_act(task)
        space = getattr(task, "observation_space", None)
        parts: dict[str, Any] = dict(space.spaces) if isinstance(space, spaces.Dict) else {"observation": space}
        boxes = {name: part for name, part in parts.items() if isinstance(part, spaces.Box)}
        if not boxes or len(boxes) < len(parts):
            raise TypeError(
                f"{_name(task)}.observation_space: expected a gymnasium.spaces.Box or a Dict of them, got {space!r}"
            )
        if not _names(task, "reward_terms"):
            raise ValueError(f"{_name(task)}.reward_terms: expected at least one name, got {task.reward_terms!r}")
        for name in _names(task, "markers"):
            if name not in MARKERS:
                hint = did_you_mean(name, MARKERS)
                raise ValueError(
                    f"{_name(task)}.markers: expected names among {', '.join(MARKERS)}, got {name!r}{hint}"
                )
        for name in _names(task, "info_names"):
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


def _name(task: Task) -> str:
    return type(task).__name__


def _names(task: Task, field: str) -> tuple[str, ...]:
    """Return a field that holds names. Raises an error if it is not a sequence of names or holds a duplicate."""
    names = getattr(task, field)
    if isinstance(names, str):
        raise TypeError(f"{_name(task)}.{field}: expected a tuple of names, got {names!r}: write ({names!r},)")
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"{_name(task)}.{field}: expected a tuple of names, got {names!r}")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{_name(task)}.{field}: expected different names, got {twice!r} twice")
    return tuple(names)


#: Attributes that a subclass may declare and methods that it may override.
_DECLARED = tuple(name for name in Task.__annotations__ if name not in _PROVIDED and not name.startswith("_"))
_METHODS = tuple(name for name, value in vars(Task).items() if inspect.isfunction(value) and not name.startswith("_"))


def settable_names(task: Task) -> set[str]:
    """Return the public attributes of a task that may be set between steps: ``step_m`` and those that `Task` lacks."""
    return {
        name
        for name in dir(task)
        if not name.startswith("_")
        and (name == "step_m" or not (hasattr(Task, name) or name in Task.__annotations__))
        and not callable(inspect.getattr_static(task, name))
    }


def _refuse_misspelt(task: Task) -> None:
    """Raise TypeError if a public name of a task resembles a member of `Task` that its class does not define.

    Names that begin with an underscore and attributes that are set in `setup` are not checked.
    """
    own: dict[str, Any] = {}
    for kind in type(task).__mro__[::-1]:
        if kind not in Task.__mro__:
            own.update(vars(kind))
    own.update(vars(task))
    for name, value in own.items():
        if name.startswith("_") or hasattr(Task, name) or name in Task.__annotations__:
            continue
        value = getattr(value, "__func__", value)  # for static and class methods
        if isinstance(value, type) or (hasattr(value, "__get__") and not inspect.isroutine(value)):
            continue  # nested classes and properties
        known = _METHODS if callable(value) else _DECLARED
        meant = next((other for other in known if other not in own and _is_near(name, value, other)), None)
        if meant is not None:
            raise TypeError(
                f"{_name(task)}.{name} resembles a name of Task. Did you mean {meant!r}? If not, begin it with "
                "an underscore; an attribute may be set in setup instead"
            )


def _is_near(name: str, value: Any, meant: str) -> bool:
    """Return whether a name differs from the intended one only in case, underscores, a plural or a typing error."""
    if callable(value):
        needed = len(inspect.signature(getattr(Task, meant)).parameters)
        if _letters(name) == _letters(meant):
            return True
        if needed < 2 or needed != _count_parameters(value):
            return False  # it could not be called in place of the other method
    elif _has_words_of(name, meant) or _OTHER_NAMES.get(name) == meant:
        return True
    elif meant == "step_m" or name.strip("_").count("_") > meant.count("_"):
        return _letters(name) == _letters(meant)  # lidar_m or step_ms may be a quantity with its unit
    a, b = (_letters(text).removesuffix("s") for text in (name, meant))
    # A word that begins with another letter is another word: flight is no misspelt light.
    return sorted(a) == sorted(b) or (a[:1] == b[:1] and difflib.SequenceMatcher(None, a, b).ratio() > 0.88)


#: Names that other packages give to attributes of tasks.
_OTHER_NAMES = dict.fromkeys(
    ("episode_length", "max_episode_length", "max_ep_len", "time_limit", "horizon"), "max_episode_steps"
)


def _has_words_of(name: str, meant: str) -> bool:
    """Return whether a name leaves out or shortens words of the intended one, as in max_steps and max_ep_steps."""
    words, known = name.lower().split("_"), meant.split("_")
    if len(words) < 2 or not (known[0].startswith(words[0]) and known[-1].startswith(words[-1])):
        return False
    left = iter(known)
    return all(len(word) > 1 and any(other.startswith(word) for other in left) for word in words)


def _count_parameters(function: Any) -> int | None:
    try:
        return len(inspect.signature(function).parameters)
    except ValueError:  # raised for some builtins
        return None


def _letters(name: str) -> str:
    return name.replace("_", "").lower()


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
