"""The engine's navigation tasks written in NumPy: a template for your own tasks, and the engine's test oracle.

python examples/navigation_numpy.py flies both side by side with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import rotate
from flockstep.task import Array, BoolArray, Target

DIRECTIONS = {
    "discrete": np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32),
    "discrete_forward": np.array([[1, 0, 0], [0, 1, 0], [0, -1, 0]], np.float32),
}


class Navigation(flockstep.Task):
    """Fly from the start through the waypoints to the goal; see `flockstep.NavigationConfig` for the fields.

    Random starts and the pixel observation are left out.
    """

    reward_terms = ("distance", "crash", "free_space", "step", "action_change", "overshoot")
    max_episode_steps = 3000

    def __init__(
        self,
        config: flockstep.NavigationConfig,
        lidar: flockstep.LidarConfig,
        cameras: Sequence[flockstep.CameraConfig] = (),
    ) -> None:
        self.config = config
        self.lidar = lidar
        self.camera = cameras
        rays = lidar.shape[0] * lidar.shape[1]
        head = [-1.0, 0.0] if config.observation == "blob" else [-1.0, -1.0, -1.0]
        low = np.concatenate([head, np.zeros(rays)]).astype(np.float32)
        self.observation_space = spaces.Box(low, np.ones_like(low), dtype=np.float32)
        self.discrete = config.action in DIRECTIONS
        if self.discrete:
            self.action_space = spaces.Discrete(len(DIRECTIONS[config.action]))
        else:
            self.action_space = spaces.Box(-1, 1, (3 if config.action == "displacement" else 4,), np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        n, worlds = batch.num_drones, batch.worlds
        self.goals = np.zeros((len(worlds), max(len(w.waypoints) for w in worlds) + 1, 3))
        for row, world in zip(self.goals, worlds, strict=True):
            row[: len(world.waypoints) + 1] = [*world.waypoints, world.goal]
        self.num_waypoints = np.array([len(w.waypoints) for w in worlds])
        self.goal_index = np.zeros(n, int)  # number of waypoints reached
        self.last_distance = np.zeros(n)  # m to the current goal
        self.last_action = np.full((n, *(self.action_space.shape or ())), np.nan)  # NaN: every action is a change
        self.action = self.last_action

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        self.goal_index[mask] = 0
        self.last_action[mask] = np.nan
        self.last_distance[mask] = self.distance(batch)[mask]

    def act(self, batch: flockstep.Batch, actions: Array) -> Target:
        self.action = actions.astype(float)
        quat = batch.quat_wxyz
        if self.discrete:
            displacement = DIRECTIONS[self.config.action][actions]
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

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
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
        self.last_distance = distance if r.carry_over_distance else self.distance(batch)

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
        overshot = (r.overshoot_weight != 0) & (batch.position[:, 0] > goal_x + r.goal_radius_m)
        overshoot_term = np.where(overshot, -r.goal_reward / 10, 0)

        self.success[:] = at_goal & ~crashed
        self.left_area[:] = overshot
        terms = {
            "distance": r.distance_weight * distance_term,
            "crash": r.crash_weight * crash_term,
            "free_space": r.free_space_weight * free_space_term,
            "step": r.step_weight * step_term,
            "action_change": r.action_change_weight * change_term,
            "overshoot": r.overshoot_weight * overshoot_term,
        }
        return terms, crashed | at_goal | overshot

    def observe(self, batch: flockstep.Batch) -> Array:
        head = self.blob(batch) if self.config.observation == "blob" else self.direction(batch)
        return np.concatenate([head, self.ranges(batch)], axis=1)

    def direction(self, batch: flockstep.Batch) -> Array:
        """Return the direction to the current goal in the sensed body frame, (N, 3); its norm `goal_norm` is 1."""
        offset = self.goal(batch) - batch.sensed_position
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        direction = np.divide(offset, length, out=np.zeros_like(offset), where=length > 0)
        direction = rotate(batch.sensed_quat_wxyz.astype(float), direction, inverse=True)
        if self.config.goal_norm == "maximum":
            largest = np.abs(direction).max(axis=1, keepdims=True)
            direction = np.divide(direction, largest, out=direction, where=largest > 0)
        return np.clip(direction, -1, 1)

    def blob(self, batch: flockstep.Batch) -> Array:
        """Return offset and area of the box around the green pixels of each image, (N, 2)."""
        rgb = batch.camera().rgb.astype(int)
        if batch.camera().config.layout == "chw":
            rgb = rgb.transpose(0, 2, 3, 1)
        red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
        mask = 4 * green > 5 * np.maximum(red, blue) + 64
        blobs = np.zeros((batch.num_drones, 2))
        for blob, seen in zip(blobs, mask, strict=True):
            rows, columns = np.nonzero(seen)
            if len(rows) > 0:
                height, width = seen.shape
                left, right = columns.min(), columns.max() + 1
                blob[0] = ((left + right) / 2 - width / 2) / (width / 2)
                blob[1] = (right - left) * (rows.max() + 1 - rows.min()) / (width * height)
        return blobs

    def goal(self, batch: flockstep.Batch) -> Array:
        """Return the current goal of each drone, (N, 3) m."""
        goal: Array = self.goals[batch.world_index, self.goal_index]
        return goal

    def distance(self, batch: flockstep.Batch) -> Array:
        """Return the distance of each drone to its current goal, (N,) m."""
        distance: Array = np.linalg.norm(self.goal(batch) - batch.position, axis=1)
        return distance

    def ranges(self, batch: flockstep.Batch) -> Array:
        """Return the LiDAR ranges over the maximum range, (N, beams), 1 on a miss."""
        ranges = batch.lidar().ranges.reshape(batch.num_drones, -1).astype(float)
        return np.minimum(ranges / batch.lidar().max_range_m[:, None], 1)

    def state(self) -> dict[str, Array]:
        names = ("goal_index", "last_distance", "last_action")
        return {name: getattr(self, name) for name in names}

    def load(self, state: Mapping[str, Array]) -> None:
        for name, value in state.items():
            setattr(self, name, value)


def main(steps: int = 2000) -> None:
    """Fly the engine's tasks and these with the same random actions."""
    camera_reward = flockstep.NavigationReward(overshoot_weight=1.0)
    for config in (
        flockstep.NavigationConfig(),
        flockstep.NavigationConfig(observation="blob", action="discrete_forward", reward=camera_reward),
    ):
        engine = flockstep.DroneVectorEnv(35, observation=config.observation)
        assert engine.lidar is not None
        twin_task = Navigation(config, engine.lidar, engine.cameras)
        twin = flockstep.DroneVectorEnv(35, worlds=engine.batch.worlds, task=twin_task)
        engine.reset(seed=0)
        twin.reset(seed=0)
        engine.action_space.seed(0)
        worst_observation = worst_reward = 0.0
        for _ in range(steps):
            actions = engine.action_space.sample()
            a, b = engine.step(actions), twin.step(actions)
            worst_observation = max(worst_observation, float(np.abs(a[0] - b[0]).max()))
            worst_reward = max(worst_reward, float(np.abs(a[1] - b[1]).max()))
            assert (a[2] == b[2]).all()
            assert (a[3] == b[3]).all()
        print(
            f"{config.observation}: {35 * steps:,} steps, flags the same: observations within {worst_observation:.1e}, "
            f"rewards {worst_reward:.1e}"
        )


if __name__ == "__main__":
    main()
