"""A training, and the seeds that it may use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv

Array = npt.NDArray[Any]
Keywords = dict[str, Any]

#: Seeds of generated worlds, three disjoint ranges: for training, for choosing among models and settings, and for the
#: report, which nothing else uses.
TRAINING_SEEDS = range(0, 500_000)
CHOOSING_SEEDS = range(500_000, 1_000_000)
UNSEEN_SEEDS = range(1_000_000, 1_500_000)


def first_env_seed(seed: int, num_envs: int) -> int:
    """Return the seed of env 0 in a training; env i has this seed plus i.

    Trainings with other seeds and the same number of envs use none of these, nor do the flights that choose a model or
    are reported.
    """
    return UNSEEN_SEEDS.stop + seed * num_envs


class Measure:
    """Measures flights, one for each row of the envs, besides their ends and durations."""

    def __init__(self, envs: DroneVectorEnv) -> None:
        self.envs, self.hz = envs, envs.batch.clock.policy_hz

    def step(self, observation: Any, flying: npt.NDArray[np.bool_]) -> None:
        """Measure after a step; ``flying`` has the rows whose flight goes on."""

    def values(self, steps: Array, success: Array) -> dict[str, Array]:
        """Return the values (N,) by name, from the steps and the successes (N,); NaN where there is none.

        Values named ``success`` and ``crashed`` replace those of the task.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Training:
    """One training, and the flights that judge it."""

    env: str | type[Task]
    """A Gymnasium id, or a class of your own."""
    steps: int
    """Steps of all drones together."""
    num_envs: int
    """Environments that fly at once."""
    settings: Keywords
    """Keywords of the learner. The learning rate falls to zero if ``falls``."""
    learns: Callable[[], Keywords] = dict
    """Returns the keywords of the environments for training. ``drones_per_env`` may be a dict from numbers of drones to
    the drones that fly so, and ``num_envs`` then has their sum."""
    judged: Callable[[int, int], Mapping[str, Keywords]] = lambda flights, seed: {"": {}}
    """Returns the keywords of the environments that judge by kind, from the number of flights and the first seed.
    ``flights`` among them replaces the number."""
    over: tuple[str, ...] | None = None
    """Kinds whose flights together are the verdict. None: all."""
    measure: Callable[[DroneVectorEnv], Measure] | None = None
    """Measures the flights."""
    figures: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Further figures by name: a kind, or "" for all flights of the verdict, and what of it."""
    baselines: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """Flyers without a policy by name; of several the best one counts, chosen by flights of its own."""
    film: Keywords = field(default_factory=dict)
    """Keywords of `flockstep.record`."""
    learner: str = "PPO"
    """``"PPO"``, or ``"APG"`` for the derivatives of the flight."""
    entropy: float = 0.0
    """Entropy bonus at the start; it falls to zero over the first 80 % of the steps."""
    falls: bool = True
    """Whether the learning rate falls to zero."""
    flights: int = 1000
    """Flights of the report, of each kind."""
    bench: tuple[str, str, int] | None = None
    """The bench in which it trains, the name of its figures there, and the number of seeds."""
