"""Train a navigation task with Stable-Baselines3 PPO.

.venv/bin/python training/train_ppo.py --task lidar
.venv/bin/python training/train_ppo.py --task camera
.venv/bin/python training/train_ppo.py --task pixels
.venv/bin/python training/train_ppo.py --seed 1 --max-minutes 5 --out out/train/seed1
.venv/bin/python training/train_ppo.py --resume out/train/lidar/policy.zip
"""

from __future__ import annotations

import argparse
import ctypes
import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
from tqdm import tqdm

import flockstep
from evaluate import fly, greedy
from flockstep.sb3 import BlobFeatures, GoalFeatures, PixelFeatures
from tasks import CHOOSING_SEEDS, TRAINING_SEEDS, Setup, TaskName, remember, task_names

#: An evaluation flight that takes more flown steps has failed: those that reach the goal take half as long.
EVALUATION_STEPS = 500

# Options of glibc's mallopt, from malloc.h.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3


@dataclass
class Args:
    """Train a policy. Every hyperparameter is free; the README's figures were made with each task's defaults."""

    task: TaskName = "lidar"
    """What to train."""
    seed: int = 0
    """Of the environments, the network and the sampling of actions."""
    out: Path = Path("out/train/lidar")
    """Where policy.zip, progress.csv, TensorBoard logs and result.json go."""
    resume: Path | None = None
    """A policy.zip to begin with, its network included. Steps and schedules begin anew."""
    total_steps: int = 1_500_000
    """Step budget. Learning rate and entropy bonus fall to zero with it: it is not only a limit."""
    max_minutes: float | None = None
    """Time budget."""
    evaluate_every: int = 150_000
    """Steps between evaluations; the best model of all of them is kept."""
    evaluation_worlds: int = 500
    """Generated playgrounds that these fly; training does not. No evaluation flies those that ship."""
    solved_rate: float = 0.985
    """Solved: an evaluation succeeds in this share of its playgrounds."""
    stop_when_solved: bool = True
    """Stop at the first such evaluation."""
    num_envs: int = 512
    """Drones flying at once."""
    generated: int = 1000
    """Generated playgrounds to train in, beside those that ship for training."""
    playground_share: float = 0.3
    """Share of episodes flown in those that ship."""
    random_start: bool = False
    """Begin episodes anywhere in the spawn box."""
    width_px: int = 64
    """Of the camera, where the task has one; 4:3."""
    samples_per_pixel: int = 1
    """Of the camera."""
    frame_skip: int = 1
    """Flown steps per decision of the policy. The other numbers of steps here count decisions, but for the next one."""
    max_episode_steps: int = 400
    """Training episodes are cut after so many flown steps: a policy that stalls gets no more reward."""
    reward_scale: float = 0.1
    """Training sees reward * reward_scale ..."""
    reward_clip: float = 10.0
    """... clipped to +- this ..."""
    step_cost: float = 0.0
    """... less this: where the goal is out of sight, hovering must not pay. Everything reported is the task's own."""
    steps_per_update: int = 64
    """Steps of each env between updates."""
    batch_size: int = 4096
    """Minibatch size."""
    epochs: int = 3
    """Passes over the steps of an update."""
    learning_rate: float = 3e-3
    """At the start; falls to zero linearly."""
    entropy: float = 0.03
    """Entropy bonus at the start; falls to zero over the first 80 % of the steps."""
    gamma: float = 0.98
    """Discount."""
    gae_lambda: float = 0.95
    """Of generalised advantage estimation."""
    clip_range: float = 0.2
    """Of PPO."""
    net: tuple[int, ...] = (64, 64)
    """Hidden layers of actor and critic."""
    num_threads: int = 0
    """Of the simulator; 0 means physical cores."""
    learner_threads: int = 1
    """Of PyTorch. For small networks more cost more than they bring."""
    progress: bool = True
    """Show the progress bar."""

    @property
    def setup(self) -> Setup:
        """What is flown."""
        return Setup(self.task, self.width_px, self.width_px * 3 // 4, self.samples_per_pixel, self.frame_skip)


#: What each task is trained with where nothing else is said.
DEFAULTS: dict[TaskName, Args] = {
    "lidar": Args(),
    "camera": Args(
        task="camera",
        out=Path("out/train/camera"),
        total_steps=2_000_000,
        evaluate_every=100_000,
        evaluation_worlds=100,
        solved_rate=0.9,
        generated=200,
        playground_share=0.5,
        random_start=True,
        step_cost=0.15,
    ),
    "pixels": Args(
        task="pixels",
        out=Path("out/train/pixels"),
        total_steps=400_000,
        evaluate_every=50_000,
        evaluation_worlds=100,
        solved_rate=0.9,
        random_start=True,
        num_envs=128,
        generated=100,
        playground_share=0.6,
        batch_size=256,
        frame_skip=4,
        step_cost=0.3,
        learning_rate=1e-3,
    ),
}

POLICIES = {
    "lidar": ("MlpPolicy", GoalFeatures),
    "camera": ("MlpPolicy", BlobFeatures),
    "pixels": ("MultiInputPolicy", PixelFeatures),
}


class LearnerReward(VecEnvWrapper):
    """Rewards clipped for the learner, less a cost per step; the episode returns in the infos stay as they are."""

    def __init__(self, venv: VecEnv, clip: float, step_cost: float = 0.0) -> None:
        super().__init__(venv)
        self.clip, self.step_cost = clip, step_cost
        self.seconds = 0.0  # spent in the environment

    def reset(self) -> Any:
        """Begin new episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Fly one step."""
        before = time.perf_counter()
        observation, reward, done, infos = self.venv.step_wait()
        self.seconds += time.perf_counter() - before
        return observation, np.clip(reward, -self.clip, self.clip) - self.step_cost, done, infos


class TimedPPO(PPO):
    """PPO that notes how long it collects and how long it learns."""

    collecting_s = 0.0
    learning_s = 0.0

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Fly the steps of one update."""
        before = time.perf_counter()
        go_on = super().collect_rollouts(*args, **kwargs)
        self.collecting_s += time.perf_counter() - before
        return go_on

    def train(self) -> None:
        """Learn from them."""
        before = time.perf_counter()
        super().train()
        self.learning_s += time.perf_counter() - before


class Supervisor(BaseCallback):
    """Progress bar, schedules, evaluations, the end of training, and where the time goes."""

    def __init__(self, args: Args) -> None:
        super().__init__()
        self.args = args
        self.worlds = args.setup.generated(CHOOSING_SEEDS, args.evaluation_worlds)
        self.next_evaluation = args.evaluate_every
        self.started = time.perf_counter()
        self.evaluating_s = self.evaluating_in_rollouts_s = 0.0
        self.best = -1.0
        self.solved = False
        self.evaluations: list[dict[str, float]] = []
        self.successes: list[bool] = []

    def _on_training_start(self) -> None:
        self.bar = tqdm(
            total=self.args.total_steps,
            unit=" steps",
            unit_scale=True,
            disable=not self.args.progress,
            dynamic_ncols=True,
            desc="training",
        )
        if self.args.resume:  # what is learned must be better than what it begins with, to take its place
            self.evaluate()

    def _on_rollout_start(self) -> None:
        done = self.num_timesteps / self.args.total_steps
        self.model.ent_coef = self.args.entropy * max(0.0, 1.0 - done / 0.8)
        if self.num_timesteps >= self.next_evaluation:
            self.next_evaluation += self.args.evaluate_every
            self.evaluate()
            self.evaluating_in_rollouts_s = self.evaluating_s

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if info:
                self.successes.append(info["is_success"])
        minutes = (time.perf_counter() - self.started) / 60
        out_of_time = self.args.max_minutes is not None and minutes > self.args.max_minutes
        return not (out_of_time or (self.solved and self.args.stop_when_solved))

    def _on_rollout_end(self) -> None:
        recent = self.successes[-1000:]
        self.successes = recent
        rate = sum(recent) / max(len(recent), 1)
        self.logger.record("rollout/success_rate", rate)
        self.bar.update(self.num_timesteps - self.bar.n)
        self.bar.set_postfix_str(f"success {rate:.0%}")

    def _on_training_end(self) -> None:
        if not (self.solved and self.args.stop_when_solved):  # else nothing was learned since the last evaluation
            self.evaluate()
        self.bar.close()

    def evaluate(self) -> None:
        """Fly the deterministic policy in the playgrounds kept for this; keep the model if it is the best so far."""
        before = time.perf_counter()
        flights = fly(greedy(self.model), self.worlds, EVALUATION_STEPS, setup=self.args.setup)
        rate = float(np.mean([flight.outcome == "success" for flight in flights]))
        self.logger.record("eval/success_rate", rate)
        self.evaluations.append({"steps": self.num_timesteps, "success_rate": rate})
        self.solved |= rate >= self.args.solved_rate
        if rate >= self.best:
            self.best = rate
            written = self.args.out / "written.zip"  # the best model so far stays whole if this is interrupted
            self.model.save(written)
            written.replace(self.args.out / "policy.zip")
        self.bar.write(
            f"  {self.num_timesteps:>9,} steps: reaches the goal in {rate:.1%} of {len(flights)} generated playgrounds "
            "that it does not train in"
        )
        self.evaluating_s += time.perf_counter() - before


@dataclass
class Outcome:
    """What a training reached, and what it took."""

    solved: bool  # by the best model, which is the one returned
    steps: int
    seconds: float  # of training; evaluations are not in it
    evaluation_seconds: float
    steps_per_second: float  # steps / seconds
    seconds_by_part: dict[str, float]
    evaluations: list[dict[str, float]]


def make_envs(args: Args) -> LearnerReward:
    """Return the training environments: each episode is flown in a world drawn at random."""
    setup = args.setup
    playgrounds = flockstep.scenes.load(setup.playgrounds[0])
    worlds = playgrounds + setup.generated(TRAINING_SEEDS, args.generated)
    if 0 < args.playground_share < 1 and args.generated:
        # A world is drawn as often as it stands in the list.
        repeats = round(args.playground_share / (1 - args.playground_share) * args.generated / len(playgrounds))
        worlds += playgrounds * max(repeats - 1, 0)
    envs = setup.make(
        args.num_envs,
        worlds=worlds,
        max_episode_steps=args.max_episode_steps,
        random_start=args.random_start,
        random_world=True,
        stagger_first_episode=True,
        num_threads=args.num_threads,
        autoreset_mode="same_step",
        copy=False,
        reward_scale=args.reward_scale,
    )
    return LearnerReward(flockstep.sb3.make_vec(envs), args.reward_clip, args.step_cost)


def keep_freed_memory() -> None:
    """Ask glibc to keep large blocks that are freed instead of handing them back to the kernel.

    An update allocates and frees activations of a megabyte all the time; handed back, each page of them is faulted in
    and cleared anew on every pass.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, 1 << 25)
        mallopt(M_TRIM_THRESHOLD, 1 << 28)


def train(args: Args) -> tuple[PPO, Outcome]:
    """Train; return the best model of all evaluations and what it took."""
    keep_freed_memory()
    torch.set_num_threads(args.learner_threads)
    args.out.mkdir(parents=True, exist_ok=True)
    venv = make_envs(args)
    venv.seed(args.seed * args.num_envs)
    hyperparameters = {
        "n_steps": args.steps_per_update,
        "batch_size": args.batch_size,
        "n_epochs": args.epochs,
        "learning_rate": LinearSchedule(args.learning_rate, 0.0, 1.0),
        "gamma": args.gamma,
        "gae_lambda": args.gae_lambda,
        "clip_range": args.clip_range,
        "ent_coef": args.entropy,
        "seed": args.seed,
    }
    if args.resume:
        model = TimedPPO.load(args.resume, env=venv, device="cpu", **hyperparameters)
    else:
        policy, features = POLICIES[args.task]
        network = {
            "net_arch": list(args.net),
            "activation_fn": torch.nn.ReLU,
            "features_extractor_class": features,
        }
        model = TimedPPO(policy, venv, policy_kwargs=network, device="cpu", **hyperparameters)
    remember(model, args.setup)
    model.set_logger(configure(str(args.out), ["csv", "tensorboard"]))

    supervisor = Supervisor(args)
    before = time.perf_counter()
    model.learn(args.total_steps, callback=supervisor, log_interval=1)
    elapsed = time.perf_counter() - before - supervisor.evaluating_s
    steps = model.num_timesteps
    seconds = {
        "environment": venv.seconds,
        "policy and rollout buffer": model.collecting_s - venv.seconds - supervisor.evaluating_in_rollouts_s,
        "update": model.learning_s,
    }
    model.logger.close()
    venv.close()
    outcome = Outcome(
        supervisor.solved, steps, elapsed, supervisor.evaluating_s, steps / elapsed, seconds, supervisor.evaluations
    )
    described = {key: str(value) if isinstance(value, Path) else value for key, value in asdict(args).items()}
    (args.out / "result.json").write_text(json.dumps({"args": described, **asdict(outcome)}, indent=1) + "\n")
    return PPO.load(args.out / "policy.zip", device="cpu"), outcome


def command_line() -> Args:
    """Read the command line; what it leaves out is as its task has it."""
    chooser = argparse.ArgumentParser(add_help=False)
    chooser.add_argument("--task", choices=task_names(), default="lidar")
    task = chooser.parse_known_args()[0].task
    return tyro.cli(Args, default=DEFAULTS[task])


if __name__ == "__main__":
    arguments = command_line()
    try:
        _, result = train(arguments)
    except KeyboardInterrupt:
        print(f"\nInterrupted. In {arguments.out}/ is what was kept before: policy.zip, the best model so far.")
        sys.exit(130)
    best = max(evaluation["success_rate"] for evaluation in result.evaluations)
    print(f"The best model reaches the goal in {best:.1%} of the generated playgrounds it was chosen by;")
    print(
        f"{result.steps:,} steps in {result.seconds:.0f} s ({result.steps_per_second:,.0f} steps/s), and "
        f"{result.evaluation_seconds:.0f} s of evaluations."
    )
    print(f"Policy and logs are in {arguments.out}/; training/evaluate.py flies it in the playgrounds that ship.")
