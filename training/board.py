"""The board: seconds of trainings, with `flockstep.PPO` and with Stable-Baselines3 at the same settings.

./dev board             # all trainings; needs an idle machine and about an hour
./dev board hover       # one of them

Each training has five seeds, and all are reported. Its settings were found with the seeds 100 and above. The policy is
the last one of the training: nothing chooses among policies. It is judged by flights whose seeds nothing else uses. The
seconds are those of learning and flying, without making the environments and without the flights that judge.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import torch
import tyro
from stable_baselines3 import PPO as SB3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule

import flockstep
from flockstep.sb3 import DroneVecEnv, GoalFeatures, PointFeatures, evaluate
from training import train_flight
from training.flight import Flights, fly, make
from training.rotor_navigation import RotorNavigation
from training.tasks import CHOOSING_SEEDS, TRAINING_SEEDS, UNSEEN_SEEDS, Setup, first_env_seed

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]
Learner = Literal["flockstep", "sb3"]

SEEDS = range(5)
CURVE_POINTS = 8
CURVE_FLIGHTS = 200


@dataclass(frozen=True)
class Verdict:
    """Results of the flights of a policy."""

    success: float
    """Share of successful flights."""
    crashed: float
    """Share of flights that ended by a contact."""


@dataclass(frozen=True)
class Training:
    """A training of the board."""

    steps: int
    """Steps of all drones together."""
    num_envs: int
    """Drones that fly at once."""
    settings: dict[str, Any]
    """Keywords of PPO."""
    make: Callable[[int, int], flockstep.DroneVectorEnv]
    """Makes the environments, from their number and the number of threads."""
    judge: Callable[[Predict, int, int], Verdict]
    """Flies a policy, from the number of flights and the first seed."""
    baseline: Callable[[], Verdict]
    """Flies what a policy has to beat, with the flights of the report."""
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
        flown = evaluate(predict, made, flights, seed, worlds=worlds, random_world=False, max_episode_steps=most_steps)
        return Verdict(flown.success_rate, flown.ends["contact"])

    return judged


def straight_by_steps(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the goal by the six steps of the LiDAR task."""
    direction = observation[:, :3]
    axis = np.abs(direction).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(direction, axis[:, None], axis=1)[:, 0] < 0)


def straight_by_velocity(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the goal by velocities."""
    return np.clip(observation[:, :3] / 3.0, -1, 1)


LIDAR = judge_navigation("flockstep/LidarNavigation-v0", 500)
ROTORS = judge_navigation(RotorNavigation, 400)

TRAININGS: dict[str, Training] = {
    "hover": Training(
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
    ),
    "track": Training(
        steps=3_000_000,
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
    ),
    "lidar": Training(
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
    ),
    "lidar_rotors": Training(
        steps=1_500_000,
        num_envs=512,
        settings={"n_steps": 32, "batch_size": 1024, "n_epochs": 4, "learning_rate": 1e-3, "gamma": 0.98},
        make=make_rotors,
        judge=ROTORS,
        baseline=lambda: ROTORS(straight_by_velocity, 1000, UNSEEN_SEEDS.start),
    ),
}


class Watch(BaseCallback):
    """Schedules the entropy bonus, and judges the policy a few times; the clock stands still meanwhile."""

    def __init__(self, training: Training, judges: bool) -> None:
        super().__init__()
        self.training, self.judges = training, judges
        self.curve: list[dict[str, float]] = []
        self.judging_s = 0.0

    def _on_training_start(self) -> None:
        self.begun = time.perf_counter()
        self.next_at = self.training.steps // CURVE_POINTS

    def _on_rollout_start(self) -> None:
        done = self.model.num_timesteps / self.training.steps
        self.model.ent_coef = self.training.entropy * max(0.0, 1.0 - done / 0.8)
        if self.judges and self.model.num_timesteps >= self.next_at:
            self.next_at += self.training.steps // CURVE_POINTS
            before = time.perf_counter()
            seconds = before - self.begun - self.judging_s
            verdict = self.training.judge(predict_of(self.model), CURVE_FLIGHTS, CHOOSING_SEEDS.start)
            self.curve.append({"steps": self.model.num_timesteps, "seconds": seconds, "success": verdict.success})
            self.judging_s += time.perf_counter() - before

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.seconds = time.perf_counter() - self.begun - self.judging_s


def predict_of(model: Any) -> Predict:
    """Return a model's policy without exploration."""
    return lambda observation: np.asarray(model.predict(observation, deterministic=True)[0])


def train(name: str, learner: Learner, seed: int, threads: int, *, judges: bool = True) -> tuple[Any, Watch]:
    """Train once; return the model and the clock."""
    training = TRAININGS[name]
    envs = DroneVecEnv(training.make(training.num_envs, threads))
    settings = dict(training.settings)
    settings["learning_rate"] = LinearSchedule(settings["learning_rate"], 0.0, 1.0)
    if learner == "flockstep":
        model: Any = flockstep.PPO("MlpPolicy", envs, seed=seed, num_threads=threads, **settings)
    else:
        torch.set_num_threads(threads)
        model = SB3("MlpPolicy", envs, seed=seed, device="cpu", **settings)
    envs.seed(first_env_seed(seed, training.num_envs))  # the seed of the model is that of other trainings, too
    watch = Watch(training, judges)
    model.learn(training.steps, callback=watch, log_interval=None)
    envs.close()
    return model, watch


@dataclass
class Args:
    """Options of the board."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Trainings; default: all."""
    out: Path = Path("out/bench/board.json")
    """File of the results."""
    seeds: int = len(SEEDS)
    """Number of seeds."""
    sb3: bool = True
    """Also train with Stable-Baselines3."""


def report(name: str, args: Args) -> dict[str, Any]:
    """Run everything that the board says about one training."""
    training = TRAININGS[name]
    first, flights = UNSEEN_SEEDS.start, training.flights
    runs = []
    for seed in range(args.seeds):
        run: dict[str, Any] = {"seed": seed}
        for learner, threads in (("flockstep", 1), ("flockstep", 2), *([("sb3", 1)] if args.sb3 else [])):
            judges = threads == 1
            model, watch = train(name, learner, seed, threads, judges=judges)  # type: ignore[arg-type]
            entry: dict[str, Any] = {"seconds": watch.seconds}
            if judges:
                verdict = training.judge(predict_of(model), flights, first)
                entry |= {"success": verdict.success, "crashed": verdict.crashed, "curve": watch.curve}
                if learner == "flockstep":
                    parameters = model.learner.parameters
            elif not np.array_equal(parameters, model.learner.parameters):
                raise AssertionError(f"{name}: two threads gave other parameters than one")
            run[f"{learner}_{threads}"] = entry
            print(
                f"{name} seed {seed} {learner} {threads}: {entry['seconds']:.1f} s {entry.get('success', '')}",
                flush=True,
            )
        runs.append(run)
    baseline = training.baseline()
    return {
        "name": name,
        "steps": training.steps,
        "flights": flights,
        "baseline": {"success": baseline.success, "crashed": baseline.crashed},
        "runs": runs,
    }


def main(args: Args) -> None:
    """Write the results of the named trainings."""
    for name in args.names:
        if name not in TRAININGS:
            sys.exit(f"NAME: expected one of {', '.join(TRAININGS)}, got {name!r}")
    rows = [report(name, args) for name in args.names or TRAININGS]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Args))
