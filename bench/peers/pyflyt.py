"""PyFlyt, on Bullet."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from PyFlyt.core import Aviary
from PyFlyt.gym_envs.quadx_envs.quadx_hover_env import QuadXHoverEnv

from peers import rate
from peers.cases import Flown, Quadrotor


def fly(case: Quadrotor) -> Flown:
    found = Flown(version("PyFlyt"))
    many = 64
    places = np.stack([np.arange(many) * 2.0, np.zeros(many), np.full(many, 5.0)], axis=1)
    flock = Aviary(places, np.zeros((many, 3)), drone_type="quadx", drone_options={"control_hz": 120})
    flock.set_mode(0)
    flock.set_all_setpoints(np.tile([0.0, 0.0, 0.0, 0.4], (many, 1)))
    ticks = flock.physics_hz // 120  # per step, which is one controller step
    found.simulator["Bullet, 4.2 ms, body rates, 64 drones"] = rate(flock.step, round(ticks) * many)
    env = QuadXHoverEnv(agent_hz=120)  # it does not support 100 Hz
    env.reset(seed=0)
    action = np.array([0.0, 0.0, 0.0, 0.4])

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    found.environment["hover, body rates, 2 ticks of 4.2 ms"] = rate(step, 1)
    return found
