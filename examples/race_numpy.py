"""The engine's race task written in NumPy: a template for your own races, and the engine's test oracle.

The shared parts are in hover_numpy.py. python examples/race_numpy.py flies the engine's task and this one side by side
with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep import EpisodeEnd
from flockstep.rotations import quat_from_rpy, rotate
from flockstep.task import Array, BoolArray
from hover_numpy import FlightTask, fly_both


class Race(FlightTask):
    """Fly through the gates of a track; see `flockstep.RaceConfig` for the fields.

    The engine also redraws a start that would touch something; this task does not.
    """

    reward_terms = ("progress", "gate", "rates", "change", "crash")
    max_episode_steps = 350
    worlds = "race/figure-8"
    drone = "racer5"
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates", max_rate_dps=460, max_yaw_rate_dps=230)
    clock = flockstep.ClockConfig(policy_hz=50)
    records_path = True

    def __init__(self, config: flockstep.RaceConfig) -> None:
        self.config = config
        self.max_thrust_to_weight = config.max_thrust_to_weight
        self.observation_space = spaces.Box(-np.inf, np.inf, (13 + 6 * config.gates_ahead,), np.float32)

    def setup(self, batch: flockstep.Batch) -> None:
        super().setup(batch)
        self.num_gates = np.array([len(world.gates) for world in batch.worlds])
        shape = len(batch.worlds), self.num_gates.max()
        self.centers, self.normals = np.zeros((2, *shape, 3))
        for i, world in enumerate(batch.worlds):
            for k, gate in enumerate(world.gates):
                self.centers[i, k] = gate["center"]
                self.normals[i, k] = rotate(np.array(gate["quat_wxyz"]), np.array([1.0, 0, 0]))
        n = batch.num_drones
        self.target, self.passed = np.zeros((2, n), int)
        self.distance = np.zeros(n)  # m, to the next gate
        self.speed_cap = np.full(n, float(self.config.speed_cap_mps[0]))
        self.clean = np.zeros((n, self.config.cap_episodes), bool)  # the last episodes, the latest first

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        rows = batch.rows  # of the mask
        self.passed[rows] = 0
        world = batch.world_index[rows]
        count = self.num_gates[world]
        chosen = (batch.random(stream=1, count=1, rows=rows)[:, 0] * count.astype(np.float32)).astype(int)
        target = self.target[rows] = np.minimum(chosen, count - 1)
        position, quat, velocity = self.start(batch, rows, (target - 1) % count, target)
        batch.set_pose(position, quat, rows=rows)
        batch.set_velocity(velocity, rows=rows)
        self.distance[rows] = np.linalg.norm(self.centers[world, target] - batch.position[rows], axis=1)

    def start(self, batch: flockstep.Batch, rows: Array, last: Array, following: Array) -> tuple[Array, Array, Array]:
        """Return positions, quaternions and velocities behind one gate, on the way to the next."""
        c, world = self.config, batch.world_index[rows]
        random = batch.random(stream=0, count=10, rows=rows).astype(float)
        even = 2 * random - 1
        is_between = c.start == "between"
        share = 0.9 * np.maximum(0, 2 * random[:, :1] - 1) * is_between
        way = self.centers[world, following] - self.centers[world, last]
        leaving = self.normals[world, last]
        direction = (1 - share) * leaving + share * way / np.linalg.norm(way, axis=1, keepdims=True)
        behind = (1 - share) * (0.3 + c.start_offset_m * np.abs(leaving).sum(axis=1, keepdims=True))
        to_next = share * (way - 0.8 * self.normals[world, following])
        position = self.centers[world, last] + behind * leaving + to_next
        yaw = np.arctan2(direction[:, 1], direction[:, 0]) + np.radians(c.start_yaw_deg) * even[:, 4]
        roll, pitch = np.radians(c.start_tilt_deg) * even[:, 5:7].T
        quat = quat_from_rpy(np.stack([roll, pitch, yaw], axis=1))
        return (
            position + c.start_offset_m * even[:, 1:4],
            quat,
            c.start_speed_mps * even[:, 7:] * is_between,
        )

    def curriculum(self, batch: flockstep.Batch, rows: Array) -> None:
        """Raise the cap on the rewarded speed of drones of which enough last episodes were clean."""
        c, end = self.config, batch.episode_end
        rows = rows[end[rows] != EpisodeEnd.bad_state]
        has_half_lap = 2 * self.passed[rows] >= self.num_gates[batch.world_index[rows]]
        is_clean = (end[rows] == EpisodeEnd.success) | ((end[rows] == EpisodeEnd.time) & has_half_lap)
        self.clean[rows] = np.column_stack([is_clean, self.clean[rows, :-1]])
        rises = rows[self.clean[rows].mean(axis=1, dtype=np.float32) >= np.float32(c.cap_success)]
        self.speed_cap[rises] = np.minimum(self.speed_cap[rises] + c.cap_rise_mps, c.speed_cap_mps[1])

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c, world = self.config, batch.world_index
        distance = np.linalg.norm(self.centers[world, self.target] - batch.position, axis=1)
        progress = np.minimum(self.distance - distance, self.speed_cap / self.clock.policy_hz)
        passed, missed = batch.terms.crossed(self.target, miss_m=c.miss_m)
        lap = self.num_gates[world]
        self.target = (self.target + passed) % lap
        self.passed += passed
        distance = np.linalg.norm(self.centers[world, self.target] - batch.position, axis=1)
        self.distance = np.where(self.flying, distance, self.distance)
        self.left_area[:] = distance > c.max_distance_m
        crashed = batch.contact.hit | missed | self.left_area
        self.success[:] = ~crashed & (self.passed >= c.laps * lap)
        terms = {
            "progress": c.progress_weight * progress,
            "gate": c.gate_weight * passed,
            "rates": -c.rates_weight * np.linalg.norm(batch.angular_velocity, axis=1),
            "change": -c.change_weight * self.change(),
            "crash": -c.crash_weight * crashed,
        }
        return terms, crashed | self.success

    def observe(self, batch: flockstep.Batch) -> Array:
        scale, world, terms = self.config.observation_scale, batch.world_index[:, None], batch.terms
        ahead = (self.target[:, None] + np.arange(self.config.gates_ahead)) % self.num_gates[world]
        offsets = scale * terms.to_body(self.centers[world, ahead])
        gates = np.concatenate([offsets, terms.rotate_to_body(self.normals[world, ahead])], axis=2)
        flight = [
            scale * terms.body_velocity(),
            batch.sensed_rotation[:, 2],
            scale * batch.angular_velocity,
            self.action,
        ]
        return np.concatenate([gates.reshape(batch.num_drones, -1), *flight], axis=1)


if __name__ == "__main__":
    race = flockstep.RaceConfig(start_offset_m=0.2)  # no start touches a frame
    fly_both(race, Race(race))
