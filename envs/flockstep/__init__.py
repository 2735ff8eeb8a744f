"""A batched drone simulator for reinforcement learning.

>>> import gymnasium, flockstep
>>> envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", num_envs=1024, worlds="train")

`World`, `Batch`, `LidarConfig` and similar classes are the native simulator. `DroneVectorEnv` wraps it as a Gymnasium
environment, and `Task` is the base class for your own tasks. `flockstep.sb3` connects to Stable-Baselines3,
`flockstep.rllib` to Ray RLlib, ``parallel_env`` to PettingZoo, and `flockstep.testing` checks any Gymnasium vector
environment. `flockstep.torch` differentiates flights. `PPO` trains a policy, with the settings of `presets` if you
like, and `flockstep.policies` has trained ones. `evaluate` and `success_rates` test a policy, `record` films a
flight or writes a `Recording`, `show` replays it, `view` shows envs live, `export` writes a policy for C or ONNX.
`render` takes a picture of a world. `connect` connects to a server.
"""

# ruff: noqa: E402 # the check for required packages comes before the imports that need them

from typing import TYPE_CHECKING as _TYPE_CHECKING

from flockstep.doctor import stop_without_required as _stop_without_required

_stop_without_required()

from flockstep import policies, registration, rotations, scenes
from flockstep._core import (
    BarometerConfig,
    Batch,
    Bodies,
    BodyConfig,
    BodyMotion,
    Camera,
    CameraConfig,
    ClockConfig,
    ColorBlob,
    ColorComponents,
    ColorErrors,
    ColorRange,
    Contact,
    ControllerConfig,
    DepthErrors,
    DodgeConfig,
    DroneModel,
    DroneParameters,
    DynamicsConfig,
    EpisodeConfig,
    EpisodeEnd,
    EventPixels,
    FormationConfig,
    GateDetector,
    GpsReceiverConfig,
    GreenBlob,
    HoverConfig,
    ImuConfig,
    Lidar,
    LidarConfig,
    Light,
    MagnetometerConfig,
    NativeTask,
    NavigationConfig,
    NavigationReward,
    ObservationConfig,
    OpticalFlowConfig,
    PoseSensorConfig,
    RaceConfig,
    RangeErrors,
    Recipe,
    Server,
    ServerConfig,
    SwapConfig,
    TrackConfig,
    Variation,
    WindConfig,
    World,
    WorldBuilder,
    __version__,
    color_blob,
    color_components,
    formation_places,
    green_blob,
    parameter_names,
)
from flockstep.airframe import estimate_airframe
from flockstep.drone_mesh import DroneMesh
from flockstep.env import DroneEnv
from flockstep.evaluation import Evaluation, evaluate, success_rates
from flockstep.export import export
from flockstep.headers import cmake_dir, include_dir
from flockstep.learning import APG, PPO
from flockstep.pictures.picture import render
from flockstep.planning import plan
from flockstep.recording import record
from flockstep.recordings import Recording
from flockstep.relight import relight
from flockstep.serving import serve
from flockstep.task import Task
from flockstep.variations import describe, vary
from flockstep.vector_env import DroneVectorEnv
from flockstep.viewer import LiveView, show, view
from flockstep.world_pool import WorldPool

__all__ = [
    "APG",
    "PPO",
    "BarometerConfig",
    "Batch",
    "Bodies",
    "BodyConfig",
    "BodyMotion",
    "Camera",
    "CameraConfig",
    "ClockConfig",
    "ColorBlob",
    "ColorComponents",
    "ColorErrors",
    "ColorRange",
    "Contact",
    "ControllerConfig",
    "DepthErrors",
    "DodgeConfig",
    "DroneEnv",
    "DroneMesh",
    "DroneModel",
    "DroneParameters",
    "DroneVectorEnv",
    "DynamicsConfig",
    "EpisodeConfig",
    "EpisodeEnd",
    "Evaluation",
    "EventPixels",
    "FormationConfig",
    "GateDetector",
    "GpsReceiverConfig",
    "GreenBlob",
    "HoverConfig",
    "ImuConfig",
    "Lidar",
    "LidarConfig",
    "Light",
    "LiveView",
    "MagnetometerConfig",
    "NativeTask",
    "NavigationConfig",
    "NavigationReward",
    "ObservationConfig",
    "OpticalFlowConfig",
    "PoseSensorConfig",
    "RaceConfig",
    "RangeErrors",
    "Recipe",
    "Recording",
    "Server",
    "ServerConfig",
    "SwapConfig",
    "Task",
    "TrackConfig",
    "Variation",
    "WindConfig",
    "World",
    "WorldBuilder",
    "WorldPool",
    "__version__",
    "client",
    "cmake_dir",
    "color_blob",
    "color_components",
    "connect",
    "connect_async",
    "describe",
    "estimate_airframe",
    "evaluate",
    "export",
    "formation_places",
    "green_blob",
    "include_dir",
    "parallel_env",
    "parameter_names",
    "plan",
    "policies",
    "presets",
    "record",
    "register_task",
    "relight",
    "render",
    "rllib",
    "rotations",
    "sb3",
    "scenes",
    "serve",
    "show",
    "success_rates",
    "testing",
    "thesis",
    "torch",
    "variations",
    "vary",
    "view",
]

registration.register()
register_task = registration.register_task

if _TYPE_CHECKING:
    from flockstep import client, rllib, sb3, testing, thesis, torch
    from flockstep.client import connect, connect_async
    from flockstep.multi_agent import parallel_env
    from flockstep.trainings.presets import presets
else:

    def __getattr__(name: str) -> object:
        # Imported on first use: client, parallel_env, rllib, sb3 and torch need optional packages; only tests need
        # testing, and only trainings need presets and thesis.
        import importlib

        if name in ("client", "rllib", "sb3", "testing", "thesis", "torch"):
            return importlib.import_module(f"flockstep.{name}")
        if name in ("connect", "connect_async"):
            return getattr(importlib.import_module("flockstep.client"), name)
        if name == "parallel_env":
            return importlib.import_module("flockstep.multi_agent").parallel_env
        if name == "presets":
            return importlib.import_module("flockstep.trainings.presets").presets
        from flockstep.errors import did_you_mean

        raise AttributeError(f"module 'flockstep' has no attribute {name!r}{did_you_mean(name, __all__)}")


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
