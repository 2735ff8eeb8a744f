"""The navigation task of the engine written in NumPy: a template for tasks of your own, and the engine's test oracle.

python examples/navigation_numpy.py flies both side by side with the same actions and prints how far apart they are.
"""

# ruff: noqa: D102 - the methods are those of swiftlet.Task, documented there

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from gymnasium import spaces

import swiftlet
from swiftlet.task import Array, BoolArray, Target, rotate

DIRECTIONS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)


class Navigation(swiftlet.Task):
    """Fly from the start over the waypoints to the goal by LiDAR; see `swiftlet.NavigationConfig` for the fields.

    Random starts, random worlds and staggered time limits are left out.
    """

    def __init__(self, config: swiftlet.NavigationConfig, lidar: swiftlet.LidarConfig) -> None:
        self.config = config
        self.lidar = lidar
        self.max_episode_steps = config.max_episode_steps
        rays = lidar.shape[0] * lidar.shape[1]
        low = np.repeat([-1.0, 0.0], [3, rays]).astype(np.float32)
        self.observation_space = spaces.Box(low, np.ones_like(low), dtype=np.float32)
        size = {"displacement": 3, "displacement_yaw": 4}
        discrete = config.action == "discrete"
        self.action_space = spaces.Discrete(6) if discrete else spaces.Box(-1, 1, (size[config.action],), np.float32)

    def setup(self, batch: swiftlet.Batch) -> None:
        n, worlds = batch.num_drones, batch.worlds
        self.goals = np.zeros((len(worlds), max(len(w.waypoints) for w in worlds) + 1, 3))
        for row, world in zip(self.goals, worlds, strict=True):
            row[: len(world.waypoints) + 1] = [*world.waypoints, world.goal]
        self.num_waypoints = np.array([len(w.waypoints) for w in worlds])
        self.goal_index = np.zeros(n, int)  # waypoints reached
        self.last_distance = np.zeros(n)  # m to the current goal
        self.last_action = np.full((n, *(self.action_space.shape or ())), np.nan)  # NaN: any action is a change
        self.action = self.last_action
        self.reward_terms = np.zeros((n, 6))

    def reset(self, batch: swiftlet.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        self.goal_index[mask] = 0
        self.last_action[mask] = np.nan
        self.last_distance[mask] = self.distance(batch)[mask]

    def act(self, batch: swiftlet.Batch, actions: Array) -> Target:
        self.action = actions.astype(float)
        quat = batch.quat_wxyz
        if self.config.action == "discrete":
            displacement = DIRECTIONS[actions]
        else:
            clipped = np.clip(actions.astype(np.float32), -1, 1)
            displacement = clipped[:, :3]
        if self.config.action == "displacement_yaw":
            half = np.radians(clipped[:, 3] * self.config.yaw_step_deg) / 2
            w, z = np.cos(half), np.sin(half)
            qw, qx, qy, qz = quat.T
            quat = np.stack([qw * w - qz * z, qx * w + qy * z, qy * w - qx * z, qz * w + qw * z], axis=1)
            quat = quat / np.linalg.norm(quat, axis=1, keepdims=True)
        return batch.position + rotate(batch.quat_wxyz, np.float32(self.config.step_m) * displacement), quat

    def step(self, batch: swiftlet.Batch) -> tuple[Array, BoolArray]:
        r = self.config.reward
        crashed = batch.contact.hit
        distance = self.distance(batch)
        reached = self.flying & (distance <= r.goal_radius_m)
        waypoints = self.num_waypoints[batch.world_index]
        at_goal = reached & (self.goal_index == waypoints)
        at_waypoint = reached & ~at_goal

        closer_cm = 100 * (self.last_distance - distance)
        waypoint_reward = r.goal_reward * r.waypoint_share / np.maximum(waypoints, 1)
        distance_term = np.where(at_goal, r.goal_reward, np.where(at_waypoint, waypoint_reward, closer_cm))
        goal_x = self.goal(batch)[:, 0]
        self.goal_index += at_waypoint
        self.last_distance = distance if r.thesis_switch else self.distance(batch)

        ranges = self.ranges(batch)
        nearest = ranges.min(axis=1)
        too_near = np.where(nearest < r.min_clearance, nearest - r.min_clearance, 0)
        crash_term = np.where(crashed, -r.goal_reward, too_near)
        count = ranges.shape[1]
        free_space_term = (ranges / r.min_clearance - 1).sum(axis=1) / (count / r.min_clearance - count)
        step_term = -(self.steps - 1) / r.step_scale
        changed = self.action != self.last_action
        change_term = -np.where(changed.any(axis=1) if changed.ndim > 1 else changed, 1.0, 0.0)
        self.last_action = np.where(self.flying.reshape(-1, *[1] * (changed.ndim - 1)), self.action, self.last_action)
        outran = (r.outrun_weight != 0) & (batch.position[:, 0] > goal_x + r.goal_radius_m)
        outrun_term = np.where(outran, -r.goal_reward / 10, 0)

        terms = [distance_term, crash_term, free_space_term, step_term, change_term, outrun_term]
        weights = [r.distance_weight, r.crash_weight, r.free_space_weight, r.step_weight]
        weights += [r.action_change_weight, r.outrun_weight]
        self.reward_terms = np.stack(terms, axis=1) * weights
        self.success[:] = at_goal & ~crashed
        return self.reward_terms.sum(axis=1), crashed | at_goal | outran

    def observe(self, batch: swiftlet.Batch) -> Array:
        offset = self.goal(batch) - batch.sensed_position
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        direction = np.divide(offset, length, out=np.zeros_like(offset), where=length > 0)
        direction = rotate(batch.sensed_quat_wxyz.astype(float), direction, inverse=True)
        return np.concatenate([np.clip(direction, -1, 1), self.ranges(batch)], axis=1)

    def goal(self, batch: swiftlet.Batch) -> Array:
        """Return the current goal of each drone, (N, 3) m."""
        return self.goals[batch.world_index, self.goal_index]

    def distance(self, batch: swiftlet.Batch) -> Array:
        """Return the distance of each drone to its current goal, (N,) m."""
        distance: Array = np.linalg.norm(self.goal(batch) - batch.position, axis=1)
        return distance

    def ranges(self, batch: swiftlet.Batch) -> Array:
        """Return the LiDAR ranges over the maximum range, (N, beams), 1 on a miss."""
        ranges = batch.lidar_ranges.reshape(batch.num_drones, -1).astype(float)
        return np.minimum(ranges / batch.lidar_max_range_m[:, None], 1)

    def state(self) -> dict[str, Array]:
        names = ("goal_index", "last_distance", "last_action")
        return {name: getattr(self, name) for name in names}

    def load(self, state: Mapping[str, Array]) -> None:
        for name, value in state.items():
            setattr(self, name, value)


def main() -> None:
    """Fly the engine's task and this one with the same random actions."""
    config, lidar = swiftlet.NavigationConfig(), swiftlet.LidarConfig()
    engine = swiftlet.DroneVectorEnv(35, worlds="train", lidar=lidar)
    twin = swiftlet.DroneVectorEnv(35, worlds="train", task=Navigation(config, lidar))
    engine.reset(seed=0)
    twin.reset(seed=0)
    engine.action_space.seed(0)
    worst_observation = worst_reward = 0.0
    for _ in range(2000):
        actions = engine.action_space.sample()
        a, b = engine.step(actions), twin.step(actions)
        worst_observation = max(worst_observation, float(np.abs(a[0] - b[0]).max()))
        worst_reward = max(worst_reward, float(np.abs(a[1] - b[1]).max()))
        assert (a[2] == b[2]).all()
        assert (a[3] == b[3]).all()
    print(f"70,000 steps, flags the same: observations within {worst_observation:.1e}, rewards {worst_reward:.1e}")


if __name__ == "__main__":
    main()
