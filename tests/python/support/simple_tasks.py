"""Tasks in Python that most tests need nothing of."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

import flockstep


class Still(flockstep.Task):
    """Observes positions and rewards nothing; an episode ends by contact."""

    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def step(self, batch: flockstep.Batch) -> Any:
        return np.zeros(batch.num_drones), batch.contact.hit

    def observe(self, batch: flockstep.Batch) -> Any:
        return batch.position


class Climb(flockstep.Task):
    """A minimal task: earn height, end at 3 m."""

    observation_space = spaces.Box(-np.inf, np.inf, (4,), np.float32)
    max_episode_steps = 12

    def setup(self, batch):
        self.bonus = np.zeros(batch.num_drones)

    def reset(self, batch, mask):
        super().reset(batch, mask)
        self.bonus[mask] = batch.random(0, 1)[mask, 0]

    def step(self, batch):
        self.success[:] = batch.position[:, 2] > 2.35
        return batch.position[:, 2] - 2 + self.bonus, self.success | batch.contact.hit

    def observe(self, batch):
        return np.concatenate([batch.position, self.bonus[:, None]], axis=1)

    def state(self):
        return {"bonus": self.bonus}

    def load(self, state):
        self.bonus[:] = state["bonus"]


class Lapper(Climb):
    """Reports its maximum height and number of steps; its fourth step is the last if the bonus is above 0.5."""

    reward_terms = ("height", "cost")
    info_names = ("top", "laps")
    max_episode_steps = 6

    def step(self, batch):
        self.truncated[:] = (batch.steps == 4) & (self.bonus > 0.5)
        self.info["top"][:] = np.maximum(self.info["top"], batch.position[:, 2])
        self.info["laps"] += 1
        terms = {"height": batch.position[:, 2] - 2, "cost": np.full(batch.num_drones, -0.25)}
        return terms, batch.contact.hit


class Commanded(Still):
    """Its actions are commands. Drones of an env begin side by side, 5 m up."""

    action_space = spaces.Box(-5000, 5000, (4,), np.float32)
    records_path = True

    def reset(self, batch: flockstep.Batch, mask: Any) -> None:
        side = np.arange(batch.num_drones) % (batch.num_drones // batch.num_envs)
        batch.set_pose(np.column_stack([0 * side, 0.6 * side, 0 * side + 5]), mask=mask)

    def act(self, batch: flockstep.Batch, actions: Any) -> Any:
        return actions
