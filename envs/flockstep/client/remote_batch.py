"""A server's batch with a task, in the form that a vector environment needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep.client import protocol as pb
from flockstep.client.bodies import RemoteBodies
from flockstep.client.call import call
from flockstep.client.errors import refusals
from flockstep.client.frames import ArrayProperty, Arrays, numpy_type
from flockstep.client.operations import BlockingOperations
from flockstep.errors import refuse_masked

_OBSERVATION, _FINAL_OBSERVATION = "observation", "final_observation"


@dataclass(frozen=True, eq=False)
class RemoteField:
    """A named array that a task declares, like `Field`: ``low`` and ``high`` are numbers, or arrays of ``shape``."""

    name: str
    dtype: str
    shape: tuple[int, ...]
    low: Any
    high: Any


@dataclass(frozen=True, eq=False)
class RemoteTask:
    """The task of a server's batch."""

    action: RemoteField
    observation: list[RemoteField]
    reward_terms: list[str]
    num_rows: int
    row_is_env: bool
    autoreset_mode: str
    policy_hz: float
    frame_skip: int
    episodes: str


class RemoteBatch:
    """Steps the task of a server's batch, and holds the arrays of its last answer, which are new in each answer.

    The arrays of episodes, and ``final_observation``, have one row for each of the K rows whose episode has ended in
    the last step; they are absent if K is 0.

    Attributes
    ----------
    task
        Its `RemoteTask`.
    bodies
        Its `RemoteBodies`.
    """

    def __init__(self, client: BlockingOperations) -> None:
        self._client = client
        self.task = client._call(call("get_task", _task))
        self.bodies = RemoteBodies(client)
        self._arrays: Arrays = {}
        self._step = call("step_envs", _arrays)  # sent by each step

    def reset(self, seeds: npt.NDArray[np.uint64] | None = None, mask: npt.NDArray[np.bool_] | None = None) -> None:
        """Begin new episodes, with seeds (E,) or none, in the envs of the mask (E,) or in all.

        If the episodes of an env's drones end separately, the mask may be (N,) if there are no seeds.
        """
        with refusals():
            self._arrays = self._client._call(call("reset_envs", _arrays, seeds=seeds, mask=mask))

    def step(self, actions: npt.ArrayLike) -> None:
        """Fly one step.

        Raises
        ------
        ValueError
            Actions have a wrong shape or dtype, or are not finite; nothing has changed.
        """
        self._step.arrays = {"actions": self._actions(actions)}
        with refusals():
            self._arrays = self._client._call(self._step)

    def snapshot(self) -> bytes:
        """Return everything that affects later steps."""
        return self._client.snapshot()

    def restore(self, blob: bytes) -> None:
        """Go back to a snapshot.

        Raises
        ------
        ValueError
            The snapshot belongs to another configuration; nothing has changed.
        """
        with refusals():
            self._arrays = self._client._call(call("restore", _arrays, snapshot=np.frombuffer(blob, np.uint8)))

    def rows_of(self, indices: npt.NDArray[np.intp] | None) -> npt.NDArray[np.intp] | slice:
        """Return where the arrays of episodes have the rows ``indices``, whose episodes must have ended; None: all.

        Raises
        ------
        ValueError
            The episode of one of the rows has not ended in the last step.
        """
        if indices is None:
            return slice(None)
        ended = np.flatnonzero(self.terminated | self.truncated)
        if np.array_equal(indices, ended):
            return slice(None)
        if not np.isin(indices, ended).all():
            raise ValueError(f"indices: expected rows whose episodes have ended in the last step, got {indices}")
        return np.searchsorted(ended, indices)

    def _actions(self, actions: npt.ArrayLike) -> npt.NDArray[Any]:
        field = self.task.action
        shape = (self.task.num_rows, *field.shape)
        refuse_masked("actions", actions)
        try:
            array = np.asarray(actions)
        except ValueError as error:  # rows of different lengths
            raise ValueError(f"actions: expected shape {shape}: {error}") from None
        is_integer = field.dtype.startswith("int")
        if array.shape != shape or array.dtype.kind not in ("iu" if is_integer else "iuf"):
            kind = "integers" if is_integer else "numbers"
            raise ValueError(f"actions: expected {kind} of shape {shape}, got {array.dtype} {array.shape}")
        return array.astype(np.int64 if is_integer else np.float32, copy=False)

    def _observation(self, name: str) -> Any:
        fields = self.task.observation
        if len(fields) == 1:
            return self._arrays[f"{name}/{fields[0].name}"]
        return {field.name: self._arrays[f"{name}/{field.name}"] for field in fields}

    @property
    def observation(self) -> Any:
        """Observations: an array (N, ...) or a dict of such arrays."""
        return self._observation(_OBSERVATION)

    @property
    def final_observation(self) -> Any:
        """Last observations of the episodes that ended in this step: arrays (K, ...)."""
        return self._observation(_FINAL_OBSERVATION)

    def _array(self, name: str) -> npt.NDArray[Any]:
        return self._arrays[name]

    reward = ArrayProperty("Rewards (N,) float32.")
    terminated = ArrayProperty("Flags (N,): the episode ended in a terminal state.")
    truncated = ArrayProperty("Flags (N,): the episode was cut off.")
    waiting = ArrayProperty("Flags (N,): the row takes no part in the next step.")
    episode_return = ArrayProperty("Sums of the rewards (K,).")
    episode_terms = ArrayProperty("Sums of the reward terms (K, terms).")
    episode_length = ArrayProperty("Numbers of steps (K,).")
    success = ArrayProperty("Flags (K,).")
    crashed = ArrayProperty("Flags (K,).")
    bad_state = ArrayProperty("Flags (K,).")
    episode_end = ArrayProperty("Reasons (K,), values of `EpisodeEnd`.")


def _arrays(reply: pb.Reply, arrays: Arrays) -> Arrays:
    return arrays


def _field(message: pb.Field) -> RemoteField:
    shape = tuple(message.shape)

    def bound(values: Any) -> Any:
        return values[0] if len(values) == 1 else np.array(values).reshape(shape)

    return RemoteField(message.name, numpy_type(message.dtype).name, shape, bound(message.low), bound(message.high))


def _task(reply: pb.Reply, arrays: Arrays) -> RemoteTask:
    task = reply.task
    return RemoteTask(
        _field(task.action),
        [_field(field) for field in task.observation],
        list(task.reward_terms),
        task.num_rows,
        task.row_is_env,
        task.autoreset_mode,
        task.policy_hz,
        task.frame_skip,
        task.episodes,
    )
