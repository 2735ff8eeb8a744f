"""Recipes of the trainings of the board: environments, hyperparameters, judges and baselines.

The hyperparameters were found with the seeds 100 and above; the board reports the seeds 0 to 4.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO as SB3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule

import flockstep
from flockstep.sb3 import DroneVecEnv, GoalFeatures, PointFeatures
from training import race, train_flight
from training.flight import POLICY_HZ, Flights, fly, make
from training.forest_flight import ForestFlight, straight
from training.rotor_navigation import RotorNavigation
from training.side_by_side import SideBySide
from training.tasks import TRAINING_SEEDS, UNSEEN_SEEDS, Setup, first_env_seed

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]
Learner = Literal["flockstep", "sb3"]

LEARNED = 0.9  # share of successful held-out flights from which a demonstration says that a policy has learned


@dataclass(frozen=True)
class Verdict:
    """Results of the flights of a policy."""

    success: float
    """Share of successful flights."""
    crashed: float
    """Share of flights that ended by a contact."""
    more: dict[str, float] = field(default_factory=dict)
    """Further results by name, such as ``lap_s``."""


@dataclass(frozen=True)
class Recipe:
    """One training."""

    steps: int
    """Steps of all drones together."""
    num_envs: int
    """Drones that fly at once."""
    settings: dict[str, Any]
    """Keywords of PPO. The learning rate falls to zero."""
    make: Callable[[int, int], flockstep.DroneVectorEnv | SideBySide]
    """Makes the environments, from their number and the number of threads."""
    judge: Callable[[Predict, int, int], Verdict]
    """Flies a policy, from the number of flights and the first seed."""
    baseline: Callable[[], Verdict]
    """Flies what a policy has to beat, with the flights of the report."""
    film: dict[str, Any]
    """Keywords of `flockstep.record`, which films the flight of the first unseen seed."""
    entropy: float = 0.0
    """Entropy bonus at the start; it falls to zero over the first 80 % of the steps."""
    flights: int = 1000
    """Flights of the report."""


# --- hover and track


def make_flight(name: train_flight.Name) -> Callable[[int, int], flockstep.DroneVectorEnv]:
    """Return a function that makes the environments of Hover or Track, with the task's training settings."""

    def made(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
        args = train_flight.Args(task=name)
        return make(
            name,
            num_envs,
            task=train_flight.training_task(args),
            reward_scale=args.reward_scale,
            stagger_first_episode=True,
            autoreset_mode="same_step",
            copy=False,
            num_threads=threads,
            **train_flight.keywords(args),
        )

    return made


def judge_flight(name: train_flight.Name) -> Callable[[Predict, int, int], Verdict]:
    """Return a function that flies Hover or Track; a flight within 5 cm is a success."""

    def judged(predict: Predict, flights: int, seed: int) -> Verdict:
        args = train_flight.Args(task=name)
        flown = fly(name, lambda observation, _: predict(observation), flights, seed, **train_flight.keywords(args))
        return _verdict(flown)

    return judged


def _verdict(flown: Flights) -> Verdict:
    return Verdict(flown.close_rate, float(flown.crashed.mean()))


# --- LiDAR


def make_lidar(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
    """Make the environments of the thesis's LiDAR task."""
    setup = Setup("lidar")
    playgrounds = flockstep.scenes.load("train")
    generated = setup.generated(TRAINING_SEEDS, 1000)
    return setup.make(
        num_envs,
        max_episode_steps=400,
        worlds=[*playgrounds * 86, *generated],  # three of ten episodes in the playgrounds of the thesis
        random_world=True,
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
        reward_scale=0.1,
        reward=flockstep.NavigationReward(goal_reward=100.0),
    )


def make_rotors(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
    """Make the environments of the LiDAR task by rotors."""
    return flockstep.DroneVectorEnv(
        num_envs,
        task=RotorNavigation(),
        worlds=Setup("lidar").generated(TRAINING_SEEDS, 300),
        max_episode_steps=300,
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
    )


def judge_navigation(task: Any, most_steps: int) -> Callable[[Predict, int, int], Verdict]:
    """Return a function that flies a navigation task once in each of several generated playgrounds."""

    def judged(predict: Predict, flights: int, seed: int) -> Verdict:
        worlds = Setup("lidar").generated(range(seed, seed + flights), flights)
        made = task() if isinstance(task, type) else task
        flown = flockstep.evaluate(
            predict, made, flights, seed, worlds=worlds, random_world=False, max_episode_steps=most_steps
        )
        return Verdict(flown.success_rate, flown.ends["contact"])

    return judged


# --- forest


@functools.cache
def forest(seed: int) -> flockstep.World:
    """Generate a forest once."""
    return flockstep.World.forest(seed)


def make_forest(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
    """Make the environments of the flight through a forest."""
    return flockstep.DroneVectorEnv(
        num_envs,
        task=ForestFlight(),
        worlds=[forest(seed) for seed in TRAINING_SEEDS[:200]],
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
    )


def judge_forest(predict: Predict, flights: int, seed: int) -> Verdict:
    """Fly once in each of several forests."""
    worlds = [forest(each) for each in range(seed, seed + flights)]
    flown = flockstep.evaluate(predict, ForestFlight, flights, seed, worlds=worlds, random_world=False)
    return Verdict(flown.success_rate, flown.ends["contact"], {"speed_mps": flown.infos["speed_mps"]})


# --- race


def judge_race(fly_it: Callable[[Predict, int, int], race.Race]) -> Callable[[Predict, int, int], Verdict]:
    """Return a function that flies races of three laps; all laps are a success."""

    def judged(predict: Predict, flights: int, seed: int) -> Verdict:
        flown = fly_it(predict, flights, seed)
        figures = {"lap_s": flown.lap_s, "speed_mps": flown.speed_mps} if flown.success.any() else {}
        return Verdict(float(flown.success.mean()), float(flown.crashed.mean()), figures)

    return judged


# --- what flies without a policy


def straight_by_steps(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the next waypoint by the six steps of the LiDAR task."""
    direction = observation[:, :3]
    axis = np.abs(direction).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(direction, axis[:, None], axis=1)[:, 0] < 0)


def straight_by_velocity(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the next waypoint as fast as it can."""
    velocity = observation[:, :3] * [1.0, 1.0, 2.0]  # an action of 1 is half as fast upwards
    return np.asarray(velocity / np.abs(velocity).max(axis=1, keepdims=True), np.float32)


LIDAR = judge_navigation("flockstep/LidarNavigation-v0", 500)
ROTORS = judge_navigation(RotorNavigation, 400)
RACE, UNSEEN_RACE = judge_race(race.fly), judge_race(race.fly_unseen)

RECIPES: dict[str, Recipe] = {
    "hover": Recipe(
        steps=1_600_000,
        num_envs=512,
        settings={
            "n_steps": 32,
            "batch_size": 1024,
            "n_epochs": 5,
            "learning_rate": 1.5e-3,
            "gamma": 0.98,
            "policy_kwargs": {"log_std_init": -1.5, "features_extractor_class": PointFeatures},
        },
        make=make_flight("hover"),
        judge=judge_flight("hover"),
        baseline=lambda: _verdict(train_flight.baseline(train_flight.Args(task="hover"))),
        film={"env": "flockstep/Hover-v0", "steps": 300, "policy_hz": POLICY_HZ["hover"]},
    ),
    "track": Recipe(
        steps=4_500_000,
        num_envs=256,
        settings={
            "n_steps": 64,
            "batch_size": 1024,
            "n_epochs": 5,
            "learning_rate": 1e-3,
            "gamma": 0.995,
            "policy_kwargs": {"log_std_init": -1.5, "features_extractor_class": PointFeatures},
        },
        make=make_flight("track"),
        judge=judge_flight("track"),
        baseline=lambda: _verdict(train_flight.baseline(train_flight.Args(task="track"))),
        film={"env": "flockstep/Track-v0", "steps": 1000, "policy_hz": POLICY_HZ["track"], "fps": 50},
    ),
    "lidar": Recipe(
        steps=1_500_000,
        num_envs=512,
        settings={
            "n_steps": 64,
            "batch_size": 1024,
            "n_epochs": 3,
            "learning_rate": 1.5e-3,
            "gamma": 0.98,
            "policy_kwargs": {"activation_fn": torch.nn.ReLU, "features_extractor_class": GoalFeatures},
        },
        entropy=0.03,
        make=make_lidar,
        judge=LIDAR,
        baseline=lambda: LIDAR(straight_by_steps, 1000, UNSEEN_SEEDS.start),
        film={"steps": 400, "fps": 25},
    ),
    "lidar_rotors": Recipe(
        steps=2_500_000,
        num_envs=512,
        settings={
            "n_steps": 32,
            "batch_size": 1024,
            "n_epochs": 4,
            "learning_rate": 1e-3,
            "gamma": 0.98,
            "policy_kwargs": {"activation_fn": torch.nn.ReLU},
        },
        make=make_rotors,
        judge=ROTORS,
        baseline=lambda: ROTORS(straight_by_velocity, 1000, UNSEEN_SEEDS.start),
        film={"env": RotorNavigation, "steps": 400},
    ),
    "forest": Recipe(
        steps=1_200_000,
        num_envs=256,
        settings={
            "n_steps": 32,
            "batch_size": 1024,
            "n_epochs": 4,
            "learning_rate": 1e-3,
            "gamma": 0.98,
            "policy_kwargs": {"net_arch": [128, 128], "activation_fn": torch.nn.ReLU, "log_std_init": -1.0},
        },
        make=make_forest,
        judge=judge_forest,
        baseline=lambda: judge_forest(straight, 300, UNSEEN_SEEDS.start),
        film={"env": ForestFlight, "worlds": forest(UNSEEN_SEEDS.start), "steps": 200},
        flights=300,
    ),
    "race": Recipe(
        steps=race.STEPS,
        num_envs=race.NUM_ENVS,
        settings=race.SETTINGS,
        make=race.make,
        judge=RACE,
        baseline=lambda: RACE(race.chosen_pursuit(race.fly), 1000, UNSEEN_SEEDS.start),
        film={**race.FILM, "render_view": race.VIEW},
    ),
    "race_unseen": Recipe(
        steps=race.UNSEEN_STEPS,
        num_envs=race.NUM_ENVS,
        settings=race.SETTINGS,
        make=race.make_on_tracks,
        judge=UNSEEN_RACE,
        baseline=lambda: UNSEEN_RACE(race.chosen_pursuit(race.fly_unseen), 1000, UNSEEN_SEEDS.start),
        film={**race.FILM, "worlds": flockstep.World.race_track(UNSEEN_SEEDS.start)},
    ),
}


class Schedule(BaseCallback):
    """Lets the entropy bonus fall."""

    def __init__(self, recipe: Recipe) -> None:
        super().__init__()
        self.recipe = recipe

    def _on_rollout_start(self) -> None:
        done = self.model.num_timesteps / self.recipe.steps
        self.model.ent_coef = self.recipe.entropy * max(0.0, 1.0 - done / 0.8)

    def _on_step(self) -> bool:
        return True


class TimeLimit(BaseCallback):
    """Ends a training after some minutes; without a limit, never."""

    def __init__(self, max_minutes: float | None) -> None:
        super().__init__()
        self._max_s = math.inf if max_minutes is None else 60 * max_minutes
        self.is_over = False

    def _on_training_start(self) -> None:
        self._end = time.perf_counter() + self._max_s

    def _on_step(self) -> bool:
        self.is_over = time.perf_counter() >= self._end
        return not self.is_over


def verdict_on(skill: str, success: float, steps: int, planned: int) -> str:
    """Return the beginning of a sentence: that a policy learned a skill, or not, and whether it had time."""
    if success >= LEARNED:
        return f"A policy learned from scratch to {skill}"
    cause = f": time ran out at {steps:,} of {planned:,} steps" if steps < planned else ""
    return f"FAILED{cause}. The policy did not learn to {skill}"


def train(recipe: Recipe, learner: Learner, seed: int, threads: int, callbacks: Sequence[BaseCallback] = ()) -> Any:
    """Train once, and return the model.

    Parameters
    ----------
    recipe, learner, seed
        What to train, by which PPO, and the seed of networks and environments.
    threads
        Number of threads of environments and learner; 0: one per physical core. Stable-Baselines3 learns with one.
    callbacks
        Further callbacks.
    """
    made = recipe.make(recipe.num_envs, threads)
    envs = DroneVecEnv(made) if isinstance(made, flockstep.DroneVectorEnv) else made
    settings = {**recipe.settings, "learning_rate": LinearSchedule(recipe.settings["learning_rate"], 0.0, 1.0)}
    if learner == "flockstep":
        model: Any = flockstep.PPO("MlpPolicy", envs, seed=seed, num_threads=threads, **settings)
    else:
        torch.set_num_threads(1)
        model = SB3("MlpPolicy", envs, seed=seed, device="cpu", **settings)
    envs.seed(first_env_seed(seed, recipe.num_envs))  # the seeds of the model are also those of other trainings
    model.learn(recipe.steps, callback=[Schedule(recipe), *callbacks], log_interval=None)
    envs.close()
    return model


def predict_of(model: Any) -> Predict:
    """Return a model's policy without exploration."""
    return lambda observation: np.asarray(model.predict(observation, deterministic=True)[0])
