"""Race by the corners of gates in images and an estimate of the flight, without a position."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from flockstep._core import GateDetector, ImuConfig, ObservationConfig, PoseSensorConfig
from flockstep.trainings.flyers import pursuit
from flockstep.trainings.flying import Flyer
from flockstep.trainings.training import Array, Keywords, Training
from flockstep.trainings.varied import RACED
from flockstep.vector_env import DroneVectorEnv

DETECTOR = GateDetector(hfov_deg=120.0, tilt_deg=20.0, max_range_m=20.0, noise_std_px=2.0, dropout=0.05)
ESTIMATE = PoseSensorConfig(
    position_noise_std_m=0.005,
    orientation_noise_std_deg=0.2,
    velocity_noise_std_mps=0.03,
    position_random_walk=0.02,
    yaw_random_walk=0.1,
)
"""As of visual-inertial odometry."""
SENSED: Keywords = {
    "pose_sensor": ESTIMATE,
    "imu": ImuConfig.preset("bmi088"),
    "observed": ObservationConfig(history=3, past_actions=2, delay_s=0.02),
}
"""What is observed besides the corners. All of it is late."""
KEPT = 0.7
"""Share of what the flyer knew of a gate that an image does not replace."""


def seen(start: Literal["between", "gate"]) -> Keywords:
    """Return the keywords of a race by corners with these starts."""
    task = copy(RACED)
    task.start, task.gate_detector = start, DETECTOR
    return {"task": task, **SENSED}


def row(race: Training) -> Training:
    """Return the row of a race by corners, from the row of the race."""
    return replace(
        race,
        steps=20_000_000,
        learns=lambda: {**race.learns(), **seen("between")},
        judged=lambda flights, seed: {
            kind: {**keywords, **seen("gate")} for kind, keywords in race.judged(flights, seed).items()
        },
        baselines={"controller": [ByCorners(pursuit(speed).act) for speed in (4.0, 4.5, 5.0, 5.5)]},
        film={**race.film, **seen("gate")},
        bench=("race_by_corners", "trained", 5),
    )


class ByCorners(Flyer):
    """Flies Race by corners as a flyer that observes where the gates are."""

    def in_envs(self, envs: DroneVectorEnv) -> Callable[[Array], Array]:
        """Return the function from observations to actions in these environments."""
        gates = Gates(envs)
        return lambda observation: self.act(gates.observed(observation), envs)


class Gates:
    """Offsets and directions of the next gates, from their corners; between images the estimated flight moves them."""

    def __init__(self, envs: DroneVectorEnv) -> None:
        task: Any = envs.task
        self.envs, self.scale, self.ahead = envs, task.observation_scale, task.gates_ahead
        gates = envs.batch.worlds[0].gates
        self.side_m = np.array([gate["size_m"] / (2**0.5 if gate["shape"] == "ring" else 1) for gate in gates])
        self.target = np.full(envs.num_envs, -1)
        self.offset, self.normal = np.zeros((2, envs.num_envs, self.ahead, 3))
        self.offset[..., 0], self.normal[..., 0] = 5.0, 1.0
        self.kept = np.zeros((envs.num_envs, self.ahead))  # 0 for a gate that was never seen

    def observed(self, observation: Array) -> Array:
        """Return what Race would observe without a detector."""
        n, corners = len(observation), 12 * self.ahead
        own = observation[:, corners : corners + 13]
        velocity, rates = (own[:, None, i : i + 3] / self.scale for i in (0, 6))
        step_s = 1 / self.envs.batch.clock.policy_hz
        self.offset -= step_s * (velocity + np.cross(rates, self.offset))
        self.normal -= step_s * np.cross(rates, self.normal)
        target = self.envs.batch.task_state["target"]
        passed = (self.target >= 0) & (target != self.target)
        for known in (self.offset, self.normal, self.kept):
            known[passed, :-1] = known[passed, 1:]
        self.kept[passed, -1] = 0.0
        self.target = target.copy()
        rays = observation[:, :corners].reshape(n, self.ahead, 4, 3).astype(float)
        side_m = self.side_m[(target[:, None] + np.arange(self.ahead)) % len(self.side_m)]
        found = (np.linalg.norm(rays, axis=3) > 0.5).all(axis=2)
        offset, normal, found[found] = located(rays[found], side_m[found])
        kept = self.kept[found][:, None]
        for known, new in ((self.offset, offset), (self.normal, normal)):
            known[found] = kept * known[found] + (1 - kept) * new
        self.kept[found] = KEPT
        self.normal /= np.linalg.norm(self.normal, axis=2, keepdims=True)
        gates = np.concatenate([self.scale * self.offset, self.normal], axis=2).reshape(n, -1)
        return np.concatenate([gates, own], axis=1)


def located(rays: Array, side_m: Array) -> tuple[Array, Array, Array]:
    """Return offsets and normals of the squares whose corners are seen along rays (N, 4, 3), and which rows are valid.

    Opposite sides of a square are equal vectors, which gives the distances of the corners up to a factor.
    """
    lengths = np.ones(rays.shape[:2])
    sides = np.stack([rays[:, 0], -rays[:, 1], rays[:, 2]], axis=2)
    lengths[:, :3] = (np.linalg.pinv(sides) @ rays[:, 3, :, None])[:, :, 0]
    corners = lengths[:, :, None] * rays
    corners *= (side_m / np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).mean(axis=1))[:, None, None]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    valid: Array = np.asarray(lengths.min(axis=1) > 0)
    return corners.mean(axis=1)[valid], normal[valid], valid
