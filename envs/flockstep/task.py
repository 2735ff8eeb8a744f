"""A task of your own: what turns poses and sensors into observations, rewards and the end of an episode.

A `Task` is one Python object for all N drones; its methods read and write arrays with a row per drone. `DroneVectorEnv`
does the rest: motion, sensing, autoreset, time limits, episode statistics, seeding, snapshots.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import Batch, CameraConfig, LidarConfig

Array: TypeAlias = npt.NDArray[Any]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
Target: TypeAlias = Array | tuple[Array, Array]


def rotate(quat_wxyz: Array, vector: Array, *, inverse: bool = False) -> Array:
    """Rotate vectors from the body frame to the world frame.

    Parameters
    ----------
    quat_wxyz
        Unit quaternions, body to world, shape (..., 4).
    vector
        Shape (..., 3), broadcast against ``quat_wxyz``.
    inverse
        Rotate from the world frame to the body frame.
    """
    w, axis = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    if inverse:
        axis = -axis
    twice = 2.0 * np.cross(axis, vector)
    rotated: Array = vector + w * twice + np.cross(axis, twice)
    return rotated.astype(np.result_type(quat_wxyz, vector), copy=False)


class Task:
    """Base class of tasks written in Python.

    Give the class an ``observation_space`` (a `gymnasium.spaces.Box`) and override `observe` and `step`; the rest has
    defaults: actions are displacements of up to ``step_m`` metres per axis, flown with collision, and episodes begin at
    the start marker of the drone's world.

    Random numbers come from ``batch.random(stream, count)``: they depend on nothing but the env's seed, its episode and
    the stream, so env i does the same whatever the number of envs. Draw a stream of its own for each purpose.

    Attributes
    ----------
    observation_space, action_space
        Spaces of one env.
    lidar, camera
        The LiDAR and the camera the task needs, if any; several cameras as a sequence.
    max_episode_steps
        Episodes are truncated after so many steps; 0 means never.
    step_m
        Metres of the default `act`.
    steps
        (N,) int64: steps flown in the current episode; in `step`, the present one included. Read only.
    flying
        (N,) bool: False where an env has ended and has not been reset. Its drone stands still, the row that `step`
        returns for it is thrown away, and state of yours that the observation depends on should stay. Read only.
    success
        (N,) bool: write it in `step`, and the infos of episodes that end will report it.
    """

    observation_space: spaces.Box
    action_space: spaces.Space[Any] = spaces.Box(-1.0, 1.0, (3,), np.float32)
    lidar: LidarConfig | None = None
    camera: CameraConfig | Sequence[CameraConfig] | None = None
    max_episode_steps: int = 1000
    step_m: float = 0.1

    steps: npt.NDArray[np.int64]
    flying: BoolArray
    success: BoolArray

    def setup(self, batch: Batch) -> None:
        """Allocate state with a row per drone. Called once, before the first `reset`."""

    def reset(self, batch: Batch, mask: BoolArray) -> None:
        """Begin new episodes where ``mask`` (N,) is True: place those drones and reset their rows of your state."""
        starts = [world.start for world in batch.worlds]
        position = np.zeros((batch.num_drones, 3), np.float32)
        for index, start in enumerate(starts):
            if start is None:
                raise ValueError(f"world {batch.worlds[index].name!r} has no start marker; override Task.reset")
            position[batch.world_index == index] = start
        batch.set_pose(position, np.tile(np.array([1, 0, 0, 0], np.float32), (batch.num_drones, 1)), mask)

    def act(self, batch: Batch, actions: Array) -> Target:
        """Return where each drone flies to: positions (N, 3) m, or a pair of positions and quaternions (N, 4)."""
        return batch.position + rotate(batch.quat_wxyz, np.float32(self.step_m) * actions.astype(np.float32))

    def step(self, batch: Batch) -> tuple[Array, BoolArray]:
        """Return the reward (N,) of the motion just flown and sensed, and whether it ended the episode (N,)."""
        raise NotImplementedError

    def observe(self, batch: Batch) -> Array:
        """Return the observation of all drones, (N, *observation_space.shape)."""
        raise NotImplementedError

    def state(self) -> dict[str, Array]:
        """Return everything of yours that the next step depends on, for `DroneVectorEnv.snapshot`."""
        return {}

    def load(self, state: Mapping[str, Array]) -> None:
        """Take back what `state` returned."""


class TaskRunner:
    """Steps a `Batch` under a Python task; offers what a batch with a built-in task offers.

    `observation`, `reward` and the flags are new arrays after every step or reset, which nobody writes again.
    """

    def __init__(self, batch: Batch, task: Task, max_episode_steps: int, autoreset_mode: str) -> None:
        if not isinstance(getattr(task, "observation_space", None), spaces.Box):
            raise TypeError(f"{type(task).__name__}.observation_space: expected a gymnasium.spaces.Box")
        if max_episode_steps < 0:
            raise ValueError(f"max_episode_steps: expected 0 (never) or more, got {max_episode_steps}")
        self._batch = batch
        self._task = task
        self._limit = max_episode_steps
        self._mode = autoreset_mode
        n = batch.num_drones
        self.terminated: BoolArray = np.zeros(n, bool)
        self.truncated: BoolArray = np.zeros(n, bool)
        self.success: BoolArray = np.zeros(n, bool)
        self.crashed: BoolArray = np.zeros(n, bool)
        self.reward = np.zeros(n, np.float32)
        self.episode_return = np.zeros(n, np.float64)
        self.episode_length = np.zeros(n, np.int64)
        self.observation: Array = np.zeros((n, *task.observation_space.shape), task.observation_space.dtype)
        self.final_observation: Array = self.observation.copy()
        self._return = np.zeros(n, np.float64)
        task.steps = np.zeros(n, np.int64)
        task.flying = np.ones(n, bool)
        task.success = np.zeros(n, bool)
        task.setup(batch)

    def reset(self, seeds: npt.ArrayLike | None = None, mask: BoolArray | None = None) -> None:
        """Begin new episodes where ``mask`` is True (everywhere by default), with new seeds if given."""
        chosen = np.ones(self._batch.num_drones, bool) if mask is None else mask
        if seeds is not None:
            self._batch.seed(seeds, chosen)
        else:
            self._batch.begin_episode(chosen)
        self._begin(chosen)
        self.terminated = self.terminated & ~chosen
        self.truncated = self.truncated & ~chosen
        self.reward = np.where(chosen, np.float32(0), self.reward)
        self.observation = self._observe()

    def step(self, actions: npt.ArrayLike) -> None:
        """Fly, sense, reward, end and reset, in the order of the built-in tasks."""
        checked = self._check(actions)
        batch, task = self._batch, self._task
        ended_before = self.terminated | self.truncated if self._mode != "same_step" else np.zeros_like(self.terminated)
        flying = ~ended_before
        task.flying[:] = flying
        task.steps += flying

        target = task.act(batch, checked)
        position, quat_wxyz = target if isinstance(target, tuple) else (target, None)
        mask = None if flying.all() else flying
        batch.move(position, quat_wxyz, mask)
        batch.sense(mask)

        raw_reward, raw_terminated = task.step(batch)
        reward = np.where(flying, self._row("reward", raw_reward), 0).astype(np.float32)
        terminated = flying & self._row("terminated", raw_terminated).astype(bool)
        truncated = flying & ~terminated & (task.steps >= (self._limit or np.inf))
        self._return += reward
        ended = terminated | truncated
        self.reward = reward
        self.success = np.where(flying, ended & task.success, self.success)
        self.crashed = np.where(flying, ended & batch.contact.hit, self.crashed)
        self.episode_return = self._return.copy()
        self.episode_length = task.steps.copy()

        if self._mode == "disabled":  # who ended earlier stays as it was
            self.terminated = np.where(flying, terminated, self.terminated)
            self.truncated = np.where(flying, truncated, self.truncated)
            self.observation = self.final_observation = self._observe()
            return
        self.terminated, self.truncated = terminated, truncated
        if self._mode == "same_step":
            over = ended
            if over.any():
                self.final_observation = self._observe()
        else:
            over = ended_before
        if over.any():
            batch.begin_episode(over)
            self._begin(over)
        self.observation = self._observe()
        if self._mode == "next_step":
            self.final_observation = self.observation
            self.success, self.crashed = self.success & flying, self.crashed & flying

    def snapshot(self) -> bytes:
        """Return everything the next step depends on."""
        arrays = {f"runner.{name}": getattr(self, name) for name in self._STATE}
        arrays |= {f"task.{key}": np.asarray(value) for key, value in self._task.state().items()}
        arrays["task_attributes.steps"] = self._task.steps
        arrays["task_attributes.success"] = self._task.success
        arrays["name"] = np.array(self._identity())
        arrays["batch"] = np.frombuffer(self._batch.snapshot(), np.uint8)
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **arrays)
        return file.getvalue()

    def restore(self, blob: bytes) -> None:
        """Go back to a snapshot of the same task and configuration; ValueError, and no change, for any other."""
        try:
            with np.load(io.BytesIO(blob), allow_pickle=False) as file:
                arrays = dict(file)
        except (OSError, ValueError, EOFError) as error:
            raise ValueError("snapshot: not one of a batch with a Python task") from error
        if str(arrays["name"]) != self._identity():
            raise ValueError(f"snapshot: expected one of {self._identity()}, got one of {arrays['name']}")
        self._batch.restore(arrays["batch"].tobytes())
        for name in self._STATE:
            setattr(self, name, arrays[f"runner.{name}"])
        self._task.steps[:] = arrays["task_attributes.steps"]
        self._task.success[:] = arrays["task_attributes.success"]
        self._task.load({key[5:]: value for key, value in arrays.items() if key.startswith("task.")})

    _STATE = (
        "terminated",
        "truncated",
        "success",
        "crashed",
        "reward",
        "episode_return",
        "episode_length",
        "observation",
        "final_observation",
        "_return",
    )

    def _identity(self) -> str:
        return f"{type(self._task).__qualname__}(max_episode_steps={self._limit}, autoreset_mode={self._mode})"

    def _begin(self, mask: BoolArray) -> None:
        self._task.steps[mask] = 0
        self._task.success[mask] = False
        self._return[mask] = 0.0
        self._task.reset(self._batch, mask)
        self._batch.sense(mask)

    def _observe(self) -> Array:
        space = self._task.observation_space
        observation = np.array(self._task.observe(self._batch), dtype=space.dtype)
        expected = (self._batch.num_drones, *space.shape)
        if observation.shape != expected:
            raise ValueError(f"{type(self._task).__name__}.observe: expected shape {expected}, got {observation.shape}")
        return observation

    def _row(self, name: str, value: Array) -> Array:
        array = np.asarray(value)
        if array.shape != (self._batch.num_drones,):
            expected = f"a {name} of shape ({self._batch.num_drones},)"
            raise ValueError(f"{type(self._task).__name__}.step: expected {expected}, got {array.shape}")
        return array

    def _check(self, actions: npt.ArrayLike) -> Array:
        array = np.asarray(actions)
        space = self._task.action_space
        expected = (self._batch.num_drones, *(space.shape or ()))
        if array.shape != expected:
            raise ValueError(f"actions: expected shape {expected}, got {array.shape}")
        if isinstance(space, spaces.Discrete):
            if array.dtype.kind not in "iu":
                raise ValueError(f"actions: expected integers, got {array.dtype}")
            if ((array < space.start) | (array >= space.start + space.n)).any():
                raise ValueError(f"actions: expected {space.start} to {space.start + space.n - 1}")
        elif isinstance(space, spaces.Box):
            if array.dtype.kind not in "fiu":
                raise ValueError(f"actions: expected numbers, got {array.dtype}")
            if not np.isfinite(array).all():
                raise ValueError("actions: expected finite numbers, got NaN or infinity")
        return array
