"""Fair claims: bundled policies beside flyers that have learned nothing, and a profile of a step.

All fly the same generated playgrounds, which no training uses: the usual ones, in which at least one leg is blocked,
and ones in which every leg is. For the camera task there are also goals far to the side of the start.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

import flockstep
from flockstep.trainings import CHOOSING_SEEDS, TRAININGS, UNSEEN_SEEDS, judge
from timing import Figure, Measured, Median, figure, native
from training.evaluate import Policy, fly, greedy, shortest_path
from training.tasks import Setup, fly_routes

Array = npt.NDArray[Any]
Figures = Iterator[Measured | Figure]

WORLDS = 2000
BLOCKS = 10  # of worlds; the spread is that of their success rates
CHOSEN_BY = 200  # worlds that choose the settings of the reactive rule, from seeds of their own
MAX_STEPS = 500  # of a flight
SIZES = (1, 1024, 16384)  # envs of which the start is timed
STARTS = 5
RANGE_M = 3.0
FAN_DEG = {"lidar": 270.0, "camera": 180.0}
#: Settings of the reactive rule that are tried: its reach in m, its strength, and how far it turns aside in degrees.
REACTIVE = list(itertools.product((0.6, 0.9, 1.2, 1.8), (1.0, 2.0, 4.0), (0.0, 45.0, 80.0)))


def reactive(task: str, reach_m: float = 1.0, strength: float = 0.0, aside_deg: float = 0.0) -> Policy:
    """Return a rule: towards the goal, away from the beam with the nearest hit. By default it flies straight."""

    def act(observation: Array) -> Array:
        way = observation[:, :3].copy()
        if task == "camera":  # the offset of the goal in an image of 90 degrees, positive to the right
            way = np.column_stack([np.ones(len(way)), -observation[:, 0], np.zeros(len(way))])
        ranges = RANGE_M * observation[:, -(35 if task == "lidar" else 20) :]
        half = np.radians(FAN_DEG[task] / 2)
        beam = np.linspace(-half, half, ranges.shape[1])[ranges.argmin(axis=1)]  # counter-clockwise from ahead
        goal = np.arctan2(way[:, 1], way[:, 0])
        side = np.sign(np.sin(beam - goal)) * np.radians(aside_deg)  # away, but rather to the goal's side
        push = strength * np.clip(1 - ranges.min(axis=1) / reach_m, 0, 1)
        way[:, 0] -= push * np.cos(beam + side)
        way[:, 1] -= push * np.sin(beam + side)
        if task == "camera":
            return np.stack([way[:, 0], way[:, 1], -way[:, 1]]).argmax(axis=0)
        return np.stack([way, -way], axis=2).reshape(len(way), 6).argmax(axis=1)

    return act


def flown(policy: Policy, worlds: Sequence[flockstep.World], setup: Setup) -> Iterator[tuple[str, Array]]:
    """Fly once through each world; yield which flights succeeded and which crashed."""
    ends = np.array([flight.outcome for flight in fly(policy, worlds, MAX_STEPS, setup=setup)])
    yield "success", ends == "success"
    yield "crashed", ends == "contact"


def planned(worlds: Sequence[flockstep.World], setup: Setup) -> Iterator[tuple[str, Array]]:
    """Fly along the planner's path through each world; no path is a failure."""
    paths = [shortest_path(world, setup) for world in worlds]
    success = np.array(fly_routes(worlds, paths))
    yield "success", success
    yield "crashed", np.array([path is not None for path in paths]) & ~success


def claimed(task: str, **kind: bool) -> Figures:
    """Fly a policy, a straight flyer, the reactive rule and the planner through the same worlds."""
    setup = Setup(task)
    chosen = setup.generated(CHOOSING_SEEDS, CHOSEN_BY, **kind)
    rates = [dict(flown(reactive(task, *each), chosen, setup))["success"].mean() for each in REACTIVE]
    best = REACTIVE[int(np.argmax(rates))]
    worlds = setup.generated(UNSEEN_SEEDS, WORLDS, **kind)
    policy = greedy(flockstep.policies.load(task))  # type: ignore[arg-type]
    flyers = {"policy": policy, "straight": reactive(task), "reactive": reactive(task, *best)}
    results = {flyer: flown(act, worlds, setup) for flyer, act in flyers.items()}
    for flyer, ends in {**results, "planner": planned(worlds, setup)}.items():
        for what, each in ends:
            shares = np.mean(np.reshape(each, (BLOCKS, -1)), axis=1)
            ends = {"least": round(float(shares.min()), 4), "greatest": round(float(shares.max()), 4)}
            more = {"settings": list(best)} if flyer == "reactive" else {}
            yield figure(f"{flyer}/{what}", float(each.mean()), "1", WORLDS, **ends, **more)


def bundled() -> Figures:
    """Fly each bundled policy over the flights that evaluate its training."""
    for name in flockstep.policies.names():
        model, training = flockstep.policies.load(name), TRAININGS[name]
        verdict = judge(training, model, training.flights, UNSEEN_SEEDS.start)
        yield {"name": f"{name}/steps", "value": model.num_timesteps, "unit": "1", "runs": 1}
        yield f"{name}/success", verdict.success, "1", training.flights
        yield f"{name}/crashed", verdict.crashed, "1", training.flights


def claims() -> Mapping[str, Callable[[], Figures]]:
    """Return the rows of the job: the tasks and kinds of worlds, and the bundled policies."""
    return {
        "lidar": partial(claimed, "lidar"),
        "lidar_blocked": partial(claimed, "lidar", blocked=True),
        "camera": partial(claimed, "camera"),
        "camera_anywhere": partial(claimed, "camera", ahead=False),
        "camera_blocked": partial(claimed, "camera", ahead=False, blocked=True),
        "bundled": bundled,
    }


STARTED = """
import json, time
times = [time.perf_counter()]
import gymnasium, flockstep
times.append(time.perf_counter())
envs = gymnasium.make_vec({env!r}, num_envs={count})
times.append(time.perf_counter())
envs.reset(seed=0)
times.append(time.perf_counter())
envs.step(envs.action_space.sample())
times.append(time.perf_counter())
print(json.dumps(times))
"""


def started() -> Figures:
    """Time new processes from the import to the end of the first step."""
    for name in ("Hover", "LidarNavigation", "CameraNavigation"):
        for count in SIZES:
            program = STARTED.format(env=f"flockstep/{name}-v0", count=count)
            command = [sys.executable, "-c", program]
            runs = [json.loads(subprocess.check_output(command, text=True)) for _ in range(STARTS)]
            for i, part in enumerate(("import", "make", "reset", "first_step")):
                yield f"{name}/n{count}/{part}", Median(run[i + 1] - run[i] for run in runs), "s", STARTS
            yield f"{name}/n{count}/all", Median(run[-1] - run[0] for run in runs), "s", STARTS


def profile() -> Mapping[str, Callable[[], Iterable[Measured | Figure]]]:
    """Return the rows of the profile: the stages of a step, and the start of a program."""
    return {"stages": partial(native, "stages"), "start": started}
