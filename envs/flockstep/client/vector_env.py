"""The Gymnasium vector environment over a server's batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flockstep import stepping
from flockstep.client.operations import BlockingOperations
from flockstep.client.remote_batch import RemoteBatch
from flockstep.stepping import AUTORESET_MODES, Array, BoolArray, Observation
from flockstep.task_declarations import action_space, observation_space


class RemoteVectorEnv(VectorEnv[Observation, Array, Array]):
    """The envs of a server's batch, as a Gymnasium vector environment. `Client.vector_env` makes it.

    Spaces, autoreset, seeds, masks and infos are those of the server's `DroneVectorEnv`, without the ``info_names`` of
    your own `Task`: the same seeds and actions give the same values. All returned arrays are new. Other clients and the
    server's program must not step or reset the same envs.

    Parameters
    ----------
    client
        The connection. `close` leaves it open.
    reward_scale
        `step` returns the rewards multiplied by this. The episode return in the infos is not scaled.

    Attributes
    ----------
    num_envs
        Number of rows of actions, observations and rewards.
    num_groups
        Number of envs, E.
    drones_per_env
        Number of drones in each env, M.
    client
        The connection.
    observation_space, action_space
        Spaces of all envs.
    single_observation_space, single_action_space
        Spaces of one env.
    autoreset_mode
        A member of `gymnasium.vector.AutoresetMode`.
    reward_scale
        Factor of the returned rewards.

    Raises
    ------
    ServerError
        ``"FAILED_PRECONDITION"``: the server's batch has no task.
    ValueError
        ``reward_scale`` is not a finite number above 0.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012
    copy = False  # the arrays of an answer belong to its receiver

    def __init__(self, client: BlockingOperations, *, reward_scale: float = 1.0) -> None:
        self.reward_scale = stepping.require_reward_scale(reward_scale)
        self.client = client
        self.batch = RemoteBatch(client)
        task = self.batch.task
        self.autoreset_mode = AUTORESET_MODES[task.autoreset_mode]
        render_fps = max(1, round(task.policy_hz / task.frame_skip))
        self.metadata = {**self.metadata, "render_fps": render_fps, "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.num_groups, self.drones_per_env = client.info.num_envs, client.info.drones_per_env
        self.num_envs = task.num_rows
        self.single_observation_space = observation_space(task)
        self.single_action_space = action_space(task)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._rows_per_env = 1 if task.row_is_env else self.drones_per_env
        self._ends_rows, self._has_rests = task.episodes != "team", task.episodes == "last"
        self._waited: BoolArray | None = None  # rows that took no part in the last step
        self._reward_terms = task.reward_terms
        self._seeded = False  # True once every env has a seed, and so an episode to continue

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes. See `DroneVectorEnv.reset`."""
        stepping.reset(self, seed, options)
        return self.batch.observation, {}

    def step(self, actions: npt.ArrayLike) -> tuple[Observation, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Fly one step in every env. See `DroneVectorEnv.step`.

        Raises
        ------
        ValueError
            Actions have a wrong shape or dtype, or are not finite; nothing has changed.
        gymnasium.error.ResetNeeded
            `step` was called before the first `reset`.
        """
        if self._has_rests and self._seeded:
            self._waited = self.batch.waiting
        stepping.step(self, actions)
        return stepping.results(self)

    def snapshot(self) -> bytes:
        """Return everything that affects later steps, as `DroneVectorEnv.snapshot` of the server's env does."""
        stepping.require_open(self)
        if not self._seeded:
            raise ResetNeeded("call reset before snapshot")
        return self.batch.snapshot()

    def restore(self, blob: bytes) -> Observation:
        """Go back to a snapshot and return its observation (N, ...).

        Raises
        ------
        ValueError
            The snapshot belongs to an env with another configuration; nothing has changed.
        """
        stepping.require_open(self)
        self.batch.restore(blob)
        self._seeded = True
        observation: Observation = self.batch.observation
        return observation

    def _finished(self) -> BoolArray | None:
        return self._waited

    def _waiting(self) -> BoolArray:
        """Return a mask of the rows that will not fly in the next step, as `flockstep.PPO` needs it."""
        return self.batch.waiting

    def episode_infos(self, indices: npt.NDArray[np.intp] | None = None) -> dict[str, Any]:
        """Return the statistics of the episodes that ended in the last step, in the envs ``indices`` (default: in all).

        Raises
        ------
        ValueError
            The episode of one of the envs has not ended in the last step.
        """
        return stepping.episode_infos(self, self.batch.rows_of(indices), {})

    def _last_infos(self, ended: npt.NDArray[np.intp]) -> dict[str, Any]:
        return stepping.episode_infos(self, slice(None), {})  # the batch has no others

    def final_observations(self, indices: npt.NDArray[np.intp]) -> list[Observation]:
        """Return the last observation of the episode that ended in each of the envs ``indices``, as new arrays.

        Raises
        ------
        ValueError
            The episode of one of the envs has not ended in the last step.
        """
        rows = self.batch.rows_of(indices)
        return stepping.final_observations(self, np.arange(len(indices)) if isinstance(rows, slice) else rows)

    def close_extras(self, **kwargs: Any) -> None:
        """Forget the batch. The client stays connected."""
        self._seeded = False
