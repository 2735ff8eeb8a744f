"""A batched drone simulator for reinforcement learning.

>>> import gymnasium, swiftlet
>>> envs = gymnasium.make_vec("swiftlet/LidarNavigation-v0", num_envs=1024, worlds="train")

`World`, `Batch`, `LidarConfig` and their kin are the native simulator; `DroneVectorEnv` makes a Gymnasium environment
of it, `Task` is the base of a task of your own, `swiftlet.sb3` serves Stable-Baselines3 and `swiftlet.testing` checks
any Gymnasium vector environment. `render` takes a picture of a world.
"""

from __future__ import annotations

import importlib
from types import ModuleType

from swiftlet import registration, scenes
from swiftlet._core import (
    Batch,
    Camera,
    CameraConfig,
    Contact,
    DroneModel,
    GreenBlob,
    LidarConfig,
    NavigationConfig,
    NavigationReward,
    PoseSensorConfig,
    World,
    __version__,
    green_blob,
    plan,
)
from swiftlet.env import DroneEnv
from swiftlet.picture import render
from swiftlet.task import Task
from swiftlet.vector_env import DroneVectorEnv

__all__ = [
    "Batch",
    "Camera",
    "CameraConfig",
    "Contact",
    "DroneEnv",
    "DroneModel",
    "DroneVectorEnv",
    "GreenBlob",
    "LidarConfig",
    "NavigationConfig",
    "NavigationReward",
    "PoseSensorConfig",
    "Task",
    "World",
    "__version__",
    "green_blob",
    "plan",
    "render",
    "sb3",
    "scenes",
    "testing",
]

registration.register()


def __getattr__(name: str) -> ModuleType:
    if name in ("sb3", "testing"):  # on first use: the one needs Stable-Baselines3, the other nobody but a test
        return importlib.import_module(f"swiftlet.{name}")
    raise AttributeError(f"module 'swiftlet' has no attribute {name!r}")
