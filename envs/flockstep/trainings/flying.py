"""Flights that judge a policy: those of `flockstep.evaluate`, with what a training measures of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flockstep._core import EpisodeEnd
from flockstep.evaluation import first_episodes
from flockstep.progress_line import ProgressLine
from flockstep.registration import make_same_step
from flockstep.task import Task
from flockstep.trainings.training import CHOOSING_SEEDS, Array, Keywords, Training
from flockstep.vector_env import DroneVectorEnv

TRIED_FLIGHTS = 200  # that choose among baselines


@dataclass
class Flyer:
    """A baseline that flies with a control of its own, or by more than the observation."""

    act: Callable[[Array, DroneVectorEnv], Array]
    """From observations (N, ...) and the environments to actions (N, ...)."""
    keywords: Keywords = field(default_factory=dict)
    """Keywords of its environments."""

    def in_envs(self, envs: DroneVectorEnv) -> Callable[[Array], Array]:
        """Return the function from observations to actions in these environments."""
        return lambda observation: self.act(observation, envs)


@dataclass(frozen=True)
class Flights:
    """Flights of one kind: single drones, or the drones of an env together."""

    success: Array
    """(E,) bool: all drones succeeded."""
    crashed: Array
    """(E,) bool: a drone ended it, by a contact or by leaving the area or the rules."""
    seconds: Array
    """(E,) s."""
    more: dict[str, Array]
    """Values (E,) by name, NaN where there is none."""

    def figure(self, what: str) -> float:
        """Return a figure of the flights; NaN if no flight has one."""
        if what in ("success", "crashed"):
            return float(getattr(self, what).mean())
        if what == "contacts_per_minute":
            return float(60 * self.crashed.sum() / self.seconds.sum())
        values = self.seconds[self.success] if what == "seconds" else self.more[what.removeprefix("median_")]
        values = values[~np.isnan(values)]
        return float((np.median if what.startswith("median_") else np.mean)(values)) if len(values) else float("nan")


@dataclass(frozen=True)
class Verdict:
    """Results of the flights of a policy."""

    success: float
    """Share of successful flights."""
    crashed: float
    """Share of flights that crashed."""
    more: dict[str, float] = field(default_factory=dict)
    """Further results by name, such as ``lap_s``."""


def fly(
    training: Training,
    policy: Any,
    flights: int,
    seed: int,
    progress: ProgressLine | None = None,
    watch: bool = False,
) -> dict[str, Flights]:
    """Fly the flights that judge a training, by kind.

    Parameters
    ----------
    training, policy
        The training, and a policy as for `flockstep.evaluate`, or a `Flyer`.
    flights, seed
        Flights of each kind; the seeds of flights and generated worlds begin with this one.
    progress
        Shows how many flights have ended.
    watch
        Show the envs of each kind in a browser, at the speed of flight.
    """
    flown = {}
    for kind, keywords in training.judged(flights, seed).items():
        own = policy.keywords if isinstance(policy, Flyer) else {}
        rest = {**keywords, **own}
        envs = make_same_step("evaluate", training.env, rest.pop("flights", flights), watch=watch, **rest)
        measure = None if training.measure is None else training.measure(envs)
        act = policy.in_envs(envs) if isinstance(policy, Flyer) else policy
        told = envs.task.info_names if isinstance(envs.task, Task) else ()
        hz, teams = envs.batch.clock.policy_hz, (envs.num_groups, -1)
        ends = first_episodes(act, envs, "evaluate", seed, None if measure is None else measure.step, None, progress)
        steps = np.array([end["episode"]["l"] for end in ends])
        success = np.array([end["is_success"] for end in ends])
        crashed = np.array([end["episode_end"] not in (EpisodeEnd.success, EpisodeEnd.time) for end in ends])
        more = {name: np.array([end[name] for end in ends]) for name in told}
        more |= {} if measure is None else measure.values(steps, success)
        success, crashed = more.pop("success", success), more.pop("crashed", crashed)
        flown[kind] = Flights(
            np.asarray(success.reshape(teams).all(axis=1)),
            np.asarray(crashed.reshape(teams).any(axis=1)),
            steps.reshape(teams).max(axis=1) / hz,
            {name: values.reshape(teams).mean(axis=1) for name, values in more.items()},
        )
    return flown


def judge(
    training: Training,
    policy: Any,
    flights: int,
    seed: int,
    progress: ProgressLine | None = None,
    watch: bool = False,
) -> Verdict:
    """Fly the flights that judge a training, and return the verdict; the arguments are those of `fly`."""
    flown = fly(training, policy, flights, seed, progress, watch)
    chosen = [flown[kind] for kind in training.over or flown]
    flown[""] = Flights(
        np.concatenate([each.success for each in chosen]),
        np.concatenate([each.crashed for each in chosen]),
        np.concatenate([each.seconds for each in chosen]),
        {name: np.concatenate([each.more[name] for each in chosen]) for name in chosen[0].more},
    )
    more = {name: flown[kind].figure(what) for name, (kind, what) in training.figures.items()}
    found = {name: value for name, value in more.items() if not np.isnan(value)}
    return Verdict(flown[""].figure("success"), flown[""].figure("crashed"), found)


def best_of(training: Training, candidates: Sequence[Any]) -> Any:
    """Return the baseline with the smallest median error, or else the most successes; of equals the last one."""
    if len(candidates) == 1:
        return candidates[0]

    def value(candidate: Any) -> float:
        verdict = judge(training, candidate, TRIED_FLIGHTS, CHOOSING_SEEDS.start)
        return -verdict.more["median_error_m"] if "median_error_m" in verdict.more else verdict.success

    values = [value(candidate) for candidate in candidates]
    return candidates[int(np.flatnonzero(np.array(values) == max(values))[-1])]
