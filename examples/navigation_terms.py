"""The LiDAR navigation task as a Python task built from the engine's terms: nearly as fast as the built-in one.

examples/navigation_numpy.py computes the same in pure NumPy, and also other actions, observations and rewards.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.task import Array, BoolArray, Target

GOAL_REWARD, GOAL_RADIUS_M = 10_000.0, 0.5
WAYPOINT_SHARE, MIN_CLEARANCE = float(np.float32(0.1)), float(np.float32(0.2))  # float32 values, as in the engine
STEPS_M = 0.1 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)


class Navigation(flockstep.Task):
    """Fly from the start through the waypoints to the goal without contact."""

    lidar = flockstep.LidarConfig()
    action_space = spaces.Discrete(6)
    reward_terms = ("distance", "crash", "free_space", "step", "action_change")
    max_episode_steps = 3000

    def __init__(self) -> None:
        rays = self.lidar.beams
        low = np.concatenate([[-1, -1, -1], np.zeros(rays)]).astype(np.float32)
        self.observation_space = spaces.Box(low, np.ones_like(low), dtype=np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        self.waypoints = np.array([len(world.waypoints) for world in batch.worlds], np.int32)
        self.goal_index = np.zeros(batch.num_drones, np.int32)
        self.last_distance = np.zeros(batch.num_drones)
        self.observation = np.zeros((batch.num_drones, *self.observation_space.shape), np.float32)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        self.goal_index[mask] = 0
        self.last_distance[mask] = batch.terms.goal_distance(self.goal_index)[mask]

    def act(self, batch: flockstep.Batch, actions: Array) -> Target:
        return batch.terms.displaced(STEPS_M[actions])

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        crashed, terms = batch.contact.hit, batch.terms
        distance = terms.goal_distance(self.goal_index)
        reached = self.flying & (distance <= GOAL_RADIUS_M)
        distance_term = 100 * (self.last_distance - distance)
        self.last_distance = distance
        at_goal = reached
        if reached.any():
            waypoints = self.waypoints[batch.world_index]
            at_goal = reached & (self.goal_index == waypoints)
            at_waypoint = reached & ~at_goal
            distance_term[at_waypoint] = GOAL_REWARD * WAYPOINT_SHARE / waypoints[at_waypoint]
            distance_term[at_goal] = GOAL_REWARD
            self.goal_index += at_waypoint
            self.last_distance = terms.goal_distance(self.goal_index)
        self.success[:] = at_goal & ~crashed
        too_near = np.minimum(terms.clearance() - MIN_CLEARANCE, 0)
        return {
            "distance": distance_term,
            "crash": np.where(crashed, -GOAL_REWARD, too_near),
            "free_space": terms.free_space(MIN_CLEARANCE),
            "step": (1 - self.steps) / 3000,
            "action_change": np.negative(terms.action_changed, dtype=float),
        }, crashed | at_goal

    def observe(self, batch: flockstep.Batch) -> Array:
        self.observation[:, :3] = batch.terms.goal_direction(self.goal_index)
        self.observation[:, 3:] = batch.terms.ranges()
        return self.observation
