"""Fly a drone by hand in a browser: the command ``python -m flockstep fly``."""

from __future__ import annotations

import argparse
import time
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep import policies
from flockstep._core import Batch, CameraConfig, LidarConfig, RaceConfig
from flockstep.rotations import yaw_of
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv
from flockstep.viewer.live import LiveView, view

#: Control modes, the default first.
CONTROLS = ("body_rates", "attitude", "heading_velocity", "velocity", "acceleration", "position")
_YAW = 0.25  # share of half a turn that a stick turns away from the current heading


class ByHand(Task):
    """A flight without aim and end."""

    action_space = spaces.Box(-1, 1, (4,), np.float32)
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def act(self, batch: Batch, actions: Any) -> Any:
        """Command what the sticks say."""
        return batch.terms.command(actions)

    def step(self, batch: Batch) -> Any:
        """Reward nothing."""
        return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)

    def observe(self, batch: Batch) -> Any:
        """Observe the position."""
        return batch.position


def command_of(control: str, sticks: tuple[float, float, float, float], yaw: float) -> npt.NDArray[np.float32]:
    """Return the action (4,) of a control mode for the sticks throttle, roll, pitch and yaw, at a heading."""
    throttle, roll, pitch, turn = sticks
    if control in ("body_rates", "attitude"):
        command = [throttle, roll, pitch, -turn * (1 if control == "body_rates" else _YAW)]
    else:
        heading = 0.0 if control == "heading_velocity" else yaw
        ahead = pitch * np.cos(heading) + roll * np.sin(heading)
        left = pitch * np.sin(heading) - roll * np.cos(heading)
        command = [ahead, left, throttle, -turn * (1 if control.endswith("velocity") else _YAW)]
    return np.array(command, np.float32)


def envs_for(arguments: argparse.Namespace) -> DroneVectorEnv:
    """Return one env with the drone, and with that of the ghost."""
    given: dict[str, Any] = {"worlds": arguments.world, "drone": arguments.drone, "num_threads": 1}
    if arguments.ghost is not None:
        race = RaceConfig(start="gate", laps=3)
        return DroneVectorEnv(1, task=race, drones_per_env=2, episodes="each", max_episode_steps=0, **given)
    sensors: dict[str, Any] = {
        "lidar": LidarConfig(beams=72, hfov_deg=360, max_range_m=10),
        "camera": CameraConfig(width_px=160, height_px=120, rate_hz=25, offset_m=(0.1, 0.0, 0.05)),
    }
    motion: dict[str, Any] = {"motion": "rotors", "control": arguments.control, "on_contact": "bounce", "policy_hz": 50}
    return DroneVectorEnv(1, task=ByHand, **given, **motion, **sensors)


def fly(envs: DroneVectorEnv, live: LiveView, control: str, ghost: Any = None) -> None:
    """Fly by the sticks of a page, while there is one, until the view is closed."""
    observation, _ = envs.reset(seed=0)
    while live.is_open:
        if not live.is_watched:
            time.sleep(0.05)
            continue
        if live.take_reset():
            observation, _ = envs.reset()
        actions = np.zeros((envs.num_envs, 4), np.float32)
        if ghost is not None:
            actions = ghost.predict(observation, deterministic=True)[0]
        actions[0] = command_of(control, live.sticks(), float(yaw_of(envs.batch.quat_wxyz)[0]))
        observation, *_ = envs.step(actions)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``fly``."""
    parser.set_defaults(run=main)
    parser.add_argument("world", metavar="WORLD", help="name of a scene, such as indoor/office, or its file")
    parser.add_argument("--drone", help="name of an airframe, or its file; default: racer5 in a race, otherwise t650")
    modes = "what the sticks command; default: body_rates, which pilots call acro"
    parser.add_argument("--control", choices=CONTROLS, default=CONTROLS[0], help=modes)
    rival = "a bundled policy that races you, in a world with gates"
    parser.add_argument("--ghost", choices=("race",), help=rival)
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1; default: any free one")


def main(arguments: argparse.Namespace) -> None:
    """Fly until Ctrl-C."""
    if arguments.ghost is not None and arguments.control != CONTROLS[0]:
        raise ValueError(f"control: expected {CONTROLS[0]!r} with a ghost, got {arguments.control!r}")
    ghost = None if arguments.ghost is None else policies.load(arguments.ghost)
    envs = envs_for(arguments)
    try:
        live = view(envs, port=arguments.port, flies=True)
    except OSError as error:
        raise RuntimeError(f"port: {error}") from error
    with live, suppress(KeyboardInterrupt):
        print(f"flockstep flies in {arguments.world}; Ctrl-C ends it", flush=True)
        fly(envs, live, arguments.control, ghost)
