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
from hover_numpy import fly_both

TRIES = 64  # random positions to try
CORNERS = 6  # of a loop
FAR_PLACE_M = 2.0
LOOP_WINDOW_M = 1.0
SAMPLES = 2000  # of the route, within the window
ROOM_M = 0.2  # to be free around the drone
PATH_WINDOW_M = 2 * ROOM_M
PATH_CELL_M = 0.2
SHARE_STEP_M = 0.1
SMOOTH_STEPS = 10  # before and after one, over which the shares are smoothed
CLOSEST = 0.7  # least distance of places, in units of their spacing
FASTEST = 1.0  # of a place that turns or narrows, in units of the leader's speed


class Places:
    """Places of a shape relative to the leader, (M, 3) m, and of a column along the route, (M,) m."""

    def __init__(self, config: flockstep.FormationConfig, count: int) -> None:
        self.spacing = config.spacing_m
        self.is_column = config.shape == "column"
        self.shape = flockstep.formation_places(config.shape, count, config.spacing_m).astype(float)
        in_a_row = flockstep.formation_places("column", count, config.spacing_m).astype(float)[:, 0]
        self.column = np.empty(count)
        self.column[np.argsort(-self.shape[:, 0], kind="stable")] = in_a_row
        self.column += self.shape[:, 0].mean() - in_a_row.mean()
        self.radius = 0.0 if self.is_column else float(np.linalg.norm(self.shape, axis=1).max())


@dataclass
class Route:
    """A line through corners (K, 3), m; a closed one repeats its first corner at the end.

    The leader's position is the mean of the line over a window before and after it. Its heading leads from the position
    the reach before to that after it.
    """

    corners: Array
    is_closed: bool
    window: float
    reach: float

    def __post_init__(self) -> None:
        lengths = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        self.ways = np.concatenate([[0], np.cumsum(lengths)])
        if self.is_closed:
            self.reach = min(self.reach, self.ways[-1] / 4)

    def position(self, way: Array) -> Array:
        """Return positions after ways along the line."""
        way = np.asarray(way)[..., None] + self.window * (2 * (np.arange(SAMPLES) + 0.5) / SAMPLES - 1)
        way = way % self.ways[-1] if self.is_closed else way
        axes = [np.interp(way, self.ways, self.corners[:, axis]).mean(axis=-1) for axis in range(3)]
        return np.stack(axes, axis=-1)

    def heading(self, way: Array) -> Array:
        """Return headings of the leader, rad."""
        along = self.position(np.asarray(way) + self.reach) - self.position(np.asarray(way) - self.reach)
        return np.asarray(np.arctan2(along[..., 1], along[..., 0]))

    def share(self, _: float) -> float:
        """Return the share of the shape, in [0, 1]."""
        return 1.0

    def in_shape(self, places: Places, way: Array) -> Array:
        """Return the places of the shape, (..., M, 3)."""
        heading = self.heading(way)[..., None]
        x, y, z = places.shape.T
        turned = [np.cos(heading) * x - np.sin(heading) * y, np.sin(heading) * x + np.cos(heading) * y, z + 0 * heading]
        return self.position(way)[..., None, :] + np.stack(turned, axis=-1)

    def in_column(self, places: Places, way: Array) -> Array:
        """Return the places of the column, (..., M, 3)."""
        return self.position(np.asarray(way)[..., None] + places.column)

    def places(self, places: Places, way: float) -> Array:
        """Return the places of the drones, (M, 3)."""
        share = 0.0 if places.is_column else self.share(way)
        shape, column = self.in_shape(places, np.array(way)), self.in_column(places, np.array(way))
        return column + share * (shape - column)


class PathRoute(Route):
    """The planned path through a world, and the share of the shape that has room along it."""

    def __init__(self, world: flockstep.World, drone: flockstep.DroneModel, places: Places) -> None:
        assert world.start is not None
        assert world.goal is not None
        goals = [*world.waypoints, world.goal]
        wide = with_room(drone)
        corners = flockstep.plan(world, world.start, goals, drone=wide, cell_m=PATH_CELL_M)
        assert corners is not None
        super().__init__(np.asarray(corners, float), False, PATH_WINDOW_M, max(places.radius, PATH_WINDOW_M))
        self.first = PATH_WINDOW_M + max(-places.column.min(), 0.0)
        self.last = self.ways[-1] - PATH_WINDOW_M - max(places.column.max(), 0.0)
        count = int(np.ceil((self.last - self.first) / SHARE_STEP_M)) + 1
        self.sampled = self.first + SHARE_STEP_M * np.arange(count)
        shape, column = self.in_shape(places, self.sampled), self.in_column(places, self.sampled)
        flights = flockstep.Batch([world], count * len(places.column), drone=wide)
        flights.set_pose(column.reshape(-1, 3))
        flights.move(shape.reshape(-1, 3))
        free = flights.contact.fraction.reshape(count, -1).min(axis=1).astype(float)
        heading = self.heading(self.sampled + SHARE_STEP_M) - self.heading(self.sampled)
        turning = np.abs(np.remainder(heading + np.pi, 2 * np.pi) - np.pi) / SHARE_STEP_M
        apart = share_apart(column, shape, CLOSEST * places.spacing)
        shares = np.minimum(np.minimum(free, apart), FASTEST / np.maximum(places.radius * turning, FASTEST))
        straight = np.linalg.norm(places.shape - places.column[:, None] * [1, 0, 0], axis=1).max()
        steps = np.abs(np.arange(count)[:, None] - np.arange(count))
        around = steps <= SMOOTH_STEPS
        change = FASTEST * SHARE_STEP_M / max(straight, SHARE_STEP_M)
        shares = (shares + change * np.maximum(steps - SMOOTH_STEPS, 0)).min(axis=1)
        self.shares = (around * shares).sum(axis=1) / around.sum(axis=1)

    def share(self, way: float) -> float:
        return float(np.interp(way, self.sampled, self.shares))


def with_room(drone: flockstep.DroneModel) -> flockstep.DroneModel:
    """Return an upright prism around the drone at any heading, and the room around it."""
    hull = drone.hull.astype(float)
    angle = 2 * np.pi * np.arange(16) / 16
    radius = (np.linalg.norm(hull[:, :2], axis=1).max() + ROOM_M) / np.cos(np.pi / 16)
    heights = hull[:, 2].min() - ROOM_M, hull[:, 2].max() + ROOM_M
    return flockstep.DroneModel([[radius * np.cos(a), radius * np.sin(a), z] for a in angle for z in heights])


def share_apart(column: Array, shape: Array, distance: float) -> Array:
    """Return the largest share of each row up to which all places keep this distance, (K,)."""
    share = np.ones(len(column))
    for j in range(column.shape[1]):
        for i in range(j):
            start, end = column[:, j] - column[:, i], shape[:, j] - shape[:, i]
            a, b = ((end - start) ** 2).sum(axis=1), (start * (end - start)).sum(axis=1)
            c = (start**2).sum(axis=1) - distance**2
            root = b**2 - a * c
            with np.errstate(invalid="ignore", divide="ignore"):
                meets = np.where((b < 0) & (root > 0), (-b - np.sqrt(root)) / a, 1.0)
            share = np.minimum(share, np.where(c <= 0, 0.0, meets))
    return share


class Formation(flockstep.Task):
    """Hold places relative to a moving leader; see `flockstep.FormationConfig` for the fields."""

    action_space = spaces.Box(-1, 1, (3,), np.float32)
    reward_terms = ("place", "crash", "near", "change")
    worlds = "arena/hall"
    interaction = "both"
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
        self.places = Places(c, self.per_env)
        self.corners = np.zeros((self.num_envs, CORNERS, 3))
        paths = c.route == "path"
        self._paths = [PathRoute(world, batch.drone, self.places) for world in batch.worlds] if paths else []
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
            last = [self._paths[int(batch.world_index[env])].last for env in range(self.num_envs)]
            arrived = np.array([self.way(batch, env, steps[env]) for env in range(self.num_envs)]) >= np.array(last)
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
        places, velocities, headings = [], [], []
        for env in range(self.num_envs):
            route = self.route(batch, env)
            now, later = (self.way(batch, env, steps[env] + more) for more in (0, 1))
            places.append(route.places(self.places, now))
            velocities.append((route.places(self.places, later) - places[-1]) / self.step_s)
            headings.append(np.full(self.per_env, route.heading(np.array(now))))
        return np.concatenate(places), np.concatenate(velocities), np.concatenate(headings)

    def way(self, batch: flockstep.Batch, env: int, steps: float) -> float:
        """Return the way of an env's leader along its route, m."""
        first = self._paths[int(batch.world_index[env])].first if self._paths else 0.0
        return float(first + self.config.leader_speed_mps * self.step_s * steps)

    def route(self, batch: flockstep.Batch, env: int) -> Route:
        """Return the route of an env's leader."""
        if self._paths:
            return self._paths[int(batch.world_index[env])]
        corners = np.concatenate([self.corners[env], self.corners[env, :1]])
        return Route(corners, True, LOOP_WINDOW_M, max(self.places.radius, LOOP_WINDOW_M))


def main() -> None:
    """Fly the engine's task and this one side by side."""
    config, random = flockstep.FormationConfig(), np.random.default_rng(0)
    lidar = flockstep.DroneVectorEnv(task=config).lidar
    assert lidar is not None

    def actions_of(observation: Array) -> Array:
        return 5 * observation[:, :3] + 0.5 * random.normal(size=(len(observation), 3)).astype(np.float32)

    fly_both(config, Formation(config, lidar), 6, actions_of, drones_per_env=4, max_episode_steps=60)


if __name__ == "__main__":
    main()
