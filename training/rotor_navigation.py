"""The playgrounds by rotors: fly from start to goal by LiDAR with velocities relative to the heading.

Unlike in the LiDAR task of the thesis, the drone has inertia, and the policy chooses velocities instead of steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

import flockstep
from flockstep.trainings import TRAINING_SEEDS, Training
from flockstep.trainings.table import worlds

Array = npt.NDArray[Any]

GOAL_RADIUS_M = 0.5
MOST_DISTANCE_M = 5.0  # observed distances are limited to this


class RotorNavigation(flockstep.Task):
    """Fly to each waypoint and then to the goal, without touching anything."""

    worlds: ClassVar[tuple[str, ...]] = ("train",)
    lidar = flockstep.LidarConfig()
    drone = "t650"
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="heading_velocity", max_speed_mps=2.0)
    clock = flockstep.ClockConfig(policy_hz=10)
    action_space = spaces.Box(-1, 1, (3,), np.float32)
    observation_space = spaces.Box(-np.inf, np.inf, (51,), np.float32)
    reward_terms = ("progress", "crash", "reached", "change")
    random_world = True
    max_episode_steps = 400

    def setup(self, batch: flockstep.Batch) -> None:
        """Allocate the state of the drones."""
        drones = batch.num_drones
        self.last_goal = np.array([len(world.waypoints) for world in batch.worlds], np.int32)
        self.goal = np.zeros(drones, np.int32)
        self.distance = np.zeros(drones, np.float32)
        self.action = np.zeros((drones, 3), np.float32)
        self.before = np.zeros((drones, 3), np.float32)

    def reset(self, batch: flockstep.Batch, mask: npt.NDArray[np.bool_]) -> None:
        """Begin at the start of the world."""
        super().reset(batch, mask)
        self.goal[mask] = 0
        self.distance[mask] = batch.terms.goal_distance(self.goal)[mask]
        self.action[mask] = 0

    def act(self, batch: flockstep.Batch, actions: Array) -> Array:
        """Return the velocities: forward, left and up; the heading stays."""
        del batch
        self.before[:] = self.action
        self.action[:] = np.clip(actions, -1, 1)
        command = np.zeros((len(actions), 4), np.float32)
        command[:, :3] = self.action
        command[:, 2] *= 0.5
        return command

    def step(self, batch: flockstep.Batch) -> tuple[Mapping[str, Array], Array]:
        """Reward progress; end at the goal or at a contact."""
        crashed = batch.contact.hit
        distance = batch.terms.goal_distance(self.goal)
        reached = self.flying & (distance <= GOAL_RADIUS_M)
        arrived = reached & (self.goal == self.last_goal[batch.world_index])
        progress = self.distance - distance
        self.goal += reached & ~arrived
        self.distance[:] = batch.terms.goal_distance(self.goal) if reached.any() else distance
        self.success[:] = arrived & ~crashed
        change = self.action - self.before
        terms = {
            "progress": progress,
            "crash": -30.0 * crashed,
            "reached": 5.0 * reached,
            "change": -0.02 * (change * change).sum(axis=1) - 0.01,
        }
        return terms, crashed | arrived

    def observe(self, batch: flockstep.Batch) -> Array:
        """Return direction and distance of the goal, ranges, and the motion in the body frame."""
        return np.concatenate(
            [
                3.0 * batch.terms.goal_direction(self.goal),
                0.4 * np.minimum(self.distance, MOST_DISTANCE_M)[:, None],
                2.0 - 2.0 * batch.terms.ranges(),
                batch.terms.body_velocity(),
                batch.sensed_rotation[:, 2],  # the world's up
                batch.angular_velocity,
                self.action,
            ],
            axis=1,
            dtype=np.float32,
        )


def straight(observation: Array) -> Array:
    """Fly straight to the next waypoint as fast as possible."""
    velocity = observation[:, :3] * [1.0, 1.0, 2.0]  # an action of 1 is half as fast upwards
    return np.asarray(velocity / np.abs(velocity).max(axis=1, keepdims=True), np.float32)


TRAINING = Training(
    env=RotorNavigation,
    steps=2_500_000,
    num_envs=512,
    settings={
        "n_steps": 32,
        "batch_size": 1024,
        "n_epochs": 4,
        "learning_rate": 1e-3,
        "gamma": 0.98,
        "policy_kwargs": {"activation_fn": "relu"},
    },
    learns=lambda: {"worlds": worlds("playground", TRAINING_SEEDS[:300]), "max_episode_steps": 300},
    judged=lambda flights, seed: {
        "": {
            "worlds": worlds("playground", range(seed, seed + flights)),
            "random_world": False,
            "max_episode_steps": 400,
        }
    },
    baselines={"straight": [straight]},
    film={"steps": 400},
)
