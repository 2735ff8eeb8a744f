"""The engine's hover task written in NumPy: a template for your own flight tasks, and the engine's test oracle.

python examples/hover_numpy.py flies both side by side with the same actions and prints the differences.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.task import Array, BoolArray

SPIN_UNIT = 10.0  # rad/s: unit of angular velocity in observation and reward


class FlightTask(flockstep.Task):
    """The shared parts of hovering and tracking: actions, observation of the drone's motion, and the world's middle.

    The length of a step follows from `clock`: set it here or in a subclass, and do not pass its keywords to the env.
    """

    action_space = spaces.Box(-1, 1, (4,), np.float32)
    worlds = "arena/hall"
    drone = "crazyflie"
    clock: flockstep.ClockConfig
    max_thrust_to_weight: float | None = None  # of actions; None: what the rotors can deliver

    def setup(self, batch: flockstep.Batch) -> None:
        middle = [world.bounds.mean(axis=0) if world.goal is None else world.goal for world in batch.worlds]
        self.middles = np.array(middle, float)  # (W, 3) m
        self.action = np.zeros((batch.num_drones, 4), np.float32)
        self.last_action = self.action

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        self.action[mask] = 0  # reference of the first action change

    def act(self, batch: flockstep.Batch, actions: Array) -> Array:
        self.last_action, self.action = self.action, np.clip(actions, -1.0, 1.0)
        return batch.terms.command(self.action, max_thrust_to_weight=self.max_thrust_to_weight)

    def own_flight(self, batch: flockstep.Batch) -> Array:
        """Return velocity, the world's up and angular velocity in the body frame, and rotor speeds, (N, 13)."""
        terms, up = batch.terms, batch.sensed_rotation[:, 2]
        return np.concatenate(
            [terms.body_velocity(), up, batch.angular_velocity / SPIN_UNIT, terms.rotor_levels()], axis=1
        )

    def middle(self, batch: flockstep.Batch) -> Array:
        """Return the goal marker of each drone's world, or the centre of its bounds, (N, 3) m."""
        middle: Array = self.middles[batch.world_index]
        return middle

    def spin(self, batch: flockstep.Batch) -> Array:
        """Return the magnitude of the angular velocity, (N,) 10 rad/s."""
        spin: Array = np.linalg.norm(batch.angular_velocity, axis=1) / SPIN_UNIT
        return spin

    def change(self) -> Array:
        """Return the mean squared difference to the previous action, (N,)."""
        change: Array = np.mean((self.action - self.last_action) ** 2, axis=1)
        return change


class Hover(FlightTask):
    """Recover a thrown drone and hold it at a point; see `flockstep.HoverConfig` for the fields.

    The engine also redraws a start that would touch something; this task does not.
    """

    observation_space = spaces.Box(-np.inf, np.inf, (16,), np.float32)
    reward_terms = ("near", "hold", "speed", "spin", "change", "crash")
    max_episode_steps = 300
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="rotor_thrusts")
    clock = flockstep.ClockConfig(policy_hz=50)

    def __init__(self, config: flockstep.HoverConfig) -> None:
        self.config = config

    def setup(self, batch: flockstep.Batch) -> None:
        super().setup(batch)
        self.held = np.zeros(batch.num_drones, int)  # consecutive steps within hold_m

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)
        self.held[mask] = 0
        c, rows = self.config, batch.rows  # of the mask
        random = batch.random(stream=0, count=12, rows=rows).astype(float)
        even = 2 * random - 1
        tilt = random[:, 3] * np.radians(c.start_tilt_deg) / 2  # half-angle for the quaternion
        axis, yaw = 2 * np.pi * random[:, 4], np.pi * random[:, 5]
        quat = [  # rotated about the vertical, then by the tilt about a level axis
            np.cos(tilt) * np.cos(yaw),
            np.sin(tilt) * np.cos(axis - yaw),
            np.sin(tilt) * np.sin(axis - yaw),
            np.cos(tilt) * np.sin(yaw),
        ]
        position = self.middle(batch)[rows] + c.start_offset_m * even[:, :3]
        batch.set_pose(position, np.stack(quat, axis=1), rows=rows)
        speed, upward, heading = c.start_speed_mps * random[:, 6], even[:, 7], 2 * np.pi * random[:, 8]
        level = np.sqrt(1 - upward**2)
        direction = np.stack([level * np.cos(heading), level * np.sin(heading), upward], axis=1)
        rates = np.radians(c.start_rate_dps) * even[:, 9:]
        batch.set_velocity(speed[:, None] * direction, rates, rows=rows)

    def step(self, batch: flockstep.Batch) -> tuple[dict[str, Array], BoolArray]:
        c = self.config
        distance = np.linalg.norm(self.middle(batch) - batch.position, axis=1)
        self.left_area[:] = distance > c.max_distance_m
        crashed = batch.contact.hit | self.left_area
        self.held = np.where(distance <= c.hold_m, self.held + 1, 0)
        self.success[:] = ~crashed & (self.held >= max(round(c.hold_s * self.clock.policy_hz), 1))
        terms = {
            "near": c.near_weight * np.exp(-2 * distance),
            "hold": c.hold_weight / (1 + (distance / c.hold_m / 2) ** 2),
            "speed": -c.speed_weight * np.linalg.norm(batch.velocity, axis=1),
            "spin": -c.spin_weight * self.spin(batch),
            "change": -c.change_weight * self.change(),
            "crash": -c.crash_weight * crashed,
        }
        return terms, crashed

    def observe(self, batch: flockstep.Batch) -> Array:
        return np.concatenate([batch.terms.to_body(self.middle(batch)), self.own_flight(batch)], axis=1)


def fly_both(
    config: object,
    twin_task: flockstep.Task,
    num_envs: int = 64,
    actions_of: Callable[[Array], Array] | None = None,
    **keywords: Any,
) -> None:
    """Fly the engine's task and its twin with the same actions, random by default, and print their differences."""
    engine, twin = (flockstep.DroneVectorEnv(num_envs, task=task, **keywords) for task in (config, twin_task))
    engine.reset(seed=0)
    twin.reset(seed=0)
    engine.action_space.seed(0)
    worst_observation = worst_reward = 0.0
    episodes = 0
    for _ in range(1000):
        actions = actions_of(engine.batch.observation) if actions_of else engine.action_space.sample()
        engine.step(actions)
        twin.step(actions)
        a, b = engine.batch, twin.batch
        worst_observation = max(worst_observation, float(np.abs(a.observation - b.observation).max()))
        worst_reward = max(worst_reward, float(np.abs(a.reward - b.reward).max()))
        assert (a.terminated == b.terminated).all()
        assert (a.truncated == b.truncated).all()
        episodes += int((a.terminated | a.truncated).sum())
    print(
        f"{type(twin_task).__name__}: {1000 * engine.num_envs:,} steps, {episodes} episodes that end alike: "
        f"observations within {worst_observation:.1e}, rewards {worst_reward:.1e}"
    )


if __name__ == "__main__":
    hover = flockstep.HoverConfig()
    fly_both(hover, Hover(hover))
