"""Flyers without a policy, to compare with, and what trainings measure of flights."""

from __future__ import annotations

from typing import Any

import numpy as np

from flockstep.rotations import rotate
from flockstep.trainings.flying import Flyer
from flockstep.trainings.training import Array, Measure
from flockstep.vector_env import DroneVectorEnv

CLOSE_M = 0.05
"""Error of a successful flight of Hover or Track."""
FORMATION_STEP_M = 0.15
"""Way of a full action of Formation."""
PATH_POINTS = 10
"""Points of the path that `velocity_control` observes."""
PURSUIT_GAIN = 3.0
"""1/s, from a difference in velocity to an acceleration."""
PURSUIT_TURN = 8.0
"""1/s, from an angle to an angular velocity."""
PURSUIT_AHEAD = 0.6
"""Distance of the aim before the gate, over that of the drone."""


class PointError(Measure):
    """Distance to the point of Hover or Track: the mean of the last steps, or the root mean square of all."""

    def __init__(self, envs: DroneVectorEnv, steps: int, last: int, power: int) -> None:
        super().__init__(envs)
        self.last, self.power = last, power
        self.distance = np.full((steps, envs.num_envs), np.nan)
        self._taken = 0

    def step(self, observation: Any, flying: Array) -> None:
        """Keep the distances; a flight that has ended before was a crash."""
        if self._taken < len(self.distance):
            self.distance[self._taken, flying] = np.linalg.norm(observation[flying, :3], axis=1)
            self._taken += 1

    def values(self, steps: Array, success: Array) -> dict[str, Array]:
        """Return the errors; one of at most 5 cm is a success."""
        error = (self.distance[-self.last :] ** self.power).mean(axis=0) ** (1 / self.power)
        return {"error_m": error, "success": error <= CLOSE_M, "crashed": np.isnan(error)}


class Laps(Measure):
    """Time and speed of the laps after the first, which begins at rest, of successful flights."""

    def __init__(self, envs: DroneVectorEnv, laps: int) -> None:
        super().__init__(envs)
        self.laps, self._steps = laps, 0
        self.first_lap = np.zeros(envs.num_envs, int)
        self.gates, self.length_m = np.zeros(envs.num_envs, int), np.zeros(envs.num_envs)

    def step(self, observation: Any, flying: Array) -> None:
        """Note the step in which the first lap ended."""
        if self._steps == 0:
            for env in range(len(self.gates)):
                centers = np.array([gate["center"] for gate in self.envs.batch.world_of(env).gates])
                self.gates[env] = len(centers)
                self.length_m[env] = np.linalg.norm(np.roll(centers, -1, axis=0) - centers, axis=1).sum()
        self._steps += 1
        passed = self.envs.batch.task_state["passed"] >= self.gates
        self.first_lap[passed & flying & (self.first_lap == 0)] = self._steps

    def values(self, steps: Array, success: Array) -> dict[str, Array]:
        """Return seconds of a lap, and metres per second along the straight ways from gate to gate."""
        laps_s = (steps - self.first_lap) * (1 / self.hz) / (self.laps - 1)
        laps_s = np.where(success, laps_s, np.nan)
        return {"lap_s": laps_s, "speed_mps": self.length_m / laps_s}


class PlaceError(Measure):
    """Mean distance of drones from their places in a formation, over the steps before the last; at most 2 m each."""

    def __init__(self, envs: DroneVectorEnv) -> None:
        super().__init__(envs)
        self.summed, self.steps = np.zeros((2, envs.num_envs))

    def step(self, observation: Any, flying: Array) -> None:
        """Add the distances."""
        self.summed += flying * 2 * np.linalg.norm(observation[:, :3], axis=1)
        self.steps += flying

    def values(self, steps: Array, success: Array) -> dict[str, Array]:
        """Return the means."""
        return {"error_m": self.summed / np.maximum(self.steps, 1)}


def position_control(observation: Array, envs: DroneVectorEnv) -> Array:
    """Fly Hover by the controller cascade, commanded to the point."""
    actions = np.zeros((len(observation), 4), np.float32)
    actions[:, :3] = np.clip(rotate(envs.batch.quat_wxyz, observation[:, :3]), -1, 1)
    return actions


def velocity_control(point: int, gain: float, towards: int = 0) -> Flyer:
    """Fly Track by the controller cascade, commanded a velocity.

    It is the path's at the observed point ``point``, plus ``gain`` (1/s) times the offset to the observed point
    ``towards``; point 0 is the path's current position.
    """

    def act(observation: Array, envs: DroneVectorEnv) -> Array:
        task: Any = envs.task
        here, next_one, aim = (observation[:, 3 * i : 3 * i + 3] for i in (point, point + 1, towards))
        velocity = rotate(envs.batch.quat_wxyz, (next_one - here) / task.ahead_s + gain * aim)
        missing_yaw = np.arctan2(observation[:, -2], observation[:, -1])
        dynamics = envs.batch.dynamics
        yaw_rate = 2 * missing_yaw / np.radians(dynamics.max_yaw_rate_dps)
        actions = np.column_stack([velocity / dynamics.max_speed_mps, yaw_rate])
        return np.asarray(np.clip(actions, -1, 1), np.float32)

    return Flyer(act, {"points": PATH_POINTS, "control": "velocity"})


def pursuit(speed_mps: float) -> Flyer:
    """Fly through the next gate of Race by a policy's observation, at about one speed.

    It aims at a point on the gate's axis, the closer to the gate the closer the drone is. From the desired acceleration
    follow the thrust and the direction of the drone's z axis, and from that the rates.
    """

    def act(observation: Array, envs: DroneVectorEnv) -> Array:
        task: Any = envs.task
        scale, most = task.observation_scale, task.max_thrust_to_weight
        offset, normal = observation[:, 0:3] / scale, observation[:, 3:6]
        own = observation[:, 6 * task.gates_ahead :]
        velocity, up = own[:, 0:3] / scale, own[:, 3:6]
        before = (offset * normal).sum(axis=1, keepdims=True)  # m along the axis to the gate's plane
        aim = offset - np.where(before > 0, PURSUIT_AHEAD * before - 0.5, 2.0) * normal
        way = aim / np.maximum(np.linalg.norm(aim, axis=1, keepdims=True), 1e-6)
        force = PURSUIT_GAIN * (speed_mps * way - velocity) / 9.81 + up  # over the weight
        thrust = np.linalg.norm(force, axis=1)
        direction = force / np.maximum(thrust, 1e-6)[:, None]
        actions = np.zeros((len(observation), 4), np.float32)
        along = np.maximum(force[:, 2], 0.0)
        actions[:, 0] = np.where(along > 1, (along - 1) / (most - 1), along - 1)
        roll, pitch = -direction[:, 1], direction[:, 0]  # the cross product of the z axis and the direction
        actions[:, 1], actions[:, 2] = PURSUIT_TURN * roll / 8.0, PURSUIT_TURN * pitch / 8.0
        actions[:, 3] = 2.0 * np.arctan2(offset[:, 1], offset[:, 0]) / 4.0
        return np.asarray(np.clip(actions, -1, 1))

    return Flyer(act)


def straight_by_steps(observation: Array) -> Array:
    """Fly straight to the next waypoint by the six steps of the LiDAR task."""
    direction = observation[:, :3]
    axis = np.abs(direction).argmax(axis=1)
    return np.asarray(2 * axis + (np.take_along_axis(direction, axis[:, None], axis=1)[:, 0] < 0))


def straight_to_blob(observation: Array) -> Array:
    """Fly to the spot in the image by the three steps of the camera task, sideways until it is ahead."""
    offset = observation[:, 0]
    return np.where(np.abs(offset) < 0.1, 0, np.where(offset > 0, 2, 1))


def straight_in_swap(observation: Array) -> Array:
    """Fly straight to the goal of Swap, and slow down within 0.15 m of it."""
    most = np.minimum(observation[:, 2:3] * 10 / 0.15, 1)
    return np.asarray(observation[:, :2] * most, np.float32)


def straight_in_dodge(observation: Array) -> Array:
    """Fly straight to the goal of Dodge."""
    return np.asarray(observation[:, :2], np.float32)


def to_place(observation: Array) -> Array:
    """Fly straight to the place in the formation, and so lag one step behind."""
    return _towards(2 * observation[:, :3])


def ahead_of_place(observation: Array) -> Array:
    """Fly straight to where the place in the formation will be after the step."""
    return _towards(2 * observation[:, :3] + np.sqrt(3) * FORMATION_STEP_M * observation[:, 3:6])


def _towards(way: Array) -> Array:
    return np.asarray(way / np.maximum(np.abs(way).max(axis=1, keepdims=True), FORMATION_STEP_M), np.float32)
