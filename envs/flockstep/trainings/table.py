"""The trainings of the bundled tasks, a row each. A new task's training is one more row.

The hyperparameters were found with training seeds of 100 and above; the board reports the seeds 0 to 4.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace
from typing import Any

import numpy as np

from flockstep import scenes
from flockstep._core import (
    FormationConfig,
    HoverConfig,
    NavigationReward,
    ObservationConfig,
    TrackConfig,
    World,
)
from flockstep.trainings import corners, firmware, flyers, gradients, varied
from flockstep.trainings.flying import Flyer
from flockstep.trainings.training import TRAINING_SEEDS, Keywords, Training

WAREHOUSES = 16
"""Generated warehouses for training, and for the flights that judge. One takes about 20 MB."""
CAMERA_HEIGHT_M, CAMERA_SIDEWAYS_M = 3.12, 2.5
"""Height of the camera task's playgrounds, and how far to the side their goals are at most."""
FORMATION: Keywords = {"task": FormationConfig(route="path"), "drones_per_env": 4}
"""What the bundled policy of Formation flies."""
FORMATION_STEPS = {"hall": 300, "playground": 400, "warehouse": 1500}


@functools.cache
def generated(kind: str, seed: int) -> World:
    """Generate a world once."""
    return World.load(f"{kind}/seed-{seed}")


def worlds(kind: str, seeds: range) -> list[World]:
    """Return the worlds of some seeds."""
    return [generated(kind, seed) for seed in seeds]


def _range(seed: int, count: int) -> range:
    return range(seed, seed + count)


def _lidar() -> Keywords:
    return {
        "worlds": [*scenes.load("train") * 86, *worlds("playground", TRAINING_SEEDS[:1000])],  # 3 of 10 in the bundled
        "random_world": True,
        "max_episode_steps": 400,
        "reward_scale": 0.1,
        "reward": NavigationReward(goal_reward=100.0),
    }


def _navigation(features: str) -> Keywords:
    return {
        "n_steps": 64,
        "batch_size": 1024,
        "n_epochs": 3,
        "learning_rate": 1.5e-3,
        "gamma": 0.98,
        "policy_kwargs": {"activation_fn": "relu", "features_extractor_class": features},
    }


def level_playground(seed: int) -> World:
    """Return a generated playground for the camera task: without waypoints, start and goal at the same height."""
    scene = generated("playground", seed).to_dict()
    markers = scene["markers"]
    markers.pop("waypoints", None)
    for place in (markers["start"], markers["goal"]):
        place[2] = CAMERA_HEIGHT_M
    for corner, side in (("min", -1), ("max", 1)):
        markers["spawn_box"][corner][2] = CAMERA_HEIGHT_M + 0.25 * side
    return World.from_dict(scene)


def goal_is_ahead(world: World) -> bool:
    """Return whether the goal is in the camera's view at the start, unless a pillar hides it."""
    assert world.start is not None and world.goal is not None
    return bool(abs(world.goal[1] - world.start[1]) <= CAMERA_SIDEWAYS_M)


def _ahead(seeds: range, count: int) -> list[World]:
    return list(itertools.islice(filter(goal_is_ahead, map(level_playground, seeds)), count))


def _camera() -> Keywords:
    return {
        # A third in the bundled ones.
        "worlds": [*scenes.load("camera-train") * 50, *_ahead(TRAINING_SEEDS, 200)],
        "random_world": True,
        "random_start": True,
        "max_episode_steps": 400,
        "reward_scale": 0.1,
        "reward": NavigationReward(goal_reward=100.0, overshoot_weight=1.0, step_scale=100.0),
    }


def _camera_judged(flights: int, seed: int) -> dict[str, Keywords]:
    unseen = range(seed, seed + 10 * flights)
    kinds = {
        "ahead": _ahead(unseen, flights),
        "any": [level_playground(each) for each in unseen[:flights]],
        "training": scenes.load("camera-train"),
        "validation": scenes.load("camera-validation"),
    }
    return {
        kind: {"worlds": chosen, "flights": len(chosen), "max_episode_steps": 500} for kind, chosen in kinds.items()
    }


def _race(flights: int, seed: int, **keywords: Any) -> dict[str, Keywords]:
    del flights, seed
    return {"": {"task": varied.RACED, "max_episode_steps": 3000, **keywords}}


def _dodge(flights: int, seed: int) -> dict[str, Keywords]:
    half = max(flights // 2, 1)
    counts = {"playground": half, "warehouse": min(WAREHOUSES, half)}
    return {
        kind: {"worlds": worlds(f"living_{kind}", _range(seed, count)), "flights": half, "max_episode_steps": 400}
        for kind, count in counts.items()
    }


@functools.cache
def _still(living: World) -> World:
    return living.with_bodies([])


def _dodge_worlds() -> list[World]:
    # The warehouses are repeated, so that about half of the episodes are there.
    return worlds("living_playground", TRAINING_SEEDS[:200]) + 12 * worlds(
        "living_warehouse", TRAINING_SEEDS[:WAREHOUSES]
    )


@functools.cache
def _large_playground(seed: int) -> World:
    """Return a playground for formations: without waypoints, at which a path may turn back."""
    world = World.playground(seed, size_m=(28.0, 28.0, 5.25))
    return world.with_markers(start=world.start, goal=world.goal)


def _formation(flights: int, seed: int) -> dict[str, Keywords]:
    drawn: dict[str, Keywords] = {
        "hall": {"task": FormationConfig(route="loop")},
        "playground": {"worlds": [_large_playground(each) for each in _range(seed, flights)]},
        "warehouse": {"worlds": worlds("warehouse", _range(seed, min(flights, WAREHOUSES)))},
    }
    return {kind: {**FORMATION, "max_episode_steps": FORMATION_STEPS[kind], **own} for kind, own in drawn.items()}


def _formation_worlds() -> list[World]:
    playgrounds = [_large_playground(seed) for seed in TRAINING_SEEDS[:100]]
    return playgrounds + 6 * worlds("warehouse", TRAINING_SEEDS[:WAREHOUSES])


_PURSUITS = {"controller": [flyers.pursuit(float(speed)) for speed in np.arange(2.0, 10.1, 0.5)]}
_POINT = {"log_std_init": -1.5, "features_extractor_class": "PointFeatures"}
_TEAM = {"net_arch": [128, 128], "log_std_init": -0.7}

TRAININGS: dict[str, Training] = {
    "hover": Training(
        env="flockstep/Hover-v0",
        steps=1_600_000,
        num_envs=512,
        settings={
            "n_steps": 32,
            "batch_size": 1024,
            "n_epochs": 5,
            "learning_rate": 1.5e-3,
            "gamma": 0.98,
            "policy_kwargs": _POINT,
        },
        learns=lambda: {
            "task": HoverConfig(crash_weight=30.0, start_tilt_deg=110.0, start_speed_mps=2.5),
            "reward_scale": 0.1,
        },
        # The last step's observation also counts: only a crash ends a flight before it.
        judged=lambda flights, seed: {"": {"max_episode_steps": 301}},
        measure=functools.partial(flyers.PointError, steps=300, last=50, power=1),
        figures={"median_error_m": ("", "median_error_m")},
        baselines={"controller": [Flyer(flyers.position_control, {"control": "position"})]},
        film={"steps": 300},
    ),
    "track": Training(
        env="flockstep/Track-v0",
        steps=4_500_000,
        num_envs=256,
        settings={
            "n_steps": 64,
            "batch_size": 1024,
            "n_epochs": 5,
            "learning_rate": 1e-3,
            "gamma": 0.995,
            "policy_kwargs": _POINT,
        },
        learns=lambda: {"task": TrackConfig(crash_weight=30.0), "reward_scale": 0.1},
        judged=lambda flights, seed: {"": {"max_episode_steps": 1001}},
        measure=functools.partial(flyers.PointError, steps=1000, last=1000, power=2),
        figures={"median_error_m": ("", "median_error_m")},
        baselines={
            "controller": [  # it lags, so it has to look ahead
                flyers.velocity_control(point, gain, towards)
                for point in range(flyers.PATH_POINTS - 1)
                for towards in (0, point)
                for gain in (0.25, 0.5, 1.0, 2.0)
            ]
        },
        film={"steps": 1000, "fps": 50},
    ),
    "lidar": Training(
        env="flockstep/LidarNavigation-v0",
        steps=1_500_000,
        num_envs=512,
        settings=_navigation("GoalFeatures"),
        entropy=0.03,
        learns=_lidar,
        judged=lambda flights, seed: {
            "": {"worlds": worlds("playground", _range(seed, flights)), "max_episode_steps": 500}
        },
        baselines={"straight": [flyers.straight_by_steps]},
        film={"steps": 400, "fps": 25},
    ),
    "camera": Training(
        env="flockstep/CameraNavigation-v0",
        steps=2_000_000,
        num_envs=512,
        settings=_navigation("BlobFeatures"),
        entropy=0.03,
        learns=_camera,
        judged=_camera_judged,
        over=("ahead",),
        figures={f"success_{kind}": (kind, "success") for kind in ("any", "training", "validation")},
        baselines={"straight": [flyers.straight_to_blob]},
        film={"steps": 400, "fps": 25},
        flights=500,
        bench=("blob", "trained", 5),
    ),
    "race": Training(
        env="flockstep/Race-v0",
        steps=11_000_000,
        num_envs=512,
        settings={
            "n_steps": 32,
            "batch_size": 2048,
            "n_epochs": 4,
            "learning_rate": 2e-3,
            "policy_kwargs": {"log_std_init": -0.7},
        },
        learns=lambda: {"worlds": [varied.narrowed(World.load("race/figure-8"))]},
        judged=functools.partial(_race, worlds="race/figure-8"),
        measure=functools.partial(flyers.Laps, laps=varied.RACED.laps),
        figures={"lap_s": ("", "lap_s"), "speed_mps": ("", "speed_mps")},
        baselines=_PURSUITS,
        film={
            "task": varied.RACED,
            "steps": 3000,
            "max_episode_steps": 3000,
            "render_view": ((-10.5, -8.5, 7.7), (0.5, 0.5, 1.0)),  # of the figure-8 from a corner of its hall
        },
    ),
    "dodge": Training(
        env="flockstep/Dodge-v0",
        steps=24_000_000,
        num_envs=512,
        settings={
            "n_steps": 32,
            "batch_size": 2048,
            "n_epochs": 4,
            "learning_rate": 1e-3,
            "gamma": 0.99,
            "policy_kwargs": _TEAM,
        },
        entropy=0.003,
        learns=lambda: {"worlds": _dodge_worlds(), "random_world": True, "max_episode_steps": 400},
        judged=_dodge,
        figures={
            "contacts_per_minute": ("", "contacts_per_minute"),
            "success_in_playgrounds": ("playground", "success"),
            "success_in_warehouses": ("warehouse", "success"),
        },
        baselines={"straight": [flyers.straight_in_dodge]},
        film={"steps": 400},
        bench=("dodge", "living", 3),
    ),
    "swap": Training(
        env="flockstep/Swap-v0",
        steps=20_000_000,
        num_envs=768,
        settings={
            "n_steps": 32,
            "batch_size": 4096,
            "n_epochs": 3,
            "learning_rate": 1e-3,
            "gamma": 0.97,
            "policy_kwargs": _TEAM,
        },
        # Policies that trained with one number of drones failed with others.
        learns=lambda: {"drones_per_env": {2: 128, 4: 128, 8: 128, 16: 384}, "max_episode_steps": 150},
        judged=lambda flights, seed: {
            str(drones): {"drones_per_env": drones, "max_episode_steps": 300} for drones in (2, 4, 8, 16, 32)
        },
        over=("8",),
        figures={f"success_of_{drones}": (str(drones), "success") for drones in (2, 4, 8, 16, 32)}
        | {"seconds": ("", "seconds")},
        baselines={"straight": [flyers.straight_in_swap]},
        film={"steps": 300},
        bench=("swap", "trained", 3),
    ),
    "formation": Training(
        env="flockstep/Formation-v0",
        steps=6_000_000,
        num_envs=128,
        settings={
            "n_steps": 32,
            "batch_size": 4096,
            "n_epochs": 3,
            "learning_rate": 1e-3,
            "gamma": 0.97,
            "policy_kwargs": _TEAM,
        },
        learns=lambda: {
            **FORMATION,
            "worlds": _formation_worlds(),
            "random_world": True,
            "max_episode_steps": FORMATION_STEPS["warehouse"],
        },
        judged=_formation,
        measure=flyers.PlaceError,
        figures={
            f"{kind}_{name}": (kind, what)
            for kind in FORMATION_STEPS
            for name, what in (("success", "success"), ("touched", "crashed"), ("error_m", "error_m"))
        },
        baselines={"ahead": [flyers.ahead_of_place], "straight": [flyers.to_place]},
        film={"steps": 300},
        flights=500,
        bench=("formation", "trained", 3),
    ),
}
#: The same worlds without bodies, for comparison; the flights that judge have them all the same.
TRAININGS["dodge_still"] = replace(
    TRAININGS["dodge"],
    learns=lambda: {**TRAININGS["dodge"].learns(), "worlds": [_still(world) for world in _dodge_worlds()]},
    bench=("dodge", "still", 1),
)
TRAININGS["race_unseen"] = replace(
    TRAININGS["race"],
    learns=lambda: {
        "worlds": [varied.narrowed(each) for each in worlds("race_track", TRAINING_SEEDS[:300])],
        "random_world": True,
    },
    judged=lambda flights, seed: _race(flights, seed, worlds=worlds("race_track", _range(seed, flights))),
    film={
        "task": varied.RACED,
        "steps": 3000,
        "max_episode_steps": 3000,
        "worlds": "race_track/seed-1000000",
    },
)
TRAININGS |= varied.TRAININGS
TRAININGS["race_alike"] = replace(
    TRAININGS["race"],
    judged=varied.raced(ObservationConfig()),
    figures=varied.TRAININGS["race_varied"].figures,
    bench=("race_varied", "alike", 5),
)
TRAININGS |= firmware.rows(TRAININGS["race"])
TRAININGS["race_by_corners"] = corners.row(TRAININGS["race"])
by_gradients = gradients.by_gradients
TRAININGS |= {
    "hover_apg": by_gradients(TRAININGS["hover"], 307_200, gradients.POINT, "hover"),
    "track_apg": by_gradients(TRAININGS["track"], 999_424, gradients.POINT, "track"),
    # Along one track as fast as the loss allows; along others no faster than 8 m/s.
    "race_apg": by_gradients(TRAININGS["race"], 1_399_680, gradients.RACE, "race", speed_cap_mps=(16.0, 16.0)),
    "race_unseen_apg": by_gradients(
        TRAININGS["race_unseen"], 3_999_360, gradients.RACE, "race_unseen", speed_cap_mps=(8.0, 8.0)
    ),
    **{f"hover_{drone}_apg": gradients.frame_row(TRAININGS["hover"], drone) for drone in varied.FRAMES},
    "frames_apg": gradients.frames_row("frames"),
    "frames_late_apg": gradients.frames_row("frames_late", action_delay_s=(0.0, 0.04)),
}
