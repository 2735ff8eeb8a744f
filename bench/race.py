"""Times steps of Race with gates that are solid and with gates that are not, one thread, in processor time.

The drones fly by `policies/race.zip`. Its actions are recorded once, and the timed steps replay them from a snapshot,
so that the policy is not timed. The two worlds alternate. Also finds the lap of a point mass.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flockstep

sys.path.append(str(Path(__file__).resolve().parent.parent))
from training import race_bound

DRONES, RUNS = 1024, 15
WARM_UP, STEPS = 300, 100
PHYSICS_HZ = 500
TICKS = (5, 10)  # per step; 10 is the default of the task
POLICY = Path(__file__).resolve().parents[1] / "policies" / "race.zip"

Measured = tuple[str, float, str, int]  # name, value, unit, runs


def measure() -> Iterator[Measured]:
    """Measure the microseconds of a step of one drone, the share of drones in a new episode at each step, and a lap."""
    for ticks in TICKS:
        replays = {name: Replay(is_solid, ticks) for name, is_solid in (("solid", True), ("open", False))}
        times: dict[str, list[float]] = {name: [] for name in replays}
        for _ in range(RUNS):
            for name, replay in replays.items():
                times[name].append(replay.seconds() / (STEPS * DRONES))
        for name, replay in replays.items():
            subject = f"race/{name}_gates/{ticks}_ticks"
            yield f"{subject}/step", 1e6 * statistics.median(times[name]), "us", RUNS
            yield f"{subject}/episodes_per_step", replay.ended, "1", 1
    bound = race_bound.Args()
    lap_s = race_bound.lap_s(flockstep.World.load("race/figure-8"), bound.thrust_to_weight, bound.parts)
    yield "race/point_mass/lap_s", lap_s, "s", 1


class Replay:
    """Recorded steps of a policy."""

    def __init__(self, is_solid: bool, ticks: int) -> None:
        scene = flockstep.World.load("race/figure-8").to_dict()
        for gate in scene["gates"]:
            gate["solid"] = is_solid
        self.envs = flockstep.DroneVectorEnv(
            DRONES,
            task=flockstep.RaceConfig(),
            worlds=flockstep.World.from_dict(scene),
            policy_hz=PHYSICS_HZ / ticks,
            physics_hz=PHYSICS_HZ,
            max_episode_steps=10 * PHYSICS_HZ // ticks,
            stagger_first_episode=True,
            copy=False,
            num_threads=1,
        )
        model = flockstep.PPO.load(POLICY)
        observation, _ = self.envs.reset(seed=0)
        for _ in range(WARM_UP):
            observation = self.envs.step(model.predict(observation, deterministic=True)[0])[0]
        self.snapshot = self.envs.snapshot()
        self.actions: list[Any] = []
        ended = 0
        for _ in range(STEPS):
            self.actions.append(np.array(model.predict(observation, deterministic=True)[0]))
            observation, _, terminated, truncated, _ = self.envs.step(self.actions[-1])
            ended += int((terminated | truncated).sum())
        self.ended = ended / (STEPS * DRONES)

    def seconds(self) -> float:
        """Fly the recorded steps again; return the processor time."""
        self.envs.restore(self.snapshot)
        before = time.process_time()
        for actions in self.actions:
            self.envs.step(actions)
        return time.process_time() - before
