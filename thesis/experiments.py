"""The two experiments of chapter 6: trainings by tables 6.2 and 6.4, and flights of their policies.

A training writes its policy to out/thesis/policies/. The reward of its episodes is the mean of the last hundred, at
every update, on the thesis's scale.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep.evaluation import first_episodes
from flockstep.registration import make_same_step
from flockstep.trainings.learning import Callback
from flockstep.trainings.presets import Preset
from timing import Measured

POLICIES = Path(__file__).resolve().parents[1] / "out" / "thesis" / "policies"
SEEDS = range(5)
MAX_STEPS = 1000  # of a flight; a successful one takes about a hundred
SAMPLED = 50  # flights through each playground with sampled actions, as in training

Figures = Iterator[Measured | dict[str, Any]]


class Curve(Callback):
    """Notes the reward of the latest episodes at every update."""

    def __init__(self) -> None:
        self.points: list[tuple[int, float]] = []
        """Steps and reward."""

    def on_rollout_end(self) -> None:
        """Note it."""
        if ended := self.model.ep_info_buffer:
            self.points.append((self.model.num_timesteps, round(float(np.mean([each["r"] for each in ended])), 1)))


def flights(model: Any, experiment: Preset, worlds: str, times: int = 1) -> Iterator[tuple[str, bool, float]]:
    """Fly through each world; yield its name, whether the drone arrived, and the reward.

    Once by the likeliest actions, and more often by sampled ones.
    """
    scenes = flockstep.scenes.load(worlds) * times
    keywords = {**experiment.keywords(), "worlds": scenes, "max_episode_steps": MAX_STEPS}
    envs = make_same_step("thesis", experiment.env, len(scenes), **keywords)
    ends = first_episodes(lambda seen: model.predict(seen, deterministic=times == 1)[0], envs, "thesis", 0)
    for world, end in zip(scenes, ends, strict=True):
        arrived = flockstep.EpisodeEnd(end["episode_end"]) is flockstep.EpisodeEnd.success
        yield world.name, arrived, float(end["episode"]["r"])
    envs.close()


def trained(experiment: Preset, name: str, seed: int, training: str, validation: str) -> Figures:
    """Train by a table of the thesis, and fly through its playgrounds."""
    curve, envs = Curve(), experiment.make_envs(num_threads=1)
    model = flockstep.PPO("MlpPolicy", envs, seed=seed, num_threads=1, **experiment)
    begun = time.process_time()
    model.learn(experiment.steps, [curve], log_interval=None)
    seconds = time.process_time() - begun
    POLICIES.mkdir(parents=True, exist_ok=True)
    model.save(POLICIES / f"{name}.zip")
    envs.close()
    yield from judged(model, experiment, training, validation)
    positive = next((steps for steps, reward in curve.points if reward > 0), float("nan"))
    yield "first_positive", positive, "", 1
    yield "steps_per_second", experiment.steps / seconds, "1/s", 1
    thinned = curve.points[:: max(len(curve.points) // 150, 1)]
    yield {"name": "reward", "value": curve.points[-1][1], "unit": "", "runs": 1, "curve": thinned}


def judged(model: Any, experiment: Preset, training: str, validation: str) -> Figures:
    """Fly through the playgrounds of training and validation."""
    for kind, worlds in (("training", training), ("validation", validation)):
        flown = list(flights(model, experiment, worlds))
        yield f"{kind}/flown", sum(arrived for _, arrived, _ in flown), "", len(flown)
        for world, _, reward in flown:
            yield {"name": f"{kind}/{Path(world).name}", "value": round(reward, 1), "unit": "", "runs": 1}


def sampled(names: Sequence[str], experiment: Preset, training: str, validation: str) -> Figures:
    """Fly kept policies by sampled actions."""
    for name in names:
        model = flockstep.PPO.load(POLICIES / f"{name}.zip")
        for kind, worlds in (("training", training), ("validation", validation)):
            arrived = [each for _, each, _ in flights(model, experiment, worlds, SAMPLED)]
            yield f"{name.rpartition('_')[2]}/{kind}", float(np.mean(arrived)), "1", len(arrived)


def lidar() -> Mapping[str, Callable[[], Figures]]:
    """Return the rows of the LiDAR experiment: five seeds, and one with the goal's direction as the program had it."""
    unit = {f"unit_{seed}": partial(trained, flockstep.thesis.lidar(), f"lidar_unit_{seed}", seed) for seed in SEEDS}
    largest = partial(trained, flockstep.thesis.lidar("maximum"), "lidar_largest_0", 0)
    again = partial(sampled, [f"lidar_unit_{seed}" for seed in SEEDS], flockstep.thesis.lidar())
    rows = {**unit, "sampled": again, "largest_0": largest}
    return {row: partial(each, "train", "validation") for row, each in rows.items()}


def camera() -> Mapping[str, Callable[[], Figures]]:
    """Return the rows of the camera experiment: five seeds with small images, one with the thesis's."""
    small = {f"64_{seed}": partial(trained, flockstep.thesis.camera(64), f"camera_64_{seed}", seed) for seed in SEEDS}
    large = partial(trained, flockstep.thesis.camera(), "camera_640_0", 0)
    again = partial(sampled, [f"camera_64_{seed}" for seed in SEEDS], flockstep.thesis.camera(64))
    rows = {**small, "sampled": again, "640_0": large}
    return {row: partial(each, "camera-train", "camera-validation") for row, each in rows.items()}
