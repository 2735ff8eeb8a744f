"""Train a quadrotor with Stable-Baselines3 PPO to recover from a throw and stay at a point, or to follow a path.

.venv/bin/python -m training.train_flight                     # Hover: a Crazyflie by rotor thrusts, thrown
.venv/bin/python -m training.train_flight --task track        # Track: a figure-8 at 1.5 m/s by thrust and body rates
.venv/bin/python -m training.train_flight --drone x500 --seed 1 --out out/train/x500
"""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule
from tqdm import tqdm

import flockstep
from flockstep.sb3 import DroneVecEnv, PointFeatures
from training.flight import LASTS_S, POLICY_HZ, Flights, Name, fly, greedy, make, position_control, velocity_control
from training.tasks import CHOOSING_SEEDS, UNSEEN_SEEDS, first_env_seed


@dataclass
class Args:
    """Options for training a policy; the figures of docs/flight-tasks.md use each task's defaults."""

    task: Name = "hover"
    """Task to train."""
    drone: str = "crazyflie"
    """Name or path of the drone's frame."""
    control: str | None = None
    """Control of the actions; default: rotor_thrusts for hover, body_rates for track."""
    seed: int = 0
    """Seed of the environments, the network and the sampling of actions."""
    out: Path | None = None
    """Folder for policy.zip and result.json; default: out/train/TASK."""
    total_steps: int | None = None
    """Step budget. The learning rate falls to zero within this many steps. Default: the task's budget."""
    evaluations: int = 12
    """Number of evaluations during training; the best policy is kept."""
    evaluation_flights: int = 200
    """Number of flights in each evaluation."""
    num_envs: int = 512
    """Number of parallel drones."""
    steps_per_update: int = 32
    """Steps of each env between updates."""
    batch_size: int = 4096
    """Minibatch size."""
    epochs: int = 5
    """Passes over the steps of an update."""
    learning_rate: float = 3e-3
    """At the start; falls to zero linearly."""
    gamma: float = 0.98
    """Discount factor."""
    crash_weight: float = 30.0
    """Weight of a crash in the training reward."""
    start_tilt_deg: float = 110.0
    """Hover: drones are thrown with more tilt in training than in the report ..."""
    start_speed_mps: float = 2.5
    """... and faster."""
    log_std: float = -1.5
    """Logarithm of the standard deviation of actions at the start."""
    net: tuple[int, ...] = (64, 64)
    """Hidden layers of actor and critic."""
    reward_scale: float = 0.1
    """Factor of the training reward."""
    learner_threads: int = 1
    """Number of PyTorch threads."""
    progress: bool = True
    """Show the progress bar."""


STEPS: dict[Name, int] = {"hover": 1_600_000, "track": 2_000_000}
REPORTED_FLIGHTS = 1000


@dataclass
class Outcome:
    """Result of a training."""

    steps: int
    seconds: float
    """Time of learning and flying, without the evaluations."""
    evaluation_seconds: float
    curve: list[dict[str, float]] = field(default_factory=list)
    """For each evaluation: steps, seconds, close_rate, median_error_m."""


def training_task(args: Args) -> flockstep.HoverConfig | flockstep.TrackConfig:
    """Return the task with its training settings."""
    if args.task == "track":
        return flockstep.TrackConfig(crash_weight=args.crash_weight)
    return flockstep.HoverConfig(
        crash_weight=args.crash_weight, start_tilt_deg=args.start_tilt_deg, start_speed_mps=args.start_speed_mps
    )


def keywords(args: Args) -> dict[str, Any]:
    """Return the keywords of the envs in addition to the task."""
    return {"drone": args.drone, **({} if args.control is None else {"control": args.control})}


class Chooser(BaseCallback):
    """Evaluates the policy at intervals and keeps the best."""

    def __init__(self, args: Args, total_steps: int) -> None:
        super().__init__()
        self.args, self.total = args, total_steps
        self.best: tuple[float, float] = (-1.0, 0.0)
        self.state: dict[str, Any] = {}
        self.outcome = Outcome(0, 0.0, 0.0)
        self.bar = tqdm(total=total_steps, disable=not args.progress, unit=" steps", unit_scale=True, mininterval=1)

    def _on_training_start(self) -> None:
        self.begun = time.perf_counter()
        self.next_at = self.total // self.args.evaluations

    def _on_step(self) -> bool:
        self.bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.next_at:
            self.try_out()
            self.next_at += self.total // self.args.evaluations

    def _on_training_end(self) -> None:
        self.try_out()
        self.bar.close()
        now = time.perf_counter()
        self.outcome.steps = self.num_timesteps
        self.outcome.seconds = now - self.begun - self.outcome.evaluation_seconds

    def try_out(self) -> None:
        """Fly the choosing seeds, and keep the policy if it is the best so far."""
        before = time.perf_counter()
        args = self.args
        flights = fly(args.task, greedy(self.model), args.evaluation_flights, CHOOSING_SEEDS.start, **keywords(args))
        error = flights.median_error_m
        if (flights.close_rate, -error) > self.best:
            self.best = (flights.close_rate, -error)
            self.state = copy.deepcopy(self.model.policy.state_dict())
        after = time.perf_counter()
        learned = before - self.begun - self.outcome.evaluation_seconds
        self.outcome.evaluation_seconds += after - before
        self.outcome.curve.append(
            {
                "steps": self.num_timesteps,
                "seconds": learned,
                "close_rate": flights.close_rate,
                "median_error_m": error,
            }
        )
        self.bar.set_postfix_str(f"{flights.close_rate:.0%} within 5 cm")


def train(args: Args, make_chooser: Callable[[Args, int], Chooser] = Chooser) -> tuple[PPO, Outcome]:
    """Train; return the best model on the choosing seeds, and the outcome.

    Parameters
    ----------
    args
        The training options.
    make_chooser
        A function of the options and the step budget that returns the callback of the training.
    """
    torch.set_num_threads(args.learner_threads)
    total = STEPS[args.task] if args.total_steps is None else args.total_steps
    envs = make(
        args.task,
        args.num_envs,
        task=training_task(args),
        reward_scale=args.reward_scale,
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        **keywords(args),
    )
    venv = DroneVecEnv(envs)
    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=args.steps_per_update,
        batch_size=args.batch_size,
        n_epochs=args.epochs,
        # No function: the saved policy would contain its bytecode, which crashes another Python version.
        learning_rate=LinearSchedule(args.learning_rate, 0.02 * args.learning_rate, 0.98),
        gamma=args.gamma,
        policy_kwargs={
            "net_arch": list(args.net),
            "log_std_init": args.log_std,
            "features_extractor_class": PointFeatures,
        },
        seed=args.seed,
        device="cpu",
    )
    venv.seed(first_env_seed(args.seed, args.num_envs))  # PPO gave it seeds that other trainings share
    chooser = make_chooser(args, total)
    model.learn(total, callback=chooser)
    model.policy.load_state_dict(chooser.state)
    return model, chooser.outcome


def baseline(args: Args) -> Flights:
    """Fly the unseen seeds with the engine's own cascade, which gets the same target point or path as the policy.

    For a path the command is the velocity at one of the observed points plus a gain towards one of them. Points and
    gain are chosen on the choosing seeds for the smallest error: the controller lags, so it has to look ahead.
    """
    if args.task == "hover":
        own = {**keywords(args), "control": "position"}
        return fly(args.task, position_control(), REPORTED_FLIGHTS, UNSEEN_SEEDS.start, **own)
    own = {**keywords(args), "control": "velocity"}
    task = flockstep.TrackConfig(points=10)
    pilots = [
        velocity_control(task, point, gain, towards)
        for point in range(9)
        for towards in (0, point)
        for gain in (0.25, 0.5, 1.0, 2.0)
    ]
    errors = [
        fly(args.task, pilot, args.evaluation_flights, CHOOSING_SEEDS.start, task=task, **own).median_error_m
        for pilot in pilots
    ]
    best = pilots[int(np.argmin(errors))]
    return fly(args.task, best, REPORTED_FLIGHTS, UNSEEN_SEEDS.start, task=task, **own)


def main(args: Args) -> None:
    """Train, fly the report once, write and print the results."""
    out = args.out or Path("out/train") / args.task
    out.mkdir(parents=True, exist_ok=True)
    model, outcome = train(args)
    model.save(out / "policy.zip")
    flown = fly(args.task, greedy(model), REPORTED_FLIGHTS, UNSEEN_SEEDS.start, **keywords(args))
    by_controller = baseline(args)
    result = {
        "args": {**asdict(replace(args, out=None)), "out": str(out)},
        "outcome": asdict(outcome),
        "close_rate": flown.close_rate,
        "crash_rate": float(flown.crashed.mean()),
        "median_error_m": flown.median_error_m,
        "controller_close_rate": by_controller.close_rate,
        "controller_median_error_m": by_controller.median_error_m,
    }
    (out / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    seconds, hz = LASTS_S[args.task], POLICY_HZ[args.task]
    print(f"""
{outcome.steps:,} steps in {outcome.seconds:.0f} s, and {outcome.evaluation_seconds:.0f} s of evaluations, by which the
policy was chosen. {REPORTED_FLIGHTS:,} flights of {seconds} s that nothing else has flown, at {hz:g} Hz:
  policy             {flown.summary()}
  controller         {by_controller.summary()}
{out}/policy.zip, {out}/result.json""")


if __name__ == "__main__":
    main(tyro.cli(Args))
