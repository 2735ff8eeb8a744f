"""Fly a drone by hand in a browser: the command ``python -m flockstep fly``."""

from __future__ import annotations

import argparse
from contextlib import closing, suppress
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep import policies, scenes
from flockstep._core import Batch, engine_tasks
from flockstep.registration import make_by_id
from flockstep.rotations import quat_from_rpy, yaw_of
from flockstep.task import Task
from flockstep.trainings.table import TRAININGS
from flockstep.vector_env import DroneVectorEnv
from flockstep.viewer.live import LiveView, view

#: Modes of control, the default first
CONTROLS = ("body_rates", "attitude", "heading_velocity", "velocity", "acceleration", "position")
_YAW = 0.25  # share of half a turn that a stick turns away from the current heading


class ByHand(Task):
    """A flight without end, which counts the gates of its world."""

    action_space = spaces.Box(-1, 1, (4,), np.float32)
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    reward_terms = ("gate",)
    records_path = True

    def setup(self, batch: Batch) -> None:
        """Begin before the first gate."""
        self.gates = len(batch.worlds[0].gates)
        self.target, self.passed = np.zeros((2, batch.num_drones), np.int64)

    def reset(self, batch: Batch, mask: Any) -> None:
        """Begin at the start, level, and face the first gate, or else where the way leads."""
        world, place = batch.worlds[0], batch.terms.start()
        aims = [*(gate["center"] for gate in world.gates), *world.waypoints, world.goal]
        ahead = np.zeros_like(place) if aims[0] is None else np.asarray(aims[0], np.float32) - place
        heading = np.arctan2(ahead[:, 1], ahead[:, 0])
        batch.set_pose(place, quat_from_rpy(np.stack([0 * heading, 0 * heading, heading], axis=-1)), mask)
        self.target[mask] = self.passed[mask] = 0

    def act(self, batch: Batch, actions: Any) -> Any:
        """Command what the sticks say."""
        return batch.terms.command(actions)

    def step(self, batch: Batch) -> Any:
        """Reward each gate."""
        passed = batch.terms.crossed(self.target)[0] if self.gates else np.zeros(batch.num_drones, np.int32)
        self.passed += passed
        self.target[:] = self.passed % max(self.gates, 1)
        return passed, np.zeros(batch.num_drones, bool)

    def observe(self, batch: Batch) -> Any:
        """Observe the position."""
        return batch.position


def command_of(mode: str, sticks: tuple[float, float, float, float], turned: float) -> npt.NDArray[np.float32]:
    """Return the action (4,) of a control mode for the sticks throttle, roll, pitch and yaw, at a heading in rad."""
    throttle, roll, pitch, turn = sticks
    if mode in CONTROLS[:2]:
        return np.array([throttle, roll, pitch, -turn * (1 if mode == CONTROLS[0] else _YAW)], np.float32)
    heading = 0.0 if mode.startswith("heading") else turned
    ahead = pitch * np.cos(heading) + roll * np.sin(heading)
    left = pitch * np.sin(heading) - roll * np.cos(heading)
    return np.array([ahead, left, throttle, -turn * (1 if mode.endswith("velocity") else _YAW)], np.float32)


def envs_for(arguments: argparse.Namespace) -> DroneVectorEnv:
    """Return one env with the drone, and with that of the ghost."""
    world = scenes.load(arguments.world)
    drone = "racer5" if arguments.drone is None and world[0].gates else arguments.drone
    make = partial(DroneVectorEnv, 1, worlds=world, drone=drone, num_threads=1, through=arguments.through)
    if arguments.ghost is not None:
        race = TRAININGS[arguments.ghost].film["task"]
        return make(task=race, drones_per_env=2, episodes="each", max_episode_steps=0)
    with closing(make_by_id("flockstep/CameraNavigation-v0", 1)) as sensing:
        sensors = partial(make, lidar=sensing.lidars, camera=sensing.cameras)
    return sensors(task=ByHand, motion="rotors", control=arguments.control, on_contact="bounce", policy_hz=50)


def fly(envs: DroneVectorEnv, live: LiveView, mode: str, ghost: Any = None) -> None:
    """Fly by the sticks of a page, while there is one, until the view is closed."""
    observation, _ = envs.reset(seed=0)
    while live.is_open:
        live.wait()
        if live.take_reset():
            observation, _ = envs.reset()
        actions = np.zeros((envs.num_envs, 4), np.float32)
        if ghost is not None:
            actions = ghost.predict(observation, deterministic=True)[0]  # the first drone's is replaced
        actions[0] = command_of(mode, live.sticks(), float(yaw_of(envs.batch.quat_wxyz)[0]))
        observation, *_ = envs.step(actions)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``fly``."""
    parser.set_defaults(run=main)
    parser.add_argument("world", metavar="WORLD", help="name of a scene, such as indoor/office, or its file")
    parser.add_argument("--drone", help="name of an airframe, or its file; default: racer5 in a race, otherwise t650")
    modes = "what the sticks command; default: body_rates, which pilots call acro, and which --ghost needs"
    parser.add_argument("--control", choices=CONTROLS, default=CONTROLS[0], help=modes)
    rival = "a bundled policy that races you by body_rates, in a world with gates"
    racing = [name for name in policies.names() if name in engine_tasks and "task" in TRAININGS[name].film]
    parser.add_argument("--ghost", choices=racing, help=rival)
    firmware = "firmware that flies: in acro mode, with --control attitude in angle mode"
    parser.add_argument("--through", choices=["betaflight"], help=firmware)
    parser.add_argument("--port", type=int, default=0, help="port on 127.0.0.1; default: any free one")


def main(arguments: argparse.Namespace) -> None:
    """Fly until Ctrl-C."""
    if arguments.ghost is not None and arguments.control != CONTROLS[0]:
        raise ValueError(f"expected --control {CONTROLS[0]} with --ghost, got {arguments.control}")
    if arguments.ghost is not None and arguments.through is not None:
        raise ValueError(f"expected no --ghost with --through, got {arguments.ghost} and {arguments.through}")
    ghost = None if arguments.ghost is None else policies.load(arguments.ghost)
    envs = envs_for(arguments)
    try:
        live = view(envs, local_port=arguments.port, flies=True)
    except OSError as error:
        raise RuntimeError(f"expected a free port, got {arguments.port}: {error}") from error
    live.names = ("you",) if ghost is None else ("you", f"ghost ({arguments.ghost})")
    with live, suppress(KeyboardInterrupt):
        print(f"flockstep flies in {arguments.world}; Ctrl-C ends it", flush=True)
        fly(envs, live, arguments.control, ghost)
