"""The engine's dodge task written in NumPy: a template for tasks among bodies, and the engine's test oracle.

python examples/dodge_numpy.py flies both side by side with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import copy

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import rotate
from flockstep.task import Array, BoolArray, Target
from hover_numpy import fly_both

TRIES = 64  # random positions to try
FAR_GOAL_M = 10.0
CLEAR_OF_BODIES_M = 1.5


class Dodge(flockstep.Task):
    """Fly to a goal by LiDAR, in the plane, among bodies that move; see `flockstep.DodgeConfig` for the fields."""

    action_space = spaces.Box(-1, 1, (2,), np.float32)
    reward_terms = ("progress", "goal", "crash", "near", "time")
    worlds = "living"
    max_episode_steps = 400

    def __init__(self, config: flockstep.DodgeConfig, lidar: flockstep.LidarConfig) -> None:
        self.config = config
        self.lidar = lidar
        rays = lidar.shape[0] * lidar.shape[1]
        low = np.concatenate([[-1, -1, 0, -1, -1], np.zeros(2 * rays)]).astype(np.float32)
        self.observation_space = spaces.Box(low, np.ones_like(low), dtype=np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        n, rays = batch.num_drones, (self.observation_space.shape[0] - 5) // 2
        self.goal = np.zeros((n, 3), np.float32)
        self.last_distance = np.zeros(n)
        self.action = np.zeros((n, 2), np.float32)
        self.last_ranges = np.zeros((n, rays), np.float32)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        rows = batch.rows
        level = np.tile(np.float32([1, 0, 0, 0]), (len(rows), 1))
        start, is_placed = self.middle(batch, rows), np.zeros(len(rows), bool)
        bodies = batch.bodies
        for drawn in self.positions(batch, rows, stream=0):
            apart = np.linalg.norm(bodies.position[rows] - drawn[:, None], axis=2)
            is_clear = ((apart >= CLEAR_OF_BODIES_M) | ~bodies.active[rows]).all(axis=1)
            takes = ~is_placed & is_clear & batch.is_free(drawn, rows=rows)
            start[takes] = drawn[takes]
            is_placed |= takes
        batch.set_pose(start, level, rows=rows)
        start = batch.position[rows]
        goal, is_placed = start.copy(), np.zeros(len(rows), bool)
        for drawn in self.positions(batch, rows, stream=1):
            distance = np.linalg.norm((drawn - start).astype(float), axis=1)
            is_farther = distance > np.linalg.norm((goal - start).astype(float), axis=1)
            takes = ~is_placed & is_farther & batch.is_free(drawn, rows=rows)
            goal[takes] = drawn[takes]
            is_placed |= takes & (distance >= self.config.goal_distance_m)
        self.goal[rows] = goal
        self.last_distance[rows] = self.distance(batch)[rows]
        self.action[rows] = 0

    def act(self, batch: flockstep.Batch, actions: Array) -> Target:
        self.last_ranges[self.flying] = self.ranges(batch)[self.flying]
        self.action[self.flying] = np.clip(actions, -1, 1)[self.flying]
        step = np.float32(self.config.step_m) * np.clip(actions.astype(np.float32), -1, 1)
        step = np.concatenate([step, np.zeros((batch.num_drones, 1), np.float32)], axis=1)
        return batch.position + rotate(batch.quat_wxyz, step)

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c = self.config
        crashed = batch.contact.hit
        distance = self.distance(batch)
        reached = ~crashed & (distance <= c.goal_radius_m)
        nearest = self.ranges(batch).min(axis=1).astype(float) * batch.lidar().max_range_m
        terms = {
            "progress": c.progress_weight * (self.last_distance - distance),
            "goal": c.goal_weight * reached,
            "crash": -c.crash_weight * crashed,
            "near": -c.near_weight * np.maximum(1 - nearest / c.near_m, 0),
            "time": np.full(batch.num_drones, -c.time_weight),
        }
        self.last_distance = np.where(self.flying, distance, self.last_distance)
        self.success[:] = reached
        return terms, crashed | reached

    def observe(self, batch: flockstep.Batch) -> Array:
        offset = (self.goal - batch.sensed_position).astype(float)
        distance = np.linalg.norm(offset, axis=1, keepdims=True)
        offset[:, 2] = 0
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        direction = np.divide(offset, length, out=np.zeros_like(offset), where=length > 0)
        direction = np.clip(rotate(batch.sensed_quat_wxyz.astype(float), direction, inverse=True), -1, 1)
        now = self.ranges(batch)
        before = np.where(self.steps[:, None] == 0, now, self.last_ranges)
        far = np.minimum(distance / FAR_GOAL_M, 1)
        return np.concatenate([direction[:, :2], far, self.action, now, before], axis=1)

    def middle(self, batch: flockstep.Batch, rows: Array) -> Array:
        """Return the start marker of each drone's world, or the centre of its bounds, (K, 3) m."""
        worlds = [batch.world_of(int(row)) for row in rows]
        middles = [world.bounds.mean(axis=0) if world.start is None else world.start for world in worlds]
        return np.array(middles, np.float32).reshape(-1, 3)

    def positions(self, batch: flockstep.Batch, rows: Array, stream: int) -> Array:
        """Return random positions in the bounds of each drone's world, at the height of `middle`, (TRIES, K, 3) m."""
        unit = batch.random(stream, 2 * TRIES, rows=rows).reshape(-1, TRIES, 2)
        bounds = np.array([batch.world_of(int(row)).bounds for row in rows], np.float32).reshape(-1, 2, 3)
        low, high = bounds[:, 0, None, :2], bounds[:, 1, None, :2]
        drawn = np.empty((len(rows), TRIES, 3), np.float32)
        drawn[..., :2] = low + unit * (high - low)
        drawn[..., 2] = self.middle(batch, rows)[:, None, 2]
        return drawn.swapaxes(0, 1)

    def distance(self, batch: flockstep.Batch) -> Array:
        """Return the distance of each drone to its goal, (N,) m."""
        distance: Array = np.linalg.norm(self.goal.astype(float) - batch.position, axis=1)
        return distance

    def ranges(self, batch: flockstep.Batch) -> Array:
        """Return the LiDAR ranges over the maximum range, (N, rays), 1 on a miss."""
        ranges = batch.lidar().ranges.reshape(batch.num_drones, -1)
        return np.minimum(ranges / batch.lidar().max_range_m[:, None], np.float32(1))


def main() -> None:
    """Fly the engine's task and this one side by side."""
    config = flockstep.DodgeConfig()
    ball = flockstep.BodyConfig(shape="sphere", size_m=[1, 1, 1], position_m=[7, 7, 1.4])
    balls = []
    for velocity in ([0.5, 0.3, 0], [-0.4, 0.1, 0], [0.2, -0.6, 0], [-0.1, 0.4, 0]):
        ball.motion = flockstep.BodyMotion(velocity_mps=velocity)
        balls.append(copy.copy(ball))
    lidar = flockstep.DroneVectorEnv(task=config).lidar
    assert lidar is not None
    fly_both(config, Dodge(config, lidar), 35, bodies=balls)


if __name__ == "__main__":
    main()
