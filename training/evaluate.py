"""Fly a trained policy once through each world; report the ends of its flights, and its path against the shortest path.

For comparison it also flies baselines without training: random actions, straight flight from marker to marker, and the
planner's path.

.venv/bin/python -m training.evaluate out/demo/policy.zip
.venv/bin/python -m training.evaluate out/demo/policy.zip --worlds train validation --generated 100 --json result.json
.venv/bin/python -m training.evaluate out/train/pixels/policy.zip --repeats 50

A saved policy contains its task, its worlds and its camera settings, but not the class of your own task: run this in a
folder from which its module can be imported.

Loading a policy runs code from its file: load only policies you trust.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
import tyro
from gymnasium import spaces
from stable_baselines3 import PPO

import flockstep
from flockstep.evaluation import first_episodes
from flockstep.trainings import UNSEEN_SEEDS
from training.tasks import Setup, fly_routes, load_policy, setup_of

#: Maximum number of control steps in a successful flight of a built-in task.
MAX_STEPS = 1000

#: Possible ends of a flight: the names of `flockstep.EpisodeEnd`.
OUTCOMES = tuple(end.name for end in flockstep.EpisodeEnd if end is not flockstep.EpisodeEnd.none)

Policy = Callable[[Any], npt.NDArray[Any]]


@dataclass
class Flight:
    """One flight from start to end of its episode."""

    world: str
    outcome: str  # one of OUTCOMES
    steps: int  # flown
    reward: float  # the task's own reward, unscaled sum
    path_length_m: float
    shortest_path_m: float | None
    trail: npt.NDArray[np.float32] = field(repr=False)  # m: (decisions + 1, 3); decisions are steps without frame skip


def greedy(model: PPO) -> Policy:
    """Return the deterministic policy of a model, which takes the most likely action."""

    def act(observation: Any) -> npt.NDArray[Any]:
        with torch.no_grad():
            actions, _ = model.predict(observation, deterministic=True)
        return actions

    return act


def fly(
    policy: Policy,
    worlds: Sequence[flockstep.World],
    max_episode_steps: int | None = None,
    shortest: bool = False,
    setup: Setup | None = None,
    random_start: bool = False,
    seed: int = 0,
    motion: str = "kinematic",
) -> list[Flight]:
    """Fly one episode in each world, in parallel, with the LiDAR task unless a setup selects another."""
    setup = setup or Setup()
    envs = setup.make_limited(
        len(worlds),
        max_episode_steps,
        worlds=list(worlds),
        autoreset_mode="disabled",
        **({"random_start": True} if random_start else {}),
        **({"motion": motion} if motion != "kinematic" else {}),  # otherwise the task's own motion
    )
    shortest_m = [shortest_path_m(world, setup) if shortest else None for world in worlds]
    return first_flights(policy, envs, worlds, seed, shortest_m)


def first_flights(
    policy: Policy,
    envs: flockstep.DroneVectorEnv,
    worlds: Sequence[flockstep.World],
    seed: int = 0,
    shortest_m: Sequence[float | None] = (),
) -> list[Flight]:
    """Fly the first episode of each env, whose autoreset is disabled, and close the envs; world i is that of env i."""
    positions: list[npt.NDArray[np.float32]] = []
    decisions = np.ones(len(worlds), int)

    def act(observation: Any) -> npt.NDArray[Any]:
        if not positions:
            positions.append(envs.batch.position.copy())
        return policy(observation)

    def watch(observation: Any, going: npt.NDArray[np.bool_]) -> None:
        del observation
        positions.append(envs.batch.position.copy())
        decisions[going] += 1

    flights = []
    for i, end in enumerate(first_episodes(act, envs, "evaluate", seed, watch)):
        trail = np.stack([row[i] for row in positions[: decisions[i] + 1]])
        flights.append(
            Flight(
                world=worlds[i].name,
                outcome=flockstep.EpisodeEnd(end["episode_end"]).name,
                steps=int(end["episode"]["l"]),
                reward=float(end["episode"]["r"]),
                path_length_m=length_m(trail),
                shortest_path_m=shortest_m[i] if shortest_m else None,
                trail=trail,
            )
        )
    return flights


def random_policy(setup: Setup) -> Policy:
    """Return a policy that draws actions uniformly, for any observation."""
    envs = setup.make(1, worlds=flockstep.scenes.load(setup.training_worlds))
    space, rng = envs.single_action_space, np.random.default_rng(0)
    envs.close()
    space.seed(0)

    def act(observation: Any) -> npt.NDArray[Any]:
        count = len(next(iter(observation.values())) if isinstance(observation, dict) else observation)
        if isinstance(space, spaces.Discrete):
            return space.start + rng.integers(space.n, size=count)
        return np.stack([space.sample() for _ in range(count)])

    return act


def baselines(worlds: Sequence[flockstep.World], setup: Setup, random_start: bool = False) -> dict[str, float]:
    """Return the success rates of baselines without training, in the same worlds.

    The straight flight and the planner know the whole world. They begin at the start marker and end at the goal, so
    they are left out if a world lacks one. They fly repeated worlds only once.
    """
    limit = None if setup.is_own else MAX_STEPS
    random = fly(random_policy(setup), worlds, limit, setup=setup, random_start=random_start)
    rates = {"random_policy": float(summary(random)["success_rate"])}
    once = list({world.name: world for world in worlds}.values())
    if all(setup.route(world) is not None for world in once):
        rates["straight_flight"] = float(np.mean(fly_routes(once, [setup.route(world) for world in once])))
        rates["planner"] = float(np.mean(fly_routes(once, [shortest_path(world, setup) for world in once])))
    return rates


def length_m(path: npt.NDArray[np.float32]) -> float:
    """Return the length of a polyline (K, 3) in metres."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def shortest_path(world: flockstep.World, setup: Setup) -> npt.NDArray[np.float32] | None:
    """Return the shortest collision-free path (K, 3) m along the task's route, or None if there is none."""
    route = setup.route(world)
    return None if route is None else flockstep.plan(world, route[0], list(route[1:]))


def shortest_path_m(world: flockstep.World, setup: Setup) -> float | None:
    """Return the length of the shortest path in m, or None if there is none."""
    path = shortest_path(world, setup)
    return None if path is None else length_m(path)


def summary(flights: Sequence[Flight]) -> dict[str, Any]:
    """Return rates over the flights and, over the successful ones, the ratio of path length to shortest path."""
    count = max(len(flights), 1)
    detours = [f.path_length_m / f.shortest_path_m for f in flights if f.outcome == "success" and f.shortest_path_m]
    return {
        "flights": len(flights),
        **{f"{end}_rate": sum(f.outcome == end for f in flights) / count for end in OUTCOMES},
        "path_over_shortest": float(np.median(detours)) if detours else None,
    }


@dataclass
class Args:
    """Options for evaluating a trained policy."""

    policy: tyro.conf.Positional[Path]
    """A model saved by training/train_ppo.py (.zip). Loading it runs code from the file: load only
    policies you trust."""
    worlds: tuple[str, ...] = ()
    """Sets of scenes, scene names or paths. Default: the policy's training and validation worlds."""
    repeats: int = 1
    """Flights in each of these; with built-in tasks, repeated flights start at random positions in the spawn box."""
    generated: int | None = None
    """Number of additional generated playgrounds, never used in training, and of ones in which every leg is blocked.
    Default: 100, or none for your own task."""
    max_episode_steps: int | None = None
    """A longer flight is a time-out. Default: 3000, or the limit of your own task."""
    shortest: bool = True
    """Also plan the shortest path in every world."""
    baselines: bool = True
    """Also fly the baselines in the same worlds."""
    json: Path | None = None
    """File for the result, which is also printed."""


def main(args: Args) -> None:
    """Evaluate, print and write."""
    model = load_policy(args.policy)
    policy, setup = greedy(model), setup_of(model)
    names = args.worlds or setup.playgrounds
    groups = {name: flockstep.scenes.load(name) * args.repeats for name in names}
    generated = (0 if setup.is_own else 100) if args.generated is None else args.generated
    if generated:
        groups["generated"] = setup.generated(UNSEEN_SEEDS, generated)
        groups["generated, every leg blocked"] = setup.generated(UNSEEN_SEEDS, generated, ahead=False, blocked=True)
    seed = UNSEEN_SEEDS.start if setup.is_own else 0  # your own task may use it to draw starts and targets
    result: dict[str, Any] = {}
    for name, worlds in groups.items():
        is_generated = name.startswith("generated")
        random_start = args.repeats > 1 and not is_generated and not setup.is_own
        flights = fly(policy, worlds, args.max_episode_steps, args.shortest, setup, random_start, seed)
        rows = [{k: v for k, v in asdict(flight).items() if k != "trail"} for flight in flights]
        result[name] = {"summary": summary(flights), "flights": rows}
        print(name, json.dumps(result[name]["summary"]))
        if args.baselines:
            result[name]["baselines"] = baselines(worlds, setup, random_start)
            for baseline, rate in result[name]["baselines"].items():
                print(f"  {baseline.replace('_', ' ')}: success rate {rate:.3g}")
        if name == "generated" and setup.generated_note:
            result[name]["note"] = setup.generated_note
            print(f"  {setup.generated_note}")
        for flight in flights:
            if not is_generated or flight.outcome != "success":
                print(f"  {flight.world}: {flight.outcome} after {flight.steps} steps, reward {flight.reward:,.1f}")
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Args))
