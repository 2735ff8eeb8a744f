"""Past positions of the drones of a batch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch


class Trail:
    """The positions of each drone since its episode began: call `record` after every step or reset.

    Parameters
    ----------
    batch
        The batch with the drones to follow.
    max_steps
        Older positions are discarded.
    """

    def __init__(self, batch: Batch, max_steps: int = 2000) -> None:
        self._batch = batch
        self._max_steps = max_steps
        self._positions: list[npt.NDArray[np.float32]] = []
        self._forgotten = 0  # number of discarded positions
        self._first = np.zeros(batch.num_drones, np.int64)  # index of the first position of each drone's episode
        self._episode = self._episodes()

    def _episodes(self) -> npt.NDArray[np.int64]:
        """Return each drone's episode number."""
        episodes = np.repeat(self._batch.episode, self._batch.drones_per_env)
        own = self._batch.own_episodes
        return episodes + own if len(own) else episodes

    def record(self, began: npt.NDArray[np.bool_] | bool = False) -> None:
        """Record the current positions of the drones.

        Parameters
        ----------
        began
            (N,): True for drones whose trail restarts, in addition to those with a new episode number.
        """
        now = self._forgotten + len(self._positions)
        episode = self._episodes()
        self._first[(episode != self._episode) | began] = now
        self._episode = episode
        self._positions.append(self._batch.position.copy())
        forget = max(int(self._first.min()), now + 1 - self._max_steps) - self._forgotten
        if forget > 0:
            del self._positions[:forget]
            self._forgotten += forget

    def of(self, drone: int) -> npt.NDArray[np.float32]:
        """Return the positions (K, 3) of one drone, oldest first."""
        first = max(int(self._first[drone]) - self._forgotten, 0)
        return np.array([positions[drone] for positions in self._positions[first:]], np.float32).reshape(-1, 3)
