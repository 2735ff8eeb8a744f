"""Flight through a forest at 5 m/s, or at 8 m/s, by a depth image of 16 x 12 pixels.

The speed is fixed: the policy chooses the direction of flight and the yaw rate. It sees the forest only in the depth
image, which also shows the goal as a sphere. It also observes the direction and distance of the goal, its motion, and
its height above the line from start to goal. The forests are generated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

import flockstep
from flockstep.rotations import rotate
from flockstep.trainings import TRAINING_SEEDS, UNSEEN_SEEDS, Training
from flockstep.trainings.table import worlds

Array = npt.NDArray[Any]

MOST_YAW_RADPS = 2.0
STEEPEST = 0.5  # largest vertical velocity as a share of the forward velocity
GOAL_RADIUS_M = 1.5
MOST_HEIGHT_M = 2.5  # above the line from start to goal; the trees are taller, so no flight passes above them
FAR_M = 20.0  # range of the camera
IMAGE_PX = (16, 12)
NEAR_M = 1.0  # depth within which nearness costs
MOST_DISTANCE_M = 20.0  # observed distances are limited to this

# Parts of the observation.
DIRECTION, DEPTH, UP = slice(0, 3), slice(4, 196), slice(199, 202)


class ForestFlight(flockstep.Task):
    """Fly to the goal between the trees, without touching anything."""

    worlds = ("forest/seed-0..9",)
    camera = flockstep.CameraConfig(
        width_px=32, height_px=24, hfov_deg=90, far_m=FAR_M, outputs=("depth",), resize=IMAGE_PX, pool="min"
    )
    drone = "kingfisher"
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="heading_velocity", max_speed_mps=6.0)
    clock = flockstep.ClockConfig(policy_hz=10)
    action_space = spaces.Box(-1, 1, (3,), np.float32)
    observation_space = spaces.Box(-np.inf, np.inf, (209,), np.float32)
    reward_terms = ("progress", "near", "crash", "reached", "change")
    info_names = ("speed_mps",)
    markers = ("goal",)
    random_world = True
    max_episode_steps = 200
    commanded_mps = 5.5  # drag makes the drone about 0.5 m/s slower

    def setup(self, batch: flockstep.Batch) -> None:
        """Allocate the state of the drones."""
        drones = batch.num_drones
        self.low, self.high = np.array([world.bounds for world in batch.worlds], np.float32).swapaxes(0, 1)
        self.start = np.array([world.start for world in batch.worlds], np.float32)
        self.goal = np.array([world.goal for world in batch.worlds], np.float32)
        self.up = np.tile(np.array([0, 0, 1], np.float32), (drones, 1))
        self.distance = np.zeros(drones, np.float32)
        self.action = np.zeros((drones, 3), np.float32)
        self.before = np.zeros((drones, 3), np.float32)
        self.last_position = np.zeros((drones, 3), np.float32)
        self.flown_m = np.zeros(drones, np.float32)

    def reset(self, batch: flockstep.Batch, mask: npt.NDArray[np.bool_]) -> None:
        """Begin at the start of the world."""
        super().reset(batch, mask)
        self.distance[mask] = batch.terms.goal_distance()[mask]
        self.action[mask] = 0
        self.last_position[mask] = batch.position[mask]
        self.flown_m[mask] = 0

    def act(self, batch: flockstep.Batch, actions: Array) -> Array:
        """Return the velocity (forward, left, up), which has a fixed length, and the yaw rate."""
        del batch
        self.before[:] = self.action
        self.action[:] = np.clip(actions, -1, 1)
        command = np.ones((len(actions), 4), np.float32)
        command[:, 1:] = self.action * [1.0, STEEPEST, MOST_YAW_RADPS]
        command[:, :3] *= self.commanded_mps / np.linalg.norm(command[:, :3], axis=1, keepdims=True)
        return command

    def above_line(self, batch: flockstep.Batch) -> Array:
        """Return the height above the straight line from start to goal, in m."""
        start, goal = self.start[batch.world_index], self.goal[batch.world_index]
        share = (batch.position[:, 0] - start[:, 0]) / (goal[:, 0] - start[:, 0])
        return np.asarray(batch.position[:, 2] - start[:, 2] - share * (goal[:, 2] - start[:, 2]))

    def step(self, batch: flockstep.Batch) -> tuple[Mapping[str, Array], Array]:
        """Reward progress; end at the goal, at a contact, or outside the forest."""
        crashed = batch.contact.hit
        distance = batch.terms.goal_distance()
        reached = distance <= GOAL_RADIUS_M
        low, high = self.low[batch.world_index, :2], self.high[batch.world_index, :2]
        outside = ((batch.position[:, :2] < low) | (batch.position[:, :2] > high)).any(axis=1)
        left = outside | (self.above_line(batch) > MOST_HEIGHT_M)
        self.success[:] = reached & ~crashed & ~left
        self.left_area[:] = left
        self.flown_m += self.flying * np.linalg.norm(batch.position - self.last_position, axis=1)
        self.last_position[:] = batch.position
        self.info["speed_mps"][:] = self.flown_m * batch.clock.policy_hz / np.maximum(self.steps, 1)
        change = self.action - self.before
        nearest = batch.camera().depth.min(axis=(1, 2))
        terms = {
            "progress": 0.5 * (self.distance - distance),
            "near": 0.2 * np.minimum(nearest - NEAR_M, 0),
            "crash": -10.0 * (crashed | left),
            "reached": 5.0 * self.success,
            "change": -0.02 * (change * change).sum(axis=1),
        }
        self.distance[:] = distance
        return terms, crashed | left | reached

    def observe(self, batch: flockstep.Batch) -> Array:
        """Return the goal, the depth image, the motion in the body frame, and the last action."""
        turned = rotate(batch.quat_wxyz, np.stack([batch.velocity, self.up]), inverse=True)
        return np.concatenate(
            [
                2.0 * batch.terms.goal_direction(),
                0.1 * np.minimum(self.distance, MOST_DISTANCE_M)[:, None],
                3.0 / (1.0 + batch.camera().depth.reshape(batch.num_drones, -1)),
                0.4 * turned[0] - [2, 0, 0],
                turned[1],
                0.5 * batch.angular_velocity,
                self.action,
                0.5 * self.above_line(batch)[:, None],
            ],
            axis=1,
            dtype=np.float32,
        )


class FastForestFlight(ForestFlight):
    """Fly at 8.5 m/s."""

    dynamics = flockstep.DynamicsConfig(motion="rotors", control="heading_velocity", max_speed_mps=9.0)
    commanded_mps = 8.5


def straight(observation: Array) -> Array:
    """Return the actions of a drone that flies straight to the goal."""
    direction, up = observation[:, DIRECTION], observation[:, UP]
    forward = np.array([1, 0, 0], np.float32) - up * up[:, :1]  # the heading, without the tilt
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    left = np.cross(up, forward)
    ahead, sideways, rise = ((direction * axis).sum(axis=1) for axis in (forward, left, up))
    most = np.maximum(ahead, 0.1)
    actions = [sideways / most, rise / (STEEPEST * most), np.arctan2(sideways, ahead)]
    return np.asarray(np.clip(np.stack(actions, axis=1), -1, 1), np.float32)


TRAINING = Training(
    env=ForestFlight,
    steps=1_200_000,
    num_envs=256,
    settings={
        "n_steps": 32,
        "batch_size": 1024,
        "n_epochs": 4,
        "learning_rate": 1e-3,
        "gamma": 0.98,
        "policy_kwargs": {"net_arch": [128, 128], "activation_fn": "relu", "log_std_init": -1.0},
    },
    learns=lambda: {"worlds": worlds("forest", TRAINING_SEEDS[:200])},
    judged=lambda flights, seed: {"": {"worlds": worlds("forest", range(seed, seed + flights)), "random_world": False}},
    figures={"speed_mps": ("", "speed_mps")},
    baselines={"straight": [straight]},
    film={"worlds": f"forest/seed-{UNSEEN_SEEDS.start}", "steps": 200},
    flights=300,
)
FAST = replace(TRAINING, env=FastForestFlight)
