"""The engine's swap task written in NumPy: a template for tasks of several drones, and the engine's test oracle.

python examples/swap_numpy.py flies both side by side with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import rotate
from flockstep.task import Array, BoolArray, Target
from hover_numpy import fly_both

FAR_GOAL_M = 10.0


class Swap(flockstep.Task):
    """Exchange places with the other drones of the env; see `flockstep.SwapConfig` for the fields."""

    action_space = spaces.Box(-1, 1, (2,), np.float32)
    reward_terms = ("progress", "goal", "crash", "near", "time")
    worlds = "arena/hall"
    interaction = "collide"
    max_episode_steps = 300

    def __init__(self, config: flockstep.SwapConfig) -> None:
        self.config = config
        low = [-1, -1, 0, -1, -1, -1, -1, *[-1, -1, -1, -1, 0] * config.neighbors]
        self.observation_space = spaces.Box(np.float32(low), np.ones(len(low), np.float32), dtype=np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        n, self.per_env = batch.num_drones, batch.drones_per_env
        self.step_s = 1 / batch.clock.policy_hz
        self.goal = np.zeros((n, 3), np.float32)
        self.last_distance = np.zeros(n)
        self.action = np.zeros((n, 2), np.float32)
        self.position = np.zeros((n, 3), np.float32)
        self.velocity = np.zeros((n, 3), np.float32)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        c, rows = self.config, batch.rows
        env, member = np.divmod(rows, self.per_env)
        worlds = [batch.world_of(int(row)) for row in rows]
        centre = np.array([world.bounds.mean(axis=0) for world in worlds], np.float32).reshape(-1, 3)
        for k, world in enumerate(worlds):
            centre[k, 2] = centre[k, 2] if world.start is None else world.start[2]
        radius = max(c.radius_m, self.per_env * c.spacing_m / (2 * np.pi))
        turn = batch.random(0, 1)[env, 0]
        other = member + (0.5 if self.per_env == 1 else self.per_env // 2)

        def places(numbers: Array) -> Array:
            angle = 2 * np.pi * (turn + numbers / self.per_env)
            return centre + radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(rows))], axis=1)

        start, goal = places(member), places(other)
        start[:, :2] += c.jitter_m * (2 * batch.random(1, 2, rows=rows, row_kind="drone") - 1)
        way = goal - start
        half = np.arctan2(way[:, 1], way[:, 0]) / 2
        zero = np.zeros(len(rows))
        batch.set_pose(start, np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1), rows=rows)
        self.goal[rows] = goal
        self.last_distance[rows] = self.distance(batch)[rows]
        self.action[rows] = self.velocity[rows] = 0

    def act(self, batch: flockstep.Batch, actions: Array) -> Target:
        self.action[self.flying] = np.clip(actions, -1, 1)[self.flying]
        self.position[:] = batch.position
        step = np.float32(self.config.step_m) * np.clip(actions.astype(np.float32), -1, 1)
        step = np.concatenate([step, np.zeros((batch.num_drones, 1), np.float32)], axis=1)
        return batch.position + rotate(batch.quat_wxyz, step)

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c = self.config
        self.velocity[self.flying] = ((batch.position - self.position) / self.step_s)[self.flying]
        crashed = batch.contact.hit
        distance = self.distance(batch)
        there = distance <= c.goal_radius_m
        success = (there & ~crashed).reshape(-1, self.per_env).all(axis=1).repeat(self.per_env)
        nearest = np.full(batch.num_drones, np.inf)
        if self.per_env > 1:
            places = batch.position.astype(float).reshape(-1, self.per_env, 3)
            apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=3)
            apart[:, np.arange(self.per_env), np.arange(self.per_env)] = np.inf
            nearest = apart.min(axis=2).ravel()
        terms = {
            "progress": c.progress_weight * (self.last_distance - distance),
            "goal": c.goal_weight * success,
            "crash": -c.crash_weight * crashed,
            "near": -c.near_weight * np.maximum(1 - nearest / c.near_m, 0),
            "time": -c.time_weight * ~there,
        }
        self.last_distance = np.where(self.flying, distance, self.last_distance)
        self.success[:] = success
        return terms, crashed | success

    def observe(self, batch: flockstep.Batch) -> Array:
        c = self.config
        fastest = np.sqrt(2) * c.step_m / self.step_s
        offset = (self.goal - batch.sensed_position).astype(float)
        distance = np.linalg.norm(offset, axis=1, keepdims=True)
        offset[:, 2] = 0
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        direction = np.divide(offset, length, out=np.zeros_like(offset), where=length > 0)
        direction = np.clip(batch.terms.rotate_to_body(direction), -1, 1)[:, :2]
        own = np.clip(batch.terms.rotate_to_body(self.velocity)[:, :2] / fastest, -1, 1)
        near = batch.terms.neighbors(c.neighbors, self.velocity)
        unit = np.maximum(np.linalg.norm(near[..., :3], axis=2, keepdims=True), c.sight_m)
        blocks = [near[..., :2] / unit, np.clip(near[..., 3:5] / (2 * fastest), -1, 1), near[..., 6:]]
        others = np.concatenate(blocks, axis=2).reshape(batch.num_drones, -1)
        far = np.minimum(distance / FAR_GOAL_M, 1)
        return np.concatenate([direction, far, self.action, own, others], axis=1)

    def distance(self, batch: flockstep.Batch) -> Array:
        """Return the distance of each drone to its goal, (N,) m."""
        distance: Array = np.linalg.norm(self.goal.astype(float) - batch.position, axis=1)
        return distance


def main() -> None:
    """Fly the engine's task and this one side by side."""
    config, random = flockstep.SwapConfig(radius_m=2.0), np.random.default_rng(0)

    def actions_of(observation: Array) -> Array:  # towards the goal, and to the right of it
        noise = random.normal(size=(len(observation), 2)).astype(np.float32)
        return observation[:, :2] + np.float32([0.0, -0.5]) + 0.5 * noise

    fly_both(config, Swap(config), 10, actions_of, drones_per_env=5)


if __name__ == "__main__":
    main()
