"""Train a task with Stable-Baselines3 PPO: a bundled one or your own.

.venv/bin/python -m training.train_ppo --task lidar
.venv/bin/python -m training.train_ppo --task camera
.venv/bin/python -m training.train_ppo --task pixels
.venv/bin/python -m training.train_ppo --task my_module:MyTask --worlds my-world.json
.venv/bin/python -m training.train_ppo --seed 1 --max-minutes 5 --out out/train/seed1
.venv/bin/python -m training.train_ppo --resume out/train/lidar/policy.zip
"""

from __future__ import annotations

import argparse
import ctypes
import json
import math
import re
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
import tyro
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
from tqdm import tqdm

import flockstep
from flockstep.sb3 import BlobFeatures, GoalFeatures, ImageFeatures, PixelFeatures
from flockstep.sb3.features import is_image
from flockstep.trainings import CHOOSING_SEEDS, TRAINING_SEEDS, first_env_seed
from training.evaluate import fly, greedy
from training.tasks import IDS, Setup, own_defaults, remember

# Options of glibc's mallopt, from malloc.h.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3


@dataclass
class Args:
    """Options for training a policy."""

    task: str = "lidar"
    """Task to train: lidar, camera or pixels; an id that flockstep registered with Gymnasium, or module:id if your own
    module registers it; or module:Class of a flockstep.Task. Modules in the working directory are found."""
    seed: int = 0
    """Seed of the environments, the network and the sampling of actions."""
    out: Path = Path("out/train/lidar")
    """Folder for policy.zip, progress.csv, TensorBoard logs and result.json."""
    resume: Path | None = None
    """A policy.zip to continue from, including its network. Steps and schedules restart. Loading it runs code from the
    file: load only policies you trust."""
    total_steps: int = 1_500_000
    """Step budget. It also sets the schedules: learning rate and entropy bonus fall to zero within this many steps."""
    max_minutes: float | None = None
    """Time budget."""
    evaluate_every: int = 150_000
    """Steps between evaluations; the best model is kept."""
    evaluation_worlds: tuple[str, ...] = ()
    """Names of worlds for evaluations, used in turn. Default: generated playgrounds that are not used in training. For
    your own task without generated worlds: its training worlds."""
    evaluation_flights: int = 500
    """Number of flights per evaluation, one in each generated playground. With named worlds, a built-in task makes one
    flight in each world; your own task repeats the worlds in turn."""
    evaluation_steps: int = 500
    """Time limit of an evaluation flight of a built-in task, in flown steps: twice what a successful flight in the
    playgrounds takes."""
    solved_rate: float = 0.985
    """Success rate of an evaluation that counts as solved."""
    stop_when_solved: bool = True
    """Stop at the first solved evaluation."""
    num_envs: int = 512
    """Number of parallel drones."""
    worlds: tuple[str, ...] = ()
    """Sets of scenes, scene names or paths to train in. Default: the bundled training playgrounds."""
    generated: int = 1000
    """Number of additional generated playgrounds to train in."""
    playground_share: float = 0.3
    """Share of episodes flown in the training worlds (worlds); the others are flown in the generated playgrounds."""
    random_start: bool = False
    """Begin episodes anywhere in the spawn box; only for navigation tasks."""
    width_px: int = 64
    """Image width of the built-in tasks' camera; the aspect ratio is 4:3."""
    samples_per_pixel: int = 1
    """Samples per pixel of that camera."""
    lidar_channels: int = 1
    """Rows of beams of the built-in tasks' LiDAR: a single one is level, several also hit the ground."""
    lidar_vfov_deg: float = 0.0
    """Angle between the highest and the lowest row."""
    frame_skip: int = 1
    """Flown steps per decision of the policy. The other step counts here are decisions, except evaluation_steps and
    max_episode_steps, which are flown steps."""
    max_episode_steps: int | None = 400
    """Training episodes are truncated after this many flown steps: a stalling policy gets no more reward. None: the
    task's own limit."""
    reward_scale: float = 0.1
    """Factor of the reward in training. All reported rewards are the task's own."""
    reward_clip: float | None = 10.0
    """The scaled reward is clipped to +- this value. None: no clipping."""
    step_cost: float = 0.0
    """Cost per decision, subtracted after scaling and clipping, so that hovering with the goal out of sight does not
    pay."""
    steps_per_update: int = 64
    """Steps of each env between updates."""
    batch_size: int = 4096
    """Minibatch size."""
    epochs: int = 3
    """Passes over the steps of an update."""
    learning_rate: float = 3e-3
    """Learning rate at the start; falls to zero linearly."""
    entropy: float = 0.03
    """Entropy bonus at the start; falls to zero over the first 80 % of the steps."""
    gamma: float = 0.98
    """Discount factor."""
    gae_lambda: float = 0.95
    """Lambda of generalised advantage estimation."""
    clip_range: float = 0.2
    """Clip range of PPO."""
    net: tuple[int, ...] = (64, 64)
    """Hidden layers of actor and critic."""
    num_threads: int = 0
    """Number of simulator threads; 0 means one per physical core."""
    learner_threads: int = 1
    """Number of PyTorch threads. For small networks more threads are slower."""
    progress: bool = True
    """Show the progress bar."""

    def __post_init__(self) -> None:
        """Replace the id of a bundled task by its short name."""
        self.task = IDS.get(self.task, self.task)

    @property
    def setup(self) -> Setup:
        """The task and its settings."""
        return Setup(
            self.task,
            self.width_px,
            self.width_px * 3 // 4,
            self.samples_per_pixel,
            self.frame_skip,
            self.worlds,
            self.evaluation_worlds,
            self.lidar_channels,
            self.lidar_vfov_deg,
        )


#: Default options of each bundled task.
DEFAULTS = {
    "lidar": Args(),
    "camera": Args(
        task="camera",
        out=Path("out/train/camera"),
        total_steps=2_000_000,
        evaluate_every=100_000,
        evaluation_flights=100,
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
        evaluation_flights=100,
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

#: Default options of your own tasks.
OWN = Args(
    total_steps=500_000,
    evaluate_every=25_000,
    evaluation_flights=100,
    num_envs=64,
    generated=0,
    max_episode_steps=None,
    reward_scale=1.0,
    reward_clip=None,
    steps_per_update=32,
    batch_size=256,
    learning_rate=1e-3,
    entropy=0.0,
)

FEATURES: dict[str, type[BaseFeaturesExtractor]] = {
    "lidar": GoalFeatures,
    "camera": BlobFeatures,
    "pixels": PixelFeatures,
}


def defaults_of(task: str) -> Args:
    """Return the default options of a task.

    Raises
    ------
    ValueError
        The task does not exist.
    """
    registered = own_defaults(task)
    task = IDS.get(task, task)
    out = Path("out/train") / re.split("[:/]", task)[-1]
    return DEFAULTS.get(task) or replace(OWN, task=task, out=out, **registered)


def network(task: str, space: spaces.Space[Any]) -> tuple[str, dict[str, Any]]:
    """Return the kind of policy that suits a task's observation, and its keywords for the features extractor."""
    images = [part for part in (space.values() if isinstance(space, spaces.Dict) else [space]) if is_image(part)]
    kind = "MultiInputPolicy" if isinstance(space, spaces.Dict) else "CnnPolicy" if images else "MlpPolicy"
    features = FEATURES.get(task, ImageFeatures if images else None)
    return kind, {} if features is None else {"features_extractor_class": features}


class LearnerReward(VecEnvWrapper):
    """Clips rewards for learning and subtracts a cost per step; episode returns in the infos are unchanged."""

    def __init__(self, venv: VecEnv, clip: float | None, step_cost: float = 0.0) -> None:
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
        clipped = reward if self.clip is None else np.clip(reward, -self.clip, self.clip)
        return observation, clipped - self.step_cost, done, infos


class TimedPPO(PPO):
    """PPO that measures its time for collecting and for learning."""

    collecting_s = 0.0
    learning_s = 0.0

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Fly the steps of one update."""
        before = time.perf_counter()
        go_on = super().collect_rollouts(*args, **kwargs)
        self.collecting_s += time.perf_counter() - before
        return go_on

    def train(self) -> None:
        """Learn from the steps of one update."""
        before = time.perf_counter()
        super().train()
        self.learning_s += time.perf_counter() - before


class Supervisor(BaseCallback):
    """Progress bar, schedules, evaluations, end of training, and time measurements."""

    def __init__(self, args: Args) -> None:
        super().__init__()
        self.args = args
        self.worlds, self.where = evaluation_flights(args)
        self.next_evaluation = args.evaluate_every
        self.started = time.perf_counter()
        self.evaluating_s = self.evaluating_in_rollouts_s = 0.0
        self.best = -1.0
        self.solved = False
        self.first_success: dict[str, float] | None = None
        self.evaluations: list[dict[str, float]] = []
        self.successes: list[bool] = []

    def training_s(self) -> float:
        """Return the training time so far in s, without evaluations."""
        return time.perf_counter() - self.started - self.evaluating_s

    def _on_training_start(self) -> None:
        self.bar = tqdm(
            total=self.args.total_steps,
            unit=" steps",
            unit_scale=True,
            disable=not self.args.progress,
            dynamic_ncols=True,
            desc="training",
        )
        if self.args.resume:  # a resumed policy is replaced only by a better one
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
                if info["is_success"] and self.first_success is None:
                    self.first_success = {"steps": self.num_timesteps, "seconds": self.training_s()}
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
        if not (self.solved and self.args.stop_when_solved):  # otherwise nothing was learned since the last evaluation
            self.evaluate()
        self.bar.close()

    def evaluate(self) -> None:
        """Fly the deterministic policy in the evaluation worlds; keep the model if it is the best so far."""
        before = time.perf_counter()
        setup, seconds = self.args.setup, self.training_s()
        limit = self.args.max_episode_steps if setup.is_own else self.args.evaluation_steps
        flights = fly(greedy(self.model), self.worlds, limit, setup=setup, seed=CHOOSING_SEEDS.start)
        rate = float(np.mean([flight.outcome == "success" for flight in flights]))
        self.logger.record("eval/success_rate", rate)
        self.evaluations.append({"steps": self.num_timesteps, "seconds": seconds, "success_rate": rate})
        self.solved |= rate >= self.args.solved_rate
        if rate >= self.best:
            self.best = rate
            written = self.args.out / "written.zip"  # the best model stays intact if this is interrupted
            self.model.save(written)
            written.replace(self.args.out / "policy.zip")
        self.bar.write(f"  {self.num_timesteps:>9,} steps: success in {rate:.1%} of {len(flights)} {self.where}")
        self.evaluating_s += time.perf_counter() - before


@dataclass
class Outcome:
    """Results and costs of a training run."""

    solved: bool  # by the best model, which is returned
    steps: int
    seconds: float  # training time, without evaluations
    evaluation_seconds: float
    steps_per_second: float  # steps / seconds
    seconds_by_part: dict[str, float]
    first_success: dict[str, float] | None  # steps and seconds until the exploring policy first succeeded
    evaluations: list[dict[str, float]]  # steps and seconds until then, and the success rate


def evaluation_flights(args: Args) -> tuple[list[flockstep.World], str]:
    """Return the world of each flight of an evaluation, and a description of the worlds."""
    setup = args.setup
    names = setup.evaluation_worlds or (setup.training_worlds if setup.is_own and not args.generated else ())
    if not names:
        worlds = setup.generated(CHOOSING_SEEDS, args.evaluation_flights)
        return worlds, "generated playgrounds that it does not train in"
    worlds = flockstep.scenes.load(names)
    # Built-in tasks start the same way every time, so one flight per world is enough.
    count = max(args.evaluation_flights, len(worlds)) if setup.is_own else len(worlds)
    return [worlds[i % len(worlds)] for i in range(count)], f"flights in {', '.join(names)}"


def make_envs(args: Args) -> LearnerReward:
    """Return the training environments, in which each episode is flown in a random world."""
    setup = args.setup
    playgrounds = flockstep.scenes.load(setup.training_worlds)
    worlds = playgrounds + setup.generated(TRAINING_SEEDS, args.generated)
    if 0 < args.playground_share < 1 and args.generated:
        # The draw is uniform over the list, so repetition sets the share of a world.
        repeats = round(args.playground_share / (1 - args.playground_share) * args.generated / len(playgrounds))
        worlds += playgrounds * max(repeats - 1, 0)
    envs = setup.make_limited(
        args.num_envs,
        args.max_episode_steps,
        worlds=worlds,
        random_world=True,
        stagger_first_episode=True,
        num_threads=args.num_threads,
        autoreset_mode="same_step",
        copy=False,
        reward_scale=args.reward_scale,
        **({"random_start": True} if args.random_start else {}),
    )
    return LearnerReward(flockstep.sb3.make_vec(envs), args.reward_clip, args.step_cost)


def keep_freed_memory() -> None:
    """Configure glibc to keep large freed blocks instead of returning them to the kernel.

    An update repeatedly allocates and frees activations of a megabyte. If they were returned, each of their pages would
    be faulted in and cleared again on every pass.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, 1 << 25)
        mallopt(M_TRIM_THRESHOLD, 1 << 28)


def train(args: Args) -> tuple[PPO, Outcome]:
    """Train; return the best model of all evaluations, and the outcome."""
    keep_freed_memory()
    torch.set_num_threads(args.learner_threads)
    args.out.mkdir(parents=True, exist_ok=True)
    venv = make_envs(args)
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
        policy, features = network(args.task, venv.observation_space)
        layers = {"net_arch": list(args.net), "activation_fn": torch.nn.ReLU}
        model = TimedPPO(policy, venv, policy_kwargs={**layers, **features}, device="cpu", **hyperparameters)
    # Making or loading the model has seeded env i with seed + i, so training runs with the seeds 0 and 1 would share
    # all envs except one. The seeds set here replace those at the first reset.
    venv.seed(first_env_seed(args.seed, args.num_envs))
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
        supervisor.solved,
        steps,
        elapsed,
        supervisor.evaluating_s,
        steps / elapsed,
        seconds,
        supervisor.first_success,
        supervisor.evaluations,
    )
    described = {key: str(value) if isinstance(value, Path) else value for key, value in asdict(args).items()}
    (args.out / "result.json").write_text(json.dumps({"args": described, **asdict(outcome)}, indent=1) + "\n")
    return PPO.load(args.out / "policy.zip", device="cpu"), outcome


#: Minimum of each number, whether the minimum is allowed, and maximum.
RANGES: dict[str, tuple[float, bool, float]] = {
    "seed": (0, True, 2**32 - 1),
    "total_steps": (1, True, math.inf),
    "max_minutes": (0, False, math.inf),
    "evaluate_every": (1, True, math.inf),
    "evaluation_flights": (1, True, 500_000),
    "evaluation_steps": (1, True, math.inf),
    "solved_rate": (0, True, 1),
    "num_envs": (1, True, 2**20),
    "generated": (0, True, 500_000),
    "playground_share": (0, True, 1),
    "width_px": (4, True, 16_384),
    "samples_per_pixel": (1, True, math.inf),
    "lidar_channels": (1, True, math.inf),
    "lidar_vfov_deg": (0, True, 180),
    "frame_skip": (1, True, 1000),
    "max_episode_steps": (1, True, math.inf),
    "reward_scale": (0, False, math.inf),
    "reward_clip": (0, False, math.inf),
    "step_cost": (-math.inf, False, math.inf),
    "steps_per_update": (1, True, math.inf),
    "batch_size": (2, True, math.inf),
    "epochs": (1, True, math.inf),
    "learning_rate": (0, False, math.inf),
    "entropy": (0, True, math.inf),
    "gamma": (0, True, 1),
    "gae_lambda": (0, True, 1),
    "clip_range": (0, False, math.inf),
    "num_threads": (0, True, math.inf),
    "learner_threads": (1, True, math.inf),
}


def require_valid(args: Args) -> None:
    """Raise ValueError that names the first option with an invalid value."""
    for name, (least, is_allowed, greatest) in RANGES.items():
        value = getattr(args, name)
        if value is None:
            continue
        in_range = least <= value <= greatest and math.isfinite(value) and (is_allowed or value != least)
        if not in_range:
            expected = "a finite number"
            if least > -math.inf:
                expected = "an integer" if isinstance(value, int) else "a number"
            if greatest < math.inf:
                expected += f" in {'[' if is_allowed else '('}{least:,}, {greatest:,}]"
            elif least > -math.inf:
                expected += f" {'>=' if is_allowed else '>'} {least:,}"
            raise ValueError(f"{option(name)}: expected {expected}, got {value}")
    if any(size < 1 for size in args.net):
        raise ValueError(f"--net: expected integers >= 1, got {' '.join(map(str, args.net))}")
    steps = args.num_envs * args.steps_per_update
    if steps < 2:
        raise ValueError(f"--steps-per-update: expected at least 2 steps of all envs together, got {steps}")
    if args.resume and not args.resume.is_file():
        raise ValueError(f"--resume: expected a policy.zip, got {args.resume}, which is not there")
    for name in ("worlds", "evaluation_worlds"):
        try:
            if getattr(args, name):
                flockstep.scenes.load(getattr(args, name))
        except (ValueError, FileNotFoundError) as error:
            raise ValueError(f"{option(name)}: {error}") from None


def option(name: str) -> str:
    """Return the command-line spelling of a field of `Args`."""
    return f"--{name.replace('_', '-')}"


def command_line() -> Args:
    """Read the command line, with the task's defaults for missing options. Exits with status 2 on an invalid value."""
    chooser = argparse.ArgumentParser(add_help=False)
    chooser.add_argument("--task", default="lidar")
    try:
        defaults = defaults_of(chooser.parse_known_args()[0].task)
    except ValueError as error:
        refuse(f"--{error}")
    args = tyro.cli(Args, default=defaults)
    try:
        require_valid(args)
    except ValueError as error:
        refuse(str(error))
    return args


def refuse(message: str) -> NoReturn:
    """Print one line and exit with status 2."""
    print(message, file=sys.stderr)
    sys.exit(2)


if __name__ == "__main__":
    arguments = command_line()
    try:
        _, result = train(arguments)
    except KeyboardInterrupt:
        print(f"\nInterrupted. {arguments.out}/policy.zip holds the best model so far, if there was an evaluation.")
        sys.exit(130)
    best = max(evaluation["success_rate"] for evaluation in result.evaluations)
    print(f"The best model succeeds in {best:.1%} of the evaluation flights that selected it;")
    print(
        f"{result.steps:,} steps in {result.seconds:.0f} s ({result.steps_per_second:,.0f} steps/s), and "
        f"{result.evaluation_seconds:.0f} s of evaluations."
    )
    print(f"Policy and logs are in {arguments.out}/; training/evaluate.py evaluates the policy again.")
