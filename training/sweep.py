"""Train `flockstep.PPO` with several seeds and settings by Ray Tune: one table and one plot.

build/ray/bin/python -m training.sweep lidar --seeds 3 --set learning_rate=0.001,0.0015 --set n_epochs=3,5

Every combination of the settings trains once with each seed, from a recipe of the board, and is
judged by flights that no training uses. `./dev test ray` makes build/ray. If a sweep is interrupted, the same command
continues it: finished trainings are kept, and the others begin again.
"""

from __future__ import annotations

import ast
import csv
import dataclasses
import inspect
import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import matplotlib.pyplot as plt
import numpy as np
import ray
import tyro
from ray import tune

import flockstep
from flockstep.trainings import CHOOSING_SEEDS, Training, judge, train
from training.board import TRAININGS

FIELDS = ("steps", "num_envs", "entropy")
"""Fields of a recipe that can be swept, besides the hyperparameters of PPO and net_arch."""
UNSWEPT = {
    *("policy", "env", "seed", "device", "num_threads", "policy_kwargs", "use_sde", "sde_sample_freq"),
    *("verbose", "tensorboard_log", "stats_window_size", "rollout_buffer_class", "rollout_buffer_kwargs"),
    "_init_setup_model",
}
"""Parameters of PPO that a sweep does not change."""
FIRST_SEED = 100
"""The board reports smaller seeds, so none of those chooses settings."""

Settings = dict[str, Any]


@dataclass
class Args:
    """Options of a sweep."""

    name: tyro.conf.Positional[str]
    """Training: a name of the board."""
    set: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="NAME=VALUE,VALUE")] = ()
    """Values of a setting, such as learning_rate=0.001,0.0015 or net_arch=[64,64],[128,128]."""
    seeds: int = 3
    """Number of seeds."""
    cpus: int = 1
    """Threads of each training; Ray runs as many trainings at once as its CPUs allow."""
    flights: int = 1000
    """Flights that judge a policy."""
    out: Path = Path("out/sweep")
    """Folder; table.csv and plot.png are in its folder NAME. With several machines, all of them need to reach it."""
    address: str | None = None
    """Address of a running cluster, as `ray start` prints it; default: start Ray here."""


def values_of(sets: tuple[str, ...]) -> dict[str, list[Any]]:
    """Return the values of each setting.

    Raises
    ------
    ValueError
        A setting is unknown, given twice, or its values cannot be read.
    """
    of_ppo = [name for name in inspect.signature(flockstep.PPO).parameters if name not in UNSWEPT]
    known = [*FIELDS, *of_ppo, "net_arch"]
    found: dict[str, list[Any]] = {}
    for text in sets:
        name, _, values = text.partition("=")
        if name not in known:
            raise ValueError(f"--set: expected one of {', '.join(known)}, got {name!r}")
        if name in found:
            raise ValueError(f"--set: expected {name} once, with all its values, got it twice")
        try:
            found[name] = list(ast.literal_eval(f"[{values}]"))
        except (SyntaxError, ValueError):
            raise ValueError(f"--set: expected {name}=VALUE,VALUE with literals of Python, got {text!r}") from None
        if not found[name]:
            raise ValueError(f"--set: expected {name}=VALUE,VALUE, got {text!r}")
    return found


def recipe_with(recipe: Training, settings: Settings) -> Training:
    """Return a recipe with other settings."""
    fields = {name: value for name, value in settings.items() if name in FIELDS}
    learning = {name: value for name, value in settings.items() if name not in (*FIELDS, "net_arch")}
    hyperparameters = {**recipe.settings, **learning}
    if "net_arch" in settings:
        hyperparameters["policy_kwargs"] = {**recipe.settings["policy_kwargs"], "net_arch": settings["net_arch"]}
    return dataclasses.replace(recipe, settings=hyperparameters, **fields)


def train_and_judge(config: dict[str, Any]) -> None:
    """Train once and report the result to Ray Tune; runs in a process of Ray."""
    recipe = recipe_with(TRAININGS[config["name"]], config["settings"])
    begun = time.perf_counter()
    model = train(recipe, "flockstep", config["seed"], config["cpus"])
    seconds = time.perf_counter() - begun
    verdict = judge(recipe, model, config["flights"], CHOOSING_SEEDS.start)
    result = {"success": verdict.success, "crashed": verdict.crashed, **verdict.more, "seconds": round(seconds, 2)}
    tune.report({"result": result})


def sweep(args: Args, values: dict[str, list[Any]]) -> tune.ResultGrid:
    """Train all combinations that have not finished yet."""
    folder = (args.out / args.name).resolve()
    space = {
        "name": args.name,
        "cpus": args.cpus,
        "flights": args.flights,
        "seed": tune.grid_search(list(range(FIRST_SEED, FIRST_SEED + args.seeds))),
        "settings": {name: tune.grid_search(each) for name, each in values.items()},
    }
    trainable = tune.with_resources(train_and_judge, {"cpu": args.cpus})
    asked = {"settings": values, "seeds": args.seeds, "cpus": args.cpus, "flights": args.flights}
    kept = folder / "sweep.json"
    if tune.Tuner.can_restore(str(folder)):
        begun = json.loads(kept.read_text())
        if begun != json.loads(json.dumps(asked)):
            raise ValueError(f"--out: {folder} has a sweep with {begun}, got {asked}; choose another folder")
        tuner = tune.Tuner.restore(str(folder), trainable, restart_errored=True, param_space=space)
    else:
        folder.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(asked) + "\n")
        run = tune.RunConfig(name=args.name, storage_path=str(folder.parent), verbose=1)
        tuner = tune.Tuner(trainable, param_space=space, run_config=run)
    return tuner.fit()


def rows_of(results: tune.ResultGrid) -> list[dict[str, Any]]:
    """Return a row for each finished training, ordered by settings and seed."""
    rows = [
        {**each.config["settings"], "seed": each.config["seed"], **each.metrics["result"]}
        for each in results
        if each.metrics and "result" in each.metrics
    ]
    return sorted(rows, key=lambda row: [str(value) for value in row.values()])


def write_table(rows: list[dict[str, Any]], path: Path) -> None:
    """Write the rows as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def plot(rows: list[dict[str, Any]], names: list[str], path: Path) -> None:
    """Draw success: a column for each combination of settings, a dot for each seed, a line at their median."""
    groups: dict[str, list[float]] = {}
    for row in rows:
        label = "\n".join(f"{name}={row[name]}" for name in names) or "recipe"
        groups.setdefault(label, []).append(100 * row["success"])
    drawn, panel = plt.subplots(figsize=(2 + 1.2 * len(groups), 4), layout="constrained")
    for i, (label, success) in enumerate(groups.items()):
        panel.scatter([label] * len(success), success, color="tab:blue", alpha=0.6)
        panel.hlines(np.median(success), i - 0.3, i + 0.3, color="tab:blue", alpha=0.5, linewidth=3)
    least = min(min(success) for success in groups.values())
    panel.set(ylabel="success / %", xlim=(-0.5, len(groups) - 0.5), ylim=(min(least - 1, 95), 100.5))
    panel.tick_params(axis="x", labelsize=8)
    drawn.savefig(path, dpi=100)
    plt.close(drawn)


def main(args: Args) -> None:
    """Train, and write table and plot."""
    if args.name not in TRAININGS:
        sys.exit(f"NAME: expected one of {', '.join(TRAININGS)}, got {args.name!r}")
    for option in ("seeds", "cpus", "flights"):
        if getattr(args, option) < 1:
            sys.exit(f"--{option}: expected at least 1, got {getattr(args, option)}")
    try:
        values = values_of(args.set)
        ray.init(args.address or "local", include_dashboard=None if args.address else False)
        results = sweep(args, values)
    except ValueError as error:
        sys.exit(str(error))
    folder, rows = args.out / args.name, rows_of(results)
    planned = args.seeds * math.prod(len(each) for each in values.values())
    if rows:
        write_table(rows, folder / "table.csv")
        plot(rows, list(values), folder / "plot.png")
        print(f"\ntable.csv and plot.png, with {len(rows)} of {planned} trainings, are in {folder}/")
    if results.num_errors:
        sys.exit(f"{results.num_errors} trainings failed; the same command repeats them")
    if len(rows) < planned:
        sys.exit(f"{planned - len(rows)} of {planned} trainings are not finished: the same command continues with them")


if __name__ == "__main__":
    main(tyro.cli(Args))
