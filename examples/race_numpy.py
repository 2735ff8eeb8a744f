"""The engine's race task written in NumPy: a template for your own races, and the engine's test oracle.

The shared parts are in hover_numpy.py. python examples/race_numpy.py flies the engine's task and this one side by side
with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.rotations import quat_from_rpy, rotate
from flockstep.task import Array, BoolArray
from hover_numpy import GRAVITY, FlightTask, fly_both

NONE, CLEAN, UNCLEAN = 0, 1, 2  # how the last episode of a drone ended


class Race(FlightTask):
    """Fly through the gates of a track; see `flockstep.RaceConfig` for the fields.

    The engine also redraws a start that would touch something; this task does not. Set its `max_episode_steps` to the
    limit of the env, because an episode that reaches it may be clean.
    """

    reward_terms = ("progress", "gate", "rates", "change", "crash")
    max_episode_steps = 500
    worlds = "race/figure-8"
    drone = "racer5"
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates", max_rate_dps=460, max_yaw_rate_dps=230)
    clock = flockstep.ClockConfig(policy_hz=50)
    records_path = True

    def __init__(self, config: flockstep.RaceConfig) -> None:
        self.config = config
        self.observation_space = spaces.Box(-np.inf, np.inf, (13 + 6 * config.gates_ahead,), np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        super().setup(batch)
        self.levels[2, 0] = min(self.levels[2, 0], self.config.max_thrust_to_weight * GRAVITY)
        self.num_gates = np.array([len(world.gates) for world in batch.worlds])
        shape = len(batch.worlds), self.num_gates.max()
        self.centers, self.quats = np.zeros((*shape, 3)), np.zeros((*shape, 4))
        self.halves, self.is_ring = np.zeros(shape), np.zeros(shape, bool)
        for i, world in enumerate(batch.worlds):
            for k, gate in enumerate(world.gates):
                self.centers[i, k], self.quats[i, k] = gate["center"], gate["quat_wxyz"]
                self.halves[i, k], self.is_ring[i, k] = gate["size_m"] / 2, gate["shape"] == "ring"
        self.normals = rotate(self.quats, np.array([1.0, 0, 0]))
        n = batch.num_drones
        self.target, self.passed = np.zeros((2, n), int)
        self.distance = np.zeros(n)  # m, to the next gate
        self.speed_cap = np.full(n, float(self.config.speed_cap_mps[0]))
        self.clean = np.zeros((n, self.config.cap_episodes), bool)  # the last episodes, the latest first
        self.outcome = np.zeros(n, int)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        ended = mask & (self.outcome != NONE)
        self.clean[ended] = np.concatenate([self.outcome[ended, None] == CLEAN, self.clean[ended, :-1]], axis=1)
        rises = ended & (self.clean.mean(axis=1, dtype=np.float32) >= np.float32(self.config.cap_success))
        raised = self.speed_cap[rises] + self.config.cap_rise_mps
        self.speed_cap[rises] = np.minimum(raised, self.config.speed_cap_mps[1])
        self.outcome[mask] = NONE
        self.passed[mask] = 0
        world, count = batch.world_index, self.num_gates[batch.world_index]
        chosen = (batch.random(stream=1, count=1)[:, 0] * count.astype(np.float32)).astype(int)
        self.target[mask] = np.minimum(chosen, count - 1)[mask]
        position, quat, velocity = self.start(batch, (self.target - 1) % count, self.target)
        batch.set_pose(position, quat, mask)
        batch.set_velocity(velocity, None, None, mask)
        self.distance[mask] = np.linalg.norm(self.centers[world, self.target] - batch.position, axis=1)[mask]

    def start(self, batch: flockstep.Batch, last: Array, following: Array) -> tuple[Array, Array, Array]:
        """Return positions, quaternions and velocities behind one gate, on the way to the next."""
        c, world = self.config, batch.world_index
        random = batch.random(stream=0, count=10).astype(float)
        even = 2 * random - 1
        is_between = c.start == "between"
        share = 0.9 * random[:, :1] * is_between
        way = self.centers[world, following] - self.centers[world, last]
        leaving = self.normals[world, last]
        direction = (1 - share) * leaving + share * way / np.linalg.norm(way, axis=1, keepdims=True)
        position = self.centers[world, last] + 0.3 * leaving + share * (way - 0.8 * self.normals[world, following])
        yaw = np.arctan2(direction[:, 1], direction[:, 0]) + np.radians(c.start_yaw_deg) * even[:, 4]
        roll, pitch = np.radians(c.start_tilt_deg) * even[:, 5:7].T
        quat = quat_from_rpy(np.stack([roll, pitch, yaw], axis=1))
        return (
            position + c.start_offset_m * even[:, 1:4],
            quat,
            c.start_speed_mps * even[:, 7:] * is_between,
        )

    def follow(self, batch: flockstep.Batch) -> tuple[Array, BoolArray]:
        """Follow the path of the step, tick by tick: return how many gates each drone passed, and if it missed one."""
        world, path = batch.world_index, batch.path.astype(float)
        count = self.num_gates[world]
        passed, missed = np.zeros(len(path), int), np.zeros(len(path), bool)
        for start, end in zip(path[:, :-1].swapaxes(0, 1), path[:, 1:].swapaxes(0, 1), strict=True):
            center, normal = self.centers[world, self.target], self.normals[world, self.target]
            before, after = (((point - center) * normal).sum(axis=1) for point in (start, end))
            crosses = self.flying & ~missed & (before < 0) & (after >= 0)
            share = np.where(crosses, before / np.where(crosses, before - after, 1), 0)
            crossing = start + share[:, None] * (end - start) - center
            across = rotate(self.quats[world, self.target], crossing, inverse=True)[:, 1:]
            half, is_ring = self.halves[world, self.target], self.is_ring[world, self.target]
            is_inside = np.where(is_ring, np.hypot(*across.T), np.abs(across).max(axis=1)) < half
            passes = crosses & is_inside
            missed |= crosses & ~is_inside & (np.linalg.norm(crossing, axis=1) <= self.config.miss_m)
            passed += passes
            self.target = np.where(passes, (self.target + 1) % count, self.target)
        self.passed += passed
        return passed, missed

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c, world = self.config, batch.world_index
        distance = np.linalg.norm(self.centers[world, self.target] - batch.position, axis=1)
        progress = np.minimum(self.distance - distance, self.speed_cap / self.clock.policy_hz)
        passed, missed = self.follow(batch)
        distance = np.linalg.norm(self.centers[world, self.target] - batch.position, axis=1)
        self.distance = np.where(self.flying, distance, self.distance)
        self.left_area[:] = distance > c.max_distance_m
        crashed = batch.contact.hit | missed | self.left_area
        lap = self.num_gates[world]
        self.success[:] = ~crashed & (self.passed >= c.laps * lap)
        ends = self.flying & (crashed | self.success | (self.steps >= self.max_episode_steps))
        is_clean = self.success | (~crashed & (self.passed >= lap))
        self.outcome = np.where(ends, np.where(is_clean, CLEAN, UNCLEAN), self.outcome)
        terms = {
            "progress": c.progress_weight * progress,
            "gate": c.gate_weight * passed,
            "rates": -c.rates_weight * np.linalg.norm(batch.angular_velocity, axis=1),
            "change": -c.change_weight * self.change(),
            "crash": -c.crash_weight * crashed,
        }
        return terms, crashed | self.success

    def observe(self, batch: flockstep.Batch) -> Array:
        scale, world = self.config.observation_scale, batch.world_index
        quat = batch.sensed_quat_wxyz.astype(float)
        columns = []
        for i in range(self.config.gates_ahead):
            gate = (self.target + i) % self.num_gates[world]
            columns.append(scale * rotate(quat, self.centers[world, gate] - batch.sensed_position, inverse=True))
            columns.append(rotate(quat, self.normals[world, gate], inverse=True))
        columns.append(scale * rotate(quat, batch.velocity, inverse=True))
        columns.append(rotate(quat, np.array([0.0, 0, 1]), inverse=True))
        return np.concatenate([*columns, scale * batch.angular_velocity, self.action], axis=1)


if __name__ == "__main__":
    race = flockstep.RaceConfig(start_offset_m=0.2)  # no start touches a frame
    fly_both(race, Race(race))
