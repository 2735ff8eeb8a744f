"""The command ``flockstep check``: a task of one's own, before it is trained."""

from __future__ import annotations

import argparse
import functools
import importlib.util
import json
import math
import re
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from flockstep._core import NativeTask
from flockstep.evaluation import Evaluation, evaluate
from flockstep.progress_line import ProgressLine
from flockstep.task import Task
from flockstep.testing.checker import CHECKS
from flockstep.testing.runs import Setup
from flockstep.vector_env import DroneVectorEnv

_MODULE = "flockstep_checked"  # the file's name could be that of a module that it imports
_SETUP = {"num_envs": 4, "steps": 100, "seed": 123}  # as in `check_vector_env`
_EPISODE_STEPS = 20  # short, so that episodes end within the steps of the checks
_SPEED_ENVS, _SPEED_S = 256, 1.0
_MOST_LETTERS = 300


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``check``."""
    about = "Python file with a flockstep.Task, which is run; a name, if it has several tasks"
    parser.add_argument("task", metavar="TASK.py[:NAME]", help=about)
    parser.add_argument("--worlds", nargs="+", help="scenes or sets of scenes; default: what the task declares")
    parser.add_argument("--episodes", type=int, default=100, help="episodes of each baseline; default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode; default: %(default)s")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=main)


def main(arguments: argparse.Namespace) -> None:
    """Check, and exit with 1 if the task breaks a rule."""
    path, task = task_in(arguments.task)
    told = _Told(path)
    keywords = {} if arguments.worlds is None else {"worlds": arguments.worlds}
    make = functools.partial(DroneVectorEnv, task=task, **keywords)
    with closing(make()) as envs:
        shapes = {"observation": str(envs.single_observation_space), "action": str(envs.single_action_space)}
        zeros = _zeros(envs.single_action_space)
    progress = ProgressLine()

    def stage(text: str, run: Callable[..., Any], *given: Any, **options: Any) -> Any:
        if progress.is_due:
            progress.show(f"{text}, {progress.seconds:.0f} s")
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("error", ".*ends here as a bad state")  # of rewards that are not finite
                return run(*given, **options)
        except Exception as error:  # of the task
            return told(error)

    # Seeds choose among several worlds, so that env i does not differ from env 0 by its number.
    setup = Setup(functools.partial(make, max_episode_steps=_EPISODE_STEPS, random_world=True), **_SETUP)
    contract = {name: stage(name, check, setup) for name, check in CHECKS.items()}
    flown = {
        name: stage(f"{name} actions", evaluate, policy, task, arguments.episodes, arguments.seed, **keywords)
        for name, policy in (("random", None), ("zero", zeros))
    }
    speed = stage("speed", env_steps_per_s, make)
    progress.clear()
    if arguments.json:
        baselines = {name: asdict(each) if isinstance(each, Evaluation) else each for name, each in flown.items()}
        found = {"contract": contract, "baselines": baselines, "env_steps_per_s": speed, "num_envs": _SPEED_ENVS}
        print(json.dumps(_finite({"task": arguments.task, **shapes, **found}), allow_nan=False))
    else:
        print("\n".join(_lines(shapes, contract, flown, speed)))
    if any(isinstance(each, str) for each in (*contract.values(), *flown.values(), speed)):
        sys.exit(1)


def task_in(text: str) -> tuple[Path, Any]:
    """Return the path of ``FILE.py[:NAME]``, and the only task in this file, or that of this name.

    Raises
    ------
    ValueError
        There is no such file or task, or several tasks, or the file raises an error.
    """
    match = re.fullmatch(r"(.+\.py)(?::(\w+))?", text)
    if match is None or not Path(match[1]).is_file():
        raise ValueError(f"TASK: expected a file, FILE.py or FILE.py:NAME, got {text!r}")
    path, name = Path(match[1]).resolve(), match[2]
    spec = importlib.util.spec_from_file_location(_MODULE, path)
    assert spec is not None and spec.loader is not None  # its name ends with .py
    module = sys.modules[_MODULE] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))  # as when Python runs it
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise ValueError(f"TASK: {path.name} raises {_Told(path)(error)}") from error
    tasks = {key: value for key, value in vars(module).items() if _is_task(value)}
    if name is None and len(tasks) == 1:
        return path, next(iter(tasks.values()))
    if name not in tasks:
        named = f"{path.name}:NAME with one of {', '.join(tasks)}" if tasks else "a file with a flockstep.Task"
        raise ValueError(f"TASK: expected {named}, got {text!r}")
    return path, tasks[name]


def _is_task(value: Any) -> bool:
    if isinstance(value, type):
        return issubclass(value, Task) and value.__module__ == _MODULE
    return isinstance(value, (Task, NativeTask))


class _Told:
    """Says in a line what an error is, and in which line of the task's file it was raised."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, error: BaseException) -> str:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename) == self._path]
        kind = "" if isinstance(error, AssertionError) else f"{type(error).__name__}: "
        text = kind + " ".join(str(error).split())
        text = text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}..."
        return f"{text} ({self._path.name}, line {frames[-1].lineno})" if frames else text


def _zeros(space: spaces.Space[Any]) -> Callable[[Any], Any]:
    """Return the policy whose actions are zero, or next to zero within the bounds."""
    zero = np.zeros(space.shape or (), space.dtype)
    if isinstance(space, spaces.Box):
        zero = np.clip(zero, space.low, space.high)

    def act(observation: Any) -> Any:
        rows = len(next(iter(observation.values())) if isinstance(observation, dict) else observation)
        return np.repeat(zero[None], rows, axis=0)

    return act


def env_steps_per_s(make: Callable[[int], DroneVectorEnv]) -> float:
    """Return how many env steps the machine makes in a second, with random actions."""
    with closing(make(_SPEED_ENVS)) as envs:
        num_envs: int = envs.num_groups
        envs.action_space.seed(0)
        actions = [envs.action_space.sample() for _ in range(16)]
        envs.reset(seed=0)
        envs.step(actions[0])  # the first one allocates
        steps, began = 0, time.perf_counter()
        while time.perf_counter() < began + _SPEED_S:
            envs.step(actions[steps % len(actions)])
            steps += 1
        return steps * num_envs / (time.perf_counter() - began)


def _lines(
    shapes: dict[str, str], contract: dict[str, str | None], flown: dict[str, Evaluation | str], speed: float | str
) -> list[str]:
    lines = [f"{name:<18}{shape}" for name, shape in shapes.items()]
    lines += [f"{name:<18}{'ok' if found is None else f'FAILED: {found}'}" for name, found in contract.items()]
    ran = {name: each for name, each in flown.items() if isinstance(each, Evaluation)}
    lines += [f"{name:<18}FAILED: {each}" for name, each in flown.items() if isinstance(each, str)]
    if ran:
        first = next(iter(ran.values()))
        rows = {f"{first.episodes} episodes": [f"{name} actions" for name in ran]}
        rows["success"] = [f"{each.success_rate:.1%}" for each in ran.values()]
        rows["steps"] = [f"{each.episode_length:.1f}" for each in ran.values()]
        rows["return"] = [f"{each.episode_return:.4g}" for each in ran.values()]
        for term in first.episode_terms:
            rows[f"  {term}"] = [f"{each.episode_terms[term]:.4g}" for each in ran.values()]
        lines += [f"{name:<18}" + "".join(f"{cell:>18}" for cell in cells) for name, cells in rows.items()]
    told = f"FAILED: {speed}" if isinstance(speed, str) else f"{speed:,.0f} env steps/s with {_SPEED_ENVS} envs"
    return [*lines, f"{'speed':<18}{told}"]


def _finite(value: Any) -> Any:
    """Return a value for JSON, which has no NaN: None stands for it."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
