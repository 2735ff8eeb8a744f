"""The engine's formation task written in NumPy: a template for tasks with a leader, and the engine's test oracle.

python examples/formation_numpy.py flies both side by side with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import rotate
from flockstep.task import Array, BoolArray, Target

TRIES = 64  # random positions to try
CORNERS = 6  # of a loop
FAR_PLACE_M = 2.0
WINDOW_M = 1.0  # of the route, before and after the leader
SAMPLES = 2000  # of the route, within the window


@dataclass
class Route:
    """A line through corners (K, 3), m; a closed one repeats its first corner at the end."""

    corners: Array
    is_closed: bool

    def __post_init__(self) -> None:
        lengths = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        self.ways = np.concatenate([[0], np.cumsum(lengths)])

    def line(self, way: Array) -> Array:
        """Return points of the line, after some ways along it."""
        way = way % self.ways[-1] if self.is_closed else way
        return np.stack([np.interp(way, self.ways, self.corners[:, axis]) for axis in range(3)], axis=-1)

    def position(self, way: float) -> Array:
        """Return the mean of the line over the window."""
        middles = (np.arange(SAMPLES) + 0.5) / SAMPLES
        mean: Array = self.line(way + WINDOW_M * (2 * middles - 1)).mean(axis=0)
        return mean

    def direction(self, way: float) -> Array:
        """Return the derivative of the position by the way."""
        ends = self.line(np.array([way - WINDOW_M, way + WINDOW_M]))
        return np.asarray((ends[1] - ends[0]) / (2 * WINDOW_M))

    def heading(self, way: float) -> float:
        """Return the heading of the leader, rad."""
        x, y, _ = self.direction(way)
        return float(np.arctan2(y, x))


class Formation(flockstep.Task):
    """Hold places relative to a moving leader; see `flockstep.FormationConfig` for the fields."""

    action_space = spaces.Box(-1, 1, (3,), np.float32)
    reward_terms = ("place", "crash", "near", "change")
    worlds = "arena/hall"
    meet = "both"
    max_episode_steps = 300

    def __init__(self, config: flockstep.FormationConfig, lidar: flockstep.LidarConfig) -> None:
        self.config = config
        self.lidar = lidar
        rays = lidar.shape[0] * lidar.shape[1]
        low = np.float32([*[-1] * 12, *[*[-1] * 6, 0] * config.neighbors, *[0] * rays])
        self.observation_space = spaces.Box(low, np.ones_like(low), dtype=np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        c, n = self.config, batch.num_drones
        self.per_env = batch.drones_per_env
        self.num_envs = n // self.per_env
        self.step_s = 1 / batch.clock.policy_hz
        self.places = flockstep.formation_places(c.shape, self.per_env, c.spacing_m).astype(float)
        self.corners = np.zeros((self.num_envs, CORNERS, 3))
        self._paths = [self.path(world, batch.drone) for world in batch.worlds] if c.route == "path" else []
        self.summed_error = np.zeros(n)
        self.action = np.zeros((n, 3), np.float32)
        self.change = np.zeros(n)
        self.position = np.zeros((n, 3), np.float32)
        self.velocity = np.zeros((n, 3), np.float32)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        c, rows = self.config, batch.rows
        for env in np.unique(rows // self.per_env):
            world = batch.world_of(int(env * self.per_env))
            centre = world.bounds.mean(axis=0).astype(float)
            centre[2] = centre[2] if world.start is None else world.start[2]
            drawn = batch.random(0, 2 + CORNERS, rows=np.array([env]), row_kind="env")[0].astype(float)
            angle = 2 * np.pi * (drawn[1] + (-1 if drawn[0] < 0.5 else 1) * np.arange(CORNERS) / CORNERS)
            corners = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            self.corners[env] = centre + c.loop_radius_m * (0.6 + 0.4 * drawn[2:, None]) * corners
        place, _, heading = self.leaders(batch, np.zeros(self.num_envs))
        place, heading = place[rows], heading[rows]
        zero = np.zeros(len(rows))
        quat = np.stack([np.cos(heading / 2), zero, zero, np.sin(heading / 2)], axis=1)
        unit = 2 * batch.random(1, 2 * TRIES, rows=rows, row_kind="drone").reshape(-1, TRIES, 2) - 1
        start = place.copy()
        for k in range(len(rows)):  # one after another, since drones that have their place count
            for attempt in range(TRIES):
                drawn = place[k] + [*(c.jitter_m + 0.05 * attempt) * unit[k, attempt], 0]
                if batch.is_free(drawn[None], quat[k : k + 1], rows=rows[k : k + 1])[0]:
                    start[k] = drawn
                    break
            batch.set_pose(start[k : k + 1], quat[k : k + 1], rows=rows[k : k + 1])
        self.summed_error[rows] = 0
        self.action[rows] = self.velocity[rows] = 0

    def act(self, batch: flockstep.Batch, actions: Array) -> Target:
        action = np.clip(actions.astype(np.float32), -1, 1)
        self.change = ((action - self.action).astype(float) ** 2).mean(axis=1)
        self.action[self.flying] = action[self.flying]
        self.position[:] = batch.position
        _, _, heading = self.leaders(batch, self.steps.reshape(-1, self.per_env)[:, 0])
        zero = np.zeros(batch.num_drones)
        quat = np.stack([np.cos(heading / 2), zero, zero, np.sin(heading / 2)], axis=1).astype(np.float32)
        return batch.position + rotate(batch.quat_wxyz, np.float32(self.config.step_m) * action), quat

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c = self.config
        self.velocity[self.flying] = ((batch.position - self.position) / self.step_s)[self.flying]
        crashed = batch.contact.hit
        steps = self.steps.reshape(-1, self.per_env)[:, 0]
        place, _, _ = self.leaders(batch, steps)
        error = np.linalg.norm(place.astype(np.float32).astype(float) - batch.position, axis=1)
        self.summed_error += np.where(self.flying, error, 0)
        lost = error > c.max_distance_m
        nearest = batch.terms.ranges().min(axis=1).astype(float) * batch.lidar().max_range_m
        terms = {
            "place": c.place_weight * np.exp(-error),
            "crash": -c.crash_weight * (crashed | lost),
            "near": -c.near_weight * np.maximum(1 - nearest / c.near_m, 0),
            "change": -c.change_weight * self.change,
        }
        touched = crashed.reshape(-1, self.per_env).any(axis=1).repeat(self.per_env)
        self.left_area[:] = lost
        self.success[:] = ~touched & ~lost & (self.summed_error / np.maximum(self.steps, 1) <= c.close_m)
        if c.route == "path":
            lengths = [self.route(batch, env).ways[-1] for env in range(self.num_envs)]
            arrived = c.leader_speed_mps * self.step_s * steps >= np.array(lengths)
            self.truncated[:] = arrived.repeat(self.per_env) & ~crashed & ~lost
        return terms, crashed | lost

    def observe(self, batch: flockstep.Batch) -> Array:
        c = self.config
        fastest = np.sqrt(3) * c.step_m / self.step_s
        place, velocity, _ = self.leaders(batch, self.steps.reshape(-1, self.per_env)[:, 0])
        offset = batch.terms.to_body(place)
        offset = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), FAR_PLACE_M)
        moving = np.clip(batch.terms.rotate_to_body(velocity) / fastest, -1, 1)
        own = np.clip(batch.terms.rotate_to_body(self.velocity) / fastest, -1, 1)
        near = batch.terms.neighbors(c.neighbors, self.velocity)
        unit = np.maximum(np.linalg.norm(near[..., :3], axis=2, keepdims=True), c.sight_m)
        blocks = [near[..., :3] / unit, np.clip(near[..., 3:6] / (2 * fastest), -1, 1), near[..., 6:]]
        others = np.concatenate(blocks, axis=2).reshape(batch.num_drones, -1)
        return np.concatenate([offset, moving, self.action, own, others, batch.terms.ranges()], axis=1)

    def leaders(self, batch: flockstep.Batch, steps: Array) -> tuple[Array, Array, Array]:
        """Return place (N, 3) and its velocity (N, 3) for each drone, and the heading of its leader (N,)."""
        c = self.config
        places, velocities, headings = [], [], []
        for env in range(self.num_envs):
            route = self.route(batch, env)
            way, speed = c.leader_speed_mps * self.step_s * steps[env], c.leader_speed_mps
            heading, ahead = route.heading(way), route.heading(way + speed * self.step_s)
            turning = np.remainder(ahead - heading + np.pi, 2 * np.pi) - np.pi
            turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
            from_leader = self.places @ turn.T
            places.append(route.position(way) + from_leader)
            sideways = np.stack([-from_leader[:, 1], from_leader[:, 0], np.zeros(self.per_env)], axis=1)
            velocities.append(speed * route.direction(way) + turning / self.step_s * sideways)
            headings.append(np.full(self.per_env, heading))
        return np.concatenate(places), np.concatenate(velocities), np.concatenate(headings)

    def route(self, batch: flockstep.Batch, env: int) -> Route:
        """Return the route of an env's leader."""
        if self.config.route == "path":
            return self._paths[int(batch.world_index[env])]
        return Route(np.concatenate([self.corners[env], self.corners[env, :1]]), True)

    @staticmethod
    def path(world: flockstep.World, drone: flockstep.DroneModel) -> Route:
        """Plan the path through a world."""
        assert world.start is not None
        assert world.goal is not None
        corners = flockstep.plan(world, world.start, [*world.waypoints, world.goal], drone=drone)
        assert corners is not None
        return Route(np.asarray(corners, float), False)


def main() -> None:
    """Fly the engine's task and this one side by side."""
    config = flockstep.FormationConfig()
    engine = flockstep.DroneVectorEnv(6, task=config, max_episode_steps=60)
    assert engine.lidar is not None
    twin = flockstep.DroneVectorEnv(6, task=Formation(config, engine.lidar), drones_per_env=4, max_episode_steps=60)
    observation, _ = engine.reset(seed=0)
    twin.reset(seed=0)
    random = np.random.default_rng(0)
    worst_observation = worst_reward = 0.0
    for _ in range(200):
        actions = 5 * observation[:, :3] + 0.5 * random.normal(size=(24, 3)).astype(np.float32)
        a, b = engine.step(actions), twin.step(actions)
        observation = a[0]
        worst_observation = max(worst_observation, float(np.abs(a[0] - b[0]).max()))
        worst_reward = max(worst_reward, float(np.abs(a[1] - b[1]).max()))
        assert (a[2] == b[2]).all()
        assert (a[3] == b[3]).all()
    print(f"4,800 steps, same flags: observations within {worst_observation:.1e}, rewards within {worst_reward:.1e}")


if __name__ == "__main__":
    main()
