"""The board: seconds of trainings by `flockstep.PPO`, and by Stable-Baselines3 with the same hyperparameters.

./dev board                      # all trainings
./dev board hover --no-sb3       # one of them, without Stable-Baselines3

Each training has five seeds, and all are reported. The policy is the last one of its training, so nothing chooses among
policies; it is judged by flights whose seeds nothing else uses. The seconds are those of learning and flying, without
making the environments and without the flights that judge. For times that mean something the machine has to be idle.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import tyro
from stable_baselines3.common.callbacks import BaseCallback

import flockstep
from flockstep.trainings import CHOOSING_SEEDS, UNSEEN_SEEDS, Training, best_of, judge, train
from flockstep.trainings import TRAININGS as BUNDLED
from flockstep.trainings.learning import Learner
from training import forest_flight, rotor_navigation

Figure = dict[str, Any]

#: The trainings of the board: all that no bench measures.
TRAININGS: dict[str, Training] = {
    **{name: training for name, training in BUNDLED.items() if training.bench is None},
    "lidar_rotors": rotor_navigation.TRAINING,
    "forest": forest_flight.TRAINING,
}
LEARNED = 0.9  # share of successful held-out flights from which a demonstration says that a policy has learned
CURVE_POINTS = 8
CURVE_FLIGHTS = 200
COLORS = {"flockstep": "tab:blue", "sb3": "tab:orange"}
NAMES = {"flockstep": "flockstep.PPO", "sb3": "Stable-Baselines3"}


class Clock(BaseCallback):
    """Measures the time of a training, and judges its policy at equal distances; the clock stands still meanwhile."""

    def __init__(self, recipe: Training, judges: bool) -> None:
        super().__init__()
        self.recipe, self.judges = recipe, judges
        self.curve: list[tuple[int, float, float]] = []
        """Steps, seconds and success."""
        self.rewards: list[tuple[int, float, float]] = []
        """Steps, seconds and the mean return of the last 100 episodes, unscaled, with exploration."""
        self._judging_s = 0.0

    def seconds(self) -> float:
        """Return the time so far in s, without that of judging."""
        return time.perf_counter() - self._begun - self._judging_s

    def _on_training_start(self) -> None:
        self._begun = time.perf_counter()

    def _on_rollout_start(self) -> None:
        self._note_reward()
        if self.num_timesteps >= self.recipe.steps * (len(self.curve) + 1) // CURVE_POINTS:
            self._judge()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.training_s = self.seconds()
        self._note_reward()
        if len(self.curve) < CURVE_POINTS:
            self._judge()

    def _note_reward(self) -> None:
        if ended := self.model.ep_info_buffer:
            self.rewards.append((self.num_timesteps, self.seconds(), float(np.mean([each["r"] for each in ended]))))

    def _judge(self) -> None:
        if not self.judges:
            return
        before, seconds = time.perf_counter(), self.seconds()
        flights = min(CURVE_FLIGHTS, self.recipe.flights)
        verdict = judge(self.recipe, self.model, flights, CHOOSING_SEEDS.start)
        self.curve.append((self.num_timesteps, round(seconds, 3), verdict.success))
        self._judging_s += time.perf_counter() - before


def training_seconds(recipe: Training, seed: int, threads: int) -> float:
    """Return the time of a training by `flockstep.PPO` in s, without making the environments."""
    clock = Clock(recipe, judges=False)
    train(recipe, "flockstep", seed, threads, [clock])
    return clock.training_s


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


def figure(name: str, value: float, unit: str, runs: int, **more: Any) -> Figure:
    """Return a figure as bench/table.py reads it."""
    return {"name": f"board/{name}", "value": float(f"{value:.4g}"), "unit": unit, "runs": runs, **more}


def report(name: str, seeds: int, sb3: bool, out: Path) -> list[Figure]:
    """Train with all seeds and return what the board says about it; film the policy of the first seed."""
    recipe, figures, film = TRAININGS[name], [], out / f"{name}.mp4"
    runs: list[tuple[Learner, int]] = [("flockstep", 2), ("flockstep", 1), *([("sb3", 1)] if sb3 else [])]
    for seed in range(seeds):
        parameters: list[Any] = []
        for learner, threads in runs:
            clock = Clock(recipe, judges=threads == 1)
            model = train(recipe, learner, seed, threads, [clock])
            run = f"{name}/seed{seed}/{learner}_{threads}"
            figures.append(figure(f"{run}/seconds", clock.training_s, "s", 1))
            line = f"{run}: {clock.training_s:.1f} s"
            if clock.judges:
                verdict = judge(recipe, model, recipe.flights, UNSEEN_SEEDS.start)
                more = {"crashed": verdict.crashed, **verdict.more}
                figures.append(figure(f"{run}/success", verdict.success, "1", recipe.flights, curve=clock.curve))
                figures += [figure(f"{run}/{what}", value, "", recipe.flights) for what, value in more.items()]
                line += f", success {verdict.success:.1%}"
            print(line, flush=True)
            if learner == "flockstep":
                parameters.append(model.learner.parameters)
                model.save(out / f"{name}-seed{seed}")
                if seed == 0 and threads == 1:
                    flockstep.record(film, model, recipe.env, seed=UNSEEN_SEEDS.start, **recipe.film)
        if not np.array_equal(*parameters):
            raise AssertionError(f"{name}: one thread and two gave different policies")
    figures += comparison(name, figures)
    baseline = judge(recipe, best_of(recipe, next(iter(recipe.baselines.values()))), recipe.flights, UNSEEN_SEEDS.start)
    figures += [
        figure(f"{name}/steps", recipe.steps, "1", 1),
        figure(f"{name}/baseline/success", baseline.success, "1", recipe.flights),
        *(figure(f"{name}/baseline/{what}", value, "", recipe.flights) for what, value in baseline.more.items()),
    ]
    return figures


def comparison(name: str, figures: list[Figure]) -> list[Figure]:
    """Return the mean over each learning curve, and the p values of the difference of the two learners' seeds."""
    judged = [each for each in figures if "curve" in each]
    means = [
        figure(each["name"].removeprefix("board/").replace("success", "curve_mean"), mean, "1", CURVE_POINTS)
        for each in judged
        for mean in [float(np.mean([success for *_, success in each["curve"]]))]
    ]
    found = means.copy()
    for what, each in (("curves", means), ("success", judged)):
        ours, theirs = ([f["value"] for f in each if f"/{learner}_1/" in f["name"]] for learner in NAMES)
        if theirs:
            found.append(figure(f"{name}/p_of_{what}", permutation_p(ours, theirs), "1", len(each)))
    return found


def permutation_p(first: list[float], second: list[float]) -> float:
    """Return the p value of the exact two-sided permutation test of the difference of two means."""
    both, size = np.array([*first, *second]), len(first)
    chosen = np.array([both[list(rows)].mean() for rows in itertools.combinations(range(len(both)), size)])
    others = (both.sum() - size * chosen) / len(second)
    return float(np.mean(abs(chosen - others) >= abs(np.mean(first) - np.mean(second)) - 1e-12))


def plot(figures: list[Figure], path: Path) -> None:
    """Draw the learning curves of all seeds: one panel for each training."""
    curves = [(*each["name"].split("/")[1:4], each["curve"]) for each in figures if "curve" in each]
    names = list(dict.fromkeys(name for name, *_ in curves))
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    drawn, panels = plt.subplots(rows, columns, figsize=(4.2 * columns, 3 * rows), layout="constrained", squeeze=False)
    for panel in panels.flat[len(names) :]:
        panel.axis("off")
    for name, panel in zip(names, panels.flat, strict=False):
        for training, _, run, curve in curves:
            learner = run.rsplit("_", 1)[0]
            if training == name:
                _, seconds, success = zip(*curve, strict=True)
                panel.plot(seconds, 100 * np.array(success), color=COLORS[learner], lw=1, alpha=0.8)
        panel.set(title=name, xlabel="seconds, one thread", xlim=(0, None), ylim=(0, 101))
        panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel(f"success in {CURVE_FLIGHTS} flights / %")
    for learner, color in COLORS.items():
        panels[0, 0].plot([], [], color=color, label=NAMES[learner])
    drawn.legend(loc="outside lower center", ncols=2)
    drawn.savefig(path, dpi=100)
    plt.close(drawn)


@dataclass
class Args:
    """Options of the board."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Trainings; default: all."""
    out: Path = Path("out/board")
    """Folder for policies, films and curves.png."""
    seeds: int = 5
    """Number of seeds."""
    sb3: bool = True
    """Also train with Stable-Baselines3."""


def main(args: Args) -> list[Figure]:
    """Train, film, draw, write and return the figures."""
    for name in args.names:
        if name not in TRAININGS:
            sys.exit(f"NAME: expected one of {', '.join(TRAININGS)}, got {name!r}")
    args.out.mkdir(parents=True, exist_ok=True)
    figures = []
    for name in args.names or TRAININGS:
        figures += report(name, args.seeds, args.sb3, args.out)
        (args.out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
        plot(figures, args.out / "curves.png")
    print(f"\nFilms, policies, curves.png and figures.json are in {args.out}/")
    return figures


if __name__ == "__main__":
    main(tyro.cli(Args))
