"""Benches of tasks: their trainings beside flyers without a policy, and the time of a step of Race.

The last policy of each training is judged, in worlds and flights that nothing else uses.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS, Training, Verdict, best_of, corners, judge, train
from flockstep.variations import presets
from timing import Measured, Median, in_turns, timed

ROOT = Path(__file__).resolve().parent.parent
#: Rows of trainings by bench.
BENCHES: dict[str, list[str]] = {}
for row, training in TRAININGS.items():
    if training.bench is not None:
        BENCHES.setdefault(training.bench[0], []).append(row)
UNITS = {"contacts_per_minute": "1/min", "seconds": "s", "training_s": "s"}


def measure(bench: str) -> Iterator[Measured]:
    """Judge the flyers and the trainings of a bench."""
    if bench == "gradients":
        yield from measure_gradients()
        return
    if bench == "betaflight":
        from peers import firmware  # needs the extra

        yield from firmware.measure()
        return
    first = TRAININGS[BENCHES[bench][0]]
    for flyer, candidates in first.baselines.items():
        yield from figures(
            f"{bench}/{flyer}", judge(first, best_of(first, candidates), first.flights, FIRST), first.flights
        )
    for training in (TRAININGS[row] for row in BENCHES[bench]):
        _, label, seeds = training.bench or ("", "", 0)
        for seed in range(seeds):
            before = time.perf_counter()
            model = train(training, "flockstep", seed, 2)
            seconds = time.perf_counter() - before
            name = f"{bench}/{label}/{seed}"
            yield from figures(name, judge(training, model, training.flights, FIRST), training.flights)
            yield f"{name}/training_s", seconds, "s", 1


def measure_gradients() -> Iterator[Measured]:
    """Train by gradients and by PPO in turns, on one thread, in processor time, with seeds that chose no setting."""
    for seed in range(5, 10):  # PPO with the first three
        for row in BENCHES["gradients"]:
            _, label, _ = TRAININGS[row].bench or ("", "", 0)
            both = {"apg": TRAININGS[row]} | ({"ppo": TRAININGS[label]} if label in TRAININGS and seed < 8 else {})
            for learner, training in both.items():
                before = time.process_time()
                model = train(training, "flockstep", seed, 1)
                seconds = time.process_time() - before
                name = f"gradients/{learner}/{label}/{seed}"
                yield from figures(name, judge(training, model, training.flights, FIRST), training.flights)
                yield f"{name}/cpu_s", seconds, "s", 1


FIRST = UNSEEN_SEEDS.start


def figures(name: str, verdict: Verdict, flights: int) -> Iterator[Measured]:
    yield f"{name}/success", verdict.success, "1", flights
    for what, value in verdict.more.items():
        yield f"{name}/{what}", value, UNITS.get(what, "m" if what.endswith("_m") else "1"), flights


def measure_varied() -> Iterator[Measured]:
    """Train the LiDAR task by rotors and the forest with drones that differ and without; judge both on both."""
    from training import forest_flight, rotor_navigation

    for task, training in (("lidar_rotors", rotor_navigation.TRAINING), ("forest", forest_flight.TRAINING)):
        yield from crossed(f"rotors_varied/{task}", training, ROTORS)


def measure_erring() -> Iterator[Measured]:
    """Train race and the LiDAR task by rotors with exact and with erring sensors; judge both on both."""
    from training import rotor_navigation

    lidar = copy(rotor_navigation.RotorNavigation.lidar)
    lidar.errors = flockstep.LidarConfig.preset("vl53l1x").errors
    yield from crossed("sensor_errors/race", TRAININGS["race"], {"exact": {}, "erring": {"pose_sensor": ESTIMATE}})
    yield from crossed(
        "sensor_errors/lidar_rotors", rotor_navigation.TRAINING, {"exact": {}, "erring": {"lidar": lidar}}
    )


def measure_erring_depth() -> Iterator[Measured]:
    """Train the forest with exact and with erring depth; judge both on both."""
    from training import forest_flight

    yield from crossed("depth_errors", forest_flight.TRAINING, exact_and_d435())


def measure_erring_depth_fast() -> Iterator[Measured]:
    """Do the same at 8.5 m/s."""
    from training import forest_flight

    yield from crossed("depth_errors_fast", forest_flight.FAST, exact_and_d435())


def exact_and_d435() -> dict[str, dict[str, Any]]:
    from training import forest_flight

    camera = copy(forest_flight.ForestFlight.camera)
    camera.depth_errors = flockstep.CameraConfig.preset("d435").depth_errors
    camera.depth_errors.hole_m = None  # far: the camera pools by the minimum, which would spread holes of 0
    return {"exact": {}, "erring": {"camera": camera}}


#: A policy knows no exact pose.
ESTIMATE = copy(corners.ESTIMATE)
ESTIMATE.rate_hz, ESTIMATE.latency_s = 50, 0.02


def crossed(name: str, training: Training, kinds: Mapping[str, dict[str, Any]]) -> Iterator[Measured]:
    """Train with the keywords of each kind, and judge each policy with those of all."""
    for label, learnt in kinds.items():
        row = replace(training, learns=lambda own=learnt: {**training.learns(), **own})
        for seed in range(SEEDS):
            before = time.process_time()
            model = train(row, "flockstep", seed, 2)
            yield f"{name}/{label}/{seed}/cpu_s", time.process_time() - before, "s", 1
            for kind, flown in kinds.items():
                judged = replace(
                    row, judged=lambda flights, first, own=flown: _with(training.judged(flights, first), own)
                )
                verdict = judge(judged, model, training.flights, FIRST)
                yield f"{name}/{label}/{seed}/{kind}", verdict.success, "1", training.flights


def _with(kinds: Mapping[str, dict[str, Any]], own: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {kind: {**keywords, **own} for kind, keywords in kinds.items()}


SEEDS = 5
#: Drones as their airframe, and drones that differ as one does of which one has the data sheet.
ROTORS: dict[str, dict[str, Any]] = {"alike": {}, "varied": {"variations": flockstep.vary(presets["sim2real"])}}
DRONES, RUNS = 1024, 15
WARM_UP, STEPS = 300, 100
PHYSICS_HZ = 500
TICKS = (5, 10)  # per step; 10 is the default of the task


def measure_race() -> Iterator[Measured]:
    """Time steps of Race with gates that are solid and with gates that are not, one thread, in processor time.

    The drones fly by `policies/race.zip`. Its actions are recorded once, and the timed steps replay them from a
    snapshot, so that the policy is not timed. The two worlds alternate. Also finds the lap of a point mass.
    """
    from training import race_bound

    for ticks in TICKS:
        replays = {name: Replay(is_solid, ticks) for name, is_solid in (("solid", True), ("open", False))}
        timers = {name: timed(replay.step, STEPS, before=replay.restart) for name, replay in replays.items()}
        times = in_turns(timers, RUNS)
        for name, replay in replays.items():
            subject = f"race/{name}_gates/{ticks}_ticks"
            yield f"{subject}/step", 1e6 * Median(times[name]) / DRONES, "us", RUNS
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
        model = flockstep.policies.load("race")
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

    def restart(self) -> None:
        """Go back to the first of the recorded steps."""
        self.envs.restore(self.snapshot)
        self.turns = iter(self.actions)

    def step(self) -> None:
        """Fly the next one again."""
        self.envs.step(next(self.turns))
