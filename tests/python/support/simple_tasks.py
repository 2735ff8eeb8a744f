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
