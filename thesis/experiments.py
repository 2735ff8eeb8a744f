"""The two experiments of chapter 6: trainings by tables 6.2 and 6.4, and flights of their policies.

A training writes its policy to out/thesis/policies/. The reward of its episodes is the mean of the last hundred, at
every update, on the thesis's scale.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
import torch

import flockstep
from flockstep import CameraConfig
from flockstep.registration import make_by_id
from flockstep.trainings import TRAININGS
from flockstep.trainings.learning import Callback
from flockstep.trainings.presets import Preset
from timing import Measured
from training.evaluate import Flight, first_flights
from training.plot_paths import plot_overview

POLICIES = Path(__file__).resolve().parents[1] / "out" / "thesis" / "policies"
IMAGES = POLICIES.parents[2] / "docs" / "images"
SEEDS = range(5)
LIDAR_WORLDS, CAMERA_WORLDS = ("train", "validation"), ("camera-train", "camera-validation")
MAX_STEPS = 1000  # of a flight; a successful one takes about a hundred
OTHERS_STEPS = 3_686_400  # of the other algorithms, a tenth of the thesis's steps
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


def flights(model: Any, experiment: Preset, worlds: str, times: int = 1) -> list[Flight]:
    """Fly through each world: once by the likeliest actions, and more often by sampled ones."""
    scenes = flockstep.scenes.load(worlds) * times
    keywords = {**experiment.keywords(), "worlds": scenes, "max_episode_steps": MAX_STEPS}
    envs = make_by_id(experiment.env, len(scenes), autoreset_mode="disabled", **keywords)
    return first_flights(lambda seen: model.predict(seen, deterministic=times == 1)[0], envs, scenes)


def trained(
    experiment: Preset, name: str, seed: int, training: str, validation: str, flown: Preset | None = None
) -> Figures:
    """Train by a table of the thesis, or by other settings, and fly the thesis's experiment through its playgrounds."""
    envs = experiment.make_envs(num_threads=1)
    model = flockstep.PPO("MlpPolicy", envs, seed=seed, num_threads=1, **experiment)
    yield from learned(model, flown or experiment, experiment.steps, training, validation)
    POLICIES.mkdir(parents=True, exist_ok=True)
    model.save(POLICIES / f"{name}.zip")
    envs.close()


def trained_by(algorithm: str, experiment: Preset, training: str, validation: str) -> Figures:
    """Train by the defaults of another algorithm of Stable-Baselines3."""
    envs = experiment.make_envs(num_threads=1)
    learner = getattr(stable_baselines3, algorithm)
    torch.set_num_threads(1)
    model = learner("MlpPolicy", flockstep.sb3.DroneVecEnv(envs), seed=0, device="cpu")
    yield from learned(model, experiment, OTHERS_STEPS, training, validation)
    envs.close()


def learned(model: Any, experiment: Preset, steps: int, training: str, validation: str) -> Figures:
    """Train a model, and fly it through the playgrounds."""
    curve, begun = Curve(), time.process_time()
    model.learn(steps, [curve], log_interval=None)
    seconds = time.process_time() - begun
    yield from judged(model, experiment, training, validation)
    positive = [steps for steps, reward in curve.points if reward > 0]
    if positive:
        yield "first_positive", positive[0], "", 1
    yield "steps_per_second", steps / seconds, "1/s", 1
    if curve.points:
        thinned = curve.points[:: max(len(curve.points) // 150, 1)]
        yield {"name": "reward", "value": curve.points[-1][1], "unit": "", "runs": 1, "curve": thinned}


def judged(model: Any, experiment: Preset, training: str, validation: str) -> Figures:
    """Fly through the playgrounds of training and validation."""
    for kind, worlds in (("training", training), ("validation", validation)):
        flown = flights(model, experiment, worlds)
        yield f"{kind}/flown", sum(each.outcome == "success" for each in flown), "", len(flown)
        for each in flown:
            name = f"{kind}/{Path(each.world).name}"
            yield {"name": name, "value": round(each.reward, 1), "unit": "", "runs": 1}


def sampled(name: str, experiment: Preset, training: str, validation: str) -> Figures:
    """Fly a kept policy by sampled actions."""
    model = flockstep.PPO.load(POLICIES / f"{name}.zip")
    for kind, worlds in (("training", training), ("validation", validation)):
        flown = flights(model, experiment, worlds, SAMPLED)
        yield kind, sum(each.outcome == "success" for each in flown) / len(flown), "1", len(flown)


def bundled(experiment: Preset, training: str, validation: str) -> Figures:
    """Fly the bundled camera policy."""
    yield from judged(flockstep.policies.load("camera"), experiment, training, validation)


def draw_paths() -> None:
    """Draw the paths of the LiDAR policy of seed 0, and of the bundled camera policy: figures 6.3, 6.4, 6.8 and 6.9."""
    lidar_policy = flockstep.PPO.load(POLICIES / "lidar_unit_0.zip")
    for name, model, experiment, worlds in (
        ("lidar", lidar_policy, flockstep.thesis.lidar(), LIDAR_WORLDS),
        ("camera", flockstep.policies.load("camera"), flockstep.thesis.camera(64), CAMERA_WORLDS),
    ):
        flown = [flight for each in worlds for flight in flights(model, experiment, each)]
        scenes = [scene for each in worlds for scene in flockstep.scenes.load(each)]
        plot_overview(scenes, flown, IMAGES / f"thesis-{name}-paths.png")


def lidar() -> Mapping[str, Callable[[], Figures]]:
    """Return the rows of the LiDAR experiment: five seeds, and one with the goal's direction as the program had it."""
    unit = {f"unit_{seed}": partial(trained, flockstep.thesis.lidar(), f"lidar_unit_{seed}", seed) for seed in SEEDS}
    largest = partial(trained, flockstep.thesis.lidar("maximum"), "lidar_largest_0", 0)
    again = {f"sampled_{seed}": partial(sampled, f"lidar_unit_{seed}", flockstep.thesis.lidar()) for seed in SEEDS}
    others = {name.lower(): partial(trained_by, name, flockstep.thesis.lidar()) for name in ("A2C", "DQN")}
    rows = {**unit, **again, "largest_0": largest, **others}
    return {row: partial(each, *LIDAR_WORLDS) for row, each in rows.items()}


def camera() -> Mapping[str, Callable[[], Figures]]:
    """Return the rows of the camera experiment: five seeds with small images, one with the thesis's."""
    small = {f"64_{seed}": partial(trained, flockstep.thesis.camera(64), f"camera_64_{seed}", seed) for seed in SEEDS}
    large = partial(trained, flockstep.thesis.camera(), "camera_640_0", 0)
    again = {f"sampled_{seed}": partial(sampled, f"camera_64_{seed}", flockstep.thesis.camera(64)) for seed in SEEDS}
    row = TRAININGS["camera"]
    images = CameraConfig(width_px=640, height_px=480)
    settings = Preset(replace(row, learns=lambda: {**row.learns(), "camera": images}))
    ours = partial(trained, settings, "camera_ours_640_0", 0, flown=flockstep.thesis.camera())
    seen_larger = partial(bundled, flockstep.thesis.camera())
    rows = {**small, **again, "bundled": seen_larger, "ours_640_0": ours, "640_0": large}
    return {row: partial(each, *CAMERA_WORLDS) for row, each in rows.items()}
