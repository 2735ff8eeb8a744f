"""A picture of trainings: the success rate of every evaluation, over steps and minutes, with untrained baselines.

.venv/bin/python -m training.plot_curve out/train/seed0 out/train/seed1 out/train/seed2 --out out/curve.png

Each folder is the `--out` of a training of the same task by training/train_ppo.py; all of them are shown.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import tyro
from matplotlib.ticker import PercentFormatter

from training.evaluate import baselines
from training.train_ppo import Args as TrainingArgs
from training.train_ppo import evaluation_flights

KEYS = ("steps", "seconds", "success_rate")

#: Labels of the baselines without training. The planner is left out: it knows the world and always arrives.
BASELINES = {"straight_flight": "straight to the goal", "random_policy": "random actions"}


@dataclass
class Args:
    """Options for drawing the learning curves of trainings."""

    trainings: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of the trainings."""
    out: Path = Path("out/curve.png")
    """The picture."""


def main(args: Args) -> None:
    """Read the trainings, fly the baselines, and draw."""
    results = [json.loads((folder / "result.json").read_text()) for folder in args.trainings]
    curves = [{key: np.array([row[key] for row in result["evaluations"]]) for key in KEYS} for result in results]
    described = TrainingArgs(**{key: as_given(value) for key, value in results[0]["args"].items()})
    worlds, where = evaluation_flights(described)
    untrained = baselines(worlds, described.setup)

    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for result, curve in zip(results, curves, strict=True):
        label = f"PPO, seed {result['args']['seed']}"
        axes.plot(curve["steps"] / 1e3, curve["success_rate"], marker="o", markersize=4, label=label)
    for (name, label), style in zip(BASELINES.items(), ("--", ":"), strict=True):
        if name in untrained:
            axes.axhline(untrained[name], color="0.4", linestyle=style, label=f"{label}: {untrained[name]:.0%}")
    axes.set_xlabel("thousand steps")
    axes.set_ylabel("success rate")
    axes.set_xlim(left=0)
    axes.set_ylim(-0.02, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 0.18))  # above the baselines
    pace = float(np.median([curve["seconds"][-1] / curve["steps"][-1] for curve in curves])) * 1e3 / 60
    minutes = axes.secondary_xaxis("top", functions=(lambda steps: steps * pace, lambda minutes: minutes / pace))
    minutes.set_xlabel("minutes, at the median pace of these trainings")
    figure.suptitle(f"{described.task.split(':')[-1]}: {len(worlds)} {where}")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(args.out, dpi=100)
    plt.close(figure)
    print(f"{len(results)} trainings are in {args.out}; untrained: {untrained}")


def as_given(value: Any) -> Any:
    """Return an argument in the type of the command line; JSON has no tuples."""
    return tuple(value) if isinstance(value, list) else value


if __name__ == "__main__":
    main(tyro.cli(Args))
