"""The engine's track task written in NumPy: a template for your own flight tasks, and the engine's test oracle.

The shared parts are in hover_numpy.py. python examples/track_numpy.py flies the engine's task and this one side by side
with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import yaw_of
from flockstep.task import Array, BoolArray
from hover_numpy import FlightTask, fly_both

# Random paths are the sum of three waves along each axis.
SHARES = np.array([[1.0], [1.0], [0.5]])  # fractions of size_m, by axis
SIZES = np.array([0.6, 0.25, 0.15])  # fractions of these, by wave
RATES = np.array([1, 1.618034, 2.414214])  # relative to the first wave; the sum is never periodic


class Track(FlightTask):
    """Follow a point that moves along a smooth path; see `flockstep.TrackConfig` for the fields."""

    reward_terms = ("near", "close", "yaw", "spin", "change", "crash")
    max_episode_steps = 1000
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates")
    clock = flockstep.ClockConfig(policy_hz=100)

    def __init__(self, config: flockstep.TrackConfig) -> None:
        self.config = config
        self.observation_space = spaces.Box(-np.inf, np.inf, (15 + 3 * config.points,), np.float32)
        if config.path == "figure8":
            angle = 2 * np.pi * (np.arange(1000) + 0.5) / 1000
            speed = np.hypot(np.sin(angle), np.cos(2 * angle)).mean()  # for size 1 at 1 rad/s
        else:
            speed = np.sqrt(np.sum((SHARES * SIZES * RATES) ** 2) / 2)
        self.rate = config.speed_mps / (config.size_m * speed)  # rad/s

    def setup(self, batch: flockstep.Batch) -> None:
        super().setup(batch)
        self.phase = np.zeros((batch.num_drones, 9))  # turns: three waves along three axes; a figure-8 uses one
        self.squares = np.zeros(batch.num_drones)  # m^2: sum over the steps of the episode

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        self.squares[mask] = 0
        self.phase[mask] = batch.random(stream=1, count=9, rows=batch.rows)
        rows = batch.rows  # of the mask
        position, velocity = (values[rows] for values in self.path(batch))
        half = self.path_yaw(velocity) / 2
        offset = self.config.start_offset_m * (2.0 * batch.random(stream=0, count=3, rows=rows) - 1)
        quat = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
        batch.set_pose(position + offset, quat, rows=rows)
        batch.set_velocity(velocity, rows=rows)

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c = self.config
        position, velocity = self.path(batch)
        distance = np.linalg.norm(position - batch.position, axis=1)
        self.left_area[:] = distance > c.max_distance_m
        crashed = batch.contact.hit | self.left_area
        self.squares += distance**2
        self.success[:] = ~crashed & (self.squares <= c.close_m**2 * self.steps)
        terms = {
            "near": c.near_weight * np.exp(-2 * distance),
            "close": c.close_weight / (1 + (distance / c.close_m) ** 2),
            "yaw": -c.yaw_weight * np.abs(self.missing_yaw(velocity, batch.quat_wxyz)),
            "spin": -c.spin_weight * self.spin(batch),
            "change": -c.change_weight * self.change(),
            "crash": -c.crash_weight * crashed,
        }
        return terms, crashed

    def observe(self, batch: flockstep.Batch) -> Array:
        points = np.stack([self.path(batch, i * self.config.ahead_s)[0] for i in range(self.config.points)], axis=1)
        ways = batch.terms.to_body(points).reshape(batch.num_drones, -1)
        missing = self.missing_yaw(self.path(batch)[1], batch.sensed_quat_wxyz)
        return np.column_stack([ways, self.own_flight(batch), np.sin(missing), np.cos(missing)])

    def path(self, batch: flockstep.Batch, ahead_s: float = 0.0) -> tuple[Array, Array]:
        """Return each drone's position (N, 3) m and velocity (N, 3) m/s on its path, at a time after now."""
        size, rate = self.config.size_m, self.rate
        time = self.steps / self.clock.policy_hz + ahead_s
        phase = 2 * np.pi * self.phase
        if self.config.path == "figure8":
            a = rate * time + phase[:, 0]
            position = size * np.stack([np.cos(a), np.sin(2 * a) / 2, 0 * a], axis=1)
            velocity = size * rate * np.stack([-np.sin(a), np.cos(2 * a), 0 * a], axis=1)
        else:
            angle = rate * RATES * time[:, None, None] + phase.reshape(-1, 3, 3)  # (N, axes, waves)
            waves = size * SHARES * SIZES
            position = np.sum(waves * np.sin(angle), axis=2)
            velocity = np.sum(waves * rate * RATES * np.cos(angle), axis=2)
        return self.middle(batch) + position, velocity

    def path_yaw(self, velocity: Array) -> Array:
        """Return the commanded yaw for this velocity of the path, (N,) rad."""
        if self.config.yaw == "fixed":
            return np.zeros(len(velocity))
        yaw: Array = np.arctan2(velocity[:, 1], velocity[:, 0])
        return yaw

    def missing_yaw(self, velocity: Array, quat_wxyz: Array) -> Array:
        """Return the commanded yaw minus the drone's yaw, in [-pi, pi), (N,) rad."""
        missing: Array = (self.path_yaw(velocity) - yaw_of(quat_wxyz) + np.pi) % (2 * np.pi) - np.pi
        return missing


if __name__ == "__main__":
    track = flockstep.TrackConfig()
    fly_both(track, Track(track))
